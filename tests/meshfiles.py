"""Small mesh files: a box of second-order tetrahedra with named faces, as gmsh writes it."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
from femeshes import block


def write_box(path: Path, *, solid: bool = True, size: tuple[float, ...] = (1.0, 0.1, 0.1)) -> Path:
    """A box with the groups `left` and `right`, and `body` if it is `solid`."""
    box = block((3, 1, 1), size)
    faces = box.blocks["triangle6"]
    cells = [("triangle6", faces[box.element_sets[k]["triangle6"]]) for k in ("x0", "x1")]
    groups = {"left": (1, 2), "right": (2, 2)}
    if solid:
        cells.append(("tetra10", box.blocks["tetra10"]))
        groups["body"] = (3, 3)
    tags = [np.full(len(data), k + 1) for k, (_, data) in enumerate(cells)]
    mesh = meshio.Mesh(
        box.points, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags}
    )
    mesh.field_data = {name: np.array(value) for name, value in groups.items()}
    meshio.write(path, mesh, file_format="gmsh22")
    return path
