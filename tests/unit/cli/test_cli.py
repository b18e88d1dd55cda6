"""The command line: what it passes on, what it shows, and how it ends."""

from __future__ import annotations

import subprocess
import sys
import types
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import slidercrank
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.errors import Problem, SceneError
from flexmb.flexbody import rigid_body, save
from flexmb.results import Result
from flexmb.units import SI
from flexmb.workflow import check, reduction, simulate


@dataclass
class Outcome:
    passed: bool = True
    sensor: str = "slider.x"
    time: float = 0.0
    value: float = 0.71
    expected: float = 0.71
    tolerance: float = 1e-9
    source: str = "both links in line"
    is_open: bool = False

    def place(self, unit: str) -> str:
        return self.sensor if self.time is None else f"{self.sensor} at t = {self.time:g} {unit}"


@dataclass
class Report:
    result: Path
    flexbodies: dict[str, Path]
    picture: Path | None = None
    history: Path | None = None
    notes: list[str] = field(default_factory=lambda: ["gravity is none"])
    checks: list[Outcome] = field(default_factory=lambda: [Outcome()])
    tables: tuple = ()


class Workflow:
    """Stands in for the workflow: keeps what it was called with, answers as told."""

    def __init__(self, result: Path) -> None:
        self.report = Report(result, {"rod": result.parent / "rod.flexbody.h5"})
        self.called: dict[str, Any] = {}
        self.failure: BaseException | None = None
        self.passed = True

    def _call(self, *given: Any, **named: Any) -> None:
        self.called = {"given": given, **named}
        if "progress" in named:
            named["progress"]("reduce", 0.5, "rod")
            named["progress"]("reduce", 1.0)
        if self.failure is not None:
            raise self.failure

    def run_scene(self, *given: Any, **named: Any) -> Report:
        self._call(*given, **named)
        return self.report

    def reduce_mesh(self, *given: Any, **named: Any) -> Any:
        self._call(*given, **named)
        body = rigid_body(2.0, inertia=1.0, name="rod")
        return types.SimpleNamespace(body=body, path=Path("rod.flexbody.h5"), report=None)

    def reduce_scene(self, *given: Any, **named: Any) -> Any:
        self._call(*given, **named)
        body = rigid_body(2.0, inertia=1.0, name="rod")
        one = types.SimpleNamespace(body=body, path=Path("out/rod.flexbody.h5"), report=None)
        checks = [Outcome(passed=self.passed, sensor="frequency 1 of rod, free", time=None)]
        return types.SimpleNamespace(bodies=(one,), notes=["reused"], checks=checks, units=SI)

    def check_scene(self, *given: Any, **named: Any) -> Any:
        self._call(*given, **named)
        rod = {"modal coordinates": "11 = 6*2 interfaces + 5 modes - 6"}
        return types.SimpleNamespace(
            title="A scene",
            counts={"bodies": 3},
            notes=["none"],
            bodies={"rod": rod},
            mobility=None,
            definition=(),
        )


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slidercrank.make(tmp_path_factory.mktemp("run"))


@pytest.fixture
def workflow(result: Path, monkeypatch: pytest.MonkeyPatch) -> Workflow:
    stand_in = Workflow(result)
    for module, name in (
        (simulate, "run_scene"),
        (reduction, "reduce_mesh"),
        (reduction, "reduce_scene"),
        (check, "check_scene"),
    ):
        monkeypatch.setattr(module, name, getattr(stand_in, name))
    return stand_in


def call(*words: str) -> Any:
    return CliRunner().invoke(app, list(words))


def test_run_passes_its_options_on_and_shows_a_summary(workflow: Workflow) -> None:
    done = call("run", "scene.toml", "--set", "r=0.1", "-s", "dynamics.step=1e-5", "-o", "here")
    assert done.exit_code == 0
    progress = workflow.called.pop("progress")
    assert callable(progress)
    assert workflow.called == {
        "given": (Path("scene.toml"),),
        "output": Path("here"),
        "overrides": {"r": "0.1", "dynamics.step": "1e-5"},
        "analysis": None,
        "start_from": None,
        "fresh": False,
        "pictures": True,
    }
    for shown in ("8 000", "kinetic", "drift", "gravity is none", "result.h5"):
        assert shown in done.stdout


def test_a_summary_is_in_the_units_of_the_scene(workflow: Workflow, monkeypatch) -> None:
    scene = {"title": "m", "units": "mm-t-s", "gravity": [0, -9810.0, 0]}
    monkeypatch.setattr(Result, "model", property(lambda self: scene))
    done = call("info", str(workflow.report.result))
    assert done.exit_code == 0
    assert "energy [mJ]" in done.stdout
    assert "kinetic" in done.stdout and "500" in done.stdout  # 0.5 J
    assert "gravity: (0, -9810, 0) mm/s²" in done.stdout
    monkeypatch.setattr(Result, "model", property(lambda self: {"units": "mm-g-ms"}))
    done = call("info", str(workflow.report.result))
    assert "rows to t = 80 ms" in done.stdout and "gravity: none" in done.stdout


def test_a_failed_check_ends_in_3_and_a_stopped_run_in_130(workflow: Workflow, tmp_path) -> None:
    workflow.report.checks = [Outcome(passed=False, value=0.72)]
    done = call("run", "scene.toml", "--no-picture", "--fresh")
    assert done.exit_code == 3
    assert "FAILED" in done.stdout
    assert "the expected value is from: both links in line" in done.stdout
    assert (workflow.called["pictures"], workflow.called["fresh"]) == (False, True)
    workflow.failure = KeyboardInterrupt()
    assert call("run", "scene.toml").exit_code == 130


def test_a_mistake_is_one_message_without_traceback(workflow: Workflow) -> None:
    workflow.failure = SceneError.from_problems(
        [Problem("joints.pin.type", 'unknown joint type "revolut"', (), ("revolute",))]
    )
    done = call("run", "scene.toml")
    assert done.exit_code == 2
    assert done.stderr.startswith('error: joints.pin.type: unknown joint type "revolut"')
    assert "Traceback" not in done.output


def test_a_fault_of_our_own_asks_for_a_report(workflow: Workflow) -> None:
    workflow.failure = ZeroDivisionError("division by zero")
    done = call("check", "scene.toml")
    assert done.exit_code == 1
    assert "ZeroDivisionError: division by zero" in done.stderr
    assert "report" in done.stderr
    assert isinstance(call("--debug", "check", "scene.toml").exception, ZeroDivisionError)


@pytest.mark.parametrize(
    "words",
    [
        ("run", "scene.toml", "--set", "speed"),
        ("run", "scene.toml", "--set", "a=1", "--set", "a=2"),
        ("run",),
        ("render", "result.h5", "--direction", "up"),
        ("render", "result.h5", "--size", "big"),
        ("render", "result.h5", "--exaggeration", "much"),
        ("reduce", "rod.msh", "--material", "{E = }"),
        ("info", "no_such_file.h5"),
        ("render", "no_such_file.h5"),
        ("fly",),
    ],
)
def test_wrong_words_end_in_2(workflow: Workflow, words: tuple[str, ...]) -> None:
    done = call(*words)
    assert done.exit_code == 2
    assert done.stderr
    assert "Traceback" not in done.output


def test_reduce_reads_tables_as_in_a_scene(workflow: Workflow) -> None:
    done = call(
        "reduce", "rod.msh", "--material", "{E = 70e9, nu = 0.3, density = 2700}",
        "--units", "mm-t-s", "--interface", "a=bore_a", "--interface", "b=bore_b",
        "--section", "all={type = 'circle', radius = 0.01}", "--modes", "5",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    called = workflow.called
    assert called["material"] == {"E": 70e9, "nu": 0.3, "density": 2700}
    assert called["interfaces"] == {"a": "bore_a", "b": "bore_b"}
    assert called["sections"] == {"all": {"type": "circle", "radius": 0.01}}
    assert (called["modes"], called["units"]) == (5, "mm-t-s")
    assert "damping" not in called  # left to the library
    assert "2 kg" in done.stdout
    assert "written: rod.flexbody.h5" in done.stdout


def test_reduce_takes_a_scene(workflow: Workflow) -> None:
    done = call("reduce", "a.toml", "--body", "rod", "--set", "r=1", "--up-to", "500", "-o", "out")
    assert done.exit_code == 0, done.output
    workflow.called.pop("progress")
    assert workflow.called == {
        "given": (Path("a.toml"),),
        "body": "rod",
        "overrides": {"r": "1"},
        "fresh": False,
        "output": Path("out"),
        "report": True,
        "up_to": 500.0,
    }
    for shown in ("flexible body rod", "note: reused", "frequency 1 of rod", "out/rod.flexbody.h5"):
        assert shown in done.stdout
    workflow.passed = False
    assert call("reduce", "a.toml").exit_code == 3


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("a.toml", "--material", "steel"), "a scene says it itself"),
        (("a.toml", "--modes", "5"), "a scene says it itself"),
        (("a.msh", "--material", "steel", "--body", "rod"), "belongs to a scene"),
        (("there.msh",), "is needed with a mesh file"),
        (("thre.msh",), "thre.msh: there is no such mesh file; nearest: there.msh"),
        (("no/a.msh",), "no/a.msh: there is no such mesh file: the folder no does not exist"),
        ((".",), "is a folder, not a mesh file"),
    ],
)
def test_reduce_refuses_options_of_the_other_kind_and_missing_files(
    workflow, words, sentence, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.msh").touch()
    done = call("reduce", *words)
    assert done.exit_code == 2
    assert sentence in " ".join(done.stderr.split())


def test_check_shows_counts(workflow: Workflow) -> None:
    done = call("check", "scene.toml", "--set", "r=1")
    assert done.exit_code == 0
    assert "bodies" in done.stdout
    assert workflow.called["given"] == (Path("scene.toml"), {"r": "1"})


def test_info_knows_results_bodies_meshes_and_scenes(
    workflow: Workflow, result: Path, project: Path
) -> None:
    assert "crank_angle" in call("info", str(result)).stdout
    assert "crank_angle" in call("info", str(result.parent)).stdout
    assert "is a folder without a result.h5" in call("info", str(project)).stderr
    assert "1.6 kg" in call("info", str(result.with_name("rod.flexbody.h5"))).stdout
    assert "bore_small" in call("info", str(project / "meshes" / "connecting_rod.msh")).stdout
    scene = result.with_name("scene.toml")
    scene.write_text("")
    assert "the scene is valid" in call("info", str(scene)).stdout


def test_render_draws_beside_the_result(result: Path) -> None:
    done = call("render", str(result), "--time", "0.004", "--size", "320x180", "--direction", "-y")
    assert done.exit_code == 0, done.output
    assert result.with_name("picture.png").exists()
    assert "outside the run" in call("render", str(result), "--time", "9").stderr


def test_a_file_that_is_neither_result_nor_body_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.h5").write_text("not HDF5")
    done = call("info", str(tmp_path / "x.h5"))
    assert done.exit_code == 2
    assert "not an HDF5 file" in done.stderr
    save(rigid_body(1.0, inertia=1.0), tmp_path / "b.flexbody.h5")
    assert "no modes to draw" in call("render", str(tmp_path / "b.flexbody.h5")).stderr


@pytest.mark.seconds
def test_help_and_version() -> None:
    helped = call("--help")
    assert helped.exit_code == 0
    for word in ("run", "reduce", "render", "check", "info", "doctor", "Examples", "Exit codes"):
        assert word in helped.stdout
    for command in ("run", "reduce", "render", "check", "info"):
        assert "Example: flexmb" in call(command, "--help").stdout
    assert call("--version").stdout.startswith("flexmb ")
    words = [sys.executable, "-m", "flexmb", "--version"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout == call("--version").stdout


@pytest.mark.seconds
def test_doctor_says_what_works() -> None:
    done = call("doctor")
    assert done.exit_code == 0, done.output
    for word in ("numpy", "scikit-fem", "pictures", "cache", "compiled units", "Python"):
        assert word in done.stdout
