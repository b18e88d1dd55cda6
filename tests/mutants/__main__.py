"""Which fast tests notice a wrong sign, factor or axis: ``python -m tests.mutants --help``.

Slow tests run where a mutant names them. Nothing is compiled: changes of the engine run as plain
Python, all others on units that the cache holds. One mutant at a time, in a copy of the package; it
stops at the first failure.
"""

from __future__ import annotations

import argparse
import compileall
import contextlib
import importlib
import importlib.util
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.mutants import ROOT, Mutant, all_mutants, relevant_tests, rooms

_TIME_LIMIT = 100  # s of processor time for the tests of one mutant
_COPIED = ("flexmb", "tests", "cases", "meshes")
_COMMON = ("scipy.linalg", "scipy.sparse.linalg", "scipy.spatial", "scipy.optimize", "skfem")
_COMMON += ("scipy.integrate", "meshio", "h5py", "pydantic", "tomllib")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("names", nargs="*", help="names of mutants, or beginnings of them")
    parser.add_argument("--room", action="append", choices=list(rooms()))
    parser.add_argument("--list", action="store_true", help="print them, run nothing")
    parser.add_argument("--quick", action="store_true", help="tests it names, or of its file")
    words = parser.parse_args()
    selected = [
        mutant
        for mutant in all_mutants()
        if (not words.room or mutant.room in words.room)
        and (not words.names or mutant.name.startswith(tuple(words.names)))
    ]
    if words.list:
        for mutant in selected:
            print(f"{mutant.room:12} {mutant.name:42} {mutant.file}")
        return 0
    for name in _COMMON:  # once for all mutants
        importlib.import_module(name)
    with tempfile.TemporaryDirectory(prefix="flexmb-mutants-") as folder:
        root = _copy(Path(folder))
        verdicts = {m: _show(m, *_run(m, root, words.quick)) for m in selected}
    for room in dict.fromkeys(mutant.room for mutant in selected):
        results = [caught for mutant, caught in verdicts.items() if mutant.room == room]
        print(f"{room:12} {sum(results)} of {len(results)} caught")
    print(f"{'all':12} {sum(verdicts.values())} of {len(verdicts)} caught")
    return 0 if all(caught or m.survives for m, caught in verdicts.items()) else 1


def _copy(root: Path) -> Path:
    for name in _COPIED:
        shutil.copytree(ROOT / name, root / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", root)
    compileall.compile_dir(root / "flexmb", quiet=2)
    return root


def _run(mutant: Mutant, root: Path, quick: bool) -> tuple[bool, str]:
    """Whether a test fails, and which."""
    file = root / "flexmb" / mutant.file
    text, stat = file.read_text(encoding="utf-8"), file.stat()
    bytecode = Path(importlib.util.cache_from_source(file))  # of the same length and second
    file.write_text(mutant.changed(root), encoding="utf-8")
    bytecode.unlink(missing_ok=True)
    tests = mutant.tests if quick and mutant.tests else relevant_tests(mutant, quick)
    try:
        answer = _first_failure(mutant, root, tests)
    finally:
        file.write_text(text, encoding="utf-8")
        os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
        bytecode.unlink(missing_ok=True)
    return bool(answer), answer


def _first_failure(mutant: Mutant, root: Path, tests: Iterable[str]) -> str:
    """The test that failed, or an empty string."""
    output = root / "output.txt"
    options = ["-q", "-x", "-n", "0", "-p", "no:cacheprovider", "--tb=no", f"--rootdir={root}"]
    fast = ["-m", "not slow"]
    child = os.fork()
    if child == 0:
        os.setsid()
        stream = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(stream, 1)
        os.dup2(stream, 2)
        _enter(root, mutant.file.startswith("engine/"))
        status = 0
        for path in tests:  # one by one: to collect all of them takes longer than to run the first
            marks = [] if path in mutant.tests and "::" in path else fast
            status = int(pytest.main([*options, *marks, f"tests/{path}"]))
            if status not in (0, 5):
                break
        sys.stdout.flush()
        os._exit(status)
    status = _wait(child)
    text = output.read_text(encoding="utf-8", errors="replace")
    if status in (None, 0, 5):  # tests that take too long have not noticed
        return ""
    lines = re.findall(r"^(?:FAILED|ERROR) (?:tests/)?(.*?)(?: - |$)", text, re.MULTILINE)
    return lines[0] if lines else f"pytest ends with {status}: {text[-300:]}"


def _enter(root: Path, interpreted: bool) -> None:
    """Make this process one that imports the copy, with units as plain Python if need be."""
    os.chdir(root)
    own = {"", ".", str(ROOT), str(ROOT / "tests")}
    sys.path[:] = [str(root), str(root / "tests"), *(path for path in sys.path if path not in own)]
    sys.dont_write_bytecode = True
    for name in [name for name in sys.modules if name.split(".")[0] in ("tests", "flexmb")]:
        del sys.modules[name]
    os.environ["PYTHONPATH"] = os.pathsep.join(sys.path[:2])
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    os.environ["NUMBA_DISABLE_JIT"] = str(int(interpreted))


def _wait(child: int) -> int | None:
    """How a process ends; None if it is stopped because it takes too long."""
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        with contextlib.suppress(OSError, IndexError):
            used = Path(f"/proc/{child}/stat").read_text().rsplit(")", 1)[1].split()[11:13]
            if sum(map(int, used)) > _TIME_LIMIT * os.sysconf("SC_CLK_TCK"):
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return None
        time.sleep(0.05)


def _show(mutant: Mutant, caught: bool, test: str) -> bool:
    verdict = "caught" if caught else "survived"
    clock = time.strftime("%H:%M:%S")
    print(f"{clock} {verdict:8} {mutant.name:42} {test or mutant.survives}", flush=True)
    return caught


if __name__ == "__main__":
    sys.exit(main())
