"""Craig-Bampton reduction against the full model: static, frequencies, rigid motions."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
from femeshes import block, line, tied
from scipy.linalg import eigh

from flexmb.errors import ReductionError
from flexmb.fe import assemble, craig_bampton, make_interfaces, orthonormalise, rectangle, resolve
from flexmb.fe.reduction.free_body import free_modes

STEEL = resolve("steel")


def solid():
    fe = assemble(block((3, 1, 1), (3, 0.8, 1.1), distort=0.2), STEEL)
    return fe, make_interfaces(fe, {"left": "x0", "right": "x1"})


def beam():
    sections = {"all": rectangle(0.03, 0.05, orientation=(0, 0, 1))}
    fe = assemble(line(8, (0, 0, 0), (0.6, 0.3, 0.6)), STEEL, sections)
    return fe, make_interfaces(fe, {"root": "root", "tip": "tip"})


@pytest.fixture(params=[solid, beam], ids=["solid", "beam"])
def model(request):
    return request.param()


def self_equilibrated(fe, interfaces, seed=0):
    """Random forces and moments on the interfaces without resultant."""
    F = np.random.default_rng(seed).normal(size=6 * len(interfaces))
    R = np.concatenate([np.eye(6)] * len(interfaces))
    for k, part in enumerate(interfaces):
        x, y, z = part.position - fe.center
        R[6 * k : 6 * k + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return F - R @ np.linalg.lstsq(R, F, rcond=None)[0]


@pytest.mark.parametrize("modes", [0, 5])
def test_interface_compliance_is_exact_whatever_the_number_of_modes(model, modes):
    fe, interfaces = model
    F = self_equilibrated(fe, interfaces)
    G = tied(fe, interfaces)
    load = np.zeros(G.shape[1])
    load[: len(F)] = F
    K = G.T @ (fe.K @ G)
    full = np.linalg.pinv(K, rcond=1e-12, hermitian=True) @ load
    found = orthonormalise(fe, craig_bampton(fe, interfaces, modes))
    q = found.Z[: len(F)]
    reduced = q @ ((q.T @ F) / found.omega2)
    for seed in range(4):  # the two differ by a rigid motion, which such loads do not feel
        probe = self_equilibrated(fe, interfaces, seed)
        assert probe @ reduced == pytest.approx(probe @ full[: len(F)], rel=1e-8)


def test_with_all_modes_the_frequencies_are_those_of_the_full_model(model):
    fe, interfaces = model
    G = tied(fe, interfaces)
    wanted = eigh(G.T @ (fe.K @ G), G.T @ (fe.M @ G), eigvals_only=True)[6:]
    reduced = craig_bampton(fe, interfaces, G.shape[1] - 6 * len(interfaces))
    np.testing.assert_allclose(orthonormalise(fe, reduced).omega2, wanted, rtol=1e-7)


def test_frequencies_converge_from_above_with_the_number_of_modes():
    fe, interfaces = solid()
    found = [orthonormalise(fe, craig_bampton(fe, interfaces, n)).frequencies for n in (0, 6, 24)]
    wanted = orthonormalise(fe, craig_bampton(fe, interfaces, 100)).frequencies
    errors = [np.max(f[:5] / wanted[:5] - 1) for f in found]
    assert errors[0] > errors[1] > errors[2] > -1e-12
    assert errors[2] < 5e-3


def test_sparse_and_dense_eigensolvers_agree(monkeypatch):
    fe, interfaces = solid()
    dense = craig_bampton(fe, interfaces, 10)
    monkeypatch.setattr(import_module("flexmb.fe.reduction.fixed_interface"), "_DENSE", 0)
    sparse = craig_bampton(fe, interfaces, 10)
    np.testing.assert_allclose(np.diag(sparse.K), np.diag(dense.K), rtol=1e-9)
    np.testing.assert_allclose(sparse.basis, dense.basis, atol=1e-6 * np.abs(dense.basis).max())


def test_the_basis_holds_the_rigid_motions(model):
    fe, interfaces = model
    reduced = craig_bampton(fe, interfaces, 3)
    found = reduced.basis @ reduced.rigid
    np.testing.assert_allclose(found, fe.rigid, atol=1e-9)


def test_modes_are_orthonormal_and_carry_no_rigid_motion(model):
    fe, interfaces = model
    found = orthonormalise(fe, craig_bampton(fe, interfaces, 5))
    assert found.Phi.shape[1] == 6 * 2 + 5 - 6
    np.testing.assert_allclose(found.Phi.T @ (fe.M @ found.Phi), np.eye(11), atol=1e-9)
    stiffness = found.Phi.T @ (fe.K @ found.Phi)
    np.testing.assert_allclose(stiffness, np.diag(found.omega2), atol=1e-9 * found.omega2[-1])
    momentum = fe.rigid.T @ (fe.M @ found.Phi)
    assert np.abs(momentum).max() < 1e-9 * np.sqrt(np.diag(fe.rigid.T @ (fe.M @ fe.rigid)).max())


def test_a_second_run_gives_the_same_basis(model):
    fe, interfaces = model
    one, two = (orthonormalise(fe, craig_bampton(fe, interfaces, 6)).Phi for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_equal_frequencies_give_modes_along_the_axes():
    """A square beam bends alike in both planes: each mode keeps to one of them."""
    fe = assemble(line(10), STEEL, {"all": rectangle(0.05, 0.05)})
    found = orthonormalise(fe, craig_bampton(fe, make_interfaces(fe, {"a": "root"}), 8))
    sideways = found.Phi[fe.numbering.table[:, 1:3]]
    share = (sideways**2).sum(axis=0) / (sideways**2).sum(axis=(0, 1))
    bending = share[:, (sideways**2).sum(axis=(0, 1)) > 1e-6]
    assert bending.shape[1] >= 4
    assert np.minimum(bending[0], bending[1]).max() < 1e-6


def test_free_modes_without_interfaces(monkeypatch):
    fe, _ = solid()
    wanted = eigh(fe.K.toarray(), fe.M.toarray(), eigvals_only=True)[6:14]
    for limit in (10**6, 0):
        monkeypatch.setattr(import_module("flexmb.fe.reduction.free_body"), "DENSE", limit)
        found = orthonormalise(fe, free_modes(fe, (), 8))
        np.testing.assert_allclose(found.omega2, wanted, rtol=1e-8)


@pytest.mark.parametrize("kind", ["rbe2", "rbe3"])
def test_a_body_that_is_all_interface(kind):
    """One beam element held at both its nodes has nothing inside: its matrices are the body's."""
    fe = assemble(line(1), STEEL, {"all": rectangle(0.02, 0.03)})
    ends = {name: {"group": name, "type": kind} for name in ("root", "tip")}
    found = craig_bampton(fe, make_interfaces(fe, ends), 0)
    order = fe.numbering.table[:2].ravel()
    scale = np.abs(fe.K).max()
    np.testing.assert_allclose(found.K, fe.K.toarray()[np.ix_(order, order)], atol=1e-12 * scale)
    wanted = eigh(fe.K.toarray(), fe.M.toarray(), eigvals_only=True)[6:]
    np.testing.assert_allclose(orthonormalise(fe, found).omega2, wanted, rtol=1e-8)
    with pytest.raises(ReductionError, match="1 requested, but .* only 0 fixed-interface"):
        craig_bampton(fe, make_interfaces(fe, ends), 1)


def test_too_many_modes():
    fe, interfaces = beam()
    with pytest.raises(ReductionError, match="43 requested, but .* only 42 fixed-interface"):
        craig_bampton(fe, interfaces, 43)
    with pytest.raises(ReductionError, match="only 48 elastic modes"):
        free_modes(fe, (), 49)
