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


def test_a_new_sensor_is_recorded_and_acts(tmp_path: Path) -> None:
    """m v' = -c v², so 1/v grows by c t/m."""
    difference, first, last, unit = Extension("sensor", tmp_path).run(DRAG).split()
    assert float(difference) < 1e-12
    assert float(first) == pytest.approx(5.0)
    assert float(last) == pytest.approx(1.0 / (1.0 / 5.0 + 0.5 * 2.0 / 2.0), rel=1e-5)
    assert unit == "m/s"
