"""Kinetostatic bodies at short steps: rates of their deformation must not feed on themselves."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from accuracyscenes import beside_a_large_motion
from flexiblescenes import rod
from truth.test_effects import channels

import flexmb
from flexmb.errors import FlexmbError, SolverError
from flexmb.model import Model
from tests.benchmarks.audit_honesty import random_model

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


def pendulum_on_a_rod(deformation, place=0.0, **words):
    """It hangs on a rod that a driver turns by 1.2 rad, on which it would vibrate at 6 Hz."""
    made = Model("pendulum on a driven rod", gravity=[0, -9.81, 0])
    made.add_marker("ground.hub", position=[place, 0, 0])
    made.add_body("rod", rod(0.016, 1.0, 10, 6), position=[place, 0, 0], deformation=deformation,
                  **words)  # fmt: skip
    made.add_body("bob", mass=2.0, inertia=[0.02] * 3, position=[place + 1.0, -0.25, 0])
    made.add_marker("bob.top", position=[0, 0.25, 0])
    made.add_joint("hub", "revolute", between=["ground.hub", "rod.root"], axis="z")
    made.add_joint("pin", "revolute", between=["rod.tip", "bob.top"], axis="z")
    made.add_driver("motor", joint="hub", angle="1.2*step5(t, 0, 0, 1, 1)")
    made.add_sensor("R", "reaction", joint="pin", axes="global")
    made.add_sensor("bob", "position", of="bob")
    return made


NAMES = ("R.x", "R.y", "bob.y")
KNOBS = {"start": "quasi-static", "outputs": 50, "verify": False}


@pytest.mark.seconds
def test_more_accuracy_does_not_make_a_pendulum_on_a_driven_rod_worse():
    """Reactions were 800 N for 38 N, and 15 % of the energy was off."""
    full, _ = channels(
        pendulum_on_a_rod("dynamic", damping=0.1), NAMES, **KNOBS, duration=1.0, accuracy=1e-5
    )
    some, result = channels(
        pendulum_on_a_rod("quasi-static"), NAMES, **KNOBS, duration=1.0, accuracy=1e-6,
        method="generalized-alpha",
    )  # fmt: skip
    largest = np.abs(full[:2]).max()
    assert np.abs(some[:2]).max() == pytest.approx(largest, rel=0.02)
    assert np.abs(some[2] - full[2]).max() < 2e-3
    assert result.statistics["energy_balance_error"] < 2e-4


@pytest.mark.seconds
@pytest.mark.parametrize(
    ("method", "place"),
    [("radau", 0.0)]
    + [pytest.param(*case, marks=pytest.mark.slow)
       for case in (("radau", 1000.0), ("generalized-alpha", 0.0), ("explicit-rk", 0.0))],
)  # fmt: skip
def test_errors_do_not_grow_as_steps_get_shorter(method, place):
    """Each step left the same error: energy was off ten times as much by steps of 0.1 ms."""
    knobs = {**KNOBS, "duration": 1.0, "accuracy": None, "method": method}
    runs = [channels(pendulum_on_a_rod("quasi-static", place), NAMES, **knobs, step=step)
            for step in (1e-3, 1e-4)]  # fmt: skip
    (long, before), (short, after) = runs
    assert np.abs(short - long)[2].max() < (1e-6 if method == "radau" else 5e-6)
    assert np.abs(short - long)[:2, 5:].max() < 2e-3 * np.abs(long[:2]).max()
    balances = [one.statistics["energy_balance_error"] for one in (before, after)]
    assert balances[1] < 1.1 * balances[0] + 1e-6


@pytest.mark.seconds
@pytest.mark.parametrize("accuracy", [1e-3, 1e-5])
def test_an_explicit_method_sees_how_far_the_deformation_is_from_its_stages(accuracy):
    """It took 26 steps at any accuracy, and told 2 % of the error of reactions."""
    knobs, made = KNOBS | {"duration": 1.0}, pendulum_on_a_rod("quasi-static")
    true, _ = channels(made, NAMES, **knobs, accuracy=None, step=2.5e-4, method="radau")
    found, result = channels(
        made, NAMES, **knobs | {"verify": True}, accuracy=accuracy, method="explicit-rk"
    )
    off = np.abs(found - true)
    place = off[2].max() / np.ptp(true[2])
    reaction = off[:2, 8:].max() / np.ptp(true[:2], axis=1).max()
    assert place < accuracy
    told = result.statistics
    assert place / 3 < told["measured_error_of_positions"]
    assert reaction / 3 < told["measured_error_of_reactions"]


@pytest.mark.seconds
@pytest.mark.parametrize("method", ["radau", "generalized-alpha", "explicit-rk"])
def test_first_rows_have_the_rates_of_a_smooth_start(method):
    """The deformation had none until four steps were there, of which none is far longer than the
    one before: reactions of the first rows were off by 11 %."""
    made = pendulum_on_a_rod("quasi-static", 0.0)
    made.drivers.clear()
    made.add_driver("motor", joint="hub", angle="1.2*sin(2*t)")
    knobs, names = KNOBS | {"duration": 0.1}, ("R.x", "R.y")
    true, _ = channels(made, names, **knobs, accuracy=None, step=1e-5, method="radau")
    found, result = channels(made, names, **knobs | {"verify": True}, accuracy=1e-4, method=method)
    off = np.abs(found - true) / np.ptp(true, axis=1).max()
    assert off[:, :8].max() < 1.5e-3
    assert result.statistics["measured_error_of_reactions"] < 3 * off.max()


@pytest.mark.parametrize(
    "method", ["generalized-alpha", *(pytest.param(k, marks=pytest.mark.slow)
                                      for k in ("radau", "explicit-rk"))]
)  # fmt: skip
def test_accelerations_of_the_deformation_are_no_round_off_in_the_shortest_steps(method):
    """A heavy ball on a short rod falls on a hinge: its reaction is that of a rigid pendulum.

    Nothing vibrates, so that it is smooth; it jumped by 1e-3.

    I φ̈ = m g d cos φ and ω² = 2 m g d sin φ / I, the reaction m g − m a of the centre.
    """
    length, side, g, density = 0.8, 0.012, 9.81, 7800.0
    made = Model("heavy ball", gravity=[0, -g, 0])
    made.add_body("rod", rod(side, length, 8, 6), deformation="quasi-static")
    made.add_body("ball", mass=5.0, inertia=[0.02] * 3, position=[length, 0, 0])
    made.add_joint("hub", "revolute", between=["ground", "rod.root"], axis="z")
    made.add_joint("tie", "fixed", between=["rod.tip", "ball"])
    made.add_sensor("R", "reaction", joint="hub", axes="global")
    made.add_sensor("turn", "angle", joint="hub")
    (x, y, turn), _ = channels(
        made, ("R.x", "R.y", "turn"), **KNOBS, duration=0.02, accuracy=None, step=1e-5,
        method=method,
    )  # fmt: skip
    own = density * side**2 * length
    moment, mass = 5.0 * length + own * length / 2, 5.0 + own
    inertia = 0.02 + 5.0 * length**2 + own * (length**2 / 3 + side**2 / 12)
    phi = -turn
    alpha, square = moment * g * np.cos(phi) / inertia, 2 * moment * g * np.sin(phi) / inertia
    along = -moment * (alpha * np.sin(phi) + square * np.cos(phi))
    down = moment * (alpha * np.cos(phi) - square * np.sin(phi))
    force = np.hypot(along, mass * g - down)
    size = np.hypot(x, y)[5:]
    np.testing.assert_allclose(size, force[5:], rtol=5e-3)  # what it bends, left out
    smooth = np.polynomial.Polynomial.fit(np.arange(len(size)), size, 6)
    np.testing.assert_allclose(size, smooth(np.arange(len(size))), rtol=2e-5)


def fast_crank(deformation, speed=60, place=0.0):
    """A thin rod moves a slider, at 60 rad/s by up to 0.42 of the load that buckles it."""
    made, radius, length = Model("fast crank"), 0.04, 0.3
    made.add_marker("ground.at", position=[place, 0, 0])
    made.add_body("crank", mass=1.0, inertia=[0.01] * 3, position=[place, 0, 0])
    made.add_marker("crank.pin", position=[radius, 0, 0])
    made.add_body("rod", rod(0.003, length, 10, 3), position=[place + radius, 0, 0],
                  deformation=deformation)  # fmt: skip
    made.add_body("slider", mass=0.3, inertia=[1e-4] * 3,
                  position=[place + radius + length, 0, 0])  # fmt: skip
    made.add_joint("bearing", "revolute", between=["ground.at", "crank"], axis="z")
    made.add_joint("pin", "spherical", between=["crank.pin", "rod.root"])
    made.add_joint("wrist", "cylindrical", between=["rod.tip", "slider"], axis="z")
    made.add_joint("guide", "prismatic", between=["ground.at", "slider"], axis="x")
    made.add_driver("motor", joint="bearing", angle=f"{speed}*t")
    made.add_marker("rod.middle", position=[length / 2, 0, 0])
    made.add_sensor("middle", "position", of="rod.middle")
    made.add_sensor("slider", "position", of="slider")
    return made


@pytest.mark.seconds
@pytest.mark.parametrize("step", [None, 1e-4])
@pytest.mark.parametrize("place", [0.0, pytest.param(1000.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", ["radau", "generalized-alpha", "explicit-rk"])
def test_loads_that_follow_the_modes_by_more_than_these_settle(method, place, step):
    """Tension turns with what it bends: the iteration grew, and runs ended within a millisecond."""
    names, knobs = ("middle.x", "middle.y", "slider.x"), {**KNOBS, "duration": 0.1}
    true, _ = channels(fast_crank("dynamic"), names, **knobs, accuracy=1e-5, method="radau")
    steps = {"accuracy": None if step else 1e-5, "step": step, "method": method}
    made = fast_crank("quasi-static", place=place)
    found, result = channels(made, names, **knobs, **steps)
    found[[0, 2]] -= place
    off = np.abs(found - true).max(axis=1) / np.ptp(true, axis=1)
    assert np.all(off < [2e-4, 3e-3, 1e-6])
    assert result.statistics["energy_balance_error"] < 1e-4


@pytest.mark.seconds
@pytest.mark.parametrize("step", [None, 1e-4])
@pytest.mark.parametrize("method", ["generalized-alpha", "explicit-rk"])
def test_they_settle_beside_a_large_motion(method, step):
    """The size of the model is not that of the crank. Beside what moves freely accelerations were
    those of a step, with reactions of the pose before in its matrix: runs ended."""
    names, knobs = ("middle.x", "middle.y", "slider.x"), {"duration": 0.1, "verify": False}
    true, _ = channels(fast_crank("dynamic"), names, **knobs, outputs=300, start="quasi-static",
                       accuracy=1e-5, method="radau")  # fmt: skip
    made = beside_a_large_motion(fast_crank("quasi-static"))
    steps = {"accuracy": None if step else 1e-5, "step": step, "method": method}
    found, _ = channels(made, names, **knobs, outputs=300, start="quasi-static", **steps)
    off = np.abs(found - true).max(axis=1) / np.ptp(true, axis=1)
    assert np.all(off < [2e-4, 2e-3, 1e-6])


@pytest.mark.parametrize("method", ["radau", "generalized-alpha", "explicit-rk"])
def test_a_rod_that_buckles_has_no_equilibrium(method):
    """It is pulled at first, and pushed from about a quarter of a turn on: no unstable end."""
    with pytest.raises(SolverError, match=r"do(es)? not (settle|converge)") as failed:
        flexmb.simulate(
            fast_crank("quasi-static", 200), duration=0.03, accuracy=1e-5, method=method
        )
    assert 1.5 < 200 * float(re.search(r"t = ([\d.]+) s", str(failed.value))[1]) < 2.0


def test_what_reactions_lack_at_first_is_no_instability():
    """They are solved for by a matrix with those of before: what that changes was taken for a
    deformation that loads push on, and an arm that is driven ended at 0.0842 s."""
    model = random_model(41)
    model.bodies["arm"] = model.bodies["arm"].model_copy(update={"deformation": "quasi-static"})
    model.set_validity(deflection="any", rotation="any", inertia_loads="any", truncation="any",
                       load_factor="any", speed="any")  # fmt: skip
    runs = [flexmb.simulate(model, method=method, accuracy=1e-3, outputs=300)["load.y"]
            for method in ("generalized-alpha", "radau")]  # fmt: skip
    np.testing.assert_allclose(*runs, atol=1e-6 * np.ptp(runs[1]))


def test_fixed_explicit_steps_tell_that_an_arm_bends_too_far():
    """They told their limit of stability, which the change of what follows its loads is not."""
    model = random_model(1)
    model.bodies["arm"] = model.bodies["arm"].model_copy(update={"deformation": "quasi-static"})
    duration = model.dynamics.duration
    with pytest.raises(FlexmbError, match=r"bodies.arm is deflected by 0\.\d+ of its length"):
        flexmb.simulate(
            model, method="explicit-rk", accuracy=None, step=duration / 300, outputs=300
        )


@pytest.mark.slow
def test_a_plate_bends_as_its_damped_vibrations_end():
    """Across its plane nothing softens it; its joint was closed a third of a turn on, or the run
    ended, as reactions were those of the pose before."""
    scene = Path(__file__).parents[2] / "cases" / "rotating_plate" / "scene.toml"
    runs = []
    for words in ({"deformation": "quasi-static"}, {"deformation": "dynamic", "damping": "0.7"}):
        words |= {"inertia_coupling": "constant", "geometric_stiffening": "none", "modes": "4"}
        changes = {f"bodies.plate.{name}": value for name, value in words.items()}
        model = flexmb.load_scene(scene, {**changes, "dynamics.outputs": "50"})
        model.checks = []
        runs.append(flexmb.simulate(model)["corner.z"])
    loaded = slice(0, 10)  # until 0.05 s
    np.testing.assert_allclose(runs[0][loaded], runs[1][loaded], rtol=1e-6)
    assert np.abs(runs[0][12:]).max() < 1e-9
