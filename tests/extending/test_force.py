"""A force with memory by a file of the model, a file of the engine and one registry line."""

from __future__ import annotations

from pathlib import Path

import pytest

from extending import Extension

CYCLES = """
import numpy as np

import flexmb

k, limit, amplitude = 1e3, 20.0, 0.05
model = flexmb.Model("an elastoplastic spring in cycles")
model.add_body("mass", mass=1.0, inertia=[0.1, 0.1, 0.1], position=[1, 0, 0])
model.add_joint("guide", "prismatic", between=["ground", "mass"], axis="x")
model.add_driver("shaker", joint="guide", stroke=f"1 + {amplitude}*sin(2*pi*t)")
model.add_force(
    "spring", "elastoplastic", between=["ground", "mass"], stiffness=k, yield_force=limit
)
model.add_sensor("force", "reaction", force="spring", axes="global")
model.add_sensor("stroke", "stroke", joint="guide")
model.add_sensor("stored", "energy", quantity="spring")
result = flexmb.simulate(model, duration=1.75, step=1e-3, outputs=175)

plastic, expected = 0.0, []
for elongation in result["stroke"] - 1.0:
    force = k * (elongation - plastic)
    if abs(force) > limit:
        plastic += (force - np.sign(force) * limit) / k
        force = np.sign(force) * limit
    expected.append(force)
print(np.abs(result["force.x"] + expected).max())
print(np.abs(result["stored"] - np.square(expected) / (2 * k)).max())
"""


@pytest.mark.seconds
def test_a_new_force_with_memory_follows_its_history(tmp_path: Path) -> None:
    force, energy = Extension("force", tmp_path).run(CYCLES).split()
    assert float(force) < 1e-9
    assert float(energy) < 1e-12


REFUSED = """
import flexmb

model = flexmb.Model("refused")
model.add_body("mass", mass=1.0, inertia=[0.1, 0.1, 0.1], position=[1, 0, 0])
words = {"between": ["ground", "mass"], "stiffness": -1.0, "yield_force": 20.0}
try:
    model.add_force("spring", "elastoplastic", **words)
except flexmb.FlexmbError as error:
    print(error)
"""


def test_its_words_are_checked_as_all_others(tmp_path: Path) -> None:
    assert "forces.spring.stiffness" in Extension("force", tmp_path).run(REFUSED)
