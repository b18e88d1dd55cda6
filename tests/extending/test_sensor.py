"""A sensor by a file of the engine, its words in the model's file of sensors, and one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from extending import Extension

DRAG = """
import numpy as np

import flexmb

model = flexmb.Model("a body with drag in proportion to its speed squared", gravity=[0, 0, 0])
model.add_body("ball", mass=2.0, inertia=[0.1, 0.1, 0.1], velocity=[3.0, 0.0, 4.0])
model.add_sensor("v", "velocity", of="ball")
model.add_sensor("speed", "speed", of="ball")
drag = [f"-0.5*speed*v.{axis}" for axis in "xyz"]
model.add_force("drag", "force", at="ball", value=drag)
result = flexmb.simulate(model, duration=2.0, accuracy=1e-6, method="radau", outputs=20)
velocity = np.column_stack([result[f"v.{axis}"] for axis in "xyz"])
print(np.abs(result["speed"] - np.linalg.norm(velocity, axis=1)).max())
print(result["speed"][0], result["speed"][-1], result.unit("speed"))
"""


@pytest.mark.seconds
def test_a_new_sensor_is_recorded_and_acts(tmp_path: Path) -> None:
    """m v' = -c v², so 1/v grows by c t/m."""
    difference, first, last, unit = Extension("sensor", tmp_path).run(DRAG).split()
    assert float(difference) < 1e-12
    assert float(first) == pytest.approx(5.0)
    assert float(last) == pytest.approx(1.0 / (1.0 / 5.0 + 0.5 * 2.0 / 2.0), rel=1e-5)
    assert unit == "m/s"


PENDULUM = """
import numpy as np
import flexmb

def pendulum(drag):
    model = flexmb.Model("pendulum", gravity=[0, -9.81, 0])
    model.add_body("rod", mass=2.0, inertia=[0.1, 0.1, 0.1], position=[0.5, 0, 0])
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
    extension = Extension("sensor", tmp_path)
    unit, moved, measured, followed = extension.run(PENDULUM).split()
    assert unit == "m/s"
    assert float(moved) > 1.0
    assert float(measured) < 1e-12
    assert float(followed) < 1e-10  # the gradient lets the tangent know how the force changes


@pytest.mark.seconds
def test_the_new_sensor_is_listed_and_its_mistakes_are_reported(tmp_path: Path) -> None:
    extension = Extension("sensor", tmp_path)
    code = "import sys; from flexmb.cli import main; sys.argv[1:] = ['list', 'sensors']; main()"
    assert "speed" in extension.run(code)
    mistake = (
        "import flexmb; m = flexmb.Model('m')\n"
        "try: m.add_sensor('s', 'speed')\n"
        "except flexmb.FlexmbError as error: print(error)"
    )
    assert "sensors.s.of: is missing" in extension.run(mistake)
