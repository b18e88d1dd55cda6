"""Cells of VTK that are hexahedra, quadrilaterals and tetrahedra under other names, or none."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv

import flexmb
from flexmb.errors import MeshError
from flexmb.fe import read_mesh
from flexmb.fe.meshes import mesh_file

HEXAHEDRON, VOXEL, PIXEL, POLYGON, POLYLINE, STRIP, LAGRANGE_TETRA = 12, 11, 8, 7, 4, 6, 71
STEEL = {"E": 210e9, "nu": 0.3, "density": 7850.0}
BOTTOM = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
CUBE = np.array([*BOTTOM, *((x, y, 1) for x, y, _ in BOTTOM)], float)
AS_VOXEL = [0, 1, 3, 2, 4, 5, 7, 6]  # x runs fastest, then y, then z


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(mesh_file, "check_reading", lambda *_: None)


def written(path, points, *cells):
    """A file of VTK with cells of (type, nodes)."""
    rows = np.concatenate([[len(nodes), *nodes] for _, nodes in cells])
    grid = pv.UnstructuredGrid(rows, [kind for kind, _ in cells], np.asarray(points, float))
    grid.save(path)
    return path


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
def test_voxels_are_hexahedra(tmp_path, suffix):
    """Half of a bar was lost, without a word, where the other half is of hexahedra."""
    points = np.vstack([CUBE, CUBE + [1.0, 0.0, 0.0]])
    points, same = np.unique(points, axis=0, return_inverse=True)
    one, other = same.ravel()[:8], same.ravel()[8:]
    cells = [(HEXAHEDRON, one), (VOXEL, other[AS_VOXEL])]
    path = written(tmp_path / f"bar.{suffix}", points, *cells)
    np.testing.assert_array_equal(read_mesh(path).blocks["hexahedron"], [one, other])
    body = flexmb.reduce(path, material=STEEL, modes=2)
    assert body.mass == pytest.approx(2 * 7850.0)


@pytest.mark.parametrize(
    ("kind", "order"), [(PIXEL, [0, 1, 3, 2]), (POLYGON, [0, 1, 2, 3])], ids=["pixel", "polygon"]
)
def test_pixels_and_polygons_of_four_corners_are_quadrilaterals(tmp_path, kind, order):
    path = written(tmp_path / "plate.vtu", CUBE[:4], (kind, order))
    np.testing.assert_array_equal(read_mesh(path).blocks["quad"], [[0, 1, 2, 3]])


def test_lagrange_tetrahedra_are_tetrahedra(tmp_path):
    """As FEniCSx writes them; the volume of the curved element is that of the straight one."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
    edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    points = np.vstack([corners, [(corners[a] + corners[b]) / 2 for a, b in edges]])
    path = written(tmp_path / "tet.vtu", points, (LAGRANGE_TETRA, range(10)))
    body = flexmb.reduce(path, material=STEEL, modes=1)
    assert body.mass == pytest.approx(7850.0 / 6)


def test_polylines_are_left_out_with_a_note(tmp_path):
    cells = [(HEXAHEDRON, range(8)), (POLYLINE, [0, 1, 2]), (STRIP, [0, 1, 2, 3])]
    mesh = read_mesh(written(tmp_path / "a.vtu", CUBE, *cells))
    assert "also has polylines and triangle strips, which are no elements" in mesh.note
    assert not read_mesh(written(tmp_path / "b.vtu", CUBE, cells[0])).note


@pytest.mark.parametrize(
    ("cell", "sentence"),
    [
        ((POLYGON, [0, 1, 2, 3, 7]), "polygons of 5 corners, which are not read: write triangles"),
        ((36, [0, 1, 2, 3, 4, 5, 6]), "cells of VTK's type 36, which are not read: write linear"),
    ],
)
def test_elements_that_are_not_known_are_refused(tmp_path, cell, sentence):
    path = written(tmp_path / "a.vtu", CUBE, (HEXAHEDRON, range(8)), cell)
    with pytest.raises(MeshError, match=f"a.vtu: the mesh file has {sentence}"):
        read_mesh(path)
