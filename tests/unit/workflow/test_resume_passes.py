"""Going on with runs under error control: the scout and repeated passes lose nothing either."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from accuracyscenes.bristles import puck
from accuracyscenes.friction import FRICTION, on_points

import flexmb
from flexmb.analysis.dynamics import integration as module
from flexmb.results import Result
from flexmb.results.channels import TABLES
from flexmb.results.writer import ResultWriter

pytestmark = pytest.mark.filterwarnings("ignore::flexmb.errors.FlexmbWarning")


def driven() -> flexmb.Model:
    """A pendulum turned to and fro, whose errors are larger than a first pass expects."""
    made = flexmb.Model("driven", gravity=[0, -9.81, 0])
    made.add_body("b", mass=1, center=[0.5, 0, 0], inertia=[0.01, 0.1, 0.1])
    made.add_marker("b.end", position=[1, 0, 0])
    made.add_joint("pin", "revolute", between=["ground", "b"], axis="z")
    made.add_force("twist", "torque", at="b", value=[0, 0, "6*sin(3*t)"])
    made.add_sensor("end", "position", of="b.end")
    made.set_dynamics(duration=10.0, outputs=60, accuracy=1e-7)
    return made


_SHORT = 6 * 16 * 9  # so that a pass has many chunks


class Interrupt:
    """Progress that presses Ctrl-C after a chunk of a pass, and knows the passes."""

    def __init__(self, at: tuple[int, int] = (0, 0)) -> None:
        self.at, self.passes, self.chunk, self.share = at, 1, 0, 0.0

    def __call__(self, phase: str, fraction: float, detail: str = "") -> None:
        if phase != "integrate":
            return
        if fraction < self.share:
            self.passes, self.chunk = self.passes + 1, 0
        self.share, self.chunk = fraction, self.chunk + 1
        if (self.passes, self.chunk) == self.at:
            raise KeyboardInterrupt


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_CHUNK_WORK", _SHORT)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Result:
    seen, folder = Interrupt(), tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_CHUNK_WORK", _SHORT)
        result = flexmb.simulate(driven(), output=folder, progress=seen)
    assert result.statistics["passes"] == seen.passes == 2 and seen.chunk > 5
    return result


def assert_same(done: Result, whole: Result) -> None:
    """Tables, the newest state and statistics but for the seconds."""
    assert done.status == "finished"
    for name in TABLES:
        assert done.table(name).tobytes() == whole.table(name).tobytes(), name
    (rows, state), (wanted, states) = done.last_state(), whole.last_state()
    assert rows == wanted and state.keys() == states.keys()
    for name, array in states.items():
        assert state[name].tobytes() == array.tobytes(), name
    for name, value in whole.statistics.items():
        assert name.startswith("seconds") or done.statistics[name] == value, name


SLOW = [pytest.param(at, marks=pytest.mark.slow) for at in ((1, 4), (2, 1))]


@pytest.mark.parametrize("at", [(1, 1), (2, 5), *SLOW])
def test_a_stopped_pass_goes_on_to_the_same_bytes(
    tmp_path: Path, whole: Result, at: tuple[int, int]
) -> None:
    part = flexmb.simulate(driven(), output=tmp_path / "part", progress=Interrupt(at))
    rows = len(part.time)
    assert part.status == "stopped" and rows < len(whole.time)
    assert part.statistics["passes"] == at[0]
    again = flexmb.resume(part, progress=Interrupt((1, 2)))
    assert again.status == "stopped" and rows < len(again.time)
    assert_same(flexmb.resume(again), whole)


@pytest.mark.slow
def test_a_run_killed_at_any_moment_goes_on_to_the_same_bytes(
    tmp_path: Path, whole: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lies on the disk before and after every call of the writer is what a kill leaves."""
    left: list[tuple[str, Path]] = []

    def watched(name: str) -> None:
        method = getattr(ResultWriter, name)

        def call(self: ResultWriter, *words: object) -> None:
            keep(f"before {name}")
            method(self, *words)
            keep(f"after {name}")

        monkeypatch.setattr(ResultWriter, name, call)

    def keep(moment: str) -> None:
        folder = tmp_path / f"left{len(left)}"
        shutil.copytree(tmp_path / "run", folder)
        left.append((moment, folder))

    with monkeypatch.context():
        for name in ("append", "save_state", "restart"):
            watched(name)
        flexmb.simulate(driven(), output=tmp_path / "run")
    monkeypatch.undo()
    monkeypatch.setattr(module, "_CHUNK_WORK", _SHORT)
    began = [(folder / "result.h5").is_file() for _, folder in left].index(True)
    assert began <= [moment for moment, _ in left].index("after append")  # the first rows
    restart = [moment for moment, _ in left].index("before restart")
    for k in (restart - 1, restart + 1):  # to a longer run, from the old pass and the new one
        folder = shutil.copytree(left[k][1], tmp_path / f"longer{k}")
        np.testing.assert_allclose(flexmb.resume(folder, duration=20.0).time, np.arange(121) / 6)
    chosen = [*range(began, restart - 4, 19), *range(restart - 4, restart + 6), len(left) - 1]
    for k in chosen:
        _, folder = left[k]
        assert Result(folder).status == "running"
        assert_same(flexmb.resume(folder), whole)


@pytest.mark.seconds
@pytest.mark.parametrize("outputs", [30, pytest.param(60, marks=pytest.mark.slow)])
def test_a_finished_run_is_extended_as_accurately(
    tmp_path: Path, whole: Result, outputs: int
) -> None:
    """Chunks are others, so not to the bit."""
    model = driven()
    model.set_dynamics(duration=5.0, outputs=outputs, accuracy=1e-6)
    short = flexmb.simulate(model, output=tmp_path / "short")
    done = flexmb.resume(short, duration=10.0)
    model.set_dynamics(
        duration=10.0, outputs=600, accuracy=1e-12, verify=False, method="explicit-rk"
    )
    truth = flexmb.simulate(model, output=tmp_path / "truth")
    names = ["end.x", "end.y"]
    for result in (done, whole):
        every = 600 // (len(result.time) - 1)
        error = max(np.abs(result[name] - truth[name][::every]).max() for name in names)
        error /= max(np.ptp(truth[name]) for name in names)
        assert error < 2e-6
        said = result.statistics["measured_error_of_positions"]
        assert error < max(3 * said, 2e-7)
        if result is whole or outputs >= 51:  # else also measured between the rows
            assert said < max(5 * error, 2e-7)


GUIDE = FRICTION["guide loaded to and fro"]
FIXED = {"step": 5e-4, "method": "generalized-alpha"}


@pytest.mark.parametrize(
    ("make", "way"),
    [
        (on_points, FIXED), (puck, FIXED), (GUIDE.make, FIXED),
        (GUIDE.make, {"method": "radau"}), (GUIDE.make, {"method": "explicit-rk"}),
    ],
    ids=["block", "puck", "guide", "guide by radau", "guide by explicit-rk"],
)  # fmt: skip
def test_bristles_resume_to_the_same_bytes(
    tmp_path: Path, make: Callable[[float], flexmb.Model], way: dict[str, object]
) -> None:
    """By a method that needs no accelerations of markers as well: a bristle remembers them."""
    knobs = {"duration": 0.15, "outputs": 30, **way}
    whole = flexmb.simulate(make(1.0), output=tmp_path / "whole", **knobs)
    part = flexmb.simulate(make(1.0), output=tmp_path / "part", progress=Interrupt((1, 1)), **knobs)
    assert part.status == "stopped"
    assert_same(flexmb.resume(part), whole)
