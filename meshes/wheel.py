"""Make wheel.msh: a turbine-like wheel with nine blades, second-order tetrahedra, in millimetres.

Run ``python meshes/wheel.py`` (needs the package gmsh). A hub around the z axis, bored for a shaft,
carries flat blades, staggered about their radial axes. Physical groups: the surface ``bore``, the
volume ``wheel``.
"""

from __future__ import annotations

import math
from pathlib import Path

import gmsh
from gmsh_file import make

HUB = {"bore": 15.0, "radius": 40.0, "width": 20.0}  # radii and width along z, mm
BLADES = 9
BLADE = {"length": 50.0, "wide": 18.0, "thick": 3.0}  # mm beyond the hub, chord, thickness
STAGGER = 35.0  # degrees of the chord from the z axis
SIZE = 9.0  # element size, mm


def main(path: Path) -> None:
    """Build the geometry, mesh it and write the file."""
    make(path, lambda: name_groups(build()), MeshSizeMax=SIZE, HighOrderOptimize=1)


def build() -> int:
    """The solid; returns its tag."""
    occ, width = gmsh.model.occ, HUB["width"]
    hub = (3, occ.addCylinder(0, 0, -width / 2, 0, 0, width, HUB["radius"]))
    blades = []
    for k in range(BLADES):
        inside = 8.0  # mm of the blade within the hub
        start = HUB["radius"] - inside
        size = (BLADE["length"] + inside, BLADE["thick"], BLADE["wide"])
        blade = (3, occ.addBox(start, -size[1] / 2, -size[2] / 2, *size))
        occ.rotate([blade], 0, 0, 0, 1, 0, 0, math.radians(STAGGER))
        occ.rotate([blade], 0, 0, 0, 0, 0, 1, 2 * math.pi * k / BLADES)
        blades.append(blade)
    body = occ.fuse([hub], blades)[0]
    bore = (3, occ.addCylinder(0, 0, -width, 0, 0, 2 * width, HUB["bore"]))
    body = occ.cut(body, [bore])[0]
    occ.synchronize()
    return body[0][1]


def name_groups(volume: int) -> None:
    """The physical groups: the bore is the round face within the hub."""
    found = []
    for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
        x0, y0, _, x1, y1, _ = gmsh.model.getBoundingBox(2, face)
        if max(-x0, -y0, x1, y1) < HUB["bore"] + 0.1:
            found.append(face)
    gmsh.model.addPhysicalGroup(2, found, name="bore")
    gmsh.model.addPhysicalGroup(3, [volume], name="wheel")


if __name__ == "__main__":
    main(Path(__file__).with_suffix(".msh"))
