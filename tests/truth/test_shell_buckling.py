"""Buckling loads of plates and cylinders: stiffness and geometric stiffness of shells together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh
from shellkit import KINDS, held, model, node_at, rectangle, sheet, static

from flexmb.fe import assemble, geometric_stiffness, make_interfaces, mesh_from, resolve
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.fe.sections.shell_section import shell
from flexmb.materials import Material

STEEL = Material("steel", 210e9, 0.3, 7850.0)
H = 0.01  # m, of plates 1 m wide and cylinders 1 m in radius


def load_factor(fe, loads, before, after):
    """The least multiple of the loads that buckles a model held so before and while it buckles."""
    u = np.zeros(fe.numbering.n)
    u[fe.numbering.table] = static(fe, loads, before)
    free = np.setdiff1d(np.arange(fe.numbering.n), after)
    Kg, K = (matrix[free][:, free].tocsc() for matrix in (geometric_stiffness(fe, u), fe.K))
    return 1 / eigsh(-Kg, 1, K, which="LA", return_eigenvectors=False)[0]


def squeeze(fe, axis, first, last):
    """Loads of one newton in all along an axis, pressing two edges together."""
    loads = np.zeros(fe.numbering.n)
    for name, sign in ((first, 1.0), (last, -1.0)):
        dofs = fe.numbering.table[fe.mesh.node_sets[name], axis]
        share = np.full(len(dofs), 1 / (len(dofs) - 1))
        share[[0, -1]] /= 2
        loads[dofs] = sign * share
    return loads


@pytest.mark.parametrize("kind", KINDS)
def test_square_plate(kind):
    """Simply supported, pressed along x: N = 4 pi^2 D/b^2; shear takes off 5e-4."""
    fe = model(sheet((16, 16), kind, 0.25, rectangle(1.0, 1.0)), shell(H), STEEL)
    table = fe.numbering.table
    supports = {"x0": (2, 3), "x1": (2, 3), "y0": (2, 4), "y1": (2, 4)}
    pins = table[node_at(fe.mesh, [0, 0, 0]), :2], table[node_at(fe.mesh, [1, 0, 0]), 1:2]
    dofs = np.union1d(held(fe, supports), np.concatenate(pins))
    D = STEEL.E * H**3 / 12 / (1 - STEEL.nu**2)
    found = load_factor(fe, squeeze(fe, 0, "x0", "x1"), dofs, dofs)
    assert found == pytest.approx(4 * np.pi**2 * D, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_cylinder_pressed_along_its_axis(kind):
    """N = E h^2/(R sqrt(3 (1 - nu^2))) (Timoshenko and Gere, Theory of Elastic Stability, section
    11.1). The ends move freely before buckling and not sideways after; h/R = 0.01. The pattern has
    waves of six elements: these are 3 % soft."""

    def shape(st):
        turn = np.pi / 2 * st[:, 0]
        return np.column_stack([np.sin(turn), st[:, 1], np.cos(turn)])

    fe = model(sheet((24, 32), kind, 0.2, shape), shell(H), STEEL)
    symmetry = {"x0": (0, 4, 5), "x1": (2, 3, 4)}
    pin = fe.numbering.table[fe.mesh.node_sets["y0"][:1], 1]
    before = np.union1d(held(fe, symmetry), pin)
    after = np.union1d(before, held(fe, {"y0": (0, 2), "y1": (0, 2)}))
    found = load_factor(fe, squeeze(fe, 1, "y0", "y1"), before, after) / (np.pi / 2)
    assert found == pytest.approx(STEEL.E * H**2 / np.sqrt(3 * (1 - STEEL.nu**2)), rel=0.04)


@pytest.mark.parametrize("kind", KINDS)
def test_bending_moments_of_shells_couple_twist_and_sway(kind):
    """A strip bent by a force P at its tip, swaying by v and twisted by phi: int P (L - x) phi v''
    (Timoshenko and Gere, Theory of Elastic Stability, section 6.3)."""
    mesh = mesh_from(
        {"type": "plate", "length": 1, "width": 0.06, "divisions": [16, 4], "elements": kind}
    )
    fe = assemble(mesh, resolve({"E": 2e11, "nu": 0.0, "density": 7800.0}), {"all": shell(0.01)})
    root, tip = make_interfaces(fe, {"root": "x0", "tip": {"group": "x1", "type": "rbe3"}})
    f = np.zeros((fe.numbering.n, 6))
    f[tip.loads()[0]] = tip.loads()[1]
    bent = FixedInterfaceModel(fe, (root,), tuple(range(6))).solve(f[:, 2])
    table, (x, y) = fe.numbering.table, mesh.points[:, :2].T
    y, sway, twist = y - y.mean(), np.zeros(fe.numbering.n), np.zeros(fe.numbering.n)
    slope = (6 * x - 3 * x**2) / 2
    sway[table[:, 1]], sway[table[:, 0]], sway[table[:, 5]] = (
        (3 * x**2 - x**3) / 2,
        -y * slope,
        slope,
    )
    twist[table[:, 3]], twist[table[:, 2]], twist[table[:, 4]] = x, x * y, -y
    found = sway @ (geometric_stiffness(fe, bent) @ twist)
    assert found == pytest.approx(-0.25, rel=0.01)
