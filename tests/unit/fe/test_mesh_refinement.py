"""Uniform refinement: the same nodes, groups and volumes as a finer mesh of the same shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

import flexmb
from flexmb import fe
from flexmb.errors import FlexmbError, MeshError
from flexmb.fe.mesh_checks import scaled_jacobian
from flexmb.fe.meshes import Mesh, beam, box, mesh_from, plate
from flexmb.fe.meshes.mesh import facet_moments
from flexmb.fe.meshes.mesh_refinement import refine_mesh

SOLIDS = ("hexahedron20", "hexahedron27", "hexahedron", "tetra10", "tetra", "wedge15")


def _sorted(points: np.ndarray) -> np.ndarray:
    rounded = np.round(points, 9) + 0.0
    return rounded[np.lexsort(rounded.T)]


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_refined_box_is_the_box_with_twice_the_divisions(kind: str) -> None:
    coarse = box([1, 0.5, 0.4], divisions=[2, 2, 2], elements=kind)
    fine, other = refine_mesh(coarse), box([1, 0.5, 0.4], divisions=[4, 4, 4], elements=kind)
    assert np.allclose(_sorted(fine.points), _sorted(other.points))
    assert len(fine.blocks[kind]) == 8 * len(coarse.blocks[kind]) == len(other.blocks[kind])
    assert np.array_equal(fine.points[: len(coarse.points)], coarse.points)  # numbers stay
    for name in ("x0", "y1", "z0"):
        mine, theirs = (m.points[m.group_nodes(name)] for m in (fine, other))
        assert np.allclose(_sorted(mine), _sorted(theirs))
    qualities = [scaled_jacobian(kind, m.points[m.blocks[kind]]) for m in (coarse, fine)]
    assert qualities[0] is not None
    assert qualities[1] is not None
    assert qualities[1].min() > 0.9 * qualities[0].min() > 0.1


def test_surfaces_lines_and_groups_of_nodes_alone() -> None:
    for kind in ("quad", "triangle"):
        fine = refine_mesh(plate(1, 0.5, divisions=[2, 2], elements=kind), 2)
        other = plate(1, 0.5, divisions=[8, 8], elements=kind)
        for name, nodes in other.node_sets.items():
            mine = fine.points[fine.node_sets[name]]
            assert np.allclose(_sorted(mine), _sorted(other.points[nodes])), name
    line = refine_mesh(beam(1.0, divisions=3))
    assert len(line.blocks["line"]) == 6
    assert line.points[line.group_nodes("end")][0, 0] == 1.0


def test_new_nodes_lie_on_the_curved_edges_of_second_order_elements() -> None:
    arc = np.deg2rad([0.0, 90.0, 45.0])
    ring = Mesh(
        np.stack([np.cos(arc), np.sin(arc), 0 * arc], axis=1), {"line3": np.array([[0, 1, 2]])}
    )
    fine = refine_mesh(ring)
    xi = np.array([0.25, 0.75])  # by the shape functions (1-x)(1-2x), x(2x-1), 4x(1-x)
    shapes = np.stack([(1 - xi) * (1 - 2 * xi), xi * (2 * xi - 1), 4 * xi * (1 - xi)], axis=1)
    assert np.allclose(fine.points[3:], shapes @ ring.points)
    assert {tuple(row) for row in fine.blocks["line3"]} == {(0, 2, 3), (2, 1, 4)}


def test_round_shapes_are_divided_on_their_circle() -> None:
    fine = mesh_from({"type": "disk", "radius": 1.0, "inner": 0.5, "divisions": [1, 8]}, refine=1)
    radii = np.linalg.norm(fine.points[fine.group_nodes("outer")], axis=1)
    assert len(radii) == 16
    assert np.allclose(radii, 1.0)
    area = sum(
        facet_moments(kind, fine.points[cells])[0]
        for kind, cells in fine.blocks.items()
        if kind == "quad"
    )
    assert area == pytest.approx(8 * np.sin(np.pi / 8) * (1 - 0.25))  # the polygon of 16 sides


def test_a_cantilever_of_solids_converges_to_the_euler_bernoulli_beam() -> None:
    """Beam of square section, L/h = 20: f1 = 1.8751² h/(4π L²) √(E/3ρ), less shear by 0.1 %."""
    steel = {"E": 2.1e11, "nu": 0.0, "density": 7800.0}
    exact = 1.87510407**2 * 0.05 / (4 * np.pi) * np.sqrt(2.1e11 / (3 * 7800.0))
    box_table = {"type": "box", "size": [1, 0.05, 0.05], "divisions": [4, 1, 1]}
    errors: list[float] = []

    def inspect(model: fe.FEMatrices, *_: object) -> None:
        free = np.flatnonzero(np.repeat(model.mesh.points[:, 0] > 1e-9, 3))
        K, M = (np.asarray(A.todense())[np.ix_(free, free)] for A in (model.K, model.M))
        errors.append(np.sqrt(eigh(K, M, eigvals_only=True)[0]) / (2 * np.pi * exact) - 1.0)

    for refine in (0, 1):
        body = fe.reduce(
            {**box_table, "elements": "hexahedron"},
            material=steel, interfaces={"root": "x0"}, modes=2, refine=refine, inspect=inspect,
        )  # fmt: skip
        assert body.provenance.get("refine", "0") == str(refine)
    assert errors[0] > 2.0 * errors[1] > 0.0  # too stiff, by locking, less so when finer


def test_what_cannot_be_refined_is_said() -> None:
    odd = Mesh(np.eye(5, 3) * 1.0, {"pyramid": np.arange(5)[None]})
    with pytest.raises(MeshError, match="kind pyramid cannot be refined"):
        refine_mesh(odd)
    with pytest.raises(FlexmbError, match="more than"):
        mesh_from({"type": "disk", "radius": 1.0, "inner": 0.5}, refine=6 * 3)
    with pytest.raises(FlexmbError, match="refine: must be at most 6, is 9"):
        flexmb.Model().add_body("a", mesh="m.msh", material="steel", refine=9)
    with pytest.raises(MeshError, match="refine: must be a whole number from 0 on, given -1"):
        fe.reduce({"type": "box", "size": [1, 1, 1]}, material="steel", refine=-1)


def test_too_fine_a_mesh_is_refused_before_it_is_made() -> None:
    """4 hexahedra and 18 faces, ten times halved: 4 * 8^10 + 18 * 4^10. To make them takes long."""
    with pytest.raises(MeshError, match=r"refining it makes 4\.31e\+09 elements"):
        refine_mesh(box([4, 1, 1], divisions=[4, 1, 1]), 10)


def test_what_else_a_file_has_and_its_numbers_survive() -> None:
    mesh = box([1, 1, 1], divisions=[1, 1, 1])
    numbers = np.arange(len(mesh.points)) + 100
    finer = refine_mesh(replace(mesh, note="the mesh file also has 2 MASS", numbers=numbers))
    assert finer.note == "the mesh file also has 2 MASS"
    assert finer.node_text(3) == "node 3 (number 103 of the file)"
    assert finer.node_text(len(numbers)) == f"node {len(numbers)}"
