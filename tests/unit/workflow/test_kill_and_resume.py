"""A run that is killed and resumed, again and again, ends with the bytes of one left alone."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from samebytes import assert_same_bytes

RUN = """
import sys
import flexmb
from flexmb.analysis.dynamics import integration
word, folder, scene, steps, *knobs = sys.argv[1:]
integration._CHUNK_WORK = 18 * int(steps)  # few steps: many moments at which a kill may come
def told(phase, share, detail=""):
    if phase == "integrate":
        sys.stdout.write(f"{share}\\n")
        sys.stdout.flush()
if word == "begin":
    model = flexmb.load_scene(scene, dict(knob.split("=") for knob in knobs))
    flexmb.simulate(model, output=folder, progress=told)
else:
    flexmb.resume(folder, progress=told)
"""
SCENE = Path(__file__).parents[3] / "cases" / "rigid_slider_crank" / "scene.toml"


Knobs = tuple[int, *tuple[str, ...]]  # steps in a chunk, and what is changed of the scene


def _start(word: str, folder: Path, knobs: Knobs) -> subprocess.Popen[str]:
    words = map(str, (word, folder, SCENE, *knobs))
    return subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", RUN, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _finish(process: subprocess.Popen[str]) -> None:
    _, errors = process.communicate()
    assert process.returncode == 0, errors


def _kill(process: subprocess.Popen[str], seconds: float) -> bool:
    """Kill a run a while after its first chunk; whether it was still under way."""
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(seconds)
    under_way = process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.communicate()
    return under_way


def _kill_and_resume(tmp_path: Path, kills: int, knobs: Knobs, longest: float) -> None:
    moments = random.Random(11)
    _finish(_start("begin", tmp_path / "whole", knobs))
    word = "begin"
    for _ in range(kills):
        process = _start(word, tmp_path / "killed", knobs)
        assert _kill(process, moments.uniform(0.0, longest)), "the run ended before it was killed"
        word = "resume"
    _finish(_start(word, tmp_path / "killed", knobs))
    assert_same_bytes(tmp_path / "killed" / "result.h5", tmp_path / "whole" / "result.h5")


@pytest.mark.seconds
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is a POSIX signal")
def test_the_bytes_are_the_same_after_two_kills(tmp_path: Path) -> None:
    _kill_and_resume(tmp_path, 2, (20, "dynamics.step=turn/1000"), longest=0.05)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is a POSIX signal")
@pytest.mark.parametrize(
    "knobs",
    [
        (20, "dynamics.step=turn/100000"),
        (5, "dynamics.accuracy=1e-4", "dynamics.duration=600*turn", "dynamics.outputs=12000"),
    ],
    ids=["fixed steps", "error control"],
)
def test_the_bytes_are_the_same_after_twenty_kills(tmp_path: Path, knobs: Knobs) -> None:
    _kill_and_resume(tmp_path, 20, knobs, longest=0.4)
