"""What a reduction must fulfil exactly, for rigid, weighted and mixed interfaces, solids and beams.

The statements are those on Craig-Bampton reduction that follow from its definition (Craig, Bampton,
AIAA Journal 6(7), 1968): each is checked against full matrices of the unreduced tied model.
"""

from __future__ import annotations

import numpy as np
import pytest
from femeshes import block, line, tied
from scipy.linalg import block_diag, eigh, null_space

from flexmb.fe import (
    Mesh,
    assemble,
    craig_bampton,
    free_interface,
    guyan,
    make_interfaces,
    orthonormalise,
    rectangle,
    resolve,
)
from flexmb.fe.assembly.interfaces import RigidInterface
from flexmb.fe.meshes.mesh_shapes import plate
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel, interface_shares
from flexmb.fe.sections.shell_section import shell

STEEL = resolve("steel")
SPATIAL = (0, 1, 2, 3, 4, 5)
LOOSE = {"group": "x1", "type": "rbe3"}


def solid(**interfaces):
    fe = assemble(block((2, 1, 1), (2, 0.8, 1.1), distort=0.2), STEEL)
    return fe, make_interfaces(fe, interfaces)


def rigid():
    return solid(left="x0", right="x1")


def weighted():
    return solid(left={"group": "x0", "type": "rbe3"}, right=LOOSE)


def mixed():
    return solid(left="x0", right=LOOSE)


def beams():
    sections = {"all": rectangle(0.03, 0.05, orientation=(0, 0, 1))}
    fe = assemble(line(8, (0, 0, 0), (0.6, 0.3, 0.6)), STEEL, sections)
    return fe, make_interfaces(fe, {"root": "root", "tip": {"group": "tip", "type": "rbe3"}})


def solid_and_beam():
    """A block and a beam that an rbe2 tie seats on it: with degrees of freedom that follow."""
    solid, beam = block((1, 1, 1), (1, 0.1, 0.2)), line(2, (1, 0.05, 0.1), (2, 0.05, 0.1))
    n = len(solid.points)
    sets = {name: nodes + n for name, nodes in beam.node_sets.items()}
    cells = {**solid.blocks, "line": beam.blocks["line"] + n}
    mesh = Mesh(np.vstack([solid.points, beam.points]), cells, sets, solid.element_sets)
    seat = {"seat": {"type": "rbe2", "reference": "root", "nodes": "x1"}}
    fe = assemble(mesh, STEEL, {"all": rectangle(0.1, 0.2)}, ties=seat)
    return fe, make_interfaces(fe, {"left": {"group": "x0", "type": "rbe3"}, "tip": "tip"})


def shells():
    """Edges: their nodes lie on a line and hold by their rotations."""
    fe = assemble(plate(1.0, 0.6, divisions=(4, 2), skew=0.2), STEEL, {"all": shell(0.02)})
    return fe, make_interfaces(fe, {"a": "x0", "b": {"group": "x1", "type": "rbe3"}})


MODELS = [rigid, weighted, mixed, beams, solid_and_beam, shells]


@pytest.fixture(params=MODELS, ids=[model.__name__ for model in MODELS], scope="module")
def model(request):
    return request.param()


def full(fe, interfaces):
    """Matrices of the tied model over x, its fields u = G x, and B of the interfaces' motion."""
    stiff = [part for part in interfaces if isinstance(part, RigidInterface)]
    G = tied(fe, stiff) if stiff else np.eye(fe.numbering.n)
    rows, k = [], 0
    for part in interfaces:
        if isinstance(part, RigidInterface):
            rows.append(np.eye(G.shape[1])[6 * k : 6 * k + 6])
            k += 1
        else:
            rows.append(part.W @ G[part.dofs])
    return G.T @ (fe.K @ G), G.T @ (fe.M @ G), G, np.concatenate(rows)


def held_modes(K, M, B):
    """Squared frequencies and modes of the model with its interfaces held, all of them."""
    N = null_space(B)
    omega2, V = eigh(N.T @ K @ N, N.T @ M @ N)
    return omega2, N @ V


def compliance(fe, interfaces):
    """Exact compliance at the interfaces for the loads Q without resultant: its matrix, and Q."""
    K, _, _, B = full(fe, interfaces)
    Q = null_space(rigid_motion(fe, interfaces).T)
    scale = 1 / np.sqrt(np.diag(K))
    inverse = np.linalg.pinv(scale[:, None] * K * scale, rcond=1e-11, hermitian=True)
    BQ = scale[:, None] * (B.T @ Q)
    return BQ.T @ inverse @ BQ, Q


def rigid_motion(fe, interfaces):
    """(6 i, 6) motion of the interfaces in rigid motions about the centre of mass."""
    R = np.zeros((6 * len(interfaces), 6))
    for k, part in enumerate(interfaces):
        x, y, z = part.position - fe.center
        R[6 * k : 6 * k + 6] = np.eye(6)
        R[6 * k : 6 * k + 3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    return R


def test_stiffness_is_block_diagonal_and_the_matrices_are_those_of_the_fields(model):
    fe, interfaces = model
    found = craig_bampton(fe, interfaces, 5)
    K = found.basis.T @ (fe.K @ found.basis)
    scale = 1 / np.sqrt(np.diag(K))
    np.testing.assert_allclose(scale[:, None] * (K - found.K) * scale, 0, atol=1e-9)
    assert not found.K[:12, 12:].any()
    M = found.basis.T @ (fe.M @ found.basis)
    np.testing.assert_allclose(found.M, M, atol=1e-14 * np.abs(M).max())


def test_interfaces_move_as_their_coordinates_say(model):
    """W Psi = 1 and W Phi = 0: to rounding, also where K alone is singular."""
    fe, interfaces = model
    found = craig_bampton(fe, interfaces, 5)
    size = np.abs(found.basis).max(axis=0)
    for part, motion in zip(interfaces, found.motion, strict=True):
        np.testing.assert_allclose(part.motion(found.basis) / size, motion / size, atol=1e-12)
    wanted = np.eye(12, 17).reshape(2, 6, 17)
    np.testing.assert_array_equal(found.motion, wanted)


def test_static_stiffness_has_the_rigid_motions_alone_as_null_space(model):
    fe, interfaces = model
    found = guyan(fe, interfaces)
    np.testing.assert_allclose(found.basis @ found.rigid, fe.rigid, atol=1e-9)
    scale = 1 / np.sqrt(np.diag(found.K))
    values = np.linalg.eigvalsh(scale[:, None] * found.K * scale)
    assert np.abs(values[:6]).max() < 1e-9 < 1e-6 < values[6]


def test_mass_reproduces_that_of_the_whole_body(model):
    fe, interfaces = model
    found = craig_bampton(fe, interfaces, 3)
    wanted = fe.rigid.T @ (fe.M @ fe.rigid)
    size = np.sqrt(np.diag(wanted))
    got = found.rigid.T @ found.M @ found.rigid
    np.testing.assert_allclose(got / np.outer(size, size), wanted / np.outer(size, size), atol=1e-9)


def test_fixed_interface_modes_are_those_of_the_held_model(model):
    fe, interfaces = model
    found = craig_bampton(fe, interfaces, 6)
    K, M, _, B = full(fe, interfaces)
    wanted = held_modes(K, M, B)[0][:6]
    np.testing.assert_allclose(np.diag(found.K)[12:], wanted, rtol=1e-7)
    np.testing.assert_allclose(eigh(found.K[12:, 12:], found.M[12:, 12:])[0], wanted, rtol=1e-7)


def test_all_modes_give_the_full_model(model):
    fe, interfaces = model
    K, M, _, B = full(fe, interfaces)
    found = craig_bampton(fe, interfaces, len(K) - 12)
    wanted = eigh(K, M, eigvals_only=True)[6:]
    np.testing.assert_allclose(orthonormalise(fe, found).omega2, wanted, rtol=2e-7)


def test_frequencies_are_bounds_that_fall_with_the_number_of_modes(model):
    fe, interfaces = model
    K, M, _, _ = full(fe, interfaces)
    wanted = eigh(K, M, eigvals_only=True)[6:12]
    found = [orthonormalise(fe, craig_bampton(fe, interfaces, k)).omega2[:6] for k in (0, 3, 8, 16)]
    for more, fewer in zip(found[1:], found, strict=False):
        assert (more <= fewer * (1 + 1e-9)).all()
    assert (found[-1] >= wanted * (1 - 1e-8)).all()


@pytest.mark.parametrize(
    ("method", "modes"), [(craig_bampton, 4), (guyan, 0), (free_interface, 0), (free_interface, 5)]
)
def test_compliance_at_the_interfaces_is_exact(model, method, modes):
    """For loads without resultant, whatever the number of modes."""
    fe, interfaces = model
    wanted, Q = compliance(fe, interfaces)
    elastic = orthonormalise(fe, (found := method(fe, interfaces, modes)))
    motion = (found.motion @ elastic.Z).reshape(12, -1)
    got = Q.T @ (motion / elastic.omega2) @ motion.T @ Q
    scale = 1 / np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(scale[:, None] * (got - wanted) * scale, 0, atol=1e-8)


def test_effective_interface_mass_of_all_modes_adds_up(model):
    """Sum over all k of P_k^T P_k = X^T M_ii^-1 X; for rigid motion of the interfaces it is what
    the body's mass is more than that of the interfaces with the inside following by inertia."""
    fe, interfaces = model
    K, M, G, B = full(fe, interfaces)
    held = FixedInterfaceModel(fe, interfaces, SPATIAL)
    psi = np.linalg.lstsq(G, held.modes, rcond=None)[0]
    _, V = held_modes(K, M, B)
    P = V.T @ M @ psi
    N = null_space(B)
    X = N.T @ M @ psi
    total = X.T @ np.linalg.solve(N.T @ M @ N, X)
    size = np.sqrt(np.diag(psi.T @ M @ psi))
    np.testing.assert_allclose(
        P.T @ P / np.outer(size, size), total / np.outer(size, size), atol=1e-9
    )
    inside = (G @ V)[held.dofs]
    shares = interface_shares(held, inside)
    assert shares.sum() == pytest.approx(1.0, rel=1e-9)
    assert (shares >= 0).all()
    R = rigid_motion(fe, interfaces)
    translation = (P @ R[:, :1]) ** 2
    whole = fe.inertia.mass
    left = R[:, 0] @ (psi.T @ M @ psi - total) @ R[:, 0]
    assert translation.sum() == pytest.approx(whole - left, rel=1e-9)


def test_free_interface_count_and_frequencies(model):
    """The free modes that were kept are there exactly; each interface adds six coordinates."""
    fe, interfaces = model
    K, M, _, _ = full(fe, interfaces)
    wanted = eigh(K, M, eigvals_only=True)[6:11]
    elastic = orthonormalise(fe, free_interface(fe, interfaces, 5))
    assert len(elastic.omega2) == 5 + 12
    np.testing.assert_allclose(elastic.omega2[:5], wanted, rtol=1e-7)


def test_two_bodies_with_all_modes_coupled_are_the_assembled_model():
    """A beam cut in two: reduced parts, joined at the cut, have the frequencies of the whole."""
    section = {"all": rectangle(0.03, 0.05)}
    parts = []
    for ends in (((0, 0, 0), (0.5, 0, 0)), ((0.5, 0, 0), (1, 0, 0))):
        fe = assemble(line(4, *ends), STEEL, section)
        cut = "tip" if ends[0] == (0, 0, 0) else "root"
        parts.append(craig_bampton(fe, make_interfaces(fe, {"cut": cut}), 24))
    K, M = (block_diag(*(getattr(part, name) for part in parts)) for name in "KM")
    join = np.zeros((60, 54))
    join[:30, :30] = np.eye(30)
    join[30:36, :6] = np.eye(6)
    join[36:, 30:] = np.eye(24)
    got = eigh(join.T @ K @ join, join.T @ M @ join, eigvals_only=True)[6:]
    whole = assemble(line(8), STEEL, section)
    wanted = eigh(whole.K.toarray(), whole.M.toarray(), eigvals_only=True)[6:]
    np.testing.assert_allclose(got, wanted, rtol=1e-8)


def test_weighted_interfaces_are_softer_than_rigid_ones():
    """An rbe2 only takes motions away: its frequencies bound those of the same body with rbe3, free
    and held, and an rbe3 leaves the free body as it is."""
    frequencies, held = {}, {}
    for name, make in {"rbe2": rigid, "rbe3": weighted}.items():
        fe, interfaces = make()
        K, M, _, B = full(fe, interfaces)
        frequencies[name] = orthonormalise(fe, craig_bampton(fe, interfaces, 40)).omega2[:6]
        held[name] = held_modes(K, M, B)[0][:10]
    assert (frequencies["rbe3"] < frequencies["rbe2"]).all()
    assert (held["rbe3"] < held["rbe2"]).all()
    free = eigh(fe.K.toarray(), fe.M.toarray(), eigvals_only=True)[6:12]
    np.testing.assert_allclose(frequencies["rbe3"], free, rtol=2e-2)
    assert (frequencies["rbe3"] >= free * (1 - 1e-9)).all()
