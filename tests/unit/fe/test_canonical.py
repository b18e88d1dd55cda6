"""Modes that do not depend on the order of nodes, on units or on the run."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, line

from flexmb.fe import (
    Mesh,
    assemble,
    craig_bampton,
    free_interface,
    make_interfaces,
    orthonormalise,
    rectangle,
    resolve,
)

STEEL = resolve("steel")


def square_beam():
    """Bends alike in both planes and twists: every bending frequency is double."""
    return line(12), {"all": rectangle(0.05, 0.05)}, {"root": "root"}


def square_block():
    return block((4, 2, 2), (1.0, 0.1, 0.1)), None, {"left": {"group": "x0", "type": "rbe3"}}


def shuffled(mesh, seed=3):
    """The same mesh with its nodes and elements in another order, and the new number of each."""
    rng = np.random.default_rng(seed)
    number = rng.permutation(len(mesh.points))
    points = np.empty_like(mesh.points)
    points[number] = mesh.points
    order = {kind: rng.permutation(len(cells)) for kind, cells in mesh.blocks.items()}
    cells = {kind: number[nodes[order[kind]]] for kind, nodes in mesh.blocks.items()}
    row = {kind: np.argsort(given) for kind, given in order.items()}
    groups = {
        name: {kind: row[kind][rows] for kind, rows in parts.items()}
        for name, parts in mesh.element_sets.items()
    }
    sets = {n: number[rows] for n, rows in mesh.node_sets.items() if n not in groups}
    return Mesh(points, cells, sets, groups), number


def modes(mesh, sections, interfaces, method, count=10):
    fe = assemble(mesh, STEEL, sections)
    elastic = orthonormalise(fe, method(fe, make_interfaces(fe, interfaces), count))
    everywhere = np.concatenate([elastic.Phi, np.zeros((1, elastic.Phi.shape[1]))])
    return elastic.frequencies, everywhere[fe.numbering.table]  # -1 is the row of zeros


@pytest.mark.parametrize("method", [craig_bampton, free_interface])
@pytest.mark.parametrize("model", [square_beam, square_block])
def test_the_order_of_nodes_does_not_matter(model, method):
    """Within 1e-6 of the largest motion: neighbours in frequency, 1e-3 apart and more, let the
    rounding of one shape into the other."""
    mesh, sections, interfaces = model()
    one, shapes = modes(mesh, sections, interfaces, method)
    other_mesh, number = shuffled(mesh)
    two, others = modes(other_mesh, sections, interfaces, method)
    np.testing.assert_allclose(two, one, rtol=1e-9)
    np.testing.assert_allclose(others[number], shapes, atol=1e-6 * np.abs(shapes).max())


@pytest.mark.parametrize("model", [square_beam, square_block])
def test_millimetres_do_not_matter(model):
    mesh, sections, interfaces = model()
    one, shapes = modes(mesh, sections, interfaces, craig_bampton)
    two, others = modes(mesh.scaled(1e3).scaled(1e-3), sections, interfaces, craig_bampton)
    np.testing.assert_allclose(two, one, rtol=1e-9)
    np.testing.assert_allclose(others, shapes, atol=1e-6 * np.abs(shapes).max())
