"""Different descriptions of one mechanism accelerate alike."""

from __future__ import annotations

import numpy as np
import pytest
from enginekit import Bench, exponential, quaternion_product, rotation
from generators import BODIES, TOPOLOGIES, Cloud, Mechanism, cloud, interface, random_rotation

from flexmb.flexbody import Interface
from flexmb.model import Model

# Solves are refined to round-off times the condition of the mechanism (below 1e6 here).
SOLVED = 1e-9


def quaternion(A):
    """Euler parameters of a rotation matrix."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    axis = vectors[:, -1]  # eigenvalue one
    side = vectors[:, 0]
    turned = A @ side
    angle = np.arctan2(axis @ np.cross(side, turned), side @ turned)
    return exponential(angle * axis)


def same(found, wanted, tolerance=SOLVED):
    np.testing.assert_allclose(found, wanted, atol=tolerance * np.abs(wanted).max())


@pytest.mark.parametrize("bodies", BODIES)
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_the_world_may_be_turned_and_shifted(topology, bodies):
    rng = np.random.default_rng(0)
    Q, shift = random_rotation(rng), np.array([3.0, -1.0, 2.0])
    still = Bench(Mechanism(9, topology, bodies).model)
    turned = Bench(Mechanism(9, topology, bodies, turn=Q, shift=shift).model)
    still.randomise(10)
    turned.state.t[:] = still.state.t
    turned.q[:], turned.v[:] = still.q, still.v
    wanted_vd, wanted_lam = still.accelerations()
    for row in still.sys.parts.bodies:
        i, o = int(row["iq"]), int(row["iv"])
        turned.q[i : i + 3] = Q @ still.q[i : i + 3] + shift
        turned.q[i + 3 : i + 7] = quaternion_product(quaternion(Q), still.q[i + 3 : i + 7])
        turned.v[o : o + 3] = Q @ still.v[o : o + 3]
        wanted_vd[o : o + 3] = Q @ wanted_vd[o : o + 3]
    vd, lam = turned.accelerations()
    same(vd, wanted_vd, 1e-8)
    assert np.linalg.norm(lam) == pytest.approx(np.linalg.norm(wanted_lam), rel=1e-8)
    np.testing.assert_allclose(turned.at().energies[[0, 1, 3]], still.at().energies[[0, 1, 3]])


def test_a_body_without_modes_is_a_rigid_body():
    benches = [Bench(Mechanism(11, "tree", kind).model) for kind in ("rigid", "modeless")]
    rigid, modeless = benches
    assert (modeless.sys.parts.markers["modes"] == -1).all()
    for bench in benches:
        bench.randomise(12)
    same(modeless.at().residual, rigid.at().residual, 1e-14)
    for found, wanted in zip(modeless.accelerations(), rigid.accelerations(), strict=True):
        same(found, wanted, 1e-12)


def unrotating_interface(rng, name, m):
    """An interface that the modes move and do not turn."""
    plain = interface(rng, name, m)
    return Interface(name, plain.position, plain.Phi_t, 0.0 * plain.Phi_r)


def joined(host, end, guest, shift, R):
    """The host with the guest's points fixed to its interface: they move as it does."""
    at = end.position + shift + guest.s @ R.T
    N = np.concatenate([host.N, np.broadcast_to(end.Phi_t, (len(at), *end.Phi_t.shape))])
    return Cloud(
        np.concatenate([host.mass, guest.mass]), np.concatenate([host.s, at]), N, host.K, host.D
    )


@pytest.mark.parametrize("m", [0, 3])
def test_two_welded_bodies_are_one(m):
    rng = np.random.default_rng(13)
    host, guest, end = cloud(rng, m), cloud(rng), unrotating_interface(rng, "a", m)
    shift, R = rng.standard_normal(3), random_rotation(rng)

    def add(model, points, name):
        if m:
            model.add_body(name, points.flexbody(name, [end]))
            model.add_marker(f"{name}.end", interface="a")
        else:
            model.add_body(name, **points.rigid_fields())
            model.add_marker(f"{name}.end", position=list(end.position))
        model.add_force("pull", "force", at=f"{name}.end", value=[3, 4, "sin(t)"])

    two, one = Model("two", gravity=[0, 1, -9]), Model("one", gravity=[0, 1, -9])
    add(two, host, "host")
    add(one, joined(host, end, guest, shift, R), "host")
    two.add_body(
        "guest", **guest.rigid_fields(), position=list(end.position + shift), orientation=R.tolist()
    )
    two.add_marker("guest.end", position=list(-R.T @ shift), orientation=R.T.tolist())
    two.add_joint("weld", "fixed", between=["host.end", "guest.end"])
    two, one = Bench(two), Bench(one)
    one.randomise(14)
    nq, nv = one.layout.nq, one.layout.nv
    two.state.t[:] = one.state.t
    two.q[:nq], two.v[:nv] = one.q, one.v
    # put the guest where the weld wants it
    A = rotation(one.q[3:7])
    s = end.position + end.Phi_t @ one.q[7:] + shift
    ds = end.Phi_t @ one.v[6:]
    w = one.v[3:6]
    two.q[nq : nq + 3] = one.q[:3] + A @ s
    two.q[nq + 3 :] = quaternion_product(one.q[3:7], quaternion(R))
    two.v[nv : nv + 3] = one.v[:3] + A @ (np.cross(w, s) + ds)
    two.v[nv + 3 :] = R.T @ w
    two.at()
    np.testing.assert_allclose(two.C, 0.0, atol=1e-13)
    np.testing.assert_allclose(two.rate, 0.0, atol=1e-12)
    wanted, _ = one.accelerations()
    found, lam = two.accelerations()
    same(found[:nv], wanted)
    # The weld's force on the guest is what its mass needs, by M v̇ + Cqᵀ λ = Q.
    c = guest.center
    v, vd, B = two.v[nv:], found[nv:], rotation(two.q[nq + 3 : nq + 7])
    a = vd[:3] + B @ (np.cross(vd[3:], c) + np.cross(v[3:], np.cross(v[3:], c)))
    force = guest.mass.sum() * (a - two.sys.parts.gravity)
    same(-lam[:3], force)


def test_units_do_not_matter():
    """The same in millimetres and tonnes: lengths times 1000, masses over 1000."""
    rng = np.random.default_rng(15)
    points, end = cloud(rng), rng.standard_normal(3)
    found = []
    for length, mass in ((1.0, 1.0), (1e3, 1e-3), (1e-3, 1e6)):
        scaled = Cloud(mass * points.mass, length * points.s, points.N, points.K, points.D)
        model = Model("pendulum", gravity=[0, 0, -9.81 * length])
        for name in ("a", "b"):
            model.add_body(name, **scaled.rigid_fields())
            model.add_marker(f"{name}.end", position=list(length * end))
        model.add_joint("top", "revolute", between=["ground", "a"], axis="y")
        model.add_joint("middle", "spherical", between=["a.end", "b.end"])
        bench = Bench(model)
        bench.v[3:6] = 0.0, 1.0, 0.0
        bench.project()
        vd, lam = bench.accelerations()
        per = np.tile(np.repeat([length, 1.0], 3), 2)
        force = mass * length * np.array([1, 1, 1, length, length, 1, 1, 1])
        found.append((vd / per, lam / force))
        assert bench.replaced == 0
    for vd, lam in found[1:]:
        same(vd, found[0][0], 1e-11)
        same(lam, found[0][1], 1e-11)
