"""Studies of the pendulum from end to end: true errors, order two, runs used again, failures."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import flexmb
from flexmb.errors import FlexmbError, FlexmbWarning, SceneError
from flexmb.progress import silent
from flexmb.results import Result
from flexmb.studies import study_jobs
from flexmb.studies.record_table import RecordTable, read_rows
from flexmb.studies.study_jobs import Job, StudyQueue
from flexmb.workflow.cluster import open_cluster

PENDULUM = Path(__file__).parents[3] / "cases" / "pendulum" / "scene.toml"
STEPS = (8e-3, 4e-3, 2e-3)
QUIET = {"workers": 1, "repeats": 1}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def study(folder: Path) -> flexmb.Study:
    return flexmb.study(PENDULUM, {"step": STEPS}, output=folder, sensors=["tip"], **QUIET)


def test_errors_are_the_true_ones(study: flexmb.Study) -> None:
    """Against the closed form: the bar's angle from below is 2 asin(k sn(K - w t)), k² = 1/2."""
    w = np.sqrt(3 * 9.80665 / 2)  # of a bar of one metre: 3 g / (2 L)
    for row in study.rows:
        run = Result(Path(row.folder) / "result.h5")
        sn = ellipj(ellipk(0.5) - w * run.time, 0.5)[0]
        below = 2 * np.arcsin(np.sqrt(0.5) * sn)
        true = np.stack([np.sin(below), -np.cos(below)], axis=1)
        got = np.stack([run["tip.x"], run["tip.y"]], axis=1)
        error = np.abs(got - true).max() / np.ptp(true, axis=0).max()
        assert row.errors["positions"].value == pytest.approx(error, rel=0.1)  # as promised
        assert row.errors["positions"].where == "tip"


def test_what_an_effect_contributes_is_measured_against_the_model_that_has_it(
    tmp_path: Path,
) -> None:
    """Without its weight the bar stays where it is, and misses all of its motion."""
    made = flexmb.study(
        PENDULUM, {"effects.gravity": (False, True), "step": (4e-3,)}, output=tmp_path,
        sensors=["tip"], **QUIET,
    )  # fmt: skip
    without, true = made.rows
    start = np.array([1.0, 0.0])  # along x, and from there through the lowest point
    moved = Result(Path(true.folder) / "result.h5")
    way = np.stack([moved["tip.x"], moved["tip.y"]], axis=1)
    error = np.abs(way - start).max() / np.ptp(way, axis=0).max()
    assert without.errors["positions"].value == pytest.approx(error, rel=1e-3)
    assert true.errors["positions"].value < 1e-3
    assert true.finest and not without.finest
    assert any("--set effects.gravity=true" in one for one in made.summary())


@pytest.mark.parametrize("quantity", ["positions", "velocities", "reactions"])
def test_generalized_alpha_shows_its_order_two(study: flexmb.Study, quantity: str) -> None:
    steps = [row.statistics["step_s"] for row in study.rows]
    slope = np.polyfit(np.log(steps), np.log(study.errors(quantity)), 1)[0]
    assert 1.9 < slope < 2.1


def test_the_reference_is_confirmed_by_another_method(study: flexmb.Study) -> None:
    (sentence,) = study.references.values()
    assert "generalized-alpha" in sentence
    assert "explicit-rk" in sentence
    smallest = study.errors("positions").min()
    assert all(row.errors["positions"].floor <= smallest for row in study.rows)


def results_in(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.glob("runs/*/result.h5")}


def test_what_is_there_is_used_again(study: flexmb.Study, folder: Path) -> None:
    """Only runs whose result is gone, and a new setting, are run."""
    before = results_in(folder)
    lost = Path(study.rows[2].folder) / "result.h5"
    lost.unlink()
    again = flexmb.study(
        PENDULUM, {"step": [*STEPS, 1.6e-2]}, output=folder, sensors=["tip"], **QUIET
    )
    now = results_in(folder)
    assert {path for path, when in before.items() if now[path] != when} == {lost}
    assert len(now) == len(before) + 1
    assert again.reused == len(before) - 1
    assert again.errors("positions")[:3] == pytest.approx(study.errors("positions"), rel=1e-12)


def test_records_are_one_table_with_the_values_of_the_knobs(
    study: flexmb.Study, folder: Path
) -> None:
    rows = {row["key"]: row for row in read_rows(folder / "runs.parquet").to_pylist()}
    for row in study.rows:
        stored = rows[Path(row.folder).name]
        assert stored["dynamics.step"] == row.values["dynamics.step"]
        assert stored["status"] == "finished" and len(stored["seconds"]) == 1
        assert json.loads(stored["statistics"])["steps"] == row.statistics["steps"]


@pytest.mark.parametrize("name", ["seconds", "cpu_seconds"])
def test_a_record_without_its_times_is_a_missing_one(folder: Path, study, name: str) -> None:
    assert study.rows
    row = read_rows(folder / "runs.parquet").to_pylist()[0]
    assert study_jobs._readable(row) is not None
    assert study_jobs._readable({**row, name: []}) is None


def test_a_study_of_another_scene_is_not_mixed_with_it(study: flexmb.Study, folder: Path) -> None:
    crank = PENDULUM.parents[1] / "rigid_slider_crank" / "scene.toml"
    with pytest.raises(FlexmbError, match="holds runs of another scene"):
        flexmb.study(crank, {"step": [1e-4]}, output=folder, **QUIET)


@pytest.mark.slow
def test_another_mass_or_more_repeats_run_anew(study: flexmb.Study, folder: Path) -> None:
    once = flexmb.study(PENDULUM, {"step": STEPS[:1]}, output=folder, overrides={"m": "3"}, **QUIET)
    assert once.reused == 0
    more = flexmb.study(PENDULUM, {"step": STEPS[:1]}, output=folder, workers=1, repeats=2)
    assert len(more.rows[0].seconds) == 2


def test_an_interruption_keeps_what_has_ended(tmp_path: Path) -> None:
    def interrupt(phase: str, fraction: float, detail: str = "") -> None:
        if phase == "study" and 0.0 < fraction < 1.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flexmb.study(PENDULUM, {"step": STEPS}, output=tmp_path, progress=interrupt, **QUIET)
    (row,) = read_rows(tmp_path / "runs.parquet").to_pylist()
    assert row["status"] == "finished"
    assert flexmb.study(PENDULUM, {"step": STEPS}, output=tmp_path, **QUIET).reused == 1


@pytest.mark.slow
def test_another_machine_has_a_truth_of_its_own(tmp_path: Path) -> None:
    """A pendulum four times as long is twice as slow, and no error of the short one."""
    both = flexmb.study(
        PENDULUM, {"L": [1.0, 4.0], "dynamics.step": ["period/200"]}, output=tmp_path, **QUIET
    )
    assert len(both.references) == 2
    one, other = both.errors("positions")
    assert one == pytest.approx(other, rel=1e-6)  # the same motion, scaled


@pytest.mark.slow
def test_units_of_the_scene_change_nothing(study: flexmb.Study, tmp_path: Path) -> None:
    """The same pendulum in millimetres and milliseconds, and its steps in these."""
    text = PENDULUM.read_text(encoding="utf-8").partition("[[check]]")[0]
    for si, other in (("g = 9.80665", "g = 9.80665e-3"), ("L = 1.0 ", "L = 1000 "),
                      ("[1e-4,", "[100,"), ("0.03, 0.03", "30, 30")):  # fmt: skip
        assert si in text
        text = text.replace(si, other, 1)
    scene = tmp_path / "scene.toml"
    scene.write_text(f'units = "mm-kg-ms"\n{text}', encoding="utf-8")
    steps = [1e3 * step for step in STEPS]
    found = flexmb.study(scene, {"step": steps}, output=tmp_path, sensors=["tip"], **QUIET)
    for quantity in ("positions", "velocities", "reactions"):
        assert found.errors(quantity) == pytest.approx(study.errors(quantity), rel=1e-3)


@pytest.mark.seconds
def test_error_control_keeps_what_is_asked(tmp_path: Path) -> None:
    """Accuracy found is no worse than what is asked by each method, nor far better by order two."""
    asked, methods = [1e-3, 1e-5], ["generalized-alpha", "explicit-rk", "radau"]
    found = flexmb.study(PENDULUM, {"method": methods, "accuracy": asked}, output=tmp_path, **QUIET)
    ratio = found.errors("positions").reshape(3, 2) / asked
    assert (ratio > 0.0).all() and (ratio < 1.2).all()
    assert (ratio[0] > 0.1).all()


def test_failed_and_refused_settings_are_rows_with_their_reason(tmp_path: Path) -> None:
    """A torque that is not finite from an angle on; and a step below zero for one machine."""
    text = PENDULUM.read_text(encoding="utf-8").partition("[[check]]")[0]
    text = text.replace("period/4000", "period/400*(1 - 2e6*cut*late)") + (
        '[forces.pull]\ntype = "torque"\nat = "bar"\n'
        'value = [0, 0, "1e-9*log(swing + 0.5 + cut)"]\n'
        "[study]\nvary = { cut = [0, 1e-6], late = [0, 1] }\nrepeats = 1\n"
    )
    scene = tmp_path / "scene.toml"
    scene.write_text(
        text.replace("[parameters]", "[parameters]\ncut = 0\nlate = 0"), encoding="utf-8"
    )
    found = flexmb.study(scene, output=tmp_path / "out", workers=1)
    status = {(row.values["cut"], row.values["late"]): row for row in found.rows}
    assert [row.status for row in status.values()] == ["failed"] * 3 + ["refused"]
    assert "forces.pull.value[2]" in status[1e-6, 0].reason
    assert "dynamics.step: must be positive" in status[1e-6, 1].reason
    assert all("no two tight runs ended well" in told for told in found.references.values())
    assert "no run ended" in found.summary()[-1]


def test_a_model_from_python_is_studied_with_the_same_words(tmp_path: Path) -> None:
    model = flexmb.Model("thrown")
    model.add_body("stone", mass=1.0, inertia=[1, 2, 3], angular_velocity=[1.0, 0.2, 0.1])
    model.add_marker("stone.edge", position=[0.1, 0, 0.2])
    model.add_sensor("edge", "position", of="stone.edge")
    model.set_dynamics(duration=1.0, step=1e-2, outputs=10)
    found = flexmb.study(
        model, {"method": ["generalized-alpha", "explicit-rk"]}, output=tmp_path, **QUIET
    )
    errors = found.errors("positions")
    assert 0 < errors[1] < errors[0] < 1e-3
    with pytest.raises(FlexmbError, match="overrides are for scene files"):
        flexmb.study(model, {"step": [1]}, overrides={"a": "1"})


@pytest.mark.slow
def test_two_processes_give_the_same_errors(study: flexmb.Study, tmp_path: Path) -> None:
    both = flexmb.study(
        PENDULUM, {"step": STEPS}, output=tmp_path, sensors=["tip"], repeats=1, workers=2
    )
    assert both.errors("reactions") == pytest.approx(study.errors("reactions"), rel=1e-12)
    assert all(row.cpu_seconds[0] > 0 for row in both.rows)


def test_a_run_that_takes_too_long_is_given_up_and_tried_again_next_time(
    study: flexmb.Study, tmp_path: Path
) -> None:
    scene = Result(Path(study.rows[0].folder) / "result.h5").model
    slow = Job("slow", scene, str(tmp_path), str(tmp_path / "slow"), limit=1e-9)
    for _ in range(2):
        records: list[dict[str, object]] = []
        with (
            RecordTable(tmp_path / "runs.parquet", {}) as table,
            open_cluster(1) as cluster,
            StudyQueue(cluster, table, silent) as queue,
        ):
            queue.add(slow, {}, records.append)
            queue.run("study", 0.0)
        assert records[0]["status"] == "failed"
        assert str(records[0]["reason"]).startswith("given up after 1e-09 s, at t = ")
        assert queue.reused == 0


def test_tight_runs_that_the_model_refuses_are_no_reference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the accuracy asked of them lies below round-off."""

    def refuse(*_: object) -> None:
        raise SceneError("dynamics.accuracy: below round-off")

    monkeypatch.setattr("flexmb.studies.accuracy.runner.change_model", refuse)
    found = flexmb.study(PENDULUM, {"step": STEPS[:1]}, output=tmp_path, **QUIET)
    assert found.rows[0].status == "finished"
    assert found.compared == ()
    (sentence,) = found.references.values()
    assert "no errors are shown" in sentence
    assert "below round-off" in sentence
    assert found.markdown()


def test_mistakes_in_meshes_are_told_before_anything_runs(tmp_path: Path) -> None:
    """Each value of a knob that the model refuses whatever the others are."""
    scene = tmp_path / "scene.toml"
    scene.write_text(
        "[bodies.beam]\nmesh = { type = 'box', size = [1, 0.1, 0.1] }\nmaterial = 'steel'\n"
        "interfaces = { a = 'x0' }\n[joints]\n"
        "w = { type = 'fixed', between = ['ground', 'beam.a'] }\n"
        "[sensors.tip]\ntype = 'position'\nof = 'beam'\n[dynamics]\nduration = 1e-3\n"
    )
    with pytest.raises(SceneError) as caught:
        flexmb.study(scene, {"modes": [2, 90_000], "step": [1e-4, -1]}, output=tmp_path / "out")
    told = str(caught.value)
    assert "vary modes=90000: bodies.beam.modes: 90000 requested, but the model has only" in told
    assert "dynamics.step: must be positive, is -1 s" in told
    assert not list(tmp_path.rglob("*.flexbody.h5"))
    with pytest.raises(SceneError, match="modes: 90000 requested"):
        flexmb.sweep(scene, {"modes": [2, 90_000]}, output=tmp_path / "out")


@pytest.mark.parametrize(
    ("call", "values"),
    [
        (flexmb.study, "300,400,300 rpm"),
        (flexmb.sweep, "300,400,300 rpm"),
        (flexmb.sweep, "normal(300, 20 rpm)"),
        (flexmb.sweep, "300..400:2"),
    ],
)
def test_numbers_without_the_unit_of_their_knob_are_told(
    tmp_path: Path, call: Any, values: str
) -> None:
    (tmp_path / "scene.toml").write_text(
        "[parameters]\nspeed = '250 rpm'\n[bodies.disk]\nmass = 1\ninertia = [1, 1, 1]\n"
        "angular_velocity = [0, 0, 'speed']\n"
        "velocity = [1, 0, 0]\n[sensors.disk]\ntype = 'position'\nof = 'disk'\n"
        "[dynamics]\nduration = 1e-2\noutputs = 4\n"
    )
    more = {"repeats": 1} if call is flexmb.study else {"samples": 2}
    with pytest.warns(FlexmbWarning, match="vary speed: 300 has no unit and is 2864.79 rpm"):
        call(tmp_path / "scene.toml", {"speed": values}, output=tmp_path / "a", workers=1, **more)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        clear = "300 rpm, 26.2"
        call(tmp_path / "scene.toml", {"speed": clear}, output=tmp_path / "b", workers=1, **more)
