"""Error budgets: how differences become shares, and what cannot be split."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import flexmb
from flexmb.cli import app
from flexmb.errors import FlexmbError, SceneError
from flexmb.flexbody import save
from flexmb.model.scenes.scene import load_scene
from flexmb.studies.budgets import error_shares
from flexmb.studies.budgets.error_budget import _Split
from flexmb.studies.budgets.error_shares import (
    CONVERGED,
    MESH,
    NOISE,
    NOT_CONVERGED,
    ONE,
    Estimate,
    Knob,
    SensorErrors,
    Share,
    complete_effects,
    estimate_error,
    refinement_knobs,
)
from flexmb.studies.channel_errors import History, RunHistories, _scales

SCENE = """
title = "Bar"
gravity = "earth -y"
[bodies.bar]
mass = 1
center = [0.5, 0, 0]
inertia = [0.01, 0.084, 0.084]
[joints.pivot]
type = "revolute"
between = ["ground", "bar"]
axis = "z"
[sensors.swing]
type = "angle"
joint = "pivot"
[dynamics]
duration = 0.2
step = 0.01
outputs = 10
"""
BEAM = """
[bodies.beam]
mesh = { type = "box", size = [1, 0.1, 0.1], divisions = [4, 2, 1] }
material = "steel"
interfaces = { a = "x0", b = { group = "x1", type = "rbe3" } }
modes = 8
inertia_coupling = "constant"
[bodies.block]
flexbody = "block.flexbody.h5"
[effects]
gravity = false
[sensors.tip]
type = "position"
of = "beam.b"
[dynamics]
duration = 1
"""


def reading(error: float, other: float = 0.0) -> RunHistories:
    t = np.linspace(0.0, 1.0, 11)[:, None]
    histories = [History("positions", "tip", "m", t + error * t),
                 History("positions", "root", "m", 2 * t + other * t)]  # fmt: skip
    return RunHistories(histories, [1.0, 2.0])


def estimate(*errors: float, noise: float = 0.0):
    base, *finer = (reading(error) for error in errors)
    shares = {"tip": noise, "root": noise} if noise else None
    return estimate_error(SensorErrors(base), finer, shares)


@pytest.mark.parametrize("ratio", [2.0, 4.0, 16.0, 100.0])
def test_errors_that_fall_by_a_factor_are_extrapolated_to_their_end(ratio: float) -> None:
    made = estimate(0.08, 0.08 / ratio, 0.08 / ratio**2)
    assert made.state == CONVERGED
    assert made.ratio == pytest.approx(ratio)
    for values, left in zip(made.values, (1, ratio, ratio**2), strict=True):
        assert values["tip"] == pytest.approx(0.08 / left)
    assert made.values[0]["root"] == 0.0


def test_errors_that_do_not_fall_are_lower_bounds() -> None:
    made = estimate(0.08, 0.06, 0.035)
    assert (made.state, made.rising) == (NOT_CONVERGED, ("tip",))
    assert made.values[0]["tip"] >= 0.08 - 0.035


def test_one_refinement_is_not_confirmed_and_noise_is_no_share_of_its_own() -> None:
    once = estimate(0.08, 0.02)
    assert (once.state, once.ratio) == (ONE, None)
    assert once.values[0]["tip"] >= 0.08  # no less than the error
    assert estimate(1e-4, 2e-4, 0.5e-4, noise=1e-4).state == NOISE
    assert estimate(1e-2, 2e-4, 1e-4, noise=1e-4).state == CONVERGED


def test_what_is_refined_of_a_scene(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(BEAM)
    save(flexmb.rigid_body(1.0, inertia=1.0, name="block"), tmp_path / "block.flexbody.h5")
    model = load_scene(tmp_path / "scene.toml")
    knobs = {knob.name: knob for knob in refinement_knobs(model, {"accuracy": 1e-4})}
    assert [step["bodies.beam.refine"] for step in knobs["mesh of beam"].steps] == [1, 2]
    assert knobs["mesh of beam"].coarser == ({"bodies.beam.mesh.divisions": [2, 1, 1]},)
    assert [step["bodies.beam.modes"] for step in knobs["modes of beam"].steps] == [16, 32]
    (swapped,) = knobs["interface model of beam"].steps
    assert swapped == {
        "bodies.beam.interfaces.a": {"group": "x0", "type": "rbe3"},
        "bodies.beam.interfaces.b": {"group": "x1", "type": "rbe2"},
    }
    assert "not known from a body file" in knobs["mesh of block"].why
    assert knobs["integration"].steps[0] == {"dynamics.accuracy": 1e-5}
    assert complete_effects(model) == {
        "bodies.beam.inertia_coupling": "full",
        "bodies.beam.geometric_stiffening": "full",
        "effects.gravity": True,
    }


@pytest.mark.parametrize(
    ("change", "words", "message"),
    [
        ({}, {"target": 0.0}, "target: is an error over the peak-to-peak, between 0 and 1; is 0"),
        ({}, {"knobs": ["mode"]}, 'unknown knob "mode"(?s:.*)modes'),
        ({}, {"sensors": ["swng"]}, 'unknown sensor "swng"(?s:.*)swing'),
        ({'[sensors.swing]\ntype = "angle"\njoint = "pivot"': ""}, {}, "no sensor of a position"),
        ({"[dynamics]\nduration = 0.2\nstep = 0.01\noutputs = 10": ""}, {}, "no .dynamics."),
    ],
)
def test_what_cannot_be_split_is_refused_before_anything_runs(
    tmp_path: Path, change: dict[str, str], words: dict[str, object], message: str
) -> None:
    text = SCENE
    for old, new in change.items():
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(SceneError, match=message):
        flexmb.budget(tmp_path / "scene.toml", output=tmp_path / "out", workers=1, **words)  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()


def test_a_target_that_nothing_meets_is_told(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    made = flexmb.budget(tmp_path / "scene.toml", output=tmp_path, workers=1, target=1e-12)
    assert any("no setting tried meets 1e-10 % in integration" in s for s in made.summary())
    assert any("more refinements would meet it" in s for s in made.summary())


def test_a_refinement_that_fails_is_named_and_the_rest_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    true_run, shortest = error_shares.run_changed, 0.004

    def run(job: Mapping[str, Any]) -> Mapping[str, Any]:
        if job["scene"]["dynamics"]["step"] < shortest:
            raise FlexmbError("given up after 2 s, at t = 0.1")
        return true_run(job)

    monkeypatch.setattr(error_shares, "run_changed", run)
    made = flexmb.budget(tmp_path / "scene.toml", output=tmp_path, workers=1)
    share = next(one for one in made.shares if one.kind == "integration")
    assert share.state == ONE
    assert share.note == "step=0.0025 fails: given up after 2 s, at t = 0.1"
    assert "integration" in made.sentence()
    shortest = 1.0
    with pytest.raises(FlexmbError, match="scene itself fails, so .*: given up after 2 s"):
        flexmb.budget(tmp_path / "scene.toml", output=tmp_path / "other", workers=1)


def test_the_command_shows_line_table_and_settings(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    scene, folder = str(tmp_path / "scene.toml"), str(tmp_path / "b")
    done = CliRunner().invoke(app, ["budget", scene, "-o", folder, "--workers", "1"])
    assert done.exit_code == 0, done.output
    for text in ("error of ", "integration", "effects: none is left out", "--set dynamics.step="):
        assert text in done.output
    wrong = CliRunner().invoke(app, ["budget", scene, "-o", folder, "--knob", "meshes"])
    assert wrong.exit_code != 0


def test_changes_of_single_refinements_are_added() -> None:
    errors = SensorErrors(reading(0.1, 0.2))
    both = errors.combined([reading(0.4, 0.2), reading(0.1, 0.7)])
    wanted = reading(0.4, 0.7)
    for one, other in zip(both.histories, wanted.histories, strict=True):
        np.testing.assert_allclose(one.values, other.values, rtol=1e-12)


def test_refined_modes_leave_out_a_quarter_of_the_mass_of_before(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(BEAM)
    save(flexmb.rigid_body(1.0, inertia=1.0, name="block"), tmp_path / "block.flexbody.h5")
    model = load_scene(tmp_path / "scene.toml", {"bodies.beam.modes": "{ effective_mass = 0.9 }"})
    (modes,) = (one for one in refinement_knobs(model, {}) if one.name == "modes of beam")
    kept = [step["bodies.beam.modes"]["effective_mass"] for step in modes.steps]
    assert kept == pytest.approx([0.975, 0.99375])


def test_a_refined_mesh_has_as_many_times_the_unknowns_as_it_has_dimensions() -> None:
    """Halves of lengths: 2, 4, 8 times; those of more than 150 000 are not tried."""
    knob = Knob(MESH, "b", steps=({"refine": 1}, {"refine": 2}))
    for dimension, most in ((1, 150_000 / 4), (2, 150_000 / 16), (3, 150_000 / 64)):
        for dofs, count in ((0.99 * most, 2), (1.01 * most, 1)):
            sizes = SimpleNamespace(sizes={"b": (dofs, dimension)})
            assert len(_Split._fit(sizes, knob).steps) == count


def test_how_many_more_refinements_would_meet_the_target() -> None:
    """What is left falls to a quarter each time: 0.032, 0.008, 0.002."""
    knob = Knob(MESH, "b", steps=({"refine": 1}, {"refine": 2}))
    left = Estimate(({"tip": 0.512}, {"tip": 0.128}, {"tip": 0.032}), CONVERGED, 4.0, ())
    split = SimpleNamespace(knobs=[knob], estimates={knob.name: left}, target=0.003)
    share = _Split._cheapest(split, Share(knob.name, MESH, {"tip": 0.512}, CONVERGED))
    assert "2 more refinements would meet it" in share.note


def test_a_small_reaction_is_judged_by_a_hundredth_of_the_largest() -> None:
    """What moves a billionth of the like of it stands still."""
    t = np.linspace(0.0, 1.0, 11)[:, None]
    sizes = {"reactions": (100.0, 5.0, 0.1), "positions": (3.0, 1e-3, 1e-10)}
    histories = [
        History(quantity, f"{quantity}{k}", "N" if quantity == "reactions" else "m", size * t)
        for quantity, many in sizes.items() for k, size in enumerate(many)
    ]  # fmt: skip
    assert _scales(histories) == pytest.approx([100.0, 5.0, 1.0, 3.0, 1e-3, 0.0])


def test_moments_that_are_round_off_of_forces_stand_still() -> None:
    """As of planar mechanisms in space, whose joints bear forces alone."""
    wave = np.sin(np.linspace(0.0, 6.0, 50))[:, None]
    force = History("reactions", "pin", "N", 1e4 * wave)
    moment = History("reactions", "pin", "N m", 1e-8 * wave)
    assert _scales([force, moment], 2.0)[1] == 0.0
    assert _scales([force, History("reactions", "pin", "N m", 1.0 * wave)], 2.0)[1] > 1.0
    assert _scales([History("reactions", "pin", "N", 1e-9 * wave), moment], 2.0)[1] > 0.0
