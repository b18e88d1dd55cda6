"""Values of knobs: ranges, lists, texts; and the names of knobs."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from flexmb.errors import SceneError
from flexmb.model import Model
from flexmb.model.scenes.study import resolve_knob, sweep_values

SCENE = {
    "parameters": {"speed": 3.0, "step": 1.0},
    "bodies": {"rod": {"mass": 1.0, "markers": {"tip": {"position": [1, 0, 0]}}}},
}


def test_a_range_goes_by_factors_of_ten_both_ways() -> None:
    assert sweep_values("1e-2..1e-8") == (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
    assert sweep_values("1..1000") == (1, 10, 100, 1000)
    assert sweep_values("2e-2..1e-4") == (2e-2, 2e-3, 2e-4)


def test_a_counted_range_has_equal_ratios_and_its_own_ends() -> None:
    values = sweep_values("1.234e-2..3e-5:6")
    assert (values[0], values[-1], len(values)) == (1.234e-2, 3e-5, 6)
    ratios = [b / a for a, b in pairwise(values)]
    assert np.ptp(ratios) < 0.02 * ratios[0]  # rounded to three digits
    assert sweep_values("4..32:4") == (4, 8, 16, 32)
    assert all(isinstance(value, int) for value in sweep_values("1..9:3"))


def test_lists_hold_numbers_paths_expressions_and_vectors_each_once() -> None:
    assert sweep_values("4, 8,8,16") == (4, 8, 16)
    assert sweep_values("../../a.msh,b.msh") == ("../../a.msh", "b.msh")
    assert sweep_values("max(r, 2),turn/100") == ("max(r, 2)", "turn/100")
    assert sweep_values("[0, -9.81, 0],none") == ([0, -9.81, 0], "none")
    assert sweep_values(["1e-2..1e-3", 5, np.float64(2.5)]) == (1e-2, 1e-3, 5, 2.5)
    assert sweep_values(np.array([1.0, 2.0])) == (1.0, 2.0)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("", "no values"),
        ([], "no values"),
        ("1,,2", "between the commas is empty"),
        ("0..1", "two positive ends"),
        ("1e-2..-1e-4", "two positive ends"),
        ("1e-2..", "must have two numbers"),
        ("1e-2..many", "must have two numbers"),
        ("..1e-4", "must have two numbers"),
        ("1..2:1", "from 2 to 1000"),
        ("1..2:many", "from 2 to 1000"),
        (list(range(1001)), "1001 values"),
    ],
)
def test_values_that_cannot_be_are_refused(given: object, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        sweep_values(given)


def test_short_names_are_parameters_first_then_fields_of_dynamics() -> None:
    assert resolve_knob(SCENE, "speed") == ("speed", None)
    assert resolve_knob(SCENE, "step") == ("step", None)  # the parameter, as for --set
    assert resolve_knob(SCENE, "method") == ("dynamics.method", None)
    assert resolve_knob(SCENE, "bodies.rod.mass") == ("bodies.rod.mass", None)
    assert resolve_knob(SCENE, "bodies.rod.center")[1] is None  # a field with a default


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("sped", "speed"),
        ("bodies.rd.mass", "bodies.rod.mass"),
        ("parameters.spede", "speed"),
        ("view.time", ""),
        ("bodies.rod.markers", ""),
    ],
)
def test_an_unknown_knob_names_its_neighbours(name: str, near: str) -> None:
    problem = resolve_knob(SCENE, name)[1]
    assert problem is not None
    assert near in (*problem.nearest, "")


def test_a_scene_keeps_its_study_and_gives_it_back() -> None:
    scene = {
        "bodies": {"rod": {"mass": 1, "inertia": [1, 1, 1]}},
        "sensors": {"rod": {"type": "position", "of": "rod"}},
        "dynamics": {"duration": 1, "step": 1e-2},
        "study": {"vary": {"step": "1e-2..1e-4", "bodies": {"rod": {"mass": [1, 2]}}}},
    }
    study = Model.from_scene_dict(scene).study
    assert study is not None
    assert study.vary == {"step": (1e-2, 1e-3, 1e-4), "bodies.rod.mass": (1, 2)}
    written = Model.from_scene_dict(scene).to_scene_dict()
    assert Model.from_scene_dict(written).study == study


def test_all_mistakes_of_a_study_are_told_with_their_places() -> None:
    scene = {
        "bodies": {"rod": {"mass": 1, "inertia": [1, 1, 1]}},
        "sensors": {"rod": {"type": "position", "of": "rod"}},
        "study": {"vary": {"stpe": [1], "step": []}, "target": 3, "sensor": ["rod"]},
    }
    with pytest.raises(SceneError) as caught:
        Model.from_scene_dict(scene)
    said = str(caught.value)
    assert "study.vary.step: no values are given" in said
    assert "study.target" in said
    assert 'study.sensor: unknown key "sensor"; nearest: sensors' in said
    scene["study"] = {"vary": {"stpe": [1]}, "sensors": ["rd.x"]}
    with pytest.raises(SceneError) as caught:
        Model.from_scene_dict(scene)
    assert 'study.vary.stpe: the scene has no knob "stpe"; nearest: step' in str(caught.value)
    assert 'study.sensors[0]: unknown sensor or channel "rd.x"; nearest: rod.x' in str(caught.value)
