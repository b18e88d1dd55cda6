"""Shafts that whirl while they turn about themselves, and what their modes lack.

Truth: Rayleigh's beam by Hermite's shapes with gyroscopic forces in axes that do not turn (Nelson,
J. Mech. Design 102 (1980) 793); accelerations of the points of a mesh by differences in time.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eig, eigh
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from flexmb.analysis.validity.body_accelerations import BodyAccelerations
from flexmb.fe import assemble, mesh_from, reduce
from flexmb.fe.sections.section_tables import resolve
from flexmb.flexbody import FlexBody
from flexmb.model import Model
from flexmb.results import Result
from flexmb.workflow.run import run_single

E, RHO, L, D = 2.1e11, 7850.0, 1.0, 0.02  # of the shaft, pinned at both ends
AREA, SECOND = np.pi * D**2 / 4, np.pi * D**4 / 64
PLACE, N = 0.3, 20  # of the disc; elements
PULSE, KICK = 0.02, 200.0  # s, N
SHORT = "its modes lack", "for want of modes"


def disc_of(mass):
    """Moments of inertia of a disc about its axis, and across it."""
    return 0.02 * mass, 0.01 * mass


def motion_of_disc(t, speed, mass):
    """(t, 2) across the shaft, after a pulse KICK sin²(πt/PULSE) on the disc along y."""
    h, about, across = L / N, *disc_of(mass)
    # fmt: off
    bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                     [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]])
    move = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                     [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]])
    turn = np.array([[36, 3 * h, -36, 3 * h], [3 * h, 4 * h * h, -3 * h, -h * h],
                     [-36, -3 * h, 36, -3 * h], [3 * h, -h * h, -3 * h, 4 * h * h]])
    # fmt: on
    K, M, G = (np.zeros((2 * N + 2, 2 * N + 2)) for _ in range(3))
    for k in range(N):
        own = np.ix_(range(2 * k, 2 * k + 4), range(2 * k, 2 * k + 4))
        K[own] += E * SECOND / h**3 * bend
        M[own] += RHO * AREA * h / 420 * move + RHO * SECOND / (30 * h) * turn
        G[own] += 2 * RHO * SECOND / (30 * h) * turn
    at = 2 * round(PLACE / h)
    M[at, at], M[at + 1, at + 1] = M[at, at] + mass, M[at + 1, at + 1] + across
    G[at + 1, at + 1] += about
    free = [k for k in range(2 * N + 2) if k not in (0, 2 * N)]
    K, M, G = (X[np.ix_(free, free)] for X in (K, M, G))
    squares, V = eigh(K, M, subset_by_index=[0, 11])  # y + iz by these
    b, gyro = V[free.index(at)], V.T @ G @ V
    rates, X = eig(
        np.block([[np.zeros((12, 12)), np.eye(12)], [-np.diag(squares), 1j * speed * gyro]])
    )
    kicks = np.linalg.solve(X, np.append(np.zeros(12), b))
    tau = (np.arange(4000) + 0.5) * PULSE / 4000
    force = KICK * np.sin(np.pi * tau / PULSE) ** 2 * PULSE / 4000
    sizes = [(np.exp(np.outer(ti - tau, rates)) * (force * (tau < ti))[:, None]).sum(0) for ti in t]
    w = np.array(sizes) * kicks @ X[:12].T @ b
    return np.column_stack([w.real, w.imag])


def ran(folder, speed, mass, modes, outputs=500):
    """The shaft with its disc, which turns freely; its notes."""
    model = Model("rotor")
    about, across = disc_of(mass)
    model.add_body(
        "shaft", mesh={"type": "beam", "length": L, "divisions": N}, modes=modes, stress="none",
        material={"E": E, "nu": 0.3, "density": RHO},
        sections={"all": {"type": "circle", "radius": D / 2, "shear": False}},
        interfaces={"left": "start", "right": "end",
                    "place": {"center": [PLACE, 0, 0], "radius": 1e-3}},
        angular_velocity=[speed, 0, 0], geometric_stiffening="full",
    )  # fmt: skip
    model.add_body("disc", mass=mass, inertia=[about, across, across], position=[PLACE, 0, 0],
                   angular_velocity=[speed, 0, 0])  # fmt: skip
    model.add_marker("ground.right", position=[L, 0, 0])
    model.add_joint("left", "spherical", between=["ground", "shaft.left"])
    model.add_joint("right", "in-line", between=["ground.right", "shaft.right"], axis="x")
    model.add_joint("seat", "fixed", between=["shaft.place", "disc"])
    pulse = f"{KICK}*sin(pi*min(t, {PULSE})/{PULSE})**2"
    model.add_force("kick", type="force", at="disc", axes="global", value=[0, pulse, 0])
    model.add_sensor("disc", "position", of="disc")
    model.set_dynamics(duration=0.5, outputs=outputs, accuracy=1e-5)
    report = run_single(model, folder, pictures=False)
    result = Result(report.result)
    moved = np.column_stack([result["disc.y"], result["disc.z"]])
    truth = motion_of_disc(result.time, speed, mass)
    error = np.abs(moved - truth).max() / np.ptp(truth)
    return error, [note for note in report.notes if any(words in note for words in SHORT)]


MIDDLE = pytest.param(300.0, marks=pytest.mark.slow)


@pytest.mark.seconds
@pytest.mark.parametrize("speed", [MIDDLE, 1500.0])  # rad/s; it whirls with 40 to 160
def test_a_shaft_whirls_as_in_axes_that_stand_still_and_is_told_no_error(speed, tmp_path):
    error, notes = ran(tmp_path, speed, mass=10.0, modes=4)
    assert error < 5e-4
    assert not notes


@pytest.mark.seconds
@pytest.mark.parametrize("speed", [0.0, MIDDLE, 1500.0])
def test_what_a_shaft_that_whirls_lacks_is_told_at_any_speed(speed, tmp_path):
    """A heavy shaft without vibrations of its own, which whirls with 33 Hz."""
    error, notes = ran(tmp_path, speed, mass=1.0, modes=0)
    assert error > 0.15
    (note,) = (one for one in notes if SHORT[1] in one)
    assert float(note.split("is off by about ")[1].split(" %")[0]) / 100 == pytest.approx(
        error, rel=0.4
    )
    assert float(note.split("scene, ")[1].split(" Hz")[0]) == pytest.approx(33.0, abs=4.0)


def test_a_vibration_of_a_machine_that_turns_freely_is_named_not_its_rotation(tmp_path):
    """A bar on a hub with a mass at its end, pushed at 48 Hz; Euler's bar has `wanted`."""
    hub, mass, across, (force, pushed) = 0.03, 0.2, 3e-4, (20.0, 302.0)

    def closure(omega):
        b = (RHO * AREA * omega**2 / (E * SECOND)) ** 0.25
        s, c, sh, ch = np.sin(b * L), np.cos(b * L), np.sinh(b * L), np.cosh(b * L)
        w = np.array([[0, 1, 0, 1], [s, c, sh, ch]])
        slope, bend = b * np.array([[1, 0, 1, 0], [c, -s, ch, sh]]), b * b * w * [-1, -1, 1, 1]
        shear = b**3 * np.array([-c, s, ch, sh])
        stiff, square = E * SECOND, omega**2
        return np.linalg.det([w[0], stiff * bend[0] + square * hub * slope[0],
                              stiff * bend[1] - square * across * slope[1],
                              stiff * shear + square * mass * w[1]])  # fmt: skip

    wanted = brentq(closure, 200.0, 400.0) / (2 * np.pi)
    model = Model("bar on a hub")
    model.add_body("hub", mass=1.0, inertia=[hub] * 3)
    model.add_body("bar", mesh={"type": "beam", "length": L, "divisions": N}, modes=0,
                   stress="none", material={"E": E, "nu": 0.3, "density": RHO},
                   sections={"all": {"type": "circle", "radius": D / 2, "shear": False}},
                   interfaces={"root": "start", "tip": "end"})  # fmt: skip
    model.add_body("mass", mass=mass, inertia=[across] * 3, position=[L, 0, 0])
    model.add_joint("axle", "revolute", between=["ground", "hub"], axis="z")
    model.add_joint("seat", "fixed", between=["hub", "bar.root"])
    model.add_joint("end", "fixed", between=["bar.tip", "mass"])
    push = f"{force}*sin({pushed}*t)"
    model.add_force("push", type="force", at="mass", axes="global", value=[0, push, 0])
    model.add_sensor("mass", "position", of="mass")
    model.set_validity(inertia_loads="any", truncation="any")
    model.set_dynamics(duration=1.0, outputs=500, accuracy=1e-5)
    notes = run_single(model, tmp_path, pictures=False).notes
    (note,) = (one for one in notes if SHORT[1] in one)
    assert float(note.split("scene, ")[1].split(" Hz")[0]) == pytest.approx(wanted, rel=0.01)


BLOCK = {"type": "box", "size": [0.5, 0.06, 0.04], "divisions": [6, 2, 2]}


@pytest.fixture(scope="module")
def block():
    return reduce(BLOCK, material="steel", modes=6, interfaces={"root": "x0"})


def test_accelerations_are_those_of_the_points_of_the_mesh(block):
    """Inertia forces on all motions: those of r + A (s + Φ η), twice differentiated in time."""
    fe = assemble(mesh_from(BLOCK), resolve("steel"))
    rng = np.random.default_rng(3)
    eta, rates, further = 1e-3 * rng.normal(size=(3, block.m)) * [[1], [2e2], [4e4]]
    omega, alpha, drift, pull = 40 * rng.normal(size=3), 1e3 * rng.normal(size=3), 3.0, 50.0
    turned = Rotation.from_rotvec([0.3, -0.5, 0.8])
    places, Phi = block.nodes.position, block.nodes.Phi_t

    def points(t):
        """In global axes; with ω and α in body axes at t = 0."""
        spin = Rotation.from_rotvec(omega * t + 0.5 * alpha * t**2)
        moved = places + Phi @ (eta + rates * t + 0.5 * further * t**2)
        return (turned * spin).apply(moved) + [drift * t + 0.5 * pull * t**2, 0, 0]

    h = 1e-4
    steps = [(-2, -1 / 12), (-1, 4 / 3), (0, -5 / 2), (1, 4 / 3), (2, -1 / 12)]
    a = turned.inv().apply(sum(c * points(k * h) for k, c in steps) / h**2)
    columns = SimpleNamespace(iq=0, iv=0, m=block.m)
    q = np.concatenate([np.zeros(3), np.roll(turned.as_quat(), 1), eta])
    v = np.concatenate([[drift, 0, 0], omega, rates])
    vd = np.concatenate([[pull, 0, 0], alpha, further])
    accelerations = BodyAccelerations(columns, block, np.zeros(3))
    rows = SimpleNamespace(q=q[None], v=v[None], vd=vd[None])
    x = accelerations.of_material(rows)[0]

    def force(field):
        """On the motions of the body, by the mass matrix of the mesh."""
        loads = np.zeros(fe.numbering.n)
        loads[fe.numbering.table[:, :3]] = field
        loads = (fe.M @ loads)[fe.numbering.table[:, :3]]
        return np.concatenate([loads.sum(0), np.cross(places, loads).sum(0),
                               np.einsum("nam,na->m", Phi, loads)])  # fmt: skip

    center = block.center
    whole = (x[:3] - np.cross(omega, np.cross(omega, center))
             + np.cross(x[3:6], places - center)
             + np.cross(omega, np.cross(omega, places)) + Phi @ x[12:])  # fmt: skip
    wanted = force(a)
    np.testing.assert_allclose(force(whole), wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max())


def test_forces_in_axes_that_turn_keep_their_direction(block):
    """Of a force at the origin: R⁻¹ f; and turned back it is what it was."""
    accelerations = BodyAccelerations(SimpleNamespace(iq=0, iv=0, m=block.m), block, np.zeros(3))
    rng = np.random.default_rng(4)
    forces, angle = rng.normal(size=(5, 6 + block.m)), 2 * rng.normal(size=(5, 3))
    turned = accelerations.in_turned_axes(forces, angle)
    wanted = Rotation.from_rotvec(angle).inv().apply(forces[:, :3])
    np.testing.assert_allclose(turned[:, :3], wanted, atol=1e-9)
    back = accelerations.in_turned_axes(turned, -angle)
    np.testing.assert_allclose(back, forces, atol=1e-9 * np.abs(turned).max())


def test_masses_on_a_line_have_accelerations_though_none_turns_about_it():
    """Inertia forces of five masses with one mode, as of points that turn and vibrate."""
    x, each = np.linspace(-0.5, 0.5, 5)[:, None] * [0.6, 0.8, 0.0], 0.2
    Phi = np.array([1, -0.6, -0.8, -0.6, 1])[:, None, None] * np.array([-0.8, 0.6, 0])[:, None]
    Mab = each * np.einsum("kai,kbj->abij", Phi, Phi)
    line = FlexBody("line", 5 * each, np.zeros(3), each * x.T @ x, each * Phi.sum(0),
                    each * np.einsum("ka,kbi->abi", x, Phi), Mab, [[1e4]])  # fmt: skip
    omega, alpha, eta, rate, further = [3.0, -2, 5], [40.0, 10, -20], 1e-3, 0.4, 70.0
    columns = SimpleNamespace(iq=0, iv=0, m=1)
    rows = SimpleNamespace(q=np.array([[0, 0, 0, 1, 0, 0, 0, eta]], float),
                           v=np.array([[0, 0, 0, *omega, rate]]),
                           vd=np.array([[0, 0, 0, *alpha, further]]))  # fmt: skip
    own = BodyAccelerations(columns, line, np.zeros(3)).of_material(rows)[0]
    moved, turned = x + Phi[..., 0] * eta, np.cross(omega, Phi[..., 0] * rate)
    a = np.cross(alpha, moved) + np.cross(omega, np.cross(omega, moved))
    a = a + 2 * turned + Phi[..., 0] * further
    about = np.cross(own[3:6], x) + np.cross(omega, np.cross(omega, x)) + Phi[..., 0] * own[12]
    for arms in (np.tile(np.eye(3)[:, None], (5, 1)), np.cross(np.eye(3)[:, None], x)):
        np.testing.assert_allclose((arms * (about + own[:3])).sum((1, 2)), (arms * a).sum((1, 2)),
                                   atol=1e-9)  # fmt: skip
    np.testing.assert_allclose((Phi[..., 0] * about).sum(), (Phi[..., 0] * a).sum(), atol=1e-9)
