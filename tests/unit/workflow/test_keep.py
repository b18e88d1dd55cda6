"""What of a run is stored: what is kept is the same numbers, what is not is said with its cure."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from samebytes import assert_same_bytes

import flexmb
from flexmb.analysis.dynamics import integration as module
from flexmb.errors import ResultFileError, SceneError
from flexmb.results import Result
from flexmb.workflow.check import check_scene
from flexmb.workflow.simulate import run_model

SCENE = Path(__file__).parents[3] / "cases" / "rigid_slider_crank" / "scene.toml"
pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


def scene(*keep: str, steps: int = 200, outputs: object = 50):
    model = flexmb.load_scene(SCENE)
    model.set_dynamics(duration="turn", outputs=outputs, step=f"turn/{steps}")
    model.checks.clear()
    model.set_view()
    if keep:
        model.set_results(keep=keep)
    return model


@pytest.fixture(scope="module")
def whole() -> Result:
    return flexmb.simulate(scene())


def test_everything_is_kept_unless_a_scene_says_otherwise(whole: Result) -> None:
    stored, all_bytes = whole.row_bytes
    # time, 3 bodies (7 + 6 + 6), 18 rows, 5 reactions of 12, channels, 7 energies, 2 drifts
    channels = len(whole.layout.channels)
    assert stored == all_bytes == 8 * (1 + 57 + 18 + 60 + channels + 7 + 2)


@pytest.mark.parametrize(
    ("keep", "there", "lacking"),
    [
        (["sensors"], ["slider.x", "crank_angle"], ["crank.r.x", "energy.kinetic"]),
        (["poses"], ["rod.r.x", "rod.p.3"], ["rod.w.z", "slider.x", "rod.r_ddot.x"]),
        (["rod"], ["rod.r.x", "rod.w.z", "rod.r_ddot.y"], ["crank.r.x"]),
        (["bodies.rod"], ["rod.r.x"], ["crank.r.x"]),
        (["r*.r.?"], ["rod.r.y"], ["rod.p.0", "crank.r.x"]),
        (["crank_pin"], ["crank_pin.rod.force.x"], ["wrist_pin.rod.force.x"]),
        (["joints.*_pin"], ["wrist_pin.slider.moment.z"], ["guide.slider.force.y"]),
        (["*.force.?"], ["crank_pin.rod.force.x"], ["crank_pin.rod.moment.x"]),
        (["slider.x", "energy.kinetic"], ["slider.x", "energy.kinetic"], ["slider.y"]),
        (["energy"], ["energy.kinetic", "energy.balance"], ["slider.x"]),
        (["accelerations"], ["crank.w_dot.z"], ["crank.w.z"]),
    ],
    ids=str,
)
def test_what_is_kept_is_the_same_and_the_rest_is_said(
    whole: Result, keep: list[str], there: list[str], lacking: list[str]
) -> None:
    part = flexmb.simulate(scene(*keep))
    assert part.row_bytes[0] < whole.row_bytes[0] == part.row_bytes[1]
    np.testing.assert_array_equal(part.drift, whole.drift)
    for name in there:
        np.testing.assert_array_equal(part[name], whole[name])
        assert name in part
    for name in lacking:
        assert name in whole
        assert name not in part
        message = rf'{name} was not kept by this run; keep = \["{name}"\] in \[results\] keeps it'
        with pytest.raises(ResultFileError, match=message.replace("?", r"\?")):
            part[name]
    for group in ("sensors", "reactions", "energy", "coordinates", "accelerations"):
        for name in part.channels(group):
            np.testing.assert_array_equal(part[name], whole[name])


def test_file_and_bytes() -> None:
    part = flexmb.simulate(scene("sensors", steps=2000, outputs=2000))
    full = flexmb.simulate(scene(steps=2000, outputs=2000))
    saved = full.path.stat().st_size - part.path.stat().st_size
    per_row = full.row_bytes[0] - part.row_bytes[0]
    assert saved > 2001 * per_row  # and room for whole chunks
    with h5py.File(part.path) as file:
        assert file["q"].shape == (2001, 0)
        assert len(file["layout/kept/q"]) == 0


def test_pictures_stress_reactions_and_another_run_say_what_they_need(tmp_path: Path) -> None:
    part = flexmb.simulate(scene("sensors"), output=tmp_path / "part")
    with pytest.raises(ResultFileError, match=r'keep = \["poses"\] in \[results\] keeps it'):
        flexmb.render(part, output=tmp_path / "picture.png")
    with pytest.raises(ResultFileError, match=r'keep = \["reactions"\]'):
        part.reaction("crank_pin")
    with pytest.raises(ResultFileError, match=r'keep = \["multipliers"\]'):
        _ = part.lam
    with pytest.raises(ResultFileError, match=r'keep = \["energy"\]'):
        _ = part.balance
    with pytest.raises(ResultFileError, match=r'keep = \["poses"\]'):
        flexmb.simulate(scene(), start_from=part)
    with pytest.raises(ResultFileError, match=r'kept no channels .* keep = \["reactions"\]'):
        part.to_csv(tmp_path / "rows.csv", what="reactions")
    with pytest.raises(ResultFileError, match=r'keep = \["rod.r.x"\]'):
        part.to_csv(tmp_path / "rows.csv", ["slider.x", "rod.r.x"])
    both = flexmb.simulate(scene("coordinates"), output=tmp_path / "both")
    flexmb.simulate(scene(), start_from=both)


def test_a_run_draws_what_it_can_and_says_the_rest(tmp_path: Path) -> None:
    report = run_model(scene("slider"), tmp_path)  # the body and the sensor
    assert report.picture is None
    assert report.history is not None
    assert any('keep = ["poses"]' in note for note in report.notes)
    assert any(note.startswith("[results] keeps 200 of 1240 bytes") for note in report.notes), (
        report.notes
    )


def test_known_answers_and_plots_need_not_be_named() -> None:
    model = flexmb.load_scene(SCENE, {"results.keep": '["energy"]'})
    assert set(flexmb.simulate(model).channels()) >= {c.sensor for c in model.checks}


def test_a_resumed_run_keeps_its_bytes_and_statistics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_CHUNK_WORK", 18 * 150)
    path = Path(shutil.copy(SCENE, tmp_path / "scene.toml"))
    overrides = {"dynamics.accuracy": "1e-3", "results.keep": '["slider", "rod.r.*"]'}

    def interrupt(phase: str, share: float, detail: str = "") -> None:
        if phase == "integrate" and share > 0.3:
            raise KeyboardInterrupt

    done = flexmb.simulate(flexmb.load_scene(path, overrides), output=tmp_path / "whole")
    part = flexmb.simulate(
        flexmb.load_scene(path, overrides), output=tmp_path / "part", progress=interrupt
    )
    assert part.status == "stopped"
    again = flexmb.resume(part)
    assert_same_bytes(again.path, done.path)
    for name, value in done.statistics.items():
        assert name.startswith("seconds") or again.statistics[name] == value, name


@pytest.mark.parametrize(
    ("item", "message"),
    [
        ("sensor", r'results.keep\[0\]: there is nothing of the name "sensor".*nearest: sensors'),
        ("rodd", "nearest: rod"),
        ("slider.q", r"nearest: slider"),
        ("crank_pn.*", "there is nothing of the name"),
        ("rod.r.w", r"nearest: rod\.r\.[xyz]"),
    ],
)
def test_misspelt_names_are_told_by_check_and_run(tmp_path: Path, item: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        flexmb.simulate(scene(item))
    text = SCENE.read_text() + f'\n[results]\nkeep = ["{item}"]\n'
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(SceneError, match=message):
        check_scene(path)
    path.write_text(SCENE.read_text() + '\n[results]\nkeep = ["sensors", "crank_pin"]\n')
    check_scene(path)
