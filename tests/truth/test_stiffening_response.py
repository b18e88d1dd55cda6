"""What a run tells of phases that vibrations lose for want of geometric stiffening.

A cantilever that turns with Ω about an axis at its root flaps with ω² = ω₁² + 1.193 Ω² (Southwell),
and with ω₁ where its frame is at its root and nothing stiffens it. A force at its tip that begins
at once lets it vibrate as 1 − cos ω t.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import flexmb
from flexmb.model import Model
from flexmb.results import Result

_YOUNG, _DENSITY, _LENGTH, _SIDE = 2.1e11, 7850.0, 1.0, 0.01
_FIRST = 1.875104**2 * _SIDE * np.sqrt(_YOUNG / (12.0 * _DENSITY)) / _LENGTH**2  # rad/s
_FORCE = 3.0 * _YOUNG * _SIDE**4 / 12.0 * 1e-3 / _LENGTH**2  # N, bends it by 1e-3 of its length
_DURATION = 40.0 * np.pi / _FIRST  # 20 periods


def _run(speed: float, force: str = f"{_FORCE}", periods: int = 20, **words: Any) -> Result:
    """A run of the blade at a speed over the first frequency."""
    model = Model("blade")
    _add_bar(model, "blade", _SIDE, **{"frame": "interface root", **words})
    model.add_joint("axle", "revolute", between=["ground", "blade.root"], axis="z")
    model.add_driver("motor", joint="axle", angle=f"{speed * _FIRST}*t")
    model.add_force("push", "force", at="blade.tip", value=[0, 0, force])
    model.add_sensor("tip", "position", of="blade.tip", seen_from="blade.root")
    model.set_dynamics(
        duration=periods * 2.0 * np.pi / _FIRST, outputs=15 * periods, accuracy=1e-4,
        start="undeformed", verify=False,
    )  # fmt: skip
    return flexmb.simulate(model)


def _add_bar(model: Model, name: str, side: float, **words: Any) -> None:
    model.add_body(
        name, mesh={"type": "beam", "length": _LENGTH, "divisions": 10},
        material={"E": _YOUNG, "nu": 0.3, "density": _DENSITY},
        sections={"all": {"type": "rectangle", "y": side, "z": side}},
        interfaces={"root": "start", "tip": "end"}, stress="none", **{"modes": 2, **words},
    )  # fmt: skip


def _told(run: Result) -> list[str]:
    return [one for one in run.notes if "geometric stiffening is left out" in one]


def _share(sentence: str, sensor: str) -> float:
    """The share of its range by which the sentence tells that something is off."""
    before, _, rest = sentence.partition(" is off by about ")
    assert before.endswith(sensor), sentence
    return float(rest.partition("%")[0]) / 100.0


def test_a_slow_blade_is_told_the_phase_that_its_flapping_loses() -> None:
    """0.4 % of a frequency, after 20 periods 24 % of the range of the tip."""
    run = _run(0.08)
    t, stiff = run.time, np.sqrt(1.0 + 1.193 * 0.08**2)
    true = (1.0 - np.cos(stiff * _FIRST * t)) / stiff**2 - (1.0 - np.cos(_FIRST * t))
    truth = np.abs(true).max() / 2.0
    assert truth == pytest.approx(0.24, abs=0.02)
    (sentence,) = _told(run)
    assert _share(sentence, "sensors.tip") == pytest.approx(truth, rel=0.6)


def test_static_modes_lose_the_same_phase() -> None:
    """Their frequency, 3.5327 for 3.5160, is that of the run, whatever more modes would have."""
    speed, first = 0.02, 3.5327 / 3.5160 * _FIRST
    run = _run(speed, periods=150, modes=0)
    rates = np.array([[first], [np.hypot(first, np.sqrt(1.193) * speed * _FIRST)]])
    one, other = (1.0 - np.cos(rates * run.time)) / rates**2
    truth = np.abs(one - other).max() / np.ptp(one)
    (sentence,) = _told(run)
    assert _share(sentence, "sensors.tip") == pytest.approx(truth, rel=0.3)


def test_axes_of_reactions_tilt_as_a_hanging_bar_bends() -> None:
    """In axes of the load its weight cancels most of the force that accelerates it sideways."""
    model = Model("hanging", gravity=[9.81, 0, 0])
    _add_bar(model, "bar", 0.5 * _SIDE)
    model.add_joint("clamp", "fixed", between=["ground", "bar.root"])
    model.add_body("load", mass=5.0, inertia=[0.05] * 3, position=[1, 0, 0])
    model.add_joint("hook", "fixed", between=["bar.tip", "load"])
    model.add_force("push", "force", at="load", value=[0, "0.2*step5(t, 0.1, 0, 0.2, 1)", 0])
    model.set_dynamics(duration=6, outputs=1200, accuracy=1e-4, start="quasi-static", verify=False)
    (sentence,) = _told(flexmb.simulate(model))
    assert float(sentence.split(" is off by about ")[1].split("%")[0]) < 130.0


@pytest.mark.parametrize(
    ("speed", "force", "words"),
    [
        (0.005, f"{_FORCE}", {}),  # 0.1 % of the range after 20 periods
        (0.08, f"{_FORCE}*sin({0.1 * _FIRST}*t)*step5(t, 0, 0, {_DURATION / 4}, 1)", {}),  # forced
        (0.08, f"{_FORCE}", {"geometric_stiffening": "full"}),
    ],
)  # fmt: skip
def test_nothing_is_told_of_what_stiffening_hardly_changes(
    speed: float, force: str, words: dict[str, str]
) -> None:
    assert _told(_run(speed, force, **words)) == []
