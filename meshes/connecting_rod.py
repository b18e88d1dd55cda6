"""Make connecting_rod.msh: a steel connecting rod, second-order tetrahedra, in millimetres.

Run ``python meshes/connecting_rod.py`` (needs the package gmsh). Two bored eyes, 450 mm apart along
+x, are joined by a tapering shank; the big-end bore is centred at the origin, its axis is z, and
z = 0 is the mid-plane. Physical groups: surfaces ``bore_big`` and ``bore_small``, volume ``rod``.
"""

from __future__ import annotations

import math
from pathlib import Path

import gmsh
from gmsh_file import write

LENGTH = 450.0  # mm between the bore axes
BIG = {"bore": 32.0, "outer": 48.0, "width": 36.0}  # radii and width along z, mm
SMALL = {"bore": 17.0, "outer": 28.0, "width": 36.0}
SHANK_HEIGHT = (34.0, 26.0)  # mm at the big and at the small end
SHANK_WIDTH = 18.0  # mm along z
FILLET = 16.0  # mm, where the shank meets the eyes
SIZE_SHANK, SIZE_BORE = 12.0, 10.0  # element sizes, mm


def main(path: Path) -> None:
    """Build the geometry, mesh it and write the file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("connecting_rod")
    volume = build()
    name_groups(volume)
    mesh()
    for x, eye in ((0.0, BIG), (LENGTH, SMALL)):
        place_bore_nodes(bore_faces(volume, x, eye["bore"]), x, eye)
    write(path)


def build() -> int:
    """The solid; returns its tag."""
    occ = gmsh.model.occ
    body = shank()
    for x, eye in ((0.0, BIG), (LENGTH, SMALL)):
        disc = occ.addCylinder(x, 0, -eye["width"] / 2, 0, 0, eye["width"], eye["outer"])
        body = occ.fuse([(3, body)], [(3, disc)])[0][0][1]
    occ.synchronize()
    body = occ.fillet([body], corners(body), [FILLET])[0][1]
    for x, eye in ((0.0, BIG), (LENGTH, SMALL)):
        hole = (x, 0, -eye["width"], 0, 0, 2 * eye["width"], eye["bore"])
        halves = [(3, occ.addCylinder(*hole, angle=math.pi)) for _ in range(2)]
        occ.rotate(halves[1:], x, 0, 0, 0, 0, 1, math.pi)
        body = occ.cut([(3, body)], halves)[0][0][1]
    occ.synchronize()
    return body


def shank() -> int:
    """The tapering bar between the bore axes; returns its tag."""
    occ = gmsh.model.occ
    big, small, z = SHANK_HEIGHT[0] / 2, SHANK_HEIGHT[1] / 2, -SHANK_WIDTH / 2
    corner = [(0, -big), (LENGTH, -small), (LENGTH, small), (0, big)]
    points = [occ.addPoint(x, y, z) for x, y in corner]
    lines = [occ.addLine(points[k], points[(k + 1) % 4]) for k in range(4)]
    face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    return next(tag for dim, tag in occ.extrude([(2, face)], 0, 0, SHANK_WIDTH) if dim == 3)


def corners(volume: int) -> list[int]:
    """Edges along z where the shank meets an eye."""
    found = []
    for _, edge in gmsh.model.getBoundary([(3, volume)], recursive=False, combined=False):
        for _, curve in gmsh.model.getBoundary([(2, edge)], oriented=False):
            x0, y0, z0, x1, y1, z1 = gmsh.model.getBoundingBox(1, curve)
            upright = x1 - x0 < 0.1 and y1 - y0 < 0.1 and abs(z1 - z0 - SHANK_WIDTH) < 0.1
            if upright and curve not in found:
                found.append(curve)
    return found


def name_groups(volume: int) -> None:
    """Name the bores and the volume."""
    for name, x, eye in (("bore_big", 0.0, BIG), ("bore_small", LENGTH, SMALL)):
        tags = bore_faces(volume, x, eye["bore"])
        gmsh.model.addPhysicalGroup(2, tags, name=name)
        rule_bore(tags, eye["bore"])
    gmsh.model.addPhysicalGroup(3, [volume], name="rod")


def rule_bore(faces: list[int], radius: float) -> None:
    """Even divisions around and along a bore, so that its area centroid lies on its axis."""
    for face in faces:
        for _, curve in gmsh.model.getBoundary([(2, face)], oriented=False):
            _, _, z0, _, _, z1 = gmsh.model.getBoundingBox(1, curve)
            around, along = divisions(radius)
            count = around if z1 - z0 < 1.0 else along
            gmsh.model.mesh.setTransfiniteCurve(curve, count + 1)
        gmsh.model.mesh.setTransfiniteSurface(face)


def divisions(radius: float) -> tuple[int, int]:
    """Elements along half the circumference of a bore, and along its axis."""
    return round(math.pi * radius / SIZE_BORE), round(BIG["width"] / SIZE_BORE)


def place_bore_nodes(faces: list[int], x: float, eye: dict[str, float]) -> None:
    """Move the nodes of a bore to exact places: the mesher leaves them off by 1e-6 mm."""
    around, along = divisions(eye["bore"])
    angle, height = math.pi / (2 * around), eye["width"] / (2 * along)
    for face in faces:
        tags, coordinates, _ = gmsh.model.mesh.getNodes(2, face, includeBoundary=True)
        for tag, (px, py, pz) in zip(tags, coordinates.reshape(-1, 3), strict=True):
            turn = angle * round(math.atan2(py, px - x) / angle)
            place = [x + eye["bore"] * math.cos(turn), eye["bore"] * math.sin(turn)]
            gmsh.model.mesh.setNode(tag, [*place, height * round(pz / height)], [])


def bore_faces(volume: int, x: float, radius: float) -> list[int]:
    """Faces that lie within the bounding square of a bore."""
    found = []
    for _, face in gmsh.model.getBoundary([(3, volume)], oriented=False):
        x0, y0, _, x1, y1, _ = gmsh.model.getBoundingBox(2, face)
        if max(x - x0, x1 - x, -y0, y1) < 1.01 * radius:
            found.append(face)
    return found


def mesh() -> None:
    """Second-order tetrahedra, a little finer at the eyes."""
    field = gmsh.model.mesh.field
    field.add("MathEval", 1)
    ends = f"Min(sqrt(x*x+y*y)/{2 * BIG['outer']}, sqrt((x-{LENGTH})^2+y*y)/{2 * SMALL['outer']})"
    field.setString(1, "F", f"{SIZE_BORE}+({SIZE_SHANK}-{SIZE_BORE})*Min(1,{ends})")
    field.setAsBackgroundMesh(1)
    for name in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
        gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.optimize("Netgen")
    gmsh.model.mesh.setOrder(2)
    gmsh.model.mesh.optimize("HighOrder")


if __name__ == "__main__":
    main(Path(__file__).with_suffix(".msh"))
