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


def _run(speed: float, force: str = f"{_FORCE}", **words: Any) -> Result:
    """A run of the blade at a speed over the first frequency."""
    model = Model("blade")
    model.add_body(
        "blade", mesh={"type": "beam", "length": _LENGTH, "divisions": 10},
        material={"E": _YOUNG, "nu": 0.3, "density": _DENSITY},
        sections={"all": {"type": "rectangle", "y": _SIDE, "z": _SIDE}},
        interfaces={"root": "start", "tip": "end"}, modes=2, stress="none",
        **{"frame": "interface root", **words},
    )  # fmt: skip
    model.add_joint("axle", "revolute", between=["ground", "blade.root"], axis="z")
    model.add_driver("motor", joint="axle", angle=f"{speed * _FIRST}*t")
    model.add_force("push", "force", at="blade.tip", value=[0, 0, force])
    model.add_sensor("tip", "position", of="blade.tip", seen_from="blade.root")
    model.set_dynamics(
        duration=_DURATION, outputs=300, accuracy=1e-4, start="undeformed", verify=False
    )
    return flexmb.simulate(model)


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
