"""The quality report: its numbers against full matrices, and its tables."""

from __future__ import annotations

import time

import numpy as np
import pytest
from femeshes import block, line, mirrored_block, tied
from scipy.linalg import eigh

from flexmb.errors import ReductionError
from flexmb.fe import (
    assemble,
    craig_bampton,
    free_interface,
    guyan,
    make_interfaces,
    make_loads,
    orthonormalise,
    quality_report,
    rectangle,
    resolve,
)
from flexmb.fe.reduction.eigenmodes import make_symmetry_plane
from flexmb.fe.reduction.free_body import free_modes
from flexmb.fe.reduction.quality_report import report_tables, report_text
from flexmb.progress import Stopwatch

STEEL = resolve("steel")


@pytest.fixture(scope="module")
def bar():
    fe = assemble(line(8), STEEL, {"all": rectangle(0.03, 0.05)})
    return fe, make_interfaces(fe, {"root": "root", "tip": {"group": "tip", "type": "rbe3"}})


@pytest.fixture(scope="module")
def box():
    fe = assemble(block((2, 1, 1), (2, 0.8, 1.1), distort=0.2), STEEL)
    return fe, make_interfaces(fe, {"left": "x0", "right": "x1"})


def full_modes(fe, interfaces):
    G = tied(fe, interfaces)
    omega2, W = eigh(G.T @ (fe.K @ G), G.T @ (fe.M @ G))
    return np.sqrt(omega2[6:]) / (2 * np.pi), (G @ W)[:, 6:]


def test_frequencies_and_mac_are_those_of_full_matrices(box):
    fe, interfaces = box
    elastic = orthonormalise(fe, found := craig_bampton(fe, interfaces, 4))
    frequencies, V = full_modes(fe, interfaces)
    limit = 0.5 * (frequencies[6] + frequencies[7])
    report = quality_report(fe, found, elastic, up_to=float(limit))
    check = report.frequencies
    np.testing.assert_allclose(check.full, frequencies[:7], rtol=1e-8)
    mac = (V[:, :7].T @ (fe.M @ elastic.Phi)) ** 2
    np.testing.assert_allclose(check.mac, mac, atol=1e-6)
    assert (check.mac.sum(axis=1) <= 1 + 1e-9).all()
    best = elastic.frequencies[mac.argmax(axis=1)] / frequencies[:7] - 1
    np.testing.assert_allclose(check.error, best, atol=1e-8)
    assert check.error.max() > 1e-3


def test_free_interface_modes_are_exact_in_the_report(box):
    fe, interfaces = box
    elastic = orthonormalise(fe, found := free_interface(fe, interfaces, 6))
    check = quality_report(fe, found, elastic).frequencies
    assert len(check.full) == 9
    np.testing.assert_allclose(check.error[:6], 0, atol=1e-9)
    np.testing.assert_allclose(check.mac[:6, :6], np.eye(6), atol=1e-7)


def test_equal_frequencies_have_a_partner_each_and_modes_beyond_the_body_have_none():
    """A square beam: pairs of modes. More modes of the full model than the body has coordinates."""
    fe = assemble(line(12), STEEL, {"all": rectangle(0.05, 0.05)})
    found = craig_bampton(fe, make_interfaces(fe, {"root": "root"}), 4)
    report = quality_report(fe, found, orthonormalise(fe, found), up_to=1500.0)
    check = report.frequencies
    assert len(check.full) > len(check.reduced) == 4
    matched = check.partner[check.partner >= 0]
    assert sorted(matched) == [0, 1, 2, 3]
    assert np.isnan(check.error[check.partner < 0]).all()
    assert check.likeness[:2] == pytest.approx([1, 1], abs=0.02)
    assert " none" in report_text(report)


@pytest.mark.parametrize("method", [craig_bampton, guyan, free_interface])
def test_interface_compliance_is_told_to_be_exact(bar, method):
    fe, interfaces = bar
    elastic = orthonormalise(fe, found := method(fe, interfaces, 0))
    assert quality_report(fe, found, elastic).static.interfaces < 1e-8


def test_an_interface_the_modes_do_not_serve_is_told(box):
    """Free modes alone, without residual vectors: interface compliance is missing, and by how much
    full matrices say too."""
    fe, interfaces = box
    found = free_interface(fe, interfaces, 6)
    keep = np.flatnonzero(~found.columns("attachment"))
    cut = type(found)(
        found.basis[:, keep],
        found.K[np.ix_(keep, keep)],
        found.M[np.ix_(keep, keep)],
        found.rigid[keep],
        found.motion[:, :, keep],
        interfaces,
        tuple(found.labels[k] for k in keep),
        tuple(found.kinds[k] for k in keep),
    )
    assert quality_report(fe, cut, orthonormalise(fe, cut)).static.interfaces > 0.01


def test_missing_compliance_elsewhere_is_that_of_full_matrices(box):
    fe, interfaces = box
    node = 17
    loads = make_loads(fe, {"hang": {"type": "gravity", "acceleration": [0, 0, -9.81]}})
    elastic = orthonormalise(fe, found := craig_bampton(fe, interfaces, 3, loads=loads))
    static = quality_report(fe, found, elastic, nodes=[node]).static
    assert static.labels == ("hang", "node 17 Tx", "node 17 Ty", "node 17 Tz")
    assert np.isnan(static.missing[0])
    G = tied(fe, interfaces)
    K, M, R = G.T @ (fe.K @ G), G.T @ (fe.M @ G), fe.rigid
    inverse = np.linalg.pinv(K, rcond=1e-12, hermitian=True)
    P = np.eye(len(R)) - fe.M @ (R @ np.linalg.solve(R.T @ (fe.M @ R), R.T))
    for c in range(3):
        f = np.zeros(len(R))
        f[fe.numbering.table[node, c]] = 1.0
        g = G.T @ (P @ f)
        whole = g @ inverse @ g
        part = np.sum((elastic.Phi.T @ f) ** 2 / elastic.omega2)
        assert static.missing[1 + c] == pytest.approx(1 - part / whole, abs=1e-8)
        assert 1e-3 < static.missing[1 + c] < 1
    assert M.shape == K.shape


def test_loads_with_residual_vectors_miss_nothing(box):
    fe, interfaces = box
    loads = make_loads(fe, {"poke": {"type": "force", "node": 17, "force": [1, 2, 3]}})
    for method in (craig_bampton, free_interface):
        found = method(fe, interfaces, 2, loads=loads)
        report = quality_report(fe, found, orthonormalise(fe, found))
        assert abs(report.static.missing[0]) < 1e-9


def test_effective_masses_of_all_modes_add_up(bar):
    """Axially clamped at both ends, all inner modes: what is left is the ends' own mass, for a
    linear bar element m/n times 2 (1/3) less 2 (1/6)^2-terms: from full matrices."""
    fe, interfaces = bar
    found = craig_bampton(fe, interfaces, 42)
    effective = quality_report(fe, found, orthonormalise(fe, found)).effective
    assert effective.interface.sum() == pytest.approx(1, rel=1e-8)
    b = np.concatenate([part.dofs for part in interfaces])
    i = np.setdiff1d(np.arange(fe.numbering.n), b)
    M = fe.M.toarray()
    left = M[np.ix_(b, b)] - M[np.ix_(b, i)] @ np.linalg.solve(M[np.ix_(i, i)], M[np.ix_(i, b)])
    R = fe.rigid[b]
    rest = np.diag(R.T @ left @ R) / np.diag(fe.rigid.T @ M @ fe.rigid)
    np.testing.assert_allclose(effective.share.sum(axis=0), 1 - rest, rtol=1e-7)
    assert 0.8 < effective.share.sum(axis=0)[0] < 1


def test_energy_shares_add_up_and_are_those_of_the_fields(box):
    fe, interfaces = box
    elastic = orthonormalise(fe, found := craig_bampton(fe, interfaces, 4))
    shares = quality_report(fe, found, elastic).shares
    assert shares.kinds == ("constraint", "fixed-interface")
    np.testing.assert_allclose(shares.strain.sum(axis=1), 1, atol=1e-9)
    np.testing.assert_allclose(shares.direction.sum(axis=1), 1, atol=1e-9)
    static = found.basis[:, :12] @ elastic.Z[:12]
    energy = np.sum(static * (fe.K @ static), axis=0) / elastic.omega2
    np.testing.assert_allclose(shares.strain[:, 0], energy, atol=1e-7)
    kinetic = np.sum(elastic.Z[:12] * (found.M @ elastic.Z)[:12], axis=0)
    np.testing.assert_allclose(shares.strain[:, 0], kinetic, atol=1e-7)


def test_mass_and_inertia_of_a_bar(bar):
    """rho A L, and for the section of 0.03 x 0.05 the moments of a brick."""
    fe, interfaces = bar
    found = guyan(fe, interfaces)
    check = quality_report(fe, found, orthonormalise(fe, found)).inertia
    m = STEEL.density * 0.03 * 0.05
    a, b = 0.03**2, 0.05**2
    wanted = [m, 0.5, 0, 0, m * (a + b) / 12, m * (1 + b) / 12, m * (1 + a) / 12, 0, 0, 0]
    np.testing.assert_allclose(check.matrix, wanted, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(check.integrals, wanted, rtol=1e-10, atol=1e-12)
    assert check.error < 1e-12


def test_a_body_without_interfaces_and_one_in_a_plane():
    fe = assemble(mirrored_block(), STEEL)
    found = free_modes(fe, (), 5)
    report = quality_report(fe, found, orthonormalise(fe, found), nodes=[3])
    np.testing.assert_allclose(report.frequencies.error, 0, atol=1e-8)
    assert report.static.interfaces is None
    assert report.effective is None
    mirror = make_symmetry_plane(fe, "xy")
    interfaces = make_interfaces(fe, {"a": "x0", "b": "x1"})
    found = craig_bampton(fe, interfaces, 6, mirror=mirror)
    report = quality_report(fe, found, orthonormalise(fe, found), nodes=[3], mirror=mirror)
    assert len(report.frequencies.full) == 5
    np.testing.assert_allclose(report.frequencies.error[:3], 0, atol=2e-2)
    assert report.static.interfaces < 1e-8
    assert len(report.static.labels) == 2


def test_tables_and_text(box):
    fe, interfaces = box
    watch = Stopwatch()
    found = craig_bampton(fe, interfaces, 4, watch)
    elastic = orthonormalise(fe, found)
    report = quality_report(fe, found, elastic, nodes=[17], phases=watch.phases)
    tables = report_tables(report)
    titles = [table.title for table in tables]
    assert titles[0] == "In short"
    assert titles[-1] == "Time and memory"
    assert len(titles) == 8
    for table in tables:
        assert all(len(row) == len(table.columns) for row in table.rows)
    text = report_text(report)
    assert "fixed-interface 4" in text
    assert "node 17 Ty" in text
    assert f"{report.frequencies.full[0]:.6g}" in text
    assert max(len(row) for row in text.splitlines()) < 170


def test_a_stopwatch_charges_time_to_phases_and_passes_calls_on():
    told = []
    watch = Stopwatch(lambda phase, fraction, detail="": told.append((phase, fraction)))
    watch("one", 0.0)
    time.sleep(0.02)
    watch("one", 1.0)
    time.sleep(0.03)
    watch("two", 0.0)
    watch("two", 1.0)
    phases = {phase.name: phase for phase in watch.phases}
    assert list(phases) == ["one", "two", "other"]
    assert phases["one"].wall >= 0.02
    assert phases["other"].wall >= 0.03
    assert phases["two"].wall < 0.02
    assert phases["one"].peak > 1e6
    assert told == [("one", 0.0), ("one", 1.0), ("two", 0.0), ("two", 1.0)]


def test_unit_loads_need_nodes_of_the_body(bar):
    fe, interfaces = bar
    elastic = orthonormalise(fe, found := guyan(fe, interfaces))
    with pytest.raises(ReductionError, match="node 99 is no node of the body"):
        quality_report(fe, found, elastic, nodes=[99])
