"""A section of beams by its words in the one description of options, and what it does in fe."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from extending import Extension

BEAM = """
import json

import flexmb
from flexmb.fe import section_from
from flexmb.flexbody.natural_modes import natural_modes

words = {"type": "ellipse", "y": 0.03, "z": 0.02, "shear": False}
body = flexmb.reduce(
    {"type": "beam", "length": 1.0, "divisions": 10},
    material="steel", sections={"all": words}, interfaces={"root": "start"}, modes=6,
)
scene = json.dumps(flexmb.scene_schema())
section = section_from(words)
try:
    section_from({**words, "z": -1})
except flexmb.FlexmbError as error:
    print(error)
print(body.mass, natural_modes(body, ["root"]).frequencies[0])
print(section.A, section.Iy, section.Iz, section.J, "EllipseSection" in scene)
"""


def test_a_new_section_is_reduced_and_described(tmp_path: Path) -> None:
    """The first frequency of a cantilever, 1.875104^2 sqrt(E I/(rho A L^4))/(2 pi)."""
    mistake, body, section = Extension("section", tmp_path).run(BEAM).strip().splitlines()
    assert mistake == "section.z: must be positive, given -1 m"
    mass, frequency = map(float, body.split())
    A, Iy, Iz, J, in_schema = section.split()
    a, b = 0.015, 0.01
    assert float(A) == pytest.approx(math.pi * a * b)
    assert float(Iy) == pytest.approx(math.pi * a * b**3 / 4)
    assert float(Iz) == pytest.approx(math.pi * b * a**3 / 4)
    assert float(J) == pytest.approx(math.pi * a**3 * b**3 / (a**2 + b**2))
    assert mass == pytest.approx(7850 * math.pi * a * b, rel=1e-3)
    wanted = 1.8751041**2 * math.sqrt(210e9 * float(Iy) / mass) / (2 * math.pi)
    assert frequency == pytest.approx(wanted, rel=2e-3)
    assert in_schema == "True"
