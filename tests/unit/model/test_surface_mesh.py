"""Surfaces from files have the mass properties of what they enclose, by closed forms."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.surface_mesh import (
    enclosed,
    open_edges,
    pack_surface,
    read_surface,
    unpack_surface,
)

# a box 1 x 2 x 3 from (1, 0, 0) on
CORNERS = np.array([[x, y, z] for x in (1, 2) for y in (0, 2) for z in (0, 3)], dtype=float)
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def write_text_stl(path: Path, faces: np.ndarray = FACES) -> Path:
    lines = ["solid box"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex " + " ".join(str(x) for x in CORNERS[k]) for k in face]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid box"]))
    return path


def write_binary_stl(path: Path) -> Path:
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *CORNERS[face].ravel(), 0) for face in FACES)
    path.write_bytes(b"solid but binary".ljust(80) + struct.pack("<I", len(FACES)) + body)
    return path


def write_vtu(path: Path, **options) -> Path:
    meshio = pytest.importorskip("meshio")
    brick = [0, 4, 6, 2, 1, 5, 7, 3]
    meshio.Mesh(CORNERS, [("hexahedron", [brick])]).write(path, **options)
    return path


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("text.stl", write_text_stl),
        ("binary.stl", write_binary_stl),
        ("zlib.vtu", write_vtu),
        ("plain.vtu", lambda path: write_vtu(path, compression=None)),
        ("text.vtu", lambda path: write_vtu(path, binary=False)),
    ],
)
def test_every_file_encloses_the_box(tmp_path: Path, name: str, write) -> None:
    points, faces = read_surface(write(tmp_path / name))
    assert len(points) == 8
    assert open_edges(faces) == 0
    volume, center, second = enclosed(points, faces)
    assert volume == pytest.approx(6.0, rel=1e-6)
    np.testing.assert_allclose(center, [1.5, 1.0, 1.5], rtol=1e-6)
    np.testing.assert_allclose(second, np.diag([1, 4, 9]) / 12, atol=1e-6)


def test_a_surface_far_away_and_inside_out_encloses_the_same() -> None:
    volume, center, second = enclosed(CORNERS + 1e4, FACES[:, ::-1])
    assert volume == pytest.approx(6.0, rel=1e-9)
    np.testing.assert_allclose(center - 1e4, [1.5, 1.0, 1.5], rtol=1e-9)
    np.testing.assert_allclose(second, np.diag([1, 4, 9]) / 12, atol=1e-9)


def test_packing_keeps_a_surface() -> None:
    points, faces = unpack_surface(pack_surface(CORNERS, FACES))
    np.testing.assert_array_equal(points, CORNERS)
    np.testing.assert_array_equal(faces, FACES)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.stl", b"nonsense", "no STL"),
        ("a.stl", b"solid x\nvertex 0 0 0\n", "lacks a corner"),
        ("a.stl", b"solid x\nendsolid", "no triangles"),
        ("a.obj", b"v 0 0 0", "no .stl or .vtu"),
        ("a.vtu", b"<VTKFile", "damaged"),
        ("a.vtu", b"<VTKFile/>", "no unstructured grid"),
        ("a.vtu", b'<!DOCTYPE a [<!ENTITY b "c">]><VTKFile/>', "entities"),
        ("a.vtu", b"<VTKFile><AppendedData/></VTKFile>", "appended"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(SceneError, match=words):
        read_surface(tmp_path / name)
    with pytest.raises(SceneError, match="cannot be read"):
        read_surface(tmp_path / "missing.stl")


def test_a_body_from_a_mesh_has_its_mass_properties(tmp_path: Path) -> None:
    write_text_stl(tmp_path / "box.stl")
    model = Model("m", folder=tmp_path)
    body = model.add_body("b", shape={"type": "mesh", "file": "box.stl", "scale": 0.1}, density=500)
    properties = body.mass_properties
    assert properties.mass == pytest.approx(3.0)
    np.testing.assert_allclose(properties.center, [0.15, 0.1, 0.15])
    expected = 3.0 / 12 * np.diag([0.13, 0.10, 0.05])
    np.testing.assert_allclose(properties.inertia, expected, atol=1e-12)
    stored = model.to_scene_dict(tmp_path / "elsewhere")
    assert "file" not in stored["bodies"]["b"]["shape"]
    again = Model.from_scene_dict(stored, tmp_path).bodies["b"].mass_properties
    np.testing.assert_allclose(again.inertia, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(again.center, properties.center, rtol=1e-6)


def test_a_mesh_that_is_not_closed_needs_mass_and_inertia(tmp_path: Path) -> None:
    write_text_stl(tmp_path / "open.stl", FACES[:-1])
    shape = {"type": "mesh", "file": "open.stl"}
    with pytest.raises(SceneError, match="3 edges have not two triangles"):
        Model("m", folder=tmp_path).add_body("b", shape=shape, density=500)
    Model("m", folder=tmp_path).add_body("b", shape=shape, mass=1, inertia=[1, 1, 1])
    with pytest.raises(SceneError, match="cannot be read"):
        Model("m", folder=tmp_path).add_body("b", shape={**shape, "file": "no.stl"}, density=1)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_an_extrusion_has_the_mass_properties_of_its_parts(axis: str) -> None:
    """An L of two boxes, 3 x 1 and 1 x 1 above its left end; parallel axes (Steiner)."""
    outline = [[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]]
    shape = {"type": "extrusion", "outline": outline, "thickness": 0.5, "axis": axis}
    properties = Model("m").add_body("b", shape=shape, density=2).mass_properties
    masses, places = np.array([3.0, 1.0]), np.array([[1.5, 0.5, 0.0], [0.5, 1.5, 0.0]])
    center = masses @ places / 4
    J = np.zeros((3, 3))
    for m, size, x in zip(masses, ((3, 1, 0.5), (1, 1, 0.5)), places - center, strict=True):
        S = m * (np.diag(np.square(size)) / 12 + np.outer(x, x))
        J += np.trace(S) * np.eye(3) - S
    order = {"z": [0, 1, 2], "x": [2, 0, 1], "y": [1, 2, 0]}[axis]
    assert properties.mass == pytest.approx(4.0)
    np.testing.assert_allclose(properties.center, center[order])
    np.testing.assert_allclose(properties.inertia, J[np.ix_(order, order)], atol=1e-12)


def test_an_outline_that_crosses_itself_is_refused() -> None:
    shape = {"type": "extrusion", "outline": [[0, 0], [1, 1], [1, 0], [0, 1]], "thickness": 1}
    with pytest.raises(SceneError, match="edges 1 and 3 cross"):
        Model("m").add_body("b", shape=shape, density=1)
