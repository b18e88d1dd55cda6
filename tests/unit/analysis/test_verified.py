"""Runs that measure their own error: what they do about it, and what they say where it is large."""

from __future__ import annotations

import re
import time
from types import SimpleNamespace

import numpy as np
import pytest
from accuracyscenes import AWAY, SCENES, far_apart
from accuracyscenes.textbook import Linkage
from truthkit import Memory

import flexmb
from flexmb.analysis.chunked_run import one_thread
from flexmb.analysis.dynamics import verified_run
from flexmb.analysis.dynamics.dynamics import dynamics, prepare_dynamics
from flexmb.analysis.dynamics.reached_accuracy import missed_accuracy
from flexmb.engine.compile import compile_system
from flexmb.model import Model
from flexmb.progress import silent


def links(n, angle="0 deg", **second):
    """Links of 1 m hung in a row, let go from rest but for the second one."""
    made = Model("links", gravity=[0, -9.81, 0])
    turned = np.deg2rad(float(angle.split()[0]))
    for k in range(n):
        made.add_body(
            f"b{k}", mass=1, center=[0.5, 0, 0], inertia=[0.01, 0.1, 0.1],
            position=[k * np.cos(turned), k * np.sin(turned), 0],
            orientation={"axis": "z", "angle": angle}, **(second if k == 1 else {}),
        )  # fmt: skip
        made.add_marker(f"b{k}.end", position=[1, 0, 0])
        ends = [f"b{k - 1}.end" if k else "ground", f"b{k}"]
        made.add_joint(f"j{k}", "revolute", between=ends, axis="z")
    return made


def high():
    """A double pendulum upside down, its second link thrown: soon nobody knows where it is."""
    made = links(2, "90 deg", angular_velocity=[0, 0, 1.0])
    made.add_sensor("end", "position", of="b1.end")
    return made


def simulated(made, **knobs):
    """Outcome and rows of a run, as `dynamics` gives them."""
    made.set_dynamics(**knobs)
    sink = Memory()
    compiled = compile_system(made)
    outcome = dynamics(compiled, made, sink)
    t, _, v, *_, sensors, _, _ = sink.tables()
    return outcome, t, sensors, v


LONG = {"duration": 60.0, "outputs": 600}


@pytest.fixture(scope="module")
def known():
    """Sensors of the thrown pendulum, and the time until which two tight runs agree to 1e-8."""
    tight = {"verify": False, "method": "explicit-rk"}
    (_, t, one, _), (_, _, other, _) = (
        simulated(high(), accuracy=accuracy, **tight, **LONG) for accuracy in (1e-12, 2e-12)
    )
    apart = np.abs(one - other).max(axis=1)
    until = t[np.flatnonzero(apart > 1e-8)[0]]
    assert 10.0 < until < 30.0 and apart.max() > 1.0
    return one, until


@pytest.mark.seconds
@pytest.mark.parametrize(
    "knobs",
    [
        {"method": "auto"},
        pytest.param({"method": "explicit-rk", "order": 5}, marks=pytest.mark.slow),
        pytest.param({"method": "radau"}, marks=pytest.mark.slow),
    ],
    ids=["auto", "order 5", "radau"],
)
def test_a_chaotic_motion_is_told_with_a_time_until_which_it_is_accurate(known, knobs):
    truth, until = known
    accuracy = 1e-6
    outcome, t, sensors, _ = simulated(high(), accuracy=accuracy, **knobs, **LONG)
    assert outcome.status == "finished"
    assert outcome.statistics["passes"] == 3  # the last in vain
    (note,) = [note for note in outcome.notes if note.startswith("accuracy 1e-06 was asked for")]
    assert "sensor end" in note and "multiplies errors" in note
    told = float(re.search(r"agree to it until t = ([\d.]+) s", note)[1])
    error = np.abs(sensors - truth).max(axis=1) / np.ptp(truth, axis=0).max()
    # as far as the truth is known, and not much less
    assert error[t < min(told, until)].max() < 2 * accuracy
    lost = t[np.flatnonzero(error > accuracy)[0]]
    assert 0.5 * lost < told < lost + 2.0  # from 1e-8 to 1e-6 takes as long


@pytest.mark.slow
def test_the_error_of_a_chaotic_motion_is_not_told_smaller_than_it_is(known):
    """In the end both runs are anywhere, so that what they differ by is no multiple of an error."""
    outcome, *_ = simulated(high(), accuracy=1e-6, **LONG)
    assert outcome.statistics["measured_error_of_positions"] > 0.1


@pytest.mark.seconds
@pytest.mark.parametrize("accuracy", [1e-3, pytest.param(1e-4, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "knobs",
    [{"method": "auto"}, pytest.param({"method": "radau"}, marks=pytest.mark.slow)],
    ids=["auto", "radau"],
)
def test_round_off_that_a_chaotic_motion_multiplies_is_told(accuracy, knobs):
    """A kilometre away, beside Lagrange's equations in absolute angles by SciPy.

    The same motion near the origin is accurate: the method is, and the place is not.
    """
    row = Linkage([1, 1], [0.1, 0.1], [[0.5, 0], [1, 0.5]], gravity=-9.81j)
    t = np.linspace(0.0, 25.0, 201)
    angles = row.run([np.pi / 2] * 2, [0.0, 1.0], [0, 1], t)
    end = np.exp(1j * angles).sum(axis=0)
    truth = np.column_stack([end.real, end.imag, 0.0 * t]) + AWAY
    outcome, _, sensors, _ = simulated(
        far_apart(high()), accuracy=accuracy, duration=25.0, outputs=200, **knobs
    )
    error = np.abs(sensors - truth).max() / np.ptp(truth, axis=0).max()
    assert error > 2 * accuracy
    assert outcome.statistics["measured_error_of_positions"] > error / 5  # of one walk at random
    (note,) = [note for note in outcome.notes if "was asked for" in note]
    assert "multiplies errors" in note


@pytest.mark.parametrize(
    ("make", "duration", "accuracy", "runs"),
    [
        (SCENES["Andrews' mechanism"].make, 0.03, 1e-6, 1),
        (lambda size: far_apart(high()), 25.0, 1e-3, 3),
    ],
    ids=["Andrews' mechanism", "a pendulum a kilometre away"],
)
def test_round_off_is_looked_for_by_one_run_and_measured_by_three(
    make, duration, accuracy, runs, monkeypatch
):
    """All on the steps of the scout, of which none but the run itself has to find its own."""
    made, calls, follow = [], [], verified_run._rows_on_moved_steps
    init = verified_run.Integration.__init__

    def begin(self, *arguments):
        made.append(self)
        init(self, *arguments)

    def counted(*arguments):
        calls.append(arguments)
        return follow(*arguments)

    monkeypatch.setattr(verified_run.Integration, "__init__", begin)
    monkeypatch.setattr(verified_run, "_rows_on_moved_steps", counted)
    simulated(make(1.0), accuracy=accuracy, duration=duration, outputs=200)
    assert len(calls) == runs
    steps = [int(run.state.count[0]["steps"]) for run in made if run.finished]
    assert set(steps[-runs:]) == {steps[-runs - 2]}  # those of the last scout


@pytest.mark.slow
def test_round_off_of_a_run_that_was_extended_is_told(tmp_path):
    """It is looked for from the first row on, as in a run that was as long from the start."""
    model = far_apart(high())
    model.set_dynamics(duration=25.0, outputs=25, accuracy=1e-3)
    begun = flexmb.simulate(model, output=tmp_path)
    with pytest.warns(flexmb.FlexmbWarning, match="multiplies errors"):
        longer = flexmb.resume(begun, duration=26.0)
    assert longer.statistics["measured_error_of_positions"] > 2e-3  # 6e-4 by shorter steps alone


@pytest.mark.slow
def test_a_pass_that_fails_leaves_the_one_before():
    """Less accurate than asked for, and told, but a motion from the first row to the last."""
    knobs = {"accuracy": 1e-3, "method": "generalized-alpha"}
    outcome, t, *_ = simulated(high(), **knobs, **LONG)
    assert outcome.status == "finished", outcome.message
    assert len(t) == 601
    assert any("was asked for" in note for note in outcome.notes)


def test_a_short_run_says_nothing():
    outcome, *_ = simulated(high(), accuracy=1e-6, duration=2.0, outputs=50)
    assert outcome.notes == ()
    assert outcome.statistics["measured_error_of_positions"] < 1.2e-6


def test_steps_of_fixed_length_and_runs_alone_measure_nothing():
    for knobs in ({"step": 1e-2}, {"accuracy": 1e-4, "verify": False}):
        statistics = simulated(high(), duration=1.0, outputs=10, **knobs)[0].statistics
        assert not [name for name in statistics if "measured" in name or name == "passes"]


def test_what_is_measured_is_named():
    made = high()
    made.add_sensor("speed", "velocity", of="b1.end")
    found = simulated(made, accuracy=1e-5, duration=3.0, outputs=50)[0].statistics
    assert re.fullmatch(r"end at t = \S+ s", found["worst_of_positions"])
    assert re.fullmatch(r"speed at t = \S+ s", found["worst_of_velocities"])
    assert re.fullmatch(r"joints.j[01] at t = \S+ s", found["worst_of_reactions"])
    for quantity in ("positions", "velocities", "reactions"):
        assert 0.0 < found[f"measured_error_of_{quantity}"] < 1e-4
    assert 0 < found["comparison_steps"] < found["steps"]


def pivot_only():
    made = links(1)
    made.add_sensor("pivot", "position", of="b0")
    return made


@pytest.mark.parametrize("made", [pivot_only, lambda: links(1)], ids=["sensor", "body"])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_what_is_at_rest_but_for_round_off_has_no_error(made, accuracy):
    """The only point that is looked at is the pivot of a pendulum."""
    outcome, *_ = simulated(made(), accuracy=accuracy, duration=3.0, outputs=100)
    assert outcome.statistics["passes"] == 1
    assert outcome.statistics["measured_error_of_positions"] < accuracy
    assert outcome.statistics["measured_error_of_velocities"] < 1e-2 * accuracy**0.5
    assert outcome.notes == ()


def test_turning_counts_where_nothing_is_sensed():
    """A body that turns about its frame: its orientation is a position."""
    made = Model("turning")
    made.add_body("b", mass=1, inertia=[1, 2, 2.8], angular_velocity=[0.1, 3, 0.1])
    knobs = {"duration": 20.0, "outputs": 50}
    _, _, _, truth = simulated(made, accuracy=1e-12, verify=False, method="explicit-rk", **knobs)
    for accuracy in (1e-3, 1e-5):
        outcome, _, _, found = simulated(made, accuracy=accuracy, method="generalized-alpha",
                                         **knobs)  # fmt: skip
        error = np.abs(found - truth)[:, 3:].max() / np.ptp(truth, axis=0)[3:].max()
        assert 0.0 < outcome.statistics["measured_error_of_positions"] < 2 * accuracy
        assert error < 20 * accuracy


@pytest.mark.parametrize(
    ("knobs", "near"),
    [({"method": "generalized-alpha"}, 0.01), ({"method": "explicit-rk", "order": 5}, 0.2)],
)
def test_the_error_that_it_tells_is_the_error(knobs, near):
    """Of x = cos 2πt, over its peak-to-peak: a wrong order of Richardson's would give the half."""
    made = Model("oscillator", plane="xy")
    made.add_body("mass", mass=1.0, inertia=[1, 1, 1], position=[1, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "mass"], axis="x")
    made.add_sensor("place", "position", of="mass")
    made.add_force("pull", "force", at="mass", value=["-4*pi**2*place.x", 0, 0])
    outcome, t, sensors, _ = simulated(made, accuracy=1e-3, duration=4.3, outputs=100, **knobs)
    error = np.abs(sensors[:, 0] - np.cos(2 * np.pi * t)).max() / 2
    told = outcome.statistics["measured_error_of_positions"]
    assert told == pytest.approx(error, rel=near)


@pytest.mark.parametrize(("method", "damps"), [("radau", True), ("explicit-rk", False)])
def test_only_implicit_steps_are_said_to_damp_vibrations(method, damps):
    """Explicit ones follow them: no cure is the method that runs already."""
    row = SimpleNamespace(error=0.2, name="gap", time=0.1, round_off=0.0, of_values=0.0)
    verified = SimpleNamespace(
        errors=lambda: {"positions": row}, difference=0.1,
        fine=SimpleNamespace(state=SimpleNamespace(count=[{"events": 0, "steps": 10}])),
        error=SimpleNamespace(
            reached_until=lambda accuracy: 0.0, growth=lambda: 1.0,
            round_off_amplification=lambda steps: 1.0,
        ),
        jumps=SimpleNamespace(begins_before=lambda until: True),
    )  # fmt: skip
    prepared = SimpleNamespace(
        verified=verified, method=method, settings=SimpleNamespace(accuracy=1e-4, tolerance=1e-3),
        model=Model("gap"), passes=[{"last_difference": 0.01, "count": 1}],
    )  # fmt: skip
    (sentence,) = missed_accuracy(prepared)
    assert ("damp a vibration" in sentence) is damps
    assert ('method = "explicit-rk"' in sentence) is damps


def ringing_mass():
    """A mass of 1 kg that swings by 0.5 m at 2/s, and on it 10 g that ring by 0.1 mm at 400/s."""
    made, stiffness = Model("ring", plane="xy"), 0.01 * 400.0**2
    made.add_body("slow", mass=1.0, inertia=[1, 1, 1], velocity=[1, 0, 0])
    made.add_body("fast", mass=0.01, inertia=[1, 1, 1], velocity=[1.04, 0, 0])
    made.add_joint("guide", "prismatic", between=["ground", "slow"], axis="x")
    made.add_joint("rail", "prismatic", between=["slow", "fast"], axis="x")
    for joint, k in (("guide", 4.0), ("rail", stiffness)):
        made.add_force(joint, "translational-spring-damper", joint=joint, stiffness=k)
    made.add_sensor("acceleration", "acceleration", of="fast")
    made.add_sensor("place", "position", of="fast")
    root = np.diag([1.0, 10.0])  # of the inverse of the masses
    squares, shapes = np.linalg.eigh(
        root @ np.array([[4.0 + stiffness, -stiffness], [-stiffness, stiffness]]) @ root
    )
    speeds, omega = shapes.T @ np.linalg.inv(root) @ [1.0, 1.04], np.sqrt(squares)

    def acceleration(t):
        return -(root @ shapes)[1] @ ((omega * speeds)[:, None] * np.sin(np.outer(omega, t)))

    return made, acceleration


@pytest.mark.parametrize(
    ("method", "accuracy"),
    [("generalized-alpha", 1e-3), ("generalized-alpha", 1e-4), ("radau", 1e-3)],
)
def test_the_error_of_an_accelerometer_is_told(method, accuracy):
    """A vibration that hardly moves may be all of it: 0.05 at 1e-3, beside the two modes."""
    made, truth = ringing_mass()
    outcome, t, sensors, _ = simulated(
        made, duration=1.5, outputs=333, accuracy=accuracy, method=method
    )
    error = np.abs(sensors[:, 0] - truth(t)).max() / np.ptp(truth(t))
    told = outcome.statistics["measured_error_of_accelerations"]
    assert error / 3 < told < 3 * error
    assert "acceleration at" in str(outcome.statistics["worst_of_accelerations"])


def test_accelerations_of_round_off_have_no_error():
    """Of a mass at rest on a stiff spring beside another that rings; over its own range it is 1."""
    made = Model("hanging", gravity=[0, 0, -9.81])
    for body, stiffness, speed in (("still", 1e9, 0.0), ("rings", 1e4, 1.0)):
        place = [0.3, 0.4, 0.7]
        made.add_body(body, mass=1.0, inertia=[1, 1, 1], position=place, velocity=[0, 0, speed])
        made.add_marker(f"ground.{body}", position=place)
        made.add_joint(body, "prismatic", between=[f"ground.{body}", body], axis="z")
        made.add_force(body, "translational-spring-damper", joint=body, stiffness=stiffness,
                       free=9.81 / stiffness)  # fmt: skip
        made.add_sensor(body, "acceleration", of=body)
    outcome, *_ = simulated(made, duration=0.1, outputs=50, accuracy=1e-5, method="radau")
    assert outcome.statistics["measured_error_of_accelerations"] < 1e-5


def advanced(chunks):
    """A run under error control after some chunks, with more to go."""
    made = high()
    made.set_dynamics(**LONG, accuracy=1e-9, method="explicit-rk")
    prepared = prepare_dynamics(compile_system(made), made)
    blocks = prepared.advance(first=True)[1]
    for _ in range(chunks):
        blocks += prepared.advance()[1]
    return prepared, blocks


def test_the_scout_of_a_saved_state_is_where_the_run_is():
    prepared, _ = advanced(1)
    saved, scout = prepared.arrays(), prepared.verified.scout
    assert saved["scout_t"][0] == saved["t"][0] < scout.state.t[0]


def test_a_scout_in_a_thread_of_its_own_changes_no_bit():
    prepared, blocks = advanced(2)
    with one_thread():
        alone, others = advanced(2)
    for name, array in alone.arrays().items():
        np.testing.assert_array_equal(array, prepared.arrays()[name], err_msg=name)
    for one, other in zip(blocks, others, strict=True):
        np.testing.assert_array_equal(one.q, other.q)


def test_what_goes_beside_a_repeated_run_ends_with_it(monkeypatch):
    """It went on to the end of the run after Ctrl-C, so that nothing happened for minutes."""
    ends = []

    def rows(verified, begin, chunks, shift, progress):
        if shift == 0.0:
            raise KeyboardInterrupt
        for _ in range(300 if shift < 0.0 else 0):
            time.sleep(0.01)
            progress("integrate", 1.0)
        ends.append(shift)
        return np.vstack([chunk.values for chunk in chunks])

    prepared, _ = advanced(1)
    monkeypatch.setattr(verified_run, "_rows_on_moved_steps", rows)
    monkeypatch.setattr(prepared.verified.error, "amplified_round_off", lambda: 1.0)
    with pytest.raises(KeyboardInterrupt):
        verified_run.measure_round_off_growth(prepared.verified, 1e-9, prepared.begin, silent)
    assert len(ends) == 1 and ends[0] > 0.0
