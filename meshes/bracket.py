"""Make bracket.msh: an angle bracket with bolt holes, second-order tetrahedra, in millimetres.

Run ``python meshes/bracket.py`` (needs the package gmsh). A foot in the xy plane with two holes
for bolts along z, an upright wall along x = 0 with a bore along x for a bearing, a gusset between
them in the xz plane. Physical groups: surfaces ``bolt1``, ``bolt2`` and ``bore``, volume
``bracket``.
"""

from __future__ import annotations

from pathlib import Path

import gmsh
from gmsh_file import make

FOOT = (80.0, 70.0, 8.0)  # mm along x, y, z; the wall stands at its end x = 0
WALL = (8.0, 70.0, 90.0)
GUSSET = (38.0, 6.0)  # mm: length of its legs, thickness
BOLT = {"x": 60.0, "y": 24.0, "radius": 5.0}  # two holes, at plus and minus y
BORE = {"z": 62.0, "radius": 15.0}
FILLET = 5.0  # mm, where foot and wall meet
SIZE = 8.0  # element size, mm


def main(path: Path) -> None:
    """Build the geometry, mesh it and write the file."""
    make(
        path,
        lambda: name_groups(build()),
        MeshSizeMax=SIZE,
        MeshSizeFromCurvature=10,
        HighOrderOptimize=1,
    )


def build() -> int:
    """The solid; returns its tag."""
    occ = gmsh.model.occ
    foot = (3, occ.addBox(0, -FOOT[1] / 2, 0, *FOOT))
    wall = (3, occ.addBox(0, -WALL[1] / 2, 0, *WALL))
    angle = occ.fuse([foot], [wall])[0]
    occ.synchronize()
    angle = occ.fillet([angle[0][1]], [inner_edge(angle[0][1])], [FILLET])
    body = occ.fuse(angle, [(3, gusset())])[0]
    holes = [
        (3, occ.addCylinder(BOLT["x"], y, -1, 0, 0, FOOT[2] + 2, BOLT["radius"]))
        for y in (-BOLT["y"], BOLT["y"])
    ]
    holes.append((3, occ.addCylinder(-1, 0, BORE["z"], WALL[0] + 2, 0, 0, BORE["radius"])))
    body = occ.cut(body, holes)[0]
    occ.synchronize()
    return body[0][1]


def inner_edge(volume: int) -> int:
    """The edge where foot and wall meet inside."""
    for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
        for _, edge in gmsh.model.getBoundary([(2, face)], oriented=False):
            x0, _, z0, x1, _, z1 = gmsh.model.getBoundingBox(1, edge)
            at = (x0 + x1) / 2 - WALL[0], (z0 + z1) / 2 - FOOT[2]
            if max(abs(at[0]), abs(at[1]), x1 - x0, z1 - z0) < 0.1:
                return edge
    raise RuntimeError("foot and wall do not meet")


def gusset() -> int:
    """The triangle between foot and wall; returns its tag."""
    occ, (leg, thick) = gmsh.model.occ, GUSSET
    x, z = WALL[0] - 1, FOOT[2] - 1
    corners = [(x, z), (x + leg, z), (x, z + leg)]
    points = [occ.addPoint(px, -thick / 2, pz) for px, pz in corners]
    lines = [occ.addLine(points[k], points[(k + 1) % 3]) for k in range(3)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return next(tag for dim, tag in occ.extrude([(2, face)], 0, thick, 0) if dim == 3)


def name_groups(volume: int) -> None:
    """The physical groups: cylindrical faces by the middle of their box."""
    centers = {
        "bolt1": (BOLT["x"], -BOLT["y"], FOOT[2] / 2),
        "bolt2": (BOLT["x"], BOLT["y"], FOOT[2] / 2),
        "bore": (WALL[0] / 2, 0.0, BORE["z"]),
    }
    found: dict[str, list[int]] = {name: [] for name in centers}
    for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
        if gmsh.model.getType(2, face) != "Cylinder":
            continue
        box = gmsh.model.getBoundingBox(2, face)
        middle = [(box[k] + box[k + 3]) / 2 for k in range(3)]
        for name, center in centers.items():
            if max(abs(a - b) for a, b in zip(middle, center, strict=True)) < 0.1:
                found[name].append(face)
    for name, faces in found.items():
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    gmsh.model.addPhysicalGroup(3, [volume], name="bracket")


if __name__ == "__main__":
    main(Path(__file__).with_suffix(".msh"))
