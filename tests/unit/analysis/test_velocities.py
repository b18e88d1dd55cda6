"""First velocities are those asked for at markers, of rigid and flexible bodies alike."""

from __future__ import annotations

import numpy as np
import pytest
from generators import cloud, interface, random_rotation

from flexmb.analysis.assembly.initial_state import assemble
from flexmb.analysis.assembly.velocities import rigid_motion
from flexmb.engine.compile import compile_system
from flexmb.model import Model
from flexmb.workflow.check import mobility

KEPT = 1e-9  # markers of given velocity weigh 1e8 times their body, and rounds follow
POINT = np.array([0.3, -0.2, 0.5])
SPEED, SPIN = np.array([1.0, -2.0, 0.5]), np.array([3.0, 1.0, -2.0])


def first(model):
    """Compiled model, first state, notes."""
    made = compile_system(model)
    found = assemble(made, model)
    return made, found.state, found.notes


def rates(made, state, k=0):
    """Velocity of the origin, angular velocity (both global), rates of deformation of body k."""
    body = made.layout.bodies[k]
    A = rotation(state.q[body.iq + 3 : body.iq + 7])
    v = state.v[body.iv : body.iv + 6 + body.m]
    return v[:3], A @ v[3:6], v[6:]


def rotation(p):
    e, (x, y, z) = p[0], p[1:]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * e * cross + 2 * cross @ cross


def body(model, name="b", orientation=(1, 0, 0, 0), **fields):
    model.add_body(
        name, mass=2, inertia=[1, 2, 2.5], center=[0.1, 0, 0.2], orientation=list(orientation),
        markers={"tip": {"position": POINT.tolist()}}, **fields,
    )  # fmt: skip


def initial(**fields):
    return {"tip": {key: np.asarray(value).tolist() for key, value in fields.items()}}


@pytest.mark.parametrize("orientation", [(1, 0, 0, 0), (0.5, -0.1, 0.7, 0.4)])
def test_velocity_of_the_origin_follows_from_that_of_an_offset_marker(orientation):
    model = Model("thrown")
    body(model, orientation=orientation, initial=initial(velocity=SPEED, angular_velocity=SPIN))
    made, state, notes = first(model)
    velocity, spin, _ = rates(made, state)
    arm = rotation(np.array(orientation) / np.linalg.norm(orientation)) @ POINT
    np.testing.assert_allclose(velocity, SPEED - np.cross(SPIN, arm), atol=1e-13)
    np.testing.assert_allclose(spin, SPIN, atol=1e-13)
    assert not notes


def test_axes_of_the_marker():
    turn = random_rotation(np.random.default_rng(4))
    model = Model("thrown")
    model.add_body(
        "b", mass=1, inertia=[1, 1, 1], orientation=turn.tolist(),
        markers={"tip": {"orientation": turn.T.tolist()}},
        initial={"tip": {"angular_velocity": SPIN.tolist(), "axes": "body"}},
    )  # fmt: skip
    model.add_body(
        "c", mass=1, inertia=[1, 1, 1], orientation=turn.tolist(),
        initial={"center": {"angular_velocity": SPIN.tolist(), "axes": "body"}},
    )  # fmt: skip
    made, state, _ = first(model)
    np.testing.assert_allclose(rates(made, state, 0)[1], SPIN, atol=1e-13)  # axes turned back
    np.testing.assert_allclose(rates(made, state, 1)[1], turn @ SPIN, atol=1e-13)


def test_a_velocity_alone_turns_nothing_and_a_spin_alone_turns_about_its_marker():
    model = Model("two")
    body(model, "a", initial=initial(velocity=SPEED))
    body(model, "b", initial=initial(angular_velocity=SPIN))
    made, state, _ = first(model)
    np.testing.assert_allclose(np.hstack(rates(made, state, 0)), [*SPEED, 0, 0, 0], atol=1e-13)
    np.testing.assert_allclose(rates(made, state, 1)[0], -np.cross(SPIN, POINT), atol=1e-13)


def test_two_markers_of_one_body_say_how_it_turns():
    """But not about the line through them: the body does not turn about it."""
    ends = np.array([[1.0, 0, 0], [-1.0, 0.5, 0]])
    along = ends[0] - ends[1]
    spin = np.cross(along, [0.3, 0.4, 2.0]) / (along @ along)  # across the line
    model = Model("two points")
    model.add_body(
        "b", mass=1, inertia=[1, 1, 1],
        markers={name: {"position": s.tolist()} for name, s in zip("pq", ends, strict=True)},
        initial={
            name: {"velocity": (SPEED + np.cross(spin, s)).tolist()}
            for name, s in zip("pq", ends, strict=True)
        },
    )  # fmt: skip
    made, state, notes = first(model)
    np.testing.assert_allclose(rates(made, state)[1], spin, atol=1e-13)
    np.testing.assert_allclose(rates(made, state)[0], SPEED, atol=1e-13)
    assert not notes


def test_velocities_that_would_stretch_a_body_are_told():
    model = Model("stretched")
    model.add_body(
        "b", mass=1, inertia=[1, 1, 1], velocity=[-1, 0, 0],
        markers={"tip": {"position": [1, 0, 0]}}, initial={"tip": {"velocity": [1, 0.5, 0]}},
    )  # fmt: skip
    made, state, notes = first(model)
    np.testing.assert_allclose(rates(made, state)[1], [0, 0, 0.5], atol=1e-12)
    assert [note.split(" ")[0] for note in notes] == [
        "bodies.b.velocity", "bodies.b.initial.tip.velocity"
    ]  # fmt: skip
    assert notes[0].endswith("changed by up to 1 m/s")


def pendulum(**fields):
    model = Model("pendulum")
    model.add_body(
        "bar", mass=1, inertia=[0.01, 0.1, 0.1], center=[1, 0, 0],
        markers={"tip": {"position": [2, 0, 0]}}, **fields,
    )  # fmt: skip
    model.add_joint("pivot", "revolute", between=["ground", "bar"], axis="z")
    return model


def test_a_joint_turns_what_its_tip_is_asked_to_move():
    made, state, notes = first(pendulum(initial={"tip": {"velocity": [0, 3, 0]}}))
    np.testing.assert_allclose(rates(made, state)[1], [0, 0, 1.5], atol=KEPT)
    assert not notes


def test_what_a_joint_forbids_is_told():
    made, state, notes = first(pendulum(initial={"tip": {"velocity": [4, 3, 0]}}))
    np.testing.assert_allclose(rates(made, state)[1], [0, 0, 1.5], atol=KEPT)
    assert len(notes) == 1
    assert notes[0].startswith("bodies.bar.initial.tip.velocity does not fit the joints")


def swapped(points, ends, flexible, asked, pinned):
    """The same points, rigid or flexible, perhaps held at interface b; world turned."""
    turn = random_rotation(np.random.default_rng(8))
    place = {"position": [0.2, 0.1, -0.4], "orientation": turn.tolist(), "initial": asked}
    model = Model("swap")
    if flexible:
        model.add_body("b", points.flexbody("b", ends), **place)
    else:
        markers = {end.name: {"position": end.position.tolist()} for end in ends}
        model.add_body("b", **points.rigid_fields(), markers=markers, **place)
    if pinned:
        at = np.array(place["position"]) + turn @ ends[1].position
        model.add_marker("ground.pin", position=at.tolist())
        model.add_joint("pin", "spherical", between=["ground.pin", "b.b"])
    return model, turn


@pytest.mark.parametrize("pinned", [False, True])
def test_a_flexible_body_starts_like_a_rigid_one(pinned):
    rng = np.random.default_rng(5)
    points = cloud(rng, 3)
    ends = [interface(rng, name, 3) for name in "ab"]
    spin = SPIN
    speed = SPEED
    if pinned:  # what a turn about b gives
        turn = random_rotation(np.random.default_rng(8))
        speed = np.cross(spin, turn @ (ends[0].position - ends[1].position))
    asked = {"a": {"velocity": speed.tolist(), "angular_velocity": spin.tolist()}}
    motions = []
    for flexible in (False, True):
        model, turn = swapped(points, ends, flexible, asked, pinned)
        made, state, notes = first(model)
        assert not notes
        velocity, omega, eta_dot = rates(made, state)
        np.testing.assert_allclose(eta_dot, 0, atol=KEPT)
        motions.append(np.hstack([velocity, omega]))
        a = velocity + np.cross(omega, turn @ ends[0].position)
        np.testing.assert_allclose(a, speed, atol=KEPT)
    np.testing.assert_allclose(motions[0], motions[1], atol=KEPT)


def test_what_only_straining_could_keep_is_told():
    """A flexible body is not made to deform for the sake of a velocity; its joints are kept."""
    rng = np.random.default_rng(6)
    points = cloud(rng, 3)
    ends = [interface(rng, name, 3) for name in "ab"]
    asked = {"a": {"velocity": SPEED.tolist(), "angular_velocity": [0, 0, 0]}}
    model, turn = swapped(points, ends, True, asked, pinned=True)
    made, state, notes = first(model)
    velocity, omega, eta_dot = rates(made, state)
    pin = velocity + np.cross(omega, turn @ ends[1].position) + turn @ ends[1].Phi_t @ eta_dot
    np.testing.assert_allclose(pin, 0, atol=1e-12)
    assert notes and notes[0].startswith("bodies.b.initial.a.velocity does not fit")


def test_points_that_coincide_do_not_turn():
    s = np.array([[1.0, 2, 3], [1.0, 2, 3 + 1e-13]])
    given = np.array([[1.0, 0, 0], [1.0, 1e-9, 0]])
    velocity, spin = rigid_motion(s, given, np.full((2, 3), np.nan), 1.0)
    np.testing.assert_array_equal(spin, 0)
    np.testing.assert_allclose(velocity, [1, 5e-10, 0], atol=1e-15)


@pytest.mark.parametrize("along", [3.0, 0.0])
def test_check_tells_of_velocities_that_a_run_changes(along):
    """A bar on a pin, its free end asked for 4 m/s across it, and along it, which is lost."""
    model = Model("bar")
    model.set_dynamics(duration=1)
    initial, markers = {"end": {"velocity": [along, 4, 0]}}, {"end": {"position": [2, 0, 0]}}
    model.add_body("bar", mass=1, inertia=[1, 1, 1], markers=markers, initial=initial)
    model.add_joint("pin", "revolute", between=["ground", "bar"], axis="z")
    unfit = [note for note in mobility(model).notes if "does not fit" in note]
    assert len(unfit) == (along > 0)
    for note in unfit:
        assert note.startswith("bodies.bar.initial.end.velocity")
        assert note.endswith("changed by up to 3 m/s")
