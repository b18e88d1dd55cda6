"""Which settings share a machine, which share a model, and what a study looks at."""

from __future__ import annotations

from pathlib import Path

import pytest
from goodscene import GOOD
from meshfiles import write_box

from flexmb.errors import SceneError
from flexmb.studies.channel_errors import add_velocity_sensors, check_sensors
from flexmb.studies.study_settings import StudySource, make_settings

BEAM = """
[parameters]
h = 1e-4
n = 2
push = 3
spare = 1
[bodies.beam]
mesh = "box.msh"
material = "steel"
interfaces = { a = "left", b = "right" }
modes = "n"
[joints.wall]
type = "fixed"
between = ["ground", "beam.a"]
[forces.tip]
type = "force"
at = "beam.b"
value = [0, "push*t", 0]
[sensors.tip]
type = "position"
of = "beam.b"
[dynamics]
duration = 1e-3
step = "h"
"""


def plan(tmp_path: Path, text: str, **vary: object):
    write_box(tmp_path / "box.msh")
    (tmp_path / "scene.toml").write_text(text)
    base = StudySource.of(tmp_path / "scene.toml", None, tmp_path / "out", "study")
    knobs = {name.replace("__", "."): tuple(values) for name, values in vary.items()}  # type: ignore[call-overload]
    return make_settings(base, knobs)


def kinds(settings) -> tuple[int, int]:
    """Number of machines and of models."""
    return len({one.group for one in settings}), len({one.physics for one in settings})


@pytest.mark.parametrize(
    ("knob", "values", "machines", "models"),
    [
        ("dynamics__step", (1e-4, 1e-5), 1, 1),
        ("dynamics__method", ("generalized-alpha", "explicit-rk"), 1, 1),
        ("h", (1e-4, 1e-5), 1, 1),  # a parameter that only the step uses
        ("spare", (1, 2), 1, 1),  # one that nothing uses
        ("bodies__beam__modes", (2, 5, 3), 1, 3),
        ("n", (2, 5, 3), 1, 3),  # a parameter that is the number of modes
        ("push", (3, 4), 2, 2),  # one in a function of time
        ("bodies__beam__damping", (0.1, 0.2, 0.0), 3, 3),  # another damping is another machine
        ("bodies__beam__damping", (0.0, 0.1), 1, 2),  # none leaves it out
        ("bodies__beam__damping", ({"ratio": 0.1}, 0), 1, 2),
        ("bodies__beam__deformation", ("rigid", {"band": [0, 100]}, "quasi-static"), 1, 3),
        ("bodies__*__inertia_coupling", ("constant", "partial", "full"), 1, 3),
        ("bodies__*__geometric_stiffening", ("none", "full"), 1, 2),
        ("bodies__beam__frame", ("interface a", "mean axis"), 1, 2),
        ("effects__gravity", (False, True), 1, 2),
        ("effects__planar", (True, False), 1, 2),
    ],
)
def test_what_a_knob_changes_decides_what_its_error_is_measured_against(
    tmp_path: Path, knob: str, values: tuple[object, ...], machines: int, models: int
) -> None:
    assert kinds(plan(tmp_path, BEAM, **{knob: values})) == (machines, models)


def test_the_reference_has_all_effects_that_are_varied(tmp_path: Path) -> None:
    knobs = {
        "bodies__*__deformation": ("dynamic", "rigid"),
        "bodies__beam__inertia_coupling": ("constant", "partial"),
        "effects__planar": (True, False),
        "bodies__beam__damping": (0.1, 0),
    }
    settings = plan(tmp_path, BEAM, **knobs)
    whole = {
        "bodies.*.deformation": "dynamic", "bodies.beam.inertia_coupling": "full",
        "effects.planar": False, "bodies.beam.damping": 0.1,
    }  # fmt: skip
    assert all(one.complete == whole for one in settings)
    assert len({one.complete_physics for one in settings}) == 1
    assert settings[0].complete_physics not in {one.physics for one in settings}
    (same,) = plan(tmp_path, BEAM, **{key: (one,) for key, one in settings[0].values.items()})
    assert same.complete == same.values, "what is not varied stays as the scene says"


@pytest.mark.parametrize(
    ("knob", "values", "said"),
    [
        (
            "bodies__beam__deformation",
            ("rigd", "dynamic"),
            "bodies.beam.deformation: unknown choice",
        ),
        ("bodies__*__deformation", ({"bnd": [0, 1]}, "rigid"), 'unknown key "bnd"; nearest: band'),
        ("bodies__beam__frame", ("interface c", "mean axis"), 'no interface "c"'),
        ("bodies__beam__damping", (0, -0.1), "must be zero or positive"),
        ("effects__friction", (True, "no"), "effects.friction: true or false is expected"),
    ],
)
def test_values_of_effects_are_refused_before_anything_runs(
    tmp_path: Path, knob: str, values: tuple[object, ...], said: str
) -> None:
    with pytest.raises(SceneError) as caught:
        plan(tmp_path, BEAM, **{knob: values, "dynamics__step": (1e-4, 1e-5)})
    assert said in str(caught.value)


def test_no_body_is_flexible(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no flexible body"):
        plan(tmp_path, GOOD, **{"bodies__*__deformation": ("rigid", "dynamic")})


def test_the_finest_model_has_most_modes_and_the_last_mesh(tmp_path: Path) -> None:
    write_box(tmp_path / "fine.msh")
    settings = plan(
        tmp_path, BEAM, bodies__beam__mesh=("box.msh", "fine.msh"), bodies__beam__modes=(2, 9, 4)
    )
    finest = max(settings, key=lambda one: one.rank)
    assert finest.values == {"bodies.beam.mesh": "fine.msh", "bodies.beam.modes": 9}


def test_all_combinations_are_made_and_refused_ones_kept_with_the_reason(tmp_path: Path) -> None:
    settings = plan(tmp_path, GOOD, r=(0.1, 0.2), dynamics__step=(1e-3, -1.0, 1e-4))
    assert len(settings) == 6
    refused = [one for one in settings if one.model is None]
    assert [one.values["dynamics.step"] for one in refused] == [-1.0, -1.0]
    assert "dynamics.step: must be positive" in refused[0].refusal


def test_accuracy_and_step_vary_beside_each_other_with_everything_else(tmp_path: Path) -> None:
    text = BEAM.replace('mesh = "box.msh"', "mesh = { type = 'box', size = [1, 0.1, 0.1] }")
    text = text.replace('"left"', '"x0"').replace('"right"', '"x1"')
    settings = plan(
        tmp_path, text, accuracy=[1e-3, 1e-4], step=[1e-4], method=["radau", "generalized-alpha"],
        modes=[2, 4], mesh=[0, 1],
    )  # fmt: skip
    assert len(settings) == (2 + 1) * 2 * 2 * 2
    for setting in settings:
        assert ("dynamics.accuracy" in setting.values) != ("dynamics.step" in setting.values)
        assert setting.model is not None
    assert len({setting.group for setting in settings}) == 1  # one machine
    assert len({setting.physics for setting in settings}) == 4
    finest = max(settings, key=lambda one: one.rank).values
    assert (finest["bodies.*.modes"], finest["bodies.*.refine"]) == (4, 1)


def test_parameters_of_a_python_model_are_refused_because_they_have_no_effect(
    tmp_path: Path,
) -> None:
    (tmp_path / "scene.toml").write_text(GOOD)
    model = StudySource.of(tmp_path / "scene.toml", None, None, "study").model
    base = StudySource.of(model, None, tmp_path / "out", "study")
    with pytest.raises(SceneError, match="worked its parameters into its numbers"):
        make_settings(base, {"r": (0.1, 0.2)})
    assert len(make_settings(base, {"bodies.crank.mass": (1, 2)})) == 2


def test_a_velocity_sensor_joins_each_position_sensor_that_has_none() -> None:
    sensors = {
        "a": {"type": "position", "of": "x"},
        "b": {"type": "position", "of": "y", "relative_to": "z"},
        "seen": {"type": "velocity", "of": "x"},
        "angle": {"type": "angle", "joint": "j"},
    }
    made = add_velocity_sensors({"sensors": sensors})["sensors"]
    added = {name: table for name, table in made.items() if name not in sensors}
    assert list(added.values()) == [{"type": "velocity", "of": "y", "relative_to": "z"}]


def test_a_study_without_any_position_says_how_to_sense_one(tmp_path: Path) -> None:
    text = GOOD[: GOOD.index("[sensors.tip]")] + GOOD[GOOD.index("[dynamics]") :]
    setting = plan(tmp_path, text, r=(0.1,))[0]
    with pytest.raises(SceneError, match='no sensor of a position(?s:.*)of = "crank"'):
        check_sensors(setting.model, ())


def test_divisions_refine_one_machine_and_sizes_make_others(tmp_path: Path) -> None:
    text = BEAM.replace('mesh = "box.msh"', "mesh = { type = 'box', size = [1, 0.1, 0.1] }")
    text = text.replace('"left"', '"x0"').replace('"right"', '"x1"')
    finer = plan(tmp_path, text, bodies__beam__mesh__divisions=(2, [4, 1, 1], 3))
    assert kinds(finer) == (1, 3)
    ranks = [one.rank for one in finer]
    assert sorted(ranks) == [ranks[1], ranks[0], ranks[2]]  # 4, 8 and 27 cells
    kind = plan(tmp_path, text, bodies__beam__mesh__elements=("tetra10", "hexahedron20"))
    assert kinds(kind) == (1, 2)
    text = text.replace("n = 2", "n = 2\nthick = 0.1").replace("[1, 0.1, 0.1]", "[1, 0.1, 'thick']")
    assert kinds(plan(tmp_path, text, thick=(0.1, 0.2))) == (2, 2)
    sections = "sections = { all = { type = 'solid', material = 'brass' } }"
    text = text.replace('material = "steel"', f'material = "steel"\n{sections}')
    brass = plan(tmp_path, text, bodies__beam__sections__all__material=("brass", "copper"))
    assert kinds(brass) == (2, 2)
    text = text.replace("'box', size = [1, 0.1, 'thick']", "'plate', length = 1, width = 0.1")
    text = text.replace("'solid', material = 'brass'", "'shell', thickness = 0.01")
    thick = plan(tmp_path, text, bodies__beam__sections__all__thickness=(0.01, "20 mm"))
    assert kinds(thick) == (2, 2)
