"""Cells of VTK under other names: voxels, pixels, polygons, Lagrange cells; and what is left out.

meshio leaves voxels out with a warning, as all cells it does not know, and gives polygons and
Lagrange cells names of their own. Source: VTK file formats, cell types; vtkVoxel, vtkPixel,
vtkLagrangeTetra.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from flexmb.errors import MeshError

_VOXEL = 11
_LEFT_OUT = re.compile(r"cells\s+that\s+meshio\s+cannot\s+handle\s+\(type\s+(\d+)\)")
_DRAWN = {4: "polylines", 6: "triangle strips"}  # how surfaces and lines are drawn
_POINTS = 2
_ORDER = {  # kind and order of nodes by VTK's name and number of nodes
    ("voxel", 8): ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6]),
    ("pixel", 4): ("quad", [0, 1, 3, 2]),
    ("polygon", 3): ("triangle", [0, 1, 2]),
    ("polygon", 4): ("quad", [0, 1, 2, 3]),
    ("VTK_LAGRANGE_CURVE", 2): ("line", [0, 1]),
    ("VTK_LAGRANGE_CURVE", 3): ("line3", [0, 1, 2]),
    ("VTK_LAGRANGE_TRIANGLE", 3): ("triangle", [*range(3)]),
    ("VTK_LAGRANGE_TRIANGLE", 6): ("triangle6", [*range(6)]),
    ("VTK_LAGRANGE_QUADRILATERAL", 4): ("quad", [*range(4)]),
    ("VTK_LAGRANGE_TETRAHEDRON", 4): ("tetra", [*range(4)]),
    ("VTK_LAGRANGE_TETRAHEDRON", 10): ("tetra10", [*range(10)]),
    ("VTK_LAGRANGE_HEXAHEDRON", 8): ("hexahedron", [*range(8)]),
}


def teach_meshio() -> None:
    """Let meshio read voxels and pixels, and the types of numbers that VTK 9 writes."""
    from meshio import _common, _mesh, _vtk_common
    from meshio.vtk import _vtk_51

    _vtk_common.vtk_to_meshio_type.setdefault(_VOXEL, "voxel")
    for name, (count, dimension) in {"voxel": (8, 3), "pixel": (4, 2)}.items():
        _common.num_nodes_per_cell.setdefault(name, count)
        _mesh.topological_dimension.setdefault(name, dimension)
    for word, kind in {
        "long": "int64",
        "unsigned_long": "uint64",
        "unsigned_int": "uint32",
    }.items():
        _vtk_51.vtk_to_numpy_dtype_name.setdefault(word, kind)


def rename_cells(raw: Any) -> None:
    """Give the cells of a mesh of meshio the names and the order that flexmb knows.

    Raises
    ------
    MeshError
        Polygons of more corners.
    """
    import meshio

    for k, block in enumerate(raw.cells):
        key = (block.type, np.shape(block.data)[-1])
        if key in _ORDER:
            kind, order = _ORDER[key]
            raw.cells[k] = meshio.CellBlock(kind, np.asarray(block.data)[:, order])
        elif block.type == "polygon":
            what = f"the mesh file has polygons of {key[1]} corners, which are not read"
            raise MeshError(f"{what}: write triangles and quadrilaterals")


def cells_left_out(words: str) -> str:
    """A note on cells that meshio left out, from what it printed.

    Raises
    ------
    MeshError
        They may be elements of the body.
    """
    types = sorted({int(number) for number in _LEFT_OUT.findall(words)} - {_POINTS})
    others = [number for number in types if number not in _DRAWN]
    if others:
        what = f"the mesh file has cells of VTK's type {', '.join(map(str, others))}, which are not"
        raise MeshError(f"{what} read: write linear or quadratic cells")
    names = " and ".join(_DRAWN[number] for number in types)
    return f"the mesh file also has {names}, which are no elements and left out" if names else ""
