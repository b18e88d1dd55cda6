"""Bodies that are far from their frames, as parts of an assembly that are all placed at its origin.

The same machine with frames on the bodies is the truth: the motion of a frame follows from it.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from femeshes import line
from scipy.spatial.transform import Rotation

import flexmb
from flexmb.engine.compile import compile_system
from flexmb.fe import rectangle, reduce
from flexmb.flexbody.effects import about_point
from flexmb.model import Model
from flexmb.view.drawing import Drawing
from flexmb.view.mechanism import Mechanism

FAR = np.array([1000.0, -500.0, 800.0])
TILT = Rotation.from_rotvec([0.3, -0.2, 0.5])
METHODS = ["auto", "radau", "generalized-alpha"]


def rotations(p):
    return Rotation.from_quat(np.roll(p, -1, axis=-1))


def add_link(made, name, at, frame, **fields):
    """A link of 1 m along x from `at`, in a frame that is `frame` away from there."""
    away = np.asarray(at, dtype=float) - frame
    made.add_body(name, mass=1.0, inertia=[0.01, 0.1, 0.105], center=list(away + [0.5, 0, 0]),
                  position=list(frame), **fields)  # fmt: skip
    made.add_marker(f"{name}.a", position=list(away))
    made.add_marker(f"{name}.e", position=list(away + [1.0, 0, 0]))


def pendulum(where, frames_at=None):
    """Two links on a pin at `where`; their frames are on their pins or at one point."""
    where = np.asarray(where, dtype=float)
    made = Model("double pendulum", gravity=[0, -9.81, 0])
    made.add_marker("ground.pin", position=list(where))
    for k in range(2):
        at = where + [k, 0, 0]
        add_link(made, f"b{k}", at, at if frames_at is None else np.asarray(frames_at, float))
    made.add_joint("j0", "revolute", between=["ground.pin", "b0.a"], axis="z")
    made.add_joint("j1", "revolute", between=["b0.e", "b1.a"], axis="z")
    made.add_force("spring", "rotational-spring-damper", joint="j1", stiffness=3.0, damping=0.1)
    made.add_sensor("end", "position", of="b1.e", relative_to="ground.pin")
    return made


@pytest.mark.parametrize("where", [FAR, FAR / 100], ids=["1 km", "10 m"])
@pytest.mark.parametrize("method", METHODS)
def test_frames_at_one_point_cost_nothing(method, where):
    knobs = {"duration": 2.0, "outputs": 20, "accuracy": 1e-5, "method": method}
    plain, far = pendulum(where), pendulum(where, [0, 0, 0])
    for made in (plain, far):
        made.set_dynamics(**knobs)
    plain, far = flexmb.simulate(plain), flexmb.simulate(far)
    size = np.ptp(plain["end.x"])
    assert np.abs(far["end.x"] - plain["end.x"]).max() < 4e-5 * size
    assert np.abs(far["end.y"] - plain["end.y"]).max() < 4e-5 * size
    assert far.statistics["steps"] < 1.3 * plain.statistics["steps"]
    assert far.notes == ()


def thrown(arm):
    """A free body whose centre of mass is at `arm` in its frame; the same motion for all."""
    arm = np.asarray(arm, dtype=float)
    spin, speed = np.array([1.0, 2.0, -0.5]), np.array([3.0, 1.0, 4.0])
    made = Model("thrown", gravity=[0, 0, -9.81])
    made.add_body(
        "stone", mass=2.0, inertia=[0.1, 0.2, 0.25], center=list(arm),
        position=list(-TILT.apply(arm)), orientation=TILT.as_matrix().tolist(),
        velocity=list(speed - np.cross(spin, TILT.apply(arm))), angular_velocity=list(spin),
    )  # fmt: skip
    made.set_dynamics(duration=1.0, outputs=10, accuracy=1e-10)
    return made


def test_a_result_holds_the_motion_of_the_frame():
    """r − A c, and its derivatives, c the centre of mass in the frame; velocities begin there."""
    arm = np.array([30.0, -20.0, 10.0])
    assert compile_system(thrown(arm)).layout.references
    plain, far = flexmb.simulate(thrown([0, 0, 0])), flexmb.simulate(thrown(arm))
    A = rotations(plain.q[:, 3:7])
    np.testing.assert_allclose(np.abs((far.q[:, 3:7] * plain.q[:, 3:7]).sum(axis=1)), 1, atol=1e-9)
    w, wd = plain.v[:, 3:6], plain.vd[:, 3:6]
    around = np.cross(w, arm)
    np.testing.assert_allclose(far.q[:, :3], plain.q[:, :3] - A.apply(arm), atol=1e-7)
    np.testing.assert_allclose(far.v[:, :3], plain.v[:, :3] - A.apply(around), atol=1e-6)
    turning = np.cross(wd, arm) + np.cross(w, around)
    np.testing.assert_allclose(far.vd[:, :3], plain.vd[:, :3] - A.apply(turning), atol=1e-6)


def test_a_run_begins_where_another_has_ended(tmp_path):
    first, whole = pendulum(FAR, [0, 0, 0]), pendulum(FAR, [0, 0, 0])
    first.set_dynamics(duration=0.5, outputs=5, accuracy=1e-8)
    whole.set_dynamics(duration=1.0, outputs=10, accuracy=1e-8)
    begun = flexmb.simulate(first, output=tmp_path / "first")
    second = flexmb.simulate(first, start_from=begun, output=tmp_path / "second")
    whole = flexmb.simulate(whole)
    np.testing.assert_allclose(second.q[-1], whole.q[-1], atol=1e-4)  # 1e-8 of a turn at 1400 m
    assert second["end.x"][-1] == pytest.approx(whole["end.x"][-1], abs=1e-7)
    longer = flexmb.resume(begun, duration=1.0)
    assert longer["end.x"][-1] == pytest.approx(whole["end.x"][-1], abs=1e-7)
    np.testing.assert_allclose(longer.v[-1], whole.v[-1], atol=1e-3)


@pytest.mark.seconds
def test_driving_torques_are_those_of_the_machine():
    torques = []
    for frames_at in (None, [0, 0, 0]):
        made = pendulum(FAR, frames_at)
        made.set_dynamics(duration=1.0, outputs=5, accuracy=1e-9)
        run = flexmb.simulate(made)
        for joint, word in (("j0", "low"), ("j1", "high")):
            made.add_driver(word, joint=joint, angle="0")
        found = flexmb.inverse_dynamics(made, run)
        torques.append([found.reaction(f"drivers.{word}").moment[:, 2] for word in ("low", "high")])
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-5)
    assert np.abs(torques[0]).max() < 1e-4  # nothing drives it but its weight


@pytest.mark.seconds
def test_equilibria_and_vibrations_are_those_of_the_machine():
    plain, far = (flexmb.equilibria(pendulum(FAR, at)) for at in (None, [0, 0, 0]))
    assert len(plain) == len(far)
    for one, other in zip(plain, far, strict=True):
        np.testing.assert_allclose(one.linearize().frequencies, other.linearize().frequencies,
                                   atol=1e-6)  # fmt: skip
        for k, start in ((0, FAR), (7, FAR + [1, 0, 0])):
            place = other.q[k : k + 3] + rotations(other.q[k + 3 : k + 7]).apply(start)
            np.testing.assert_allclose(place, one.q[k : k + 3], atol=1e-6)


def test_a_body_that_is_joined_at_its_frame_moves_about_it():
    """A bob on a long arm: its frame is the pin."""
    made = Model("pendulum", gravity=[0, -9.81, 0])
    made.add_body("bob", mass=1.0, inertia=[1e-4] * 3, center=[2.0, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "bob"], axis="z")
    assert compile_system(made).layout.references == ()


ARM = np.array([10.0, -5.0, 8.0])
STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}


def rod(start, **options):
    """A bar of 1 m along x whose mesh begins at `start` in its frame."""
    start = np.asarray(start, dtype=float)
    return reduce(
        line(10, start, start + [1.0, 0, 0]), material=STEEL, modes=6,
        interfaces={"root": "root", "tip": "tip"}, sections={"all": rectangle(0.01, 0.02)},
        **options,
    )  # fmt: skip


@pytest.mark.parametrize("options", [{}, {"geometric_stiffening": "full", "residual": "inertia"}])
def test_a_body_about_a_point_is_that_of_a_mesh_there(options):
    near, moved = rod([0, 0, 0], **options), about_point(rod(ARM, **options), ARM)
    assert moved.mass == pytest.approx(near.mass)
    size = near.mass
    np.testing.assert_allclose(moved.S1, near.S1, atol=1e-10 * size)
    np.testing.assert_allclose(moved.S0, near.S0, atol=1e-10 * size)
    P, near_P = np.abs(moved.P), np.abs(near.P)  # modes may have the other sign
    np.testing.assert_allclose(P, near_P, atol=1e-8 * near_P.max())
    np.testing.assert_allclose(moved.nodes.position, near.nodes.position, atol=1e-12)
    for one, other in zip(moved.interfaces, near.interfaces, strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=1e-12)
    if options:
        stiff, near_stiff = (np.abs(one.centrifugal_stiffness) for one in (moved, near))
        np.testing.assert_allclose(stiff, near_stiff, atol=1e-6 * near_stiff.max())


def swinging(start, **fields):
    """A bar on a pin at ARM, whose mesh begins at `start` in its frame."""
    made = Model("swing", gravity=[0, -9.81, 0])
    made.add_marker("ground.pin", position=list(ARM))
    made.add_body("rod", rod(start, **fields), position=list(ARM - start))
    made.add_joint("hinge", "revolute", between=["ground.pin", "rod.root"], axis="z")
    made.add_sensor("tip", "position", of="rod.tip", relative_to="ground.pin")
    return made


@pytest.mark.seconds
@pytest.mark.parametrize(("method", "accuracy"), [("radau", 1e-4), ("generalized-alpha", 1e-3)])
@pytest.mark.parametrize("start", [ARM, [1.0, 0, 0]], ids=["far", "beside"])
def test_a_mesh_far_from_its_frame_costs_nothing(start, method, accuracy):
    knobs = {"duration": 0.5, "outputs": 20, "accuracy": accuracy, "method": method}
    runs = []
    for place in ([0.0, 0, 0], start):
        made = swinging(np.asarray(place))
        made.set_dynamics(**knobs)
        runs.append(flexmb.simulate(made))
    near, far = runs
    np.testing.assert_allclose(far["tip.y"], near["tip.y"], atol=2 * accuracy)
    # steps at the start, which the vibrations of the load that is there at once decide, may differ
    assert far.statistics["steps"] < 1.3 * near.statistics["steps"] + 250
    assert far.statistics["energy_balance_error"] < 0.05


@pytest.mark.seconds
def test_a_result_places_the_nodes_of_a_far_mesh():
    made = swinging(ARM)
    assert compile_system(made).layout.references
    made.set_dynamics(duration=0.3, outputs=3, accuracy=1e-6)
    made.add_marker("ground.far", position=[0, 0, 0])
    made.add_sensor("place", "position", of="rod.tip", relative_to="ground.far")
    run = flexmb.simulate(made)
    tip = rod(ARM).interfaces[1]
    A = rotations(run.q[:, 3:7])
    moved = tip.position + run.q[:, 7:] @ tip.Phi_t.T
    place = run.q[:, :3] + A.apply(moved)
    found = np.column_stack([run[f"place.{a}"] for a in "xyz"])
    np.testing.assert_allclose(found, place, atol=1e-9)


def turning(start, stiffened):
    """A bar clamped to a hub that turns it."""
    made = Model("spin", gravity="none")
    made.add_marker("ground.pin", position=list(ARM))
    made.add_body("hub", mass=1.0, inertia=[1.0] * 3, position=list(ARM))
    made.add_body("rod", rod(start, geometric_stiffening="full", residual="inertia"),
                  position=list(ARM - start),
                  geometric_stiffening="full" if stiffened else "none")  # fmt: skip
    made.add_joint("bearing", "revolute", between=["ground.pin", "hub"], axis="z")
    made.add_joint("clamp", "fixed", between=["hub", "rod.root"])
    made.add_driver("motor", joint="bearing", angle="25*t")
    made.add_sensor("tip", "position", of="rod.tip", relative_to="hub", axes="hub")
    return made


@pytest.mark.slow
def test_stiffening_and_its_guards_know_the_body_not_its_frame():
    starts = [np.zeros(3), ARM]
    near, far = (flexmb.linearize(turning(start, True)).frequencies for start in starts)
    np.testing.assert_allclose(far, near, rtol=1e-7, atol=1e-6)
    told = []
    for start in starts:
        made = turning(start, False)
        made.set_dynamics(duration=0.2, outputs=40, accuracy=1e-4)
        with pytest.warns(flexmb.FlexmbWarning):
            told.append(flexmb.simulate(made).notes)
    assert [re.sub(r"\d\.?[\d.e+-]*", "#", one) for one in told[0]] == [
        re.sub(r"\d\.?[\d.e+-]*", "#", one) for one in told[1]
    ]


def test_symbols_in_pictures_have_the_size_of_the_machine():
    sizes = []
    for frames_at in (None, [0, 0, 0]):
        made = pendulum(FAR, frames_at)
        made.set_dynamics(duration=0.1, outputs=1)
        sizes.append(Drawing(Mechanism(flexmb.simulate(made))).size)
    assert sizes[1] == pytest.approx(sizes[0])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::flexmb.FlexmbWarning")
def test_what_gravity_does_to_a_pendulum_is_its_motion_wherever_its_frame_is(tmp_path):
    """Without gravity it rests: 1. A bar whose frame is not at its pin was told 1.07."""
    shares = []
    for start in ([0, 0, 0], [1.0, 0, 0], ARM):
        made = swinging(np.asarray(start, dtype=float))
        made.set_dynamics(duration=0.5, outputs=100, accuracy=1e-6)
        made = flexmb.audit(flexmb.simulate(made, output=tmp_path / "run"))
        shares.append(next(one.share for one in made.effects if one.effect == "gravity"))
    np.testing.assert_allclose(shares, 1.0, atol=0.05)
    assert shares[1] == pytest.approx(shares[2], rel=1e-3)
