"""Second-order tetrahedra: patch tests, and convergence of a cantilever block."""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, held_frequencies, line, slope

from flexmb.fe import assemble, rectangle, resolve
from flexmb.fe.elements.element_blocks import outer_faces

STEEL = resolve("steel")
NO_POISSON = resolve({"E": 200e9, "nu": 0.0, "density": 8000})


def boundary_nodes(fe):
    return np.unique(outer_faces(fe.blocks, fe.mesh.points)[0])


def solve_inside(fe, u):
    """Displacements when the boundary nodes are moved by ``u`` and nothing loads the inside."""
    held = fe.numbering.table[boundary_nodes(fe), :3].ravel()
    free = np.setdiff1d(np.arange(fe.numbering.n), held)
    full = u.ravel().copy()
    K = fe.K.toarray()
    full[free] = np.linalg.solve(K[np.ix_(free, free)], -K[np.ix_(free, held)] @ full[held])
    return full.reshape(-1, 3)


def test_patch_of_constant_strain():
    fe = assemble(block((3, 3, 3), distort=0.3), STEEL)
    u = fe.mesh.points @ np.random.default_rng(1).normal(size=(3, 3)) + [1, 2, 3]
    np.testing.assert_allclose(solve_inside(fe, u), u, atol=1e-11)


def test_patch_of_pure_bending():
    """The exact displacement of pure bending is quadratic, so it must come out exactly."""
    fe = assemble(block((3, 2, 2), (2, 1, 1), distort=0.3), STEEL)
    x, y, z = (fe.mesh.points - [0, 0.5, 0.5]).T
    nu = STEEL.nu
    u = np.stack([-x * y, 0.5 * (x**2 + nu * (y**2 - z**2)), nu * y * z], axis=1)
    np.testing.assert_allclose(solve_inside(fe, u), u, atol=1e-11)


def test_uniform_strain_energy():
    fe = assemble(block((2, 2, 2), (1, 2, 3), distort=0.2), STEEL)
    u = np.zeros((len(fe.mesh.points), 3))
    u[:, 0] = 1e-3 * fe.mesh.points[:, 0]
    lam, mu = STEEL.E * 0.3 / (1.3 * 0.4), STEEL.E / 2.6
    energy = 0.5 * u.ravel() @ (fe.K @ u.ravel())
    assert energy == pytest.approx(0.5 * (lam + 2 * mu) * 1e-6 * 6, rel=1e-12)


@pytest.mark.parametrize("affine", [np.eye(3), [[1, 0.3, 0], [0, 1, 0.2], [0.1, 0, 1.5]]])
def test_six_zero_modes(affine):
    fe = assemble(block((2, 1, 1), distort=0.2, affine=affine), STEEL)
    values = np.linalg.eigvalsh(fe.K.toarray())
    assert np.abs(values[:6]).max() < 1e-12 * values[-1] < 1e-6 * values[6]
    assert np.abs(fe.K @ fe.rigid).max() < 1e-13 * np.abs(fe.K).max()


def test_axial_modes_of_a_cantilever_block_at_order_four():
    """Without Poisson's ratio u_x = sin(pi x/2L) is an exact three-dimensional mode."""
    sizes, errors = (1, 2, 4), []
    for n in sizes:
        fe = assemble(block((n, 1, 1), (1, 0.2, 0.2)), NO_POISSON)
        table = fe.numbering.table
        root = table[fe.mesh.group_nodes("x0"), 0]
        held = np.concatenate([table[:, 1], table[:, 2], root])
        found = held_frequencies(fe, held, 1)[0]
        errors.append(found / (np.pi / 2 * np.sqrt(NO_POISSON.E / NO_POISSON.density)) - 1)
    assert slope(sizes, errors) == pytest.approx(-4, abs=0.4)
    assert abs(errors[-1]) < 1e-4


def test_bending_of_a_cantilever_block_converges_to_the_beam():
    """Slender block (h/L = 0.05) against a converged Timoshenko beam of the same section."""
    section = rectangle(0.05, 0.08)
    beam = assemble(line(60), NO_POISSON, {"all": section})
    wanted = held_frequencies(beam, beam.numbering.table[0], 2)
    errors = []
    for n in (4, 8, 16):
        fe = assemble(block((n, 1, 1), (1, 0.05, 0.08)), NO_POISSON)
        root = fe.numbering.table[fe.mesh.group_nodes("x0"), :3].ravel()
        errors.append(held_frequencies(fe, root, 2) / wanted - 1)
    assert np.abs(errors[-1]).max() < 3e-3
    assert (np.abs(errors[1]) < 0.35 * np.abs(errors[0])).all()
