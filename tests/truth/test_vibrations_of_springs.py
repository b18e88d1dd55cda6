"""Vibrations that only the force of a spring shows: the run states what its sensor lacks.

Two masses in guides along x, the first on a soft spring, the second on it by a stiff one, let go
from 0.2 m. No joint feels the vibration of the second, and its first acceleration is zero. The
motion is that of M ẍ + C ẋ + K x = 0, by the modes of the damped system.

A clutch that lets go makes lasting motion of the vibration of its spring: both sides keep the
speeds of that instant.
"""

from __future__ import annotations

import numpy as np
import pytest
from accuracyscenes import SCENES
from accuracyscenes.judging import largest_error
from accuracyscenes.switches import between_switches
from scipy.integrate import solve_ivp
from truthkit import run

from flexmb.analysis.dynamics import lasting_motion
from flexmb.analysis.dynamics.damped_vibrations import state_at_jump
from flexmb.analysis.dynamics.dynamics import prepare_dynamics
from flexmb.analysis.dynamics.integration import Integration
from flexmb.analysis.dynamics.lasting_motion import _rows_with_equal_steps
from flexmb.engine.compile import compile_system
from flexmb.engine.state import State
from flexmb.model import Model

SOFT, MASS = 10.0, 0.01  # N/m; kg, of the second body


def chain(stiffness, damping):
    made = Model("chain")
    for name, place, mass in (("first", 1.0, 1.0), ("second", 2.0, MASS)):
        made.add_body(name, mass=mass, inertia=[1, 1, 1], position=[place, 0, 0])
        made.add_joint(name, "prismatic", between=["ground", name], axis="x")
        made.add_sensor(f"at_{name}", "position", of=name)
        made.add_sensor(f"speed_{name}", "velocity", of=name)
    made.add_force("soft", "spring-damper", between=["ground", "first"], stiffness=SOFT,
                   free_length=0.8)  # fmt: skip
    made.add_force("stiff", "spring-damper", between=["first", "second"], stiffness=stiffness,
                   damping=damping, free_length=1)  # fmt: skip
    made.add_sensor("force", "reaction", force="stiff", quantity="force", axes="global")
    return made


def truth(stiffness, damping, t):
    """In √k times elongations and √m times speeds, in which stiff springs spoil no digits."""
    soft, stiff, m = np.sqrt(SOFT), np.sqrt(stiffness), np.sqrt(MASS)
    A = np.array([
        [0, 0, soft, 0],
        [0, 0, -stiff, stiff / m],
        [-soft, stiff, -damping, damping / m],
        [0, -stiff / m, damping / m, -damping / MASS],
    ])  # fmt: skip
    values, vectors = np.linalg.eig(A)
    share = np.linalg.solve(vectors, np.array([0.2 * soft, 0, 0, 0], complex))
    y = ((vectors * share) @ np.exp(np.outer(values, t))).real
    speeds = {"speed_first.x": y[2], "speed_second.x": y[3] / m}
    pull = stiff * y[1] + damping * (y[3] / m - y[2])
    places = {"at_first.x": 0.8 + y[0] / soft, "at_second.x": 1.8 + y[0] / soft + y[1] / stiff}
    return {"force.x": -pull}, speeds, places


@pytest.mark.parametrize(("damping", "accuracy"), [(0.0, 1e-3), (0.2, 1e-3), (0.2, 1e-7)])
def test_what_the_sensor_of_a_spring_lacks_is_stated(damping, accuracy):
    """At 503 Hz. With 1e-7 the vibration is followed at first, and lost where steps are longer."""
    found = run(chain(1e5, damping), duration=4.0, outputs=100, accuracy=accuracy, method="radau")
    pulls, speeds, places = truth(1e5, damping, found.t)
    for channels, of in ((pulls, "reactions"), (speeds, "velocities"), (places, "positions")):
        error = largest_error({name: found[name] for name in channels}, channels)[0]
        told = found.statistics[f"measured_error_of_{of}"]
        if of == "positions":
            assert error <= accuracy and told <= accuracy
        else:
            assert error / 3 <= told <= 3 * error


DRUM, OUT, BEARING, LOAD = 0.02, 0.1, 0.02, 0.05  # kg m²; N m s, of dampers
DRIVES = "3*sin(7*t)"  # N m
LETS_GO = 0.4457  # s, where a clutch lets go by time
LAWS = {"one-way": "max(drum-out,0)", "by time": f"0.5*(1-sign(t-{LETS_GO}))*(drum-out)"}


def clutch(stiffness, law):
    made, torque = Model("clutch"), f"{stiffness}*{LAWS[law]}"
    for name, inertia in (("drum", DRUM), ("out", OUT)):
        made.add_body(name, mass=1, inertia=[inertia] * 3)
        made.add_joint(name, "revolute", between=["ground", name], axis="z")
        made.add_sensor(name, "angle", joint=name)
        made.add_sensor(f"speed_{name}", "angle", joint=name, derivative=1)
    drive = f"{DRIVES}-{torque}-{BEARING}*speed_drum"
    made.add_force("drive", "torque", at="drum", value=[0, 0, drive])
    made.add_force("load", "torque", at="out", value=[0, 0, f"{torque}-{LOAD}*speed_out"])
    return made


def clutch_truth(stiffness, law, t):
    """Angles of both sides, first together, then apart: they do not meet again within 6 s."""

    def rates(now, y, k):
        torque = k * (y[0] - y[1])
        drives = 3 * np.sin(7 * now) - torque - BEARING * y[2]
        return [y[2], y[3], drives / DRUM, (torque - LOAD * y[3]) / OUT]

    def gap(now, y, k):
        return y[0] - y[1] if law == "one-way" else LETS_GO - now

    gap.terminal, gap.direction = True, -1
    known = {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853", "dense_output": True}
    first = solve_ivp(rates, (0, 1), np.zeros(4), args=(stiffness,), events=gap, **known)
    then = solve_ivp(rates, (first.t[-1], t[-1]), first.y[:, -1], args=(0.0,), **known)
    assert law != "one-way" or (then.y[0, 1:] < then.y[1, 1:]).all()
    y = np.where(t < first.t[-1], first.sol(t), then.sol(t))
    return {"drum": y[0], "out": y[1]}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("stiffness", "accuracy"), [(2e3, 1e-3), (2e3, 3e-5), (2e4, 1e-6)])
def test_a_vibration_that_is_there_when_a_clutch_lets_go_is_stated_or_followed(
    law, stiffness, accuracy
):
    """At 55 and 174 Hz: damped by the steps, it makes 2e-4 and 7e-6 of the angles afterwards."""
    found = run(clutch(stiffness, law), duration=6.0, outputs=100, accuracy=accuracy,
                method="radau")  # fmt: skip
    channels = clutch_truth(stiffness, law, found.t)
    error = largest_error({name: found[name] for name in channels}, channels)[0]
    told = found.statistics["measured_error_of_positions"]
    assert error <= 2 * accuracy
    if max(error, told) > 0.2 * accuracy:
        assert error / 3 <= told <= 3 * error


def test_a_repetition_whose_first_step_fails_has_no_rows():
    made = clutch(2e3, "one-way")
    made.set_dynamics(duration=6.0, outputs=100, accuracy=1e-3, method="radau")
    prepared = prepare_dynamics(compile_system(made), made)
    prepared.advance(first=True)
    run, jumps = prepared.verified.fine, prepared.verified.jumps
    for state in (first := prepared.first, other := State(*(x.copy() for x in prepared.first))):
        state.v[:] = np.nan
    assert not list(_rows_with_equal_steps(run, prepared.settings, first, other, jumps))


@pytest.mark.parametrize("name", ["staircase", "rectified wave", "mass between stops"])
def test_what_is_looked_for_at_many_jumps_and_events_costs_less_than_the_run(name, monkeypatch):
    """Of none of them a vibration is lost."""
    spent = []

    class Counted(Integration):
        def integrate(self, steps):
            before = int(self.state.count[0]["steps"])
            status = super().integrate(steps)
            spent.append(int(self.state.count[0]["steps"]) - before)
            return status

    monkeypatch.setattr(lasting_motion, "Integration", Counted)
    scene = SCENES[name]
    found = run(scene.make(1.0), duration=scene.duration, outputs=scene.outputs, accuracy=1e-5,
                method="radau")  # fmt: skip
    assert 0 < sum(spent) < 1.1 * found.statistics["steps"]


def test_states_at_jumps_and_events_count_the_turns_of_angles():
    """A wheel turns by 9 rad/s beside a mass that a force moves to and fro between stops."""
    made = Model("wheel beside stops")
    made.add_body("wheel", mass=1, inertia=[1] * 3, angular_velocity=[0, 0, 9.0])
    made.add_joint("pin", "revolute", between=["ground", "wheel"], axis="z")
    made.add_sensor("turn", "angle", joint="pin")
    made.add_body("mass", mass=1, inertia=[1] * 3)
    made.add_joint("rail", "prismatic", between=["ground", "mass"], axis="x")
    made.add_force("push", "force", at="mass", value=["sign(t-1)*sign(t-2.5)*sign(t-5)", 0, 0])
    made.add_force("stop", "translational-stop", joint="rail", lower=-0.1, upper=0.1,
                   stiffness=1e3)  # fmt: skip
    made.set_dynamics(duration=6.0, outputs=60, accuracy=1e-3, method="radau")
    prepared = prepare_dynamics(compile_system(made), made)
    prepared.advance(first=True)
    run, jumps = prepared.verified.fine, prepared.verified.jumps
    while not run.finished:
        prepared.advance()
    numbers = [*jumps.passed(), *jumps.events()[0]]
    assert len(jumps.passed()) == 4 and len(numbers) > 8
    for k in numbers:
        state = state_at_jump(run, prepared.first, jumps, k)
        assert state.angles[0] == pytest.approx(9.0 * state.t[0], abs=1e-6)


LUGS = "500*(max({0}-2,0)+min({0}+2,0))"  # N m: two lugs with a play of 4 rad
DISKS = {"a": 0.02, "b": 0.03, "c": 0.05}  # kg m²


@pytest.mark.seconds
def test_disks_with_lugs_that_turn_several_times_are_told_no_error_that_they_lack():
    """A combination lock: each disk takes the next one along, after nearly a turn."""
    made = Model("lock")
    for name, inertia in DISKS.items():
        made.add_body(name, mass=1, inertia=[inertia] * 3)
        made.add_joint(name, "revolute", between=["ground", name], axis="z")
        made.add_sensor(name, "angle", joint=name)
        made.add_sensor(f"s{name}", "angle", joint=name, derivative=1)
    first, second = LUGS.format("(a-b)"), LUGS.format("(b-c)")
    torques = f"2*sin(1.5*t)-0.05*sa-{first}", f"{first}-{second}-0.05*sb", f"{second}-0.1*sc"
    for name, torque in zip(DISKS, torques, strict=True):
        made.add_force(name, "torque", at=name, value=[0, 0, torque])

    def switches(t, y):
        return [y[0] - y[1] - 2, y[0] - y[1] + 2, y[1] - y[2] - 2, y[1] - y[2] + 2]

    def rates(t, y, signs):
        gaps = switches(t, y) * (np.sign([1, -1, 1, -1]) == signs)
        first, second = 500 * gaps.reshape(2, 2).sum(axis=1)
        turning = 2 * np.sin(1.5 * t) - first, first - second, second
        return [*y[3:], *((turning - np.array([0.05, 0.05, 0.1]) * y[3:]) / [*DISKS.values()])]

    found = run(made, duration=6.0, outputs=100, accuracy=1e-3, method="radau")
    channels = dict(
        zip(DISKS, between_switches(rates, switches, np.zeros(6), found.t), strict=False)
    )
    assert largest_error({name: found[name] for name in DISKS}, channels)[0] <= 2e-3
    assert found.statistics["measured_error_of_positions"] <= 1e-3
