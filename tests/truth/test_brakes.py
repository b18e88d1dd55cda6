"""Friction in joints that a brake presses: the preload as a function of time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import SceneError
from flexmb.model import Model

J, MU, R, W0 = 0.1, 0.3, 0.1, 30.0


def disc(preload, torque: str | float = 0.0, axis="z", place=(0, 0, 0), **friction):
    """A disc whose hub rubs on its pin, under a torque."""
    made = Model("disc")
    along = np.eye(3)["xyz".index(axis)]
    made.add_marker("ground.pin", position=list(place))
    made.add_body("disc", mass=2.0, inertia=[J] * 3, position=list(place),
                  angular_velocity=list(W0 * along))  # fmt: skip
    made.add_joint("pin", "revolute", between=["ground.pin", "disc"], axis=axis)
    made.add_force("brake", "joint-friction", joint="pin", dynamic=MU, radius=R, preload=preload,
                   **{"stiffness": 1e6, "damping": 2e3, **friction})  # fmt: skip
    made.add_force("drive", "torque", at="disc", value=[torque if a else 0.0 for a in along])
    made.add_sensor("turn", "angle", joint="pin", derivative=1)
    return made


def run(made, duration=2.0, **fields):
    options = {"outputs": 200, "accuracy": 1e-7, **fields}
    return flexmb.simulate(made, duration=duration, **options)


@pytest.mark.parametrize(("axis", "place"), [("z", (0, 0, 0)), ("x", (1e3, -700.0, 300.0))])
def test_a_brake_that_closes_holds_and_opens(axis, place):
    """J dw/dt = -mu R N(t) until the disc stands; the brake holds 4 N m until it opens at 1.6 s."""
    N = "200*step5(t, 0.2, 0, 0.4, 1)*(1 - step(t, 1.6, 0, 1.6001, 1))"
    found = run(disc(N, "4*step(t, 1.2, 0, 1.3, 1)", axis, place))
    t, w = found.time, found["turn"]
    x = np.clip((t - 0.2) / 0.2, 0.0, 1.0)
    impulse = 0.2 * (2.5 * x**4 - 3.0 * x**5 + x**6) + np.maximum(t - 0.4, 0.0)
    slows = W0 - MU * R * 200.0 / J * impulse
    np.testing.assert_allclose(w[t < 0.75], slows[t < 0.75], atol=1e-6)
    assert abs(w[(t > 0.95) & (t < 1.15)]).max() < 1e-6  # 6 N m hold it, and then 4 N m
    assert abs(w[(t > 1.4) & (t < 1.59)]).max() < 1e-6
    np.testing.assert_allclose(w[t > 1.62], 4.0 / J * (t[t > 1.62] - 1.60005), atol=3e-3)


def test_it_slips_when_the_preload_has_fallen_to_what_holds():
    """mu R N(t) = M at 1.667 s; from there J dw/dt = M - mu R N(t)."""
    found = run(disc("200 - 400*max(t - 1.5, 0)", "4*step(t, 0.9, 0, 1, 1)"))
    t, w = found.time, found["turn"]
    begin = 1.5 + (200.0 - 4.0 / (MU * R)) / 400.0
    after = t > begin + 0.02
    wanted = 0.5 * MU * R * 400.0 / J * (t[after] - begin) ** 2
    np.testing.assert_allclose(w[after], wanted, atol=1e-3)
    assert abs(w[(t > 1.2) & (t < begin)]).max() < 1e-3


def test_a_preload_that_swings_makes_few_events():
    """The limit of the bristle grows with the preload: without its rate there were 51 to 156."""
    counts = []
    for method in ("explicit-rk", "radau"):
        made = disc("100 + 60*sin(9*t)", "5*sin(4*t)", damping=200.0)
        found = run(made, method=method, accuracy=1e-6)
        counts.append(found.statistics["events"])
    assert counts[0] == counts[1] < 35


def test_it_is_the_constant_one_and_scales_with_units():
    plain, text = (run(disc(one)).reaction("pin").moment[:, 2] for one in (50.0, "50*cos(0*t)"))
    np.testing.assert_array_equal(plain, text)
    ends = []
    for units, force, length in (("SI", 1.0, 1.0), ("mm-t-s", 1.0, 1e3), ("cm-g-s", 1e5, 1e2)):
        made = Model("rail", units=units)
        mass = {"SI": 2.0, "mm-t-s": 2e-3, "cm-g-s": 2e3}[units]
        made.add_body("cart", mass=mass, inertia=[mass * length**2] * 3,
                      velocity=[3 * length, 0, 0])  # fmt: skip
        made.add_joint("rail", "prismatic", between=["ground", "cart"], axis="x")
        made.add_force("brake", "joint-friction", joint="rail", dynamic=MU,
                       stiffness=f"{1e5 * force / length!r}", damping="800 N s/m",
                       preload=f"{20 * force!r}*t")  # fmt: skip
        made.add_sensor("x", "stroke", joint="rail")
        ends.append(run(made, 1.0)["x"][-1] / length)
    wanted = 3.0 - MU * 20.0 / 2.0 / 6.0
    assert ends == pytest.approx([wanted] * 3, rel=1e-9)


@pytest.mark.parametrize(
    ("preload", "said"),
    [
        (-5.0, "forces.brake.preload: must not be negative, is -5 N"),
        ("10 - 20*t", "is -30 N at t = 2 s: it would pull; max(0, ...) presses only"),
        ("turn", 'unknown name "turn"'),
        ("30 mm", "a force [N] is expected"),
        ({"type": "table", "points": [[0, 1], [1, 2]]}, "its points end at 1 s, the run at 2 s"),
        ("sqrt(1 - t)", "is not finite at t = 1"),
    ],
)
def test_what_is_no_preload_is_told(preload, said):
    with pytest.raises(SceneError) as caught:
        run(disc(preload))
    assert said in str(caught.value), str(caught.value)
    assert math.isfinite(run(disc("max(0, 10 - 20*t)"))["turn"][-1])


def test_the_listing_shows_the_default_as_a_scene_writes_it():
    done = CliRunner().invoke(app, ["list", "forces", "joint-friction"])
    [line] = [line for line in done.output.splitlines() if line.lstrip().startswith("preload ")]
    assert line.split() == [
        "preload",
        *["number", "or", "table", "as", "a", "function", "of", "t", "0"],
    ]
