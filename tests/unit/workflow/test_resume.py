"""Going on with a run: nothing lost, nothing changed, and clear words where it cannot go on."""

from __future__ import annotations

import gc
import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import slidercrank
from hdf5edit import edit_hdf5
from samebytes import assert_same_bytes

import flexmb
from flexmb.analysis.dynamics import integration as module
from flexmb.errors import (
    AssemblyError,
    BodyFileError,
    FlexmbError,
    ResultFileError,
    SceneError,
    SolverError,
)
from flexmb.flexbody import load, save
from flexmb.model import Model
from flexmb.results import Result
from flexmb.results.reader import TemporaryFolder
from flexmb.results.writer import ResultWriter
from flexmb.workflow.run_report import provenance_text

SCENE = Path(__file__).parents[3] / "cases" / "rigid_slider_crank" / "scene.toml"
pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


class Interrupt:
    """Progress that presses Ctrl-C at a chosen chunk."""

    def __init__(self, chunk: int) -> None:
        self.left = chunk

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        if phase == "integrate":
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_CHUNK_WORK", 18 * 170)  # steps of which outputs are no multiple


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return Path(shutil.copy(SCENE, tmp_path / "scene.toml"))


def stopped(scene: Path, folder: Path, chunk: int = 4, **overrides: str) -> Result:
    model = flexmb.load_scene(scene, overrides)
    result = flexmb.simulate(model, output=folder, progress=Interrupt(chunk))
    assert result.status == "stopped"
    return result


@pytest.mark.parametrize(
    ("knobs", "steps"),
    [
        ({"step": "turn/2000"}, 170),
        ({"step": "turn/2000", "verify": "true"}, 170),
        ({"accuracy": "1e-3", "duration": "turn/2", "outputs": "100"}, 16 * 9),
    ],
    ids=["fixed steps", "fixed steps, verified", "error control"],
)
def test_a_stopped_run_goes_on_to_the_same_bytes(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, knobs: dict[str, str], steps: int
) -> None:
    monkeypatch.setattr(module, "_CHUNK_WORK", 18 * steps)
    overrides = {f"dynamics.{knob}": value for knob, value in knobs.items()}
    whole = flexmb.simulate(flexmb.load_scene(scene, overrides), output=tmp_path / "whole")
    part = stopped(scene, tmp_path / "part", **overrides)
    assert len(part.time) < len(whole.time)
    again = flexmb.resume(tmp_path / "part", progress=Interrupt(3))
    assert again.status == "stopped"
    assert len(part.time) < len(again.time) < len(whole.time)
    done = flexmb.resume(again)
    assert done.status == "finished"
    assert_same_bytes(done.path, whole.path)
    for name, value in whole.statistics.items():
        assert name.startswith("seconds") or done.statistics[name] == value, name


def test_a_finished_run_is_extended(scene: Path, tmp_path: Path) -> None:
    long = flexmb.simulate(flexmb.load_scene(scene, {"dynamics.duration": "0.05",
                           "dynamics.outputs": "250"}), output=tmp_path / "long")  # fmt: skip
    result = flexmb.simulate(flexmb.load_scene(scene), output=tmp_path / "short")
    with pytest.raises(ResultFileError, match="is finished at t = 0.04 s.*--duration"):
        flexmb.resume(result)
    done = flexmb.resume(result, duration="50 ms")
    assert (done.status, len(done.time)) == ("finished", 251)
    np.testing.assert_allclose(done.time, long.time, rtol=1e-12)
    np.testing.assert_allclose(done.q, long.q, atol=1e-9)
    assert done.model["dynamics"]["outputs"] == 250
    assert len(result.time) == 251  # the same result, gone on
    for wrong, words in (
        (0.0501, "whole number of output intervals of 0.0002 s, is 0.0501 s"),
        (0.03, "must not be shorter than it was, 0.05 s"),
        (0.05, "is 0.05 s already, and the run is finished"),
        (float("nan"), "duration: .*finite"),
        ("60 mm", "duration: a time .s. is expected, given .60 mm"),
        ("6 sek", 'duration: .*"sek"'),
    ):
        with pytest.raises(SceneError, match=words):
            flexmb.resume(done, duration=wrong)


def test_a_changed_scene_is_refused_and_told(scene: Path, tmp_path: Path) -> None:
    overrides = {"dynamics.duration": "0.02", "dynamics.outputs": "100"}
    stopped(scene, tmp_path / "out", chunk=2, **overrides)
    text = scene.read_text()
    scene.write_text("# a comment changes nothing\n" + text)
    flexmb.resume(tmp_path / "out", progress=Interrupt(1))
    scene.write_text(
        text.replace('of = "slider"', 'of = "crank.pin"', 1).replace("r = 0.15", "r = 0.16")
    )
    with pytest.raises(SceneError) as caught:
        flexmb.resume(tmp_path / "out")
    message = str(caught.value)
    assert "scene.toml: has changed since" in message
    assert 'sensors.slider.of was "slider", is "crank.pin"' in message
    assert "parameters.r was 0.15, is 0.16" in message
    assert "dynamics.duration" not in message  # it was, and is, overridden
    scene.write_text("[bodies")
    with pytest.raises(SceneError, match="it has mistakes now"):
        flexmb.resume(tmp_path / "out")
    assert flexmb.resume(tmp_path / "out", as_begun=True).status == "finished"


def test_another_system_or_state_is_refused(scene: Path, tmp_path: Path) -> None:
    result = stopped(scene, tmp_path / "out", chunk=1)
    with edit_hdf5(result.path) as file:
        file["layout"].attrs["fingerprint"] = "f00d"
    with pytest.raises(ResultFileError, match="was begun by flexmb .* builds another system"):
        flexmb.resume(result.path)
    shutil.rmtree(tmp_path / "out")
    result = stopped(scene, tmp_path / "out", chunk=1)
    with edit_hdf5(result.path) as file:
        names = file["state/arrays"].asstr()[()]
        file["state/arrays"][()] = names.replace('"aa"', '"bb"')
    with pytest.raises(ResultFileError, match="saved state is of another version"):
        flexmb.resume(result.path)


def test_other_compiled_code_is_said(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped(scene, tmp_path / "out", chunk=1)
    resume_module = sys.modules["flexmb.workflow.resume"]
    monkeypatch.setattr(resume_module, "code_version", lambda: {"flexmb": "0", "engine": "another"})
    with pytest.warns(flexmb.FlexmbWarning, match="the rest may differ in the last bits"):
        assert flexmb.resume(tmp_path / "out").status == "finished"


def test_a_changed_or_missing_flexible_body_is_named(tmp_path: Path) -> None:
    path = slidercrank.make(tmp_path)
    result = Result(path)
    body = load(tmp_path / "rod.flexbody.h5")
    model = Model.from_scene_dict(result.model, tmp_path)
    model.set_dynamics(duration=1.0, step=0.1)
    with ResultWriter(
        path, result.layout, 3, scene=model.to_scene_dict(),
        flexbodies={"rod": "rod.flexbody.h5"},
        texts={"origin": provenance_text(model, tmp_path, {"rod": body})},
    ) as out:  # fmt: skip
        out.save_state({"v": np.zeros(3)})
    softer = load(tmp_path / "rod.flexbody.h5")
    object.__setattr__(softer, "K", 0.5 * body.K)
    save(softer, tmp_path / "rod.flexbody.h5")
    with pytest.raises(BodyFileError, match="bodies.rod: .* has changed since the run began"):
        flexmb.resume(path)
    (tmp_path / "rod.flexbody.h5").unlink()
    with pytest.raises(BodyFileError, match="bodies.rod: .*there is no such file"):
        flexmb.resume(path)


def free_box(angle: str = "2*t", **fields: object) -> Model:
    """A free box, beside it a driven arm."""
    model = flexmb.Model("box")
    model.add_body("box", mass=2.0, inertia=[1.0, 2.0, 2.5], **fields)
    model.add_body("arm", mass=1.0, inertia=[1.0, 1.0, 1.0])
    model.add_joint("bearing", "revolute", between=["ground", "arm"], axis="z")
    model.add_driver("motor", joint="bearing", angle=angle)
    model.add_sensor("box", "position", of="box")
    model.set_dynamics(duration=0.2, step=1e-3, outputs=10)
    return model


def test_a_run_begins_where_another_ended() -> None:
    first = flexmb.simulate(free_box(velocity=[1, 2, 3], angular_velocity=[0.3, 4, 0.1]))
    whole = flexmb.simulate(free_box(velocity=[1, 2, 3], angular_velocity=[0.3, 4, 0.1]),
                            duration=0.4, outputs=20)  # fmt: skip
    with pytest.warns(
        flexmb.FlexmbWarning, match="begins at t = 0 as .* ended at t = 0.2 s: box, arm"
    ):
        second = flexmb.simulate(free_box(), start_from=first)
    np.testing.assert_array_equal(second.q[0, :7], first.q[-1, :7])
    assert second.time[0] == 0.0
    np.testing.assert_allclose(second.q[:, :7], whole.q[10:, :7], atol=1e-8)
    origin = json.loads(second.texts["origin"])
    assert origin["from"] == str(first.path)


def test_what_gives_way_to_the_joints_is_told() -> None:
    first = flexmb.simulate(free_box(velocity=[1, 0, 0]))
    model = free_box()
    model.add_body("lid", mass=1.0, inertia=[1, 1, 1])
    model.add_joint("hinge", "revolute", between=["ground", "box"], axis="z")
    with pytest.warns(flexmb.FlexmbWarning) as told:
        second = flexmb.simulate(model, start_from=first)
    texts = " | ".join(str(entry.message) for entry in told)
    assert "as placed in the scene: lid" in texts
    assert "bodies.box: joints and drivers at t = 0 change its start: moved by 0.2 m" in texts
    assert "velocity by up to 1 m/s" in texts
    assert np.abs(second.q[0, :3]).max() < 1e-12


def test_nothing_in_common_is_a_mistake(scene: Path, tmp_path: Path) -> None:
    first = flexmb.simulate(free_box())
    with pytest.raises(FlexmbError, match="has no body of this scene; it has box"):
        flexmb.run_scene(scene, output=tmp_path / "out", start_from=first, pictures=False)


@pytest.mark.seconds
def test_a_temporary_folder_goes_with_its_result_unless_saved(tmp_path: Path) -> None:
    result = flexmb.simulate(free_box())
    folder = result.path.parent
    kept = result.save(tmp_path / "kept")
    q = result.q.copy()
    again = flexmb.resume(result.path, duration=0.4)  # another result of the same folder
    del result
    gc.collect()
    assert len(again.q) == 21
    del again
    gc.collect()
    assert not folder.exists()
    np.testing.assert_array_equal(kept.q, q)


def test_a_failed_run_without_a_folder_stays_readable() -> None:
    with pytest.raises(SolverError) as caught:
        model = free_box()
        model.add_sensor("turn", "angle", joint="bearing")
        model.add_force("brake", "torque", at="arm", value=[0, 0, "log(0.2 - turn)"])
        flexmb.simulate(model)
    found = re.search(r"(\S+result\.h5) keeps the (\d+) outputs", str(caught.value))
    assert found and len(flexmb.load_result(found[1]).time) == int(found[2]) > 1


def test_a_mistake_leaves_no_folder_behind() -> None:
    before, made = set(TemporaryFolder.living), set()
    model = free_box()
    model.add_joint("pin", "revolute", between=["ground", "box"], axis="z")
    model.add_joint("far", "fixed", between=["ground", "box.center"])
    model.add_marker("ground.away", position=[1, 0, 0])
    model.add_joint("torn", "spherical", between=["ground.away", "box"])
    with pytest.raises(AssemblyError) as caught:
        flexmb.simulate(
            model, progress=lambda *told: made.update(set(TemporaryFolder.living) - before)
        )
    del caught
    gc.collect()
    assert made and not any(folder.exists() for folder in made)


def planar_arm() -> Model:
    model = flexmb.Model("arm", plane="xy")
    model.add_body("arm", mass=1.0, center=[0.3, 0, 0], inertia=[1.0, 1.0, 1.0])
    model.add_joint("bearing", "revolute", between=["ground", "arm"], axis="z")
    model.add_driver("motor", joint="bearing", angle="3*t**2")
    model.add_sensor("arm", "position", of="arm.center")
    model.set_dynamics(duration=1.0, step=1e-3, outputs=20)
    return model


def test_planar_runs_go_on_and_begin_from_planar_ones_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = flexmb.simulate(planar_arm(), output=tmp_path / "whole")
    monkeypatch.setattr(module, "_CHUNK_WORK", 6 * 170)
    part = flexmb.simulate(planar_arm(), output=tmp_path / "part", progress=Interrupt(3))
    assert part.status == "stopped"
    monkeypatch.undo()
    done = flexmb.resume(part)
    np.testing.assert_allclose(done.q, whole.q, atol=1e-12)  # chunks of another length
    assert flexmb.simulate(planar_arm(), start_from=whole).status == "finished"
    with pytest.raises(ResultFileError, match="is no run in the plane xy"):
        flexmb.simulate(planar_arm(), start_from=flexmb.simulate(free_box()))
