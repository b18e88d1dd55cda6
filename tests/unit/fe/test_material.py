"""Materials: resolved from names and numbers, and warned about when units have slipped."""

from __future__ import annotations

import pytest

from flexmb.errors import MaterialError
from flexmb.fe.sections.section_tables import plausibility, resolve
from flexmb.materials import LIBRARY


def test_from_a_name_a_mapping_and_itself():
    steel = resolve("steel")
    assert resolve(steel) is steel
    given = resolve({"E": 1e9, "nu": 0.2, "density": 2000, "name": "mine"})
    assert (given.E, given.nu, given.density, given.name) == (1e9, 0.2, 2000.0, "mine")


def test_the_library_is_plausible():
    assert not [sentence for entry in LIBRARY.values() for sentence in plausibility(entry)]


@pytest.mark.parametrize(
    ("density", "E", "sentence"),
    [
        (7.85e-9, 210e9, r"density 7.85e-09 .* given in t/mm\^3\? Then it is 7850 kg/m\^3"),
        (7.85e-6, 210e9, r"given in kg/mm\^3\?"),
        (7.85, 210e9, r"given in g/cm\^3\?"),
        (7850, 210e3, "210000 Pa is implausible; given in MPa"),
        (7850, 210, "given in GPa"),
        (900, 9e11, "wave speed sqrt.E/density. = 3.162e.04 m/s"),
        (7850, 2e6, "wave speed .* = 15.96 m/s"),
    ],
)
def test_unit_slips_are_named(density, E, sentence):
    import re

    found = "\n".join(plausibility(resolve({"E": E, "nu": 0.3, "density": density})))
    assert re.search(sentence, found)


def test_all_mistakes_at_once():
    with pytest.raises(MaterialError) as caught:
        resolve({"E": "stiff", "Nu": 0.3})
    text = str(caught.value)
    assert "material.E: must be a number" in text
    assert "material.Nu: unknown key; nearest: nu" in text
    assert "material.density: is missing" in text


@pytest.mark.parametrize(("key", "value"), [("E", -1.0), ("nu", 0.5), ("density", 0.0)])
def test_impossible_values(key, value):
    with pytest.raises(MaterialError, match=f"material.{key}"):
        resolve({"E": 1e9, "nu": 0.2, "density": 2000} | {key: value})
