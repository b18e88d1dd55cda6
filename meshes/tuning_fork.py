"""Make tuning_fork.msh: a steel tuning fork for A4, second-order tetrahedra, in millimetres.

Run ``python meshes/tuning_fork.py`` (needs the package gmsh). Two square-edged prongs along +x
beside each other in y, on a solid base; a round stem along -x. Physical groups: the surface
``stem_end``, the volume ``fork``.
"""

from __future__ import annotations

from pathlib import Path

import gmsh
from gmsh_file import make

PRONG = {"length": 103.6, "thick": 6.0, "wide": 10.0}  # mm along x, y, z
GAP = 12.0  # mm between the prongs
BASE = 24.0  # mm, length of the solid base along x
STEM = {"radius": 4.0, "length": 45.0}
SIZE = 6.0  # element size, mm


def main(path: Path) -> None:
    """Build the geometry, mesh it and write the file."""
    make(path, lambda: name_groups(build()), MeshSizeMax=SIZE, MeshSizeFromCurvature=12)


def build() -> int:
    """The solid; returns its tag."""
    occ, wide = gmsh.model.occ, PRONG["wide"]
    width = GAP + 2 * PRONG["thick"]
    parts = [(3, occ.addBox(-BASE, -width / 2, -wide / 2, BASE, width, wide))]
    for y in (-width / 2, GAP / 2):
        size = (PRONG["length"], PRONG["thick"], wide)
        parts.append((3, occ.addBox(0, y, -wide / 2, *size)))
    stem = occ.addCylinder(-BASE, 0, 0, -STEM["length"], 0, 0, STEM["radius"])
    body = occ.fuse(parts[:1], [*parts[1:], (3, stem)])[0][0][1]
    occ.synchronize()
    return body


def name_groups(volume: int) -> None:
    """The physical groups."""
    end = -BASE - STEM["length"]
    faces = gmsh.model.getBoundary([(3, volume)], oriented=False)
    at_end = [tag for _, tag in faces if gmsh.model.getBoundingBox(2, tag)[3] < end + 0.1]
    gmsh.model.addPhysicalGroup(2, at_end, name="stem_end")
    gmsh.model.addPhysicalGroup(3, [volume], name="fork")


if __name__ == "__main__":
    main(Path(__file__).with_suffix(".msh"))
