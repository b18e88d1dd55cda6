"""A sensor by its specification, its units and a registry line: the speed of a marker."""

from __future__ import annotations

from pathlib import Path

import pytest

from extending import Extension

RUN = """
import numpy as np
import flexmb

def pendulum(drag):
    model = flexmb.Model("pendulum", gravity=[0, -9.81, 0])
    model.add_body("rod", mass=2.0, inertia=[0.1, 0.1, 0.1])
    model.add_marker("rod.pin", position=[-0.5, 0, 0])
    model.add_marker("rod.tip", position=[0.5, 0, 0])
    model.add_joint("hinge", "revolute", between=["ground", "rod.pin"], axis="z")
    model.add_sensor("v", "velocity", of="rod.tip")
    model.add_sensor("fast", "speed", of="rod.tip")
    model.add_force("drag", "torque", at="rod.tip", value=[0, 0, drag])
    model.set_dynamics(duration=0.5, accuracy=1e-6, outputs=50)
    return flexmb.simulate(model)

one, other = pendulum("-0.3*fast"), pendulum("-0.3*hypot(v.x, v.y)")
print(one.unit("fast"), np.ptp(one["fast"]))
print(abs(one["fast"] - np.hypot(one["v.x"], one["v.y"])).max())
print(abs(one["fast"] - other["fast"]).max())
"""


@pytest.mark.slow  # compiles what reads the new sensor
def test_a_new_sensor_is_recorded_and_a_force_follows_it(tmp_path: Path) -> None:
    extension = Extension("sensor_speed", tmp_path)
    unit, moved, measured, followed = extension.run(RUN).split()
    assert unit == "m/s"
    assert float(moved) > 1.0
    assert float(measured) < 1e-12
    assert float(followed) < 1e-10  # the gradient lets the tangent know how the force changes


def test_the_new_sensor_is_listed_and_its_mistakes_are_reported(tmp_path: Path) -> None:
    extension = Extension("sensor_speed", tmp_path)
    code = "import sys; from flexmb.cli import main; sys.argv[1:] = ['list', 'sensors']; main()"
    assert "speed" in extension.run(code)
    mistake = (
        "import flexmb; m = flexmb.Model('m')\n"
        "try: m.add_sensor('s', 'speed')\n"
        "except flexmb.FlexmbError as error: print(error)"
    )
    assert "sensors.s.of: is missing" in extension.run(mistake)
