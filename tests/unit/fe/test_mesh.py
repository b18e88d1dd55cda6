"""The mesh object: groups, scaling, and what it refuses."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from femeshes import block

from flexmb.errors import MeshError
from flexmb.fe import Mesh
from flexmb.fe.meshes import mesh_file
from flexmb.fe.meshes.mesh import dimension


def test_dimension_of_element_kinds():
    kinds = ("vertex", "line3", "triangle6", "quad8", "tetra10", "hexahedron27", "wedge15")
    assert [dimension(kind) for kind in kinds] == [0, 1, 2, 2, 3, 3, 3]
    assert dimension("blob") == -1


def test_groups_know_their_nodes_and_scaling_moves_points_only():
    mesh = block((1, 1, 1))
    twice = mesh.scaled(2.0)
    np.testing.assert_array_equal(twice.points, 2 * mesh.points)
    np.testing.assert_array_equal(twice.node_sets["x0"], mesh.node_sets["x0"])
    assert (mesh.points[mesh.group_nodes("x1"), 0] == 1).all()
    assert len(mesh.node_sets["x1"]) == 9


def test_unknown_group_names_the_nearest():
    with pytest.raises(MeshError, match='no group "X0"; nearest: x0.*allowed: x0, x1'):
        block((1, 1, 1)).group_nodes("X0", "interfaces.left")


def test_mesh_without_groups_says_so():
    with pytest.raises(MeshError, match="no groups at all"):
        Mesh(np.zeros((1, 3)), {}).group_nodes("a")


@pytest.mark.parametrize(
    ("points", "blocks", "sentence"),
    [
        (np.zeros((0, 3)), {}, "no points"),
        ([[0, 0, np.inf]], {}, "node 0 has a coordinate that is not a number"),
        ([[0, 0, 1], [0, -1e308, 0]], {}, "node 1 has the coordinate 1e.308: volumes overflow"),
        ([[0, 0, 0]], {"line": np.array([[0, 1]])}, "line name nodes that are absent"),
    ],
)
def test_refused(points, blocks, sentence):
    with pytest.raises(MeshError, match=sentence):
        Mesh(points, blocks)


def test_elements_with_too_few_nodes_are_a_damaged_file(tmp_path, monkeypatch):
    """A Nastran CTETRA with five nodes, which meshio takes for one of ten."""
    raw = SimpleNamespace(
        points=np.zeros((5, 3)),
        cell_data={},
        cells=[SimpleNamespace(type="tetra10", data=np.arange(5)[None])],
    )
    monkeypatch.setattr(mesh_file, "_read_quietly", lambda _: raw)
    with pytest.raises(MeshError, match="is damaged: elements of kind tetra10 with 5 nodes"):
        mesh_file._read(tmp_path / "a.bdf")
