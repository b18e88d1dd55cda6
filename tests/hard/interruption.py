"""Kills, Ctrl-C and full disks in every phase: `python -m tests.hard.interruption [PHASE ...]`.

For each phase, at `--kills` random moments of the processor time that it takes: kill -9; at some
Ctrl-C; and as root on Linux a disk (tmpfs in a mount namespace of its own) that has no more room.
What must hold is in `check_outputs`: every file under its final name is whole, an older one or the
new one; a killed run opens with rows that are those of the whole run to the last bit, and resumes
to it, and so are the runs of a study, a sweep or a budget; a broken cache is a missing one; what
was left over is gone after the next whole run. `--pairs N` runs each phase twice at the same time.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

import numpy as np
import psutil

from flexmb.engine.unit_cache import read_unit
from flexmb.errors import FlexmbError
from flexmb.flexbody import load
from flexmb.results import Result
from flexmb.results.channels import TABLES
from flexmb.studies.record_table import read_rows

SCENE = """
title = "a beam that swings"
gravity = "earth -y"
joints.pin = { type = "revolute", between = ["ground", "beam.root"], axis = "z" }
sensors.tip = { type = "position", of = "beam.tip" }
sensors.swing = { type = "angle", joint = "pin" }
dynamics = { duration = 0.15, outputs = 1500, accuracy = 1e-4 }
[bodies.beam]
mesh = { type = "beam", length = 1.0, divisions = 12 }
material = "steel"
sections = { all = { type = "rectangle", y = 0.02, z = 0.01 } }
modes = 6
interfaces = { root = "start", tip = "end" }
"""
PENDULUM = """
gravity = "earth -y"
bodies.rod = { mass = 1, center = [0.5, 0, 0], inertia = [0.01, 0.1, 0.1] }
joints.pin = { type = "revolute", between = ["ground", "rod"], axis = "z" }
forces.push = { type = "force", at = "rod", value = [0, -1.0, 0] }
sensors.swing = { type = "angle", joint = "pin" }
dynamics = { duration = 1, outputs = 20 }
"""
DRIVEN = PENDULUM + 'drivers.motor = { joint = "pin", angle = "sin(t)" }\n'
DONE = (0, 3)  # an audit says that an effect is missing
KEPT = (".unit", ".lock", ".parquet", ".jsonl")  # the cache, locks, rows of runs that have ended


@dataclass(frozen=True)
class Phase:
    """A command, and the files that it writes; `{}` in its words is the folder."""

    words: str
    outputs: tuple[str, ...]
    units: int = 0  # of the compile cache that are missing at its begin
    after: str = ""  # the command that leaves what it works on


_BODY = "out/beam.flexbody.h5"
_RUN = "run {{}}/scene.toml -o {{}}/{} --no-picture"
PHASES = {
    "compile": Phase(_RUN.format("out"), ("out/result.h5", _BODY), units=6),
    "reduce": Phase("reduce {}/scene.toml --fresh -o {}/out", (_BODY,)),
    "run": Phase(_RUN.format("out"), ("out/result.h5", _BODY)),
    "film": Phase(
        "film {}/done -o {}/out/a.gif --force --fps 8 --end 0.05 --speed 0.05 --size 320x180",
        ("out/a.gif",),
    ),
    "export": Phase("export {}/done --what motion -o {}/out/x.csv", ("out/x.csv",)),
    "plot": Phase("plot {}/done tip.x swing -o {}/out/p.png --force", ("out/p.png",)),
    "report": Phase("report {}/done -o {}/out/r.html --force", ("out/r.html",)),
    "statics": Phase(
        "run {}/scene.toml --analysis statics -o {}/out",
        ("out/result.h5", _BODY, "out/picture.png"),
    ),
    "study": Phase(
        "study {}/rod.toml -v accuracy=1e-3,1e-4 --repeats 1 --workers 1 -o {}/out --fresh",
        ("out/study.csv", "out/study.md", "out/work_precision.png"),
    ),
    "sweep": Phase(
        "sweep {}/rod.toml -v bodies.rod.mass=1,2,3,4,5 --workers 1 -o {}/out --fresh",
        ("out/sweep.md", "out/sweep.json"),
    ),
    "budget": Phase(
        "budget {}/rod.toml --knob integration --workers 1 -o {}/out --fresh",
        ("out/budget.md", "out/budget.json", "out/budget.png"),
    ),
    "modes": Phase(
        "modes {}/rod.toml --vary bodies.rod.mass=1,2,3 -o {}/out/m.png", ("out/m.png",)
    ),
    "audit": Phase("audit {}/out", ("out/result.h5",), after=_RUN.format("out")),
    "inverse": Phase("inverse {}/driven.toml -o {}/out", ("out/result.h5", "out/picture.png")),
    "response": Phase(
        "response {}/rod.toml --input push.y --sensor swing -o {}/out/r.png", ("out/r.png",)
    ),
    "stress": Phase("stress {}/done -o {}/out/s.h5 --force", ("out/s.h5",)),
}


@dataclass
class Trial:
    """A phase in a folder of its own."""

    name: str
    folder: Path
    cpu: float = 0.0  # s of the processor that the whole command takes
    whole: dict[str, str] = field(default_factory=dict)  # digests of what it writes
    wrong: list[str] = field(default_factory=list)
    damaged: set[str] = field(default_factory=set)  # units of the cache: by this script
    refusals: int = 0  # of two at once

    def __post_init__(self) -> None:
        self.phase = PHASES[self.name]
        self.words = self.phase.words.format(*[self.folder] * 2).split()
        self.environment = os.environ | {"TMPDIR": str(self.folder / "tmp")}
        if self.phase.units:
            self.environment["FLEXMB_CACHE_DIR"] = str(self.folder / "cache")

    def prepare(self) -> None:
        """Make what the phase needs, run it once, and keep that as the older files."""
        for name in ("tmp", "out"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        (self.folder / "scene.toml").write_text(SCENE)
        (self.folder / "rod.toml").write_text(PENDULUM)
        (self.folder / "driven.toml").write_text(DRIVEN)
        if self.phase.units:
            from flexmb.folders import cache_root

            shutil.copytree(cache_root() / "units", self.folder / "cache" / "units")
        after = _RUN.format("done") if "{}/done" in self.phase.words else self.phase.after
        if after:
            self.finish(self.start(after.format(*[self.folder] * 2).split()))
        self.finish(self.start(self.words))  # whatever is compiled is compiled now
        self.remove_units(Random(0))
        child = self.start(self.words)
        while child.poll() is None:
            self.cpu = max(self.cpu, seconds_of(child))
            time.sleep(0.01)
        self.finish(child)
        self.whole = {name: digest(self.folder / name) for name in self.phase.outputs}
        shutil.copytree(self.folder / "out", self.folder / "older")

    def start(self, words: list[str]) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "flexmb", *words], env=self.environment, start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=self.folder,
        )  # fmt: skip

    def finish(self, child: subprocess.Popen[bytes]) -> str:
        _, text = child.communicate()
        if child.returncode not in DONE:
            raise RuntimeError(f"{self.name}: {text.decode()[-2000:]}")
        return text.decode()

    def restore(self) -> None:
        """Put the older files back; leave what kills have left."""
        for path in (self.folder / "older").iterdir():
            if path.is_dir():  # runs of a study
                shutil.copytree(path, self.folder / "out" / path.name, dirs_exist_ok=True)
            else:
                shutil.copy(path, self.folder / "out" / path.name)

    def remove_units(self, rng: Random) -> None:
        """Some of the compiled units are missing, and one is damaged."""
        if self.phase.units:
            files = sorted((self.folder / "cache" / "units").glob("*/*.unit"))
            for path in rng.sample(files, self.phase.units):
                path.unlink()
            path = rng.choice([path for path in files if path.exists()])
            self.damaged.add(path.name)
            path.write_bytes(path.read_bytes()[: rng.randrange(2000)])

    def interrupt(self, rng: Random, number: int) -> float:
        """Send a signal at a random moment; seconds until the process has ended."""
        self.restore()
        self.remove_units(rng)
        moment, child = rng.uniform(0.0, 1.05) * self.cpu, self.start(self.words)
        while child.poll() is None and seconds_of(child) < moment:
            time.sleep(0.003)
        used = seconds_of(child)
        if child.poll() is None:
            os.killpg(child.pid, number)
        spent = 0.0
        while child.poll() is None:
            spent = max(spent, seconds_of(child) - used)
            time.sleep(0.003)
        text = child.stderr.read().decode(errors="replace") if child.stderr else ""
        if number == signal.SIGINT:
            ours = "Traceback" in text and "__main__.py" in text  # else Python's, before flexmb
            if child.returncode not in (*DONE, 130, -signal.SIGINT) or ours:
                self.wrong.append(f"Ctrl-C at {moment:.2f} s: {child.returncode} {text[-300:]}")
            if spent > 1.0:
                self.wrong.append(f"Ctrl-C at {moment:.2f} s: {spent:.2f} s until it ended")
        when = f"signal {number} at {moment:.2f} s of {self.cpu:.2f} s"
        self.check_outputs(when)
        if "--fresh" in self.words and "out/result.h5" not in self.phase.outputs:
            self.finish(self.start([word for word in self.words if word != "--fresh"]))
            self.check_runs(when)
        return spent

    def start_twice(self, rng: Random) -> None:
        """Two processes do the same at nearly the same time: whole files, one may be refused."""
        self.restore()
        self.remove_units(rng)
        words = [word for word in self.words if word != "--fresh" or rng.random() < 0.5]
        children = [self.start(words)]
        time.sleep(rng.uniform(0.0, 0.3))
        children.append(self.start(words))
        ends = [(child.communicate()[1].decode(), child.returncode) for child in children]
        for said, code in ends:
            self.refusals += code == 2
            known = code in DONE or (code == 2 and "another" in said)
            if not known or "Traceback" in said:
                self.wrong.append(f"two at once: exit code {code}: {said[-400:]}")
        if all(code not in DONE for _, code in ends):
            self.wrong.append(f"two at once: none of both went on: {ends[0][0][-300:]}")
        self.check_outputs("two at once")
        self.check_runs("two at once")

    def check_runs(self, when: str) -> None:
        """The runs of a study, a sweep or a budget are those of the whole command."""
        whole, now = runs_of(self.folder / "older"), runs_of(self.folder / "out")
        different = [key for key in whole.keys() & now.keys() if whole[key] != now[key]]
        if different or (whole and not now):
            self.wrong.append(f"{when}: runs that differ: {different} of {len(now)}")

    def check_outputs(self, when: str, *, resume: bool = True) -> None:
        """Every file under its final name is whole; a run that was cut off resumes."""
        for name in self.phase.outputs:
            path = self.folder / name
            try:
                if not path.exists():
                    raise AssertionError("the older file is gone")
                if name.endswith("result.h5"):
                    self.check_result(path, when, resume)
                elif digest(path) != self.whole[name]:
                    raise AssertionError("neither the older file nor the new one")
            except (FlexmbError, AssertionError, RuntimeError, OSError) as error:
                self.wrong.append(f"{when}: {name}: {str(error)[:400]}")
        for path in (self.folder / "cache" / "units").glob("*/*.unit"):
            if path.name not in self.damaged and read_unit(path) is None:
                self.wrong.append(f"{when}: {path.name} is a broken unit")

    def check_result(self, path: Path, when: str, resume: bool) -> None:
        """The rows are those of the whole run; resumed, it is that run to the last bit."""
        older, run = Result(self.folder / "older" / "result.h5"), Result(path)
        n = len(run.time)
        for table in TABLES:
            same = np.array_equal(run.table(table), older.table(table)[:n], equal_nan=True)
            assert same, f"{n} rows of {table} differ from those of the whole run"
        if run.status != "finished" and resume and run.last_state() is not None:
            self.finish(self.start(["resume", str(path.parent), "--no-picture"]))
            self.check_result(path, when, False)
            assert len(Result(path).time) == len(older.time), "resumed, it is not whole"
        elif run.status != "finished":
            assert n == 0 or "statics" in self.name, f"{n} rows, and no state to resume from"

    def leftovers(self) -> list[str]:
        """Files that are no outputs."""
        wanted = {self.folder / name for name in self.phase.outputs} | {
            self.folder / "out" / path.relative_to(self.folder / "older")
            for path in (self.folder / "older").rglob("*")
        }
        places = [*(self.folder / "out").rglob("*"), *(self.folder / "tmp").glob("*"),
                  *(self.folder / "cache").glob("units/*/*")]  # fmt: skip
        return [
            str(path.relative_to(self.folder)) for path in places
            if path.is_file() and path not in wanted and path.suffix not in KEPT
            or path.is_dir() and path.parent.name == "tmp"
        ]  # fmt: skip


def runs_of(folder: Path) -> dict[str, str]:
    """What the runs of a study, a sweep or a budget say, by key, without times."""
    runs = {
        path.parent.name: digest(path) + repr(Result(path).table("q").tobytes())
        for path in folder.glob("runs/*/result.h5") if Result(path).status == "finished"
    }  # fmt: skip
    for row in read_rows(folder / "runs.parquet").to_pylist():
        words = {k: v for k, v in row.items() if "seconds" not in k and k != "statistics"}
        runs[f"row {row['key']}"] = repr(sorted(words.items()))
    return runs


def seconds_of(child: subprocess.Popen[bytes]) -> float:
    """Processor time of a process and its children [s]; 0 where it has ended."""
    total = 0.0
    with suppress(psutil.Error):
        process = psutil.Process(child.pid)
        for one in (process, *process.children(recursive=True)):
            with suppress(psutil.Error):
                total += sum(one.cpu_times()[:2])
    return total


def digest(path: Path) -> str:
    """Of what a file holds, without the times and names that differ from run to run."""
    if path.name.endswith(".flexbody.h5"):
        body = load(path)
        data = b"".join(m.tobytes() for m in (body.K, body.D, body.p, body.Mab))
        return hashlib.sha256(data).hexdigest()
    if path.name == "result.h5":
        return str(len(Result(path).time))
    data = path.read_bytes()
    if path.suffix == ".png":  # whole: the last chunk is IEND
        assert data[:8] == b"\x89PNG\r\n\x1a\n" and data[-8:-4] == b"IEND", "a PNG that is cut"
        return f"{struct.unpack('>II', data[16:24])}"
    if path.suffix == ".gif":
        assert data[:4] == b"GIF8" and data[-1:] == b"\x3b", "a GIF that is cut"
        return "gif"
    if path.name.startswith(("study.", "sweep.", "budget.")):  # times differ
        return f"{path.read_text().count(chr(10))} lines"
    if path.suffix == ".html":
        assert data.rstrip().endswith(b"</html>"), "a page that is cut"
        return "html"
    return hashlib.sha256(data).hexdigest()


def fill_disks(name: str, sizes: list[int]) -> int:
    """A phase on a disk with room for so many bytes; runs in a mount namespace of its own."""
    wrong = []
    with tempfile.TemporaryDirectory() as base:
        ready = Trial(name, Path(base) / "ready")
        ready.prepare()
        place = Path(base) / "disk"
        place.mkdir()
        used = sum(path.stat().st_blocks * 512 for path in ready.folder.rglob("*"))
        for size in sizes:
            mount = ["mount", "-t", "tmpfs", "-o", f"size={used + 30_000_000}", "tmpfs"]
            subprocess.run([*mount, str(place)], check=True)
            try:
                wrong += fill_disk(ready, place, size)
            finally:
                subprocess.run(["umount", str(place)], check=True)
    for sentence in wrong:
        print(f"   WRONG {sentence}", flush=True)
    return len(wrong)


def fill_disk(ready: Trial, place: Path, size: int) -> list[str]:
    """Run a phase in a copy of its folder on a disk with so much room; what is wrong."""
    shutil.copytree(ready.folder, place, dirs_exist_ok=True)
    trial = Trial(ready.name, place, ready.cpu, ready.whole, damaged=set(ready.damaged))
    trial.remove_units(Random(size))
    free = shutil.disk_usage(place).free - size
    (place / "filler").write_bytes(bytes(max(free, 0)))
    child = trial.start(trial.words)
    said = child.communicate()[1].decode(errors="replace")
    print(f"   {size} bytes free: exit code {child.returncode}: {said.strip()[-200:]}", flush=True)
    if child.returncode not in (*DONE, 2) or "Traceback" in said:
        trial.wrong.append(f"{size} bytes free: exit code {child.returncode}: {said[-400:]}")
    trial.check_outputs(f"{size} bytes free", resume=False)
    if extra := trial.leftovers():
        trial.wrong.append(f"{size} bytes free: left over: {extra}")
    (place / "filler").unlink()
    trial.finish(trial.start(trial.words))
    trial.check_outputs(f"{size} bytes free, and free again")
    return trial.wrong


def pair_often(name: str, pairs: int, seed: int) -> int:
    """A phase twice at the same time, again and again; the number of what is wrong."""
    with tempfile.TemporaryDirectory() as base:
        trial, rng = Trial(name, Path(base)), Random(f"{name} {seed}")
        trial.prepare()
        for _ in range(pairs):
            trial.start_twice(rng)
        if left := trial.leftovers():
            trial.wrong.append(f"left over: {left[:5]}")
        print(f"{name:8} {pairs} pairs: {trial.refusals} refused, {len(trial.wrong)} wrong",
              flush=True)  # fmt: skip
        for sentence in trial.wrong:
            print(f"   WRONG {sentence}", flush=True)
        return len(trial.wrong)


def kill_often(name: str, kills: int, interruptions: int, seed: int) -> int:
    """Kills and Ctrl-C in a phase; the number of what is wrong."""
    with tempfile.TemporaryDirectory() as base:
        trial, rng, began = Trial(name, Path(base)), Random(f"{name} {seed}"), time.monotonic()
        trial.prepare()
        for _ in range(kills):
            trial.interrupt(rng, signal.SIGKILL)
        most = len(trial.leftovers())
        slowest = max(
            (trial.interrupt(rng, signal.SIGINT) for _ in range(interruptions)), default=0
        )
        trial.restore()
        trial.finish(trial.start(trial.words))
        trial.check_outputs("the whole command afterwards")
        if left := trial.leftovers():
            trial.wrong.append(f"left over after a whole command: {left[:5]}")
        print(
            f"{name:8} {trial.cpu:5.2f} s: {kills} kills, {interruptions} Ctrl-C (slowest "
            f"{slowest:.2f} s), at most {most} files left over, {len(trial.wrong)} wrong, "
            f"{time.monotonic() - began:.0f} s", flush=True,
        )  # fmt: skip
        for sentence in trial.wrong:
            print(f"   WRONG {sentence}", flush=True)
        return len(trial.wrong)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.hard.interruption")
    parser.add_argument("phases", nargs="*")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--interruptions", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pairs", type=int, help="two processes at once, so often")
    parser.add_argument("--disk", action="store_true", help="full disks (root, Linux)")
    room = [0, 3000, 30_000, 100_000, 400_000, 1_500_000]
    parser.add_argument("--room", type=int, nargs="+", default=room, help="bytes on the disk")
    words = parser.parse_args()
    if words.disk and os.environ.get("FLEXMB_DISK") != "here":
        command = ["unshare", "-m", sys.executable, "-m", "tests.hard.interruption", *sys.argv[1:]]
        return subprocess.run(
            command, env=os.environ | {"FLEXMB_DISK": "here"}, check=False
        ).returncode
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may ignore it for its jobs
    wrong = 0
    for name in words.phases or PHASES:
        if words.disk:
            print(f"{name}: full disk", flush=True)
            wrong += fill_disks(name, words.room)
        elif words.pairs:
            wrong += pair_often(name, words.pairs, words.seed)
        else:
            wrong += kill_often(name, words.kills, words.interruptions, words.seed)
    print(f"{wrong} wrong", flush=True)
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
