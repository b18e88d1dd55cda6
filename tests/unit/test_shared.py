"""What all rooms share: errors, units, materials."""

from __future__ import annotations

import pickle

import pytest

from flexmb.errors import FlexmbError, MaterialError, Problem, SceneError, nearest
from flexmb.materials import COLUMNS, LIBRARY, Material, material, table
from flexmb.units import UNIT_SYSTEMS, unit_system


def test_a_problem_says_where_what_nearest_and_allowed():
    problem = Problem("joints.pin.type", 'unknown "revolut"', ("fixed", "revolute"), ("revolute",))
    assert str(problem) == (
        'joints.pin.type: unknown "revolut"; nearest: revolute; allowed: fixed, revolute'
    )


def test_an_error_has_one_line_for_each_problem_and_survives_pickling():
    error = SceneError.from_problems([Problem("a", "wrong"), Problem("b", "missing")])
    assert str(error) == "a: wrong\nb: missing"
    again = pickle.loads(pickle.dumps(error))
    assert isinstance(again, SceneError) and again.problems == error.problems
    assert FlexmbError("sentence").problems[0].what == "sentence"


def test_long_lists_of_names_are_cut():
    text = str(Problem("", "unknown", tuple(f"n{i}" for i in range(50))))
    assert "n19" in text and "n20" not in text and "and 30 more" in text


def test_nearest_names_ignore_case():
    assert nearest("STEAL", ["steel", "brass"]) == ("steel",)
    assert nearest("qqq", ["steel", "brass"]) == ()
    assert nearest("body", ["title", "bodies"]) == ("bodies",)


def test_unit_factors():
    mm = unit_system("mm-t-s")
    assert mm.factor(L=1) == 1e-3
    assert mm.factor(L=-1, M=1, T=-2) == 1e6  # MPa
    assert mm.factor(L=-3, M=1) == 1e12  # t/mm^3
    pound = unit_system("in-lbf-s")
    assert pound.factor(L=-1, M=1, T=-2) == pytest.approx(6894.757293168361, rel=1e-14)  # psi
    for system in UNIT_SYSTEMS.values():  # consistent: force is mass length over time squared
        force = system.factor(L=1, M=1, T=-2)
        assert force == pytest.approx(system.mass * system.length / system.time**2, rel=1e-14)


def test_unknown_unit_system_and_material():
    with pytest.raises(FlexmbError, match="nearest: mm-t-s"):
        unit_system("mm-ton-s")
    with pytest.raises(MaterialError, match="nearest: steel"):
        material("stel")
    assert material("Stainless_Steel") is LIBRARY["stainless steel"]


def test_impossible_materials_are_refused_with_all_numbers():
    with pytest.raises(MaterialError) as caught:
        Material("x", E=-1, nu=0.5, density=0)
    assert len(caught.value.problems) == 3


def test_library_materials_have_a_source():
    assert all(entry.source and "user" not in entry.source for entry in LIBRARY.values())


def test_the_table_of_materials_shows_them_all():
    rows = table()
    assert [row[0] for row in rows] == list(LIBRARY)
    assert all(len(row) == len(COLUMNS) and all(row) for row in rows)
    steel = dict(zip(COLUMNS, rows[0], strict=True))
    assert (steel["E [GPa]"], steel["density [kg/m³]"]) == ("210", "7850")
