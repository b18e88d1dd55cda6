"""Hostile inputs by the thousand: `python -m tests.hard.fuzz [KIND ...] [--share 0.1] [--begin N]`.

Each input is made from its kind and a number, so that `--begin N --count 1` repeats it. A process
of its own reads them, with 1 GB of memory more than it has at rest; the one that starts it ends it
when an input takes more than 10 s of the processor. A find is one of

- an exception that is no `FlexmbError`, or an exit code that says a fault of flexmb;
- a process that ends, more than 10 s, more than 1 GB (`MemoryError`);
- a control character in what is printed;
- a file opened outside the folders of the input, of the cache and of Python, or anything written
  there; a program started, code executed from the input, a connection to a network.

The finds are kept with their files in the folder that the last line names.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import importlib
import io
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import unicodedata
import warnings
from pathlib import Path
from random import Random
from typing import Any

import psutil

SECONDS, MEMORY = 10.0, 1_000_000_000
peaks: list[int] = []  # bytes that the processes of a first reading had at most
_FIRST_READING = 2.0  # seconds of the processor for the first reading of a file, here
_FOLDERS = ("mesh", "result", "records")  # of inputs
_PLAIN = ("/proc/", "/sys/", "/dev/null", "/dev/urandom", "/usr/", "/etc/", "/lib")
_STARTS = ("os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.spawn",
           "socket.connect", "pickle.find_class", "socket.bind", "urllib.Request")  # fmt: skip
_WRITES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.chmod",
           "shutil.rmtree", "os.truncate", "shutil.move", "shutil.copyfile")  # fmt: skip


class Guard:
    """An audit hook that notes what an input may not do."""

    def __init__(self, folder: Path, anywhere: bool) -> None:
        from flexmb.folders import cache_root

        project = Path(__file__).parents[2]
        self.mine = tuple(f"{path.resolve()}" for path in (folder, cache_root()))
        temporary = f"{tempfile.gettempdir()}/flexmb-"
        self.readable = (*self.mine, temporary, f"{project}", sys.prefix, sys.base_prefix, *_PLAIN)
        self.writable = (*self.mine, temporary, "/dev/null")
        self.anywhere = anywhere  # a scene names what it reads
        self.noted: list[str] = []
        sys.addaudithook(self.hook)

    def hook(self, event: str, words: Any) -> None:
        if event in _STARTS:
            if "flexmb.engine.compiler" in str(words):  # of a unit that no seed has needed
                return
            self.noted.append(f"{event} {words!r:.200}")
        elif event == "open":
            path, mode, flags = words
            if isinstance(path, str | bytes | os.PathLike):
                writes = bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
                if writes or not self.anywhere:
                    self.check(path, self.writable if writes else self.readable, event)
        elif event in _WRITES:
            for word in words:
                if isinstance(word, str | os.PathLike):
                    self.check(word, self.writable, event)

    def check(self, path: Any, allowed: tuple[str, ...], event: str) -> None:
        name = os.path.realpath(os.fsdecode(path))
        if not name.startswith(allowed) and name != tempfile.gettempdir():
            self.noted.append(f"{event} {name}")


def read_apart(path: Path, module: str) -> str | None:
    """As `flexmb.untrusted` does it, by a copy of this process instead of a new one: 100 times as
    many inputs in the same time."""
    from flexmb import untrusted

    read = importlib.import_module(module)._read_apart
    with os.fdopen(os.memfd_create("said"), "r+b") as said:
        child = os.fork()
        if child == 0:
            code = 1
            with contextlib.suppress(BaseException):
                os.dup2(said.fileno(), 1)
                sys.stdout = os.fdopen(1, "w")
                sys.argv = ["", str(path), str(int(_FIRST_READING))]
                try:
                    untrusted.serve_reading(read)
                except SystemExit as done:
                    code = done.code
                except BaseException:  # noqa: BLE001
                    if not isinstance(sys.exception(), MemoryError):
                        sys.stdout.write(traceback.format_exc())
                sys.stdout.flush()
            os._exit(code)
        _, status, used = os.wait4(child, 0)
        peaks.append(used.ru_maxrss * 1024)
        said.seek(0)
        text = said.read().decode(errors="replace").strip()
    code = os.waitstatus_to_exitcode(status)
    if code == 1 and "Traceback" in text:
        raise AssertionError(text)
    if code == untrusted._REFUSED:
        return text
    return "is damaged: reading it ends the process" if code else None


def serve(kind: str, begin: int, end: int, folder: Path) -> None:
    """Make and read inputs of a kind; one line for each on the standard output."""
    from typer import BadParameter

    from flexmb import untrusted
    from flexmb.errors import FlexmbError
    from tests.hard.hostile import KINDS

    make = KINDS[kind][1]
    report = os.fdopen(os.dup(1), "w", buffering=1)
    untrusted._first_reading = read_apart
    if kind in ("result", "records"):
        import matplotlib.font_manager  # noqa: F401  asks programs for the fonts, once
    guard = Guard(folder, kind in ("scene", "grammar", "section"))
    os.chdir(folder)
    process = psutil.Process()
    warnings.simplefilter("ignore")
    limited, at_rest = False, process.memory_info().rss
    for number in range(begin, end):
        rng = Random(f"{kind} {number}")
        report.write(f"{number}\n")
        printed = io.StringIO()
        peaks.clear()
        forget_peak()
        guard.noted.clear()
        started, outcome = sum(os.times()[:4]), ""
        try:
            with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
                make(rng, folder)
            outcome = "read"
        except (FlexmbError, BadParameter):
            outcome = "refused"
        except SystemExit as done:
            outcome = "read" if done.code in (0, None) else "refused"
            if done.code not in (0, None, 2, 3):
                outcome = f"exit code {done.code}: {printed.getvalue()[-600:]}"
        except BaseException:  # noqa: BLE001  what must not be
            outcome = traceback.format_exc()
        spent = sum(os.times()[:4]) - started  # of the first readings too
        peak = max(0, read_peak(), *peaks) - at_rest
        bad = [
            c for c in printed.getvalue() if unicodedata.category(c)[0] == "C" and c not in "\n\t"
        ]
        if bad:
            outcome = f"control characters {bad[:3]!r} in {printed.getvalue()[-600:]!r}"
        if guard.noted and outcome in ("read", "refused"):
            outcome = f"not allowed: {guard.noted[:3]}"
        if spent > SECONDS:
            outcome = f"{spent:.1f} s of the processor"
        if peak > MEMORY:
            outcome = f"{peak / 1e6:.0f} MB"
        report.write(f"{number} {spent:.2f} {peak / 1e6:.0f} {outcome!r}\n")
        if not limited and number - begin > 3:  # what is imported late is no part of an input
            at_rest = process.memory_info().rss
            limit = process.memory_info().vms + MEMORY
            resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
            limited = True


def forget_peak() -> None:
    """The largest memory of this process is measured anew from here."""
    Path("/proc/self/clear_refs").write_text("5")


def read_peak() -> int:
    """Bytes that this process had at most since then."""
    words = Path("/proc/self/status").read_text().split("VmHWM:")[1].split()
    return int(words[0]) * 1024


class Campaign:
    """Runs the inputs of one kind and collects what is wrong."""

    def __init__(self, kind: str, folder: Path, finds: Path) -> None:
        self.kind, self.folder, self.finds = kind, folder, finds
        self.counts: collections.Counter[str] = collections.Counter()
        self.wrong: dict[str, list[int]] = {}
        self.slowest, self.largest = (0.0, 0), (0.0, 0)  # s, MB, with the number of the input

    def run(self, begin: int, end: int) -> None:
        while begin < end:
            begin = self.serve_some(begin, min(end, begin + 4000))

    def serve_some(self, begin: int, end: int) -> int:
        """Start a process; the number of the first input that it left."""
        words = [
            sys.executable,
            "-m",
            "tests.hard.fuzz",
            "--serve",
            self.kind,
            str(begin),
            str(end),
        ]
        child = subprocess.Popen(
            [*words, str(self.folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        assert child.stdout is not None and child.stderr is not None
        os.set_blocking(child.stdout.fileno(), False)
        at, since, rest = begin, 0.0, ""
        process = psutil.Process(child.pid)
        while True:
            ended = child.poll() is not None
            rest += (child.stdout.read() or b"").decode()
            *lines, rest = rest.split("\n")
            for line in lines:
                number, _, outcome = line.partition(" ")
                at = int(number)
                with contextlib.suppress(psutil.Error):
                    since = sum(process.cpu_times()[:2])
                if outcome:
                    spent, peak, outcome = outcome.split(" ", 2)
                    self.slowest = max(self.slowest, (float(spent), at))
                    self.largest = max(self.largest, (float(peak), at))
                    self.note(at, outcome)
                    at += 1
            if ended:
                if at < end:
                    why = child.stderr.read().decode(errors="replace").strip()[-300:]
                    self.note(at, repr(f"the process ended with {child.returncode}: {why}"))
                    at += 1
                return at
            with contextlib.suppress(psutil.Error):
                if sum(process.cpu_times()[:2]) - since > SECONDS + 3.0:
                    child.kill()
                    child.wait()
                    self.note(at, repr(f"more than {SECONDS:g} s of the processor"))
                    return at + 1
            time.sleep(0.1)

    def note(self, number: int, outcome: str) -> None:
        text = eval(outcome)  # noqa: S307  a repr of this program's own
        if text in ("read", "refused"):
            self.counts[text] += 1
            return
        self.counts["wrong"] += 1
        key = signature(text)
        if key not in self.wrong:
            kept = self.finds / f"{self.kind}-{number}"
            kept.mkdir(parents=True, exist_ok=True)
            (kept / "outcome.txt").write_text(text)
            for path in [*self.folder.glob("fuzz*"), *map(self.folder.joinpath, _FOLDERS)]:
                if path.is_dir():
                    with contextlib.suppress(shutil.Error):  # the next input replaces it
                        shutil.copytree(path, kept / path.name, dirs_exist_ok=True)
                elif path.is_file():
                    shutil.copy(path, kept)
        self.wrong.setdefault(key, []).append(number)


def signature(text: str) -> str:
    """What tells finds apart: the last line, and the place in flexmb."""
    lines = text.strip().splitlines()
    frames = [line.strip() for line in lines if "/flexmb/" in line and "File" in line]
    place = frames[-1].rpartition("/flexmb/")[2] if frames else ""
    last = "".join("#" if c.isdigit() else c for c in lines[-1][:90])
    return f"{last} [{place}]"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.hard.fuzz")
    parser.add_argument("kinds", nargs="*")
    parser.add_argument("--share", type=float, default=1.0, help="of the inputs of each kind")
    parser.add_argument("--begin", type=int, default=0, help="number of the first input")
    parser.add_argument("--count", type=int, help="inputs of each kind")
    parser.add_argument("--folder", type=Path, help="where to work; a new one by default")
    parser.add_argument("--serve", nargs=4, help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.serve:
        kind, begin, end, folder = words.serve
        serve(kind, int(begin), int(end), Path(folder))
        return 0
    from flexmb.folders import cache_root
    from tests.hard.hostile import KINDS
    from tests.hard.hostile_seeds import prepare

    os.nice(10)
    folder = words.folder or Path(tempfile.mkdtemp(prefix="flexmb-fuzz-"))
    if not (folder / "seeds").is_dir():
        folder.mkdir(exist_ok=True)
        prepare(folder)
    units = cache_root() / "units"  # compiled once for all
    os.environ["FLEXMB_CACHE_DIR"] = os.environ["MPLCONFIGDIR"] = str(folder / "cache")
    if units.is_dir() and not (folder / "cache").is_dir():
        shutil.copytree(units, folder / "cache" / "units")
    total, wrong, started = 0, 0, time.monotonic()
    for kind in words.kinds or KINDS:
        campaign, began = Campaign(kind, folder, folder / "finds"), time.monotonic()
        count = words.count or int(KINDS[kind][0] * words.share)
        campaign.run(words.begin, words.begin + count)
        counts = campaign.counts
        total, wrong = total + counts.total(), wrong + counts["wrong"]
        print(
            f"{kind:10} {counts.total():7} inputs: {counts['read']} read, {counts['refused']} "
            f"refused, {counts['wrong']} wrong in {time.monotonic() - began:.0f} s; at most "
            f"{campaign.slowest[0]:.1f} s ({campaign.slowest[1]}) and {campaign.largest[0]:.0f} MB "
            f"({campaign.largest[1]})", flush=True,
        )  # fmt: skip
        for key, numbers in sorted(campaign.wrong.items(), key=lambda item: -len(item[1])):
            print(f"   {len(numbers):5} x  {key}  e.g. {kind} {numbers[:3]}", flush=True)
    seconds = time.monotonic() - started
    print(f"{total} inputs, {wrong} wrong, {seconds:.0f} s; {folder}", flush=True)
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
