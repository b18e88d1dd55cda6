"""Extending flexmb by a patch: how many files a new kind of something touches, and that it works.

Each ``<kind>.patch`` here is a unified diff that adds one kind (a force, a sensor, a section, an
integrator, an output format) to the package. ``test_<kind>.py`` applies it to a copy of the package
and runs a script with that copy in a new process::

    from extending import Extension

    def test_a_force_with_memory_acts(tmp_path):
        extension = Extension("force", tmp_path)
        output = extension.run("import flexmb; ...; print(result['slider.x'][-1])")
        assert float(output) == pytest.approx(...)

A name with a further word after the kind is a second example of it: ``force_hysteresis.patch``.
``test_limits.py`` counts the files that every patch names against `LIMITS`.

To write or renew a patch: edit the package, tell git of new files, let git print the difference,
and take the edits back::

    git add -N flexmb/model/forces/hysteresis.py
    git diff -U2 flexmb > tests/extending/force.patch
    git checkout flexmb && git clean -f flexmb

The old lines of a hunk must occur exactly once in the file; line numbers do not matter. So a patch
stays valid until the lines next to its insertion change: registry lines make the best neighbours.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).parent
PROJECT = HERE.parents[1]
#: Most files of the package that a new kind may touch, its own files and registry lines counted.
LIMITS = {"force": 3, "sensor": 3, "section": 2, "integrator": 2, "output_format": 2}


class Hunk(NamedTuple):
    """A piece of a file before and after."""

    file: str
    before: str
    after: str


def patches() -> list[str]:
    """Names of all patches."""
    return sorted(path.stem for path in HERE.glob("*.patch"))


def kind_of(name: str) -> str:
    """The kind of what a patch adds: the longest key of `LIMITS` that its name begins with."""
    kinds = [kind for kind in LIMITS if name == kind or name.startswith(f"{kind}_")]
    assert kinds, f"{name}.patch: its name begins with none of {', '.join(LIMITS)}"
    return max(kinds, key=len)


def hunks(name: str) -> Iterator[Hunk]:
    """The hunks of a patch (unified diff; ``a/`` and ``b/`` before the paths)."""
    file, before, after = "", list[str](), list[str]()
    for line in [*(HERE / f"{name}.patch").read_text(encoding="utf-8").splitlines(), "diff"]:
        if line.startswith(("diff", "@@", "--- ")):
            if before or after:
                yield Hunk(file, "".join(before), "".join(after))
            before, after = [], []
        elif line.startswith("+++ "):
            file = line.removeprefix("+++ ").removeprefix("b/")
        elif file and line[:1] in ("", " "):
            before.append(line[1:] + "\n")
            after.append(line[1:] + "\n")
        elif line.startswith("-"):
            before.append(line[1:] + "\n")
        elif line.startswith("+"):
            after.append(line[1:] + "\n")


def apply(name: str, folder: Path) -> list[str]:
    """Apply a patch to the copy of the project in a folder; returns the files that it names."""
    files = []
    for hunk in hunks(name):
        path = folder / hunk.file
        if not hunk.before:
            assert not path.exists(), f"{name}.patch: {hunk.file} exists already"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(hunk.after, encoding="utf-8")
        else:
            assert path.is_file(), f"{name}.patch: there is no file {hunk.file} any more"
            text = path.read_text(encoding="utf-8")
            times = text.count(hunk.before)
            what = f"{name}.patch: these lines occur {times} times in {hunk.file}, renew the patch"
            assert times == 1, f"{what}:\n{hunk.before}"
            path.write_text(text.replace(hunk.before, hunk.after), encoding="utf-8")
        files.append(hunk.file)
    assert files, f"{name}.patch: holds no change"
    return list(dict.fromkeys(files))


class Extension:
    """A copy of the package with a patch applied.

    Parameters
    ----------
    name : str
        Of the patch, without its ending.
    folder : Path
        Where the copy is made, such as pytest's ``tmp_path``.
    """

    def __init__(self, name: str, folder: Path) -> None:
        self.folder = folder / "extended"
        shutil.copytree(
            PROJECT / "flexmb", self.folder / "flexmb", ignore=shutil.ignore_patterns("__pycache__")
        )
        self.files = apply(name, self.folder)

    def run(self, code: str, *words: str | Path) -> str:
        """What a script prints that runs with the copy; `words` are its ``sys.argv[1:]``.

        The modules of tests can be imported too. Compiled units are shared with all other tests.
        """
        places = [str(self.folder), str(PROJECT / "tests")]
        done = subprocess.run(
            [sys.executable, "-c", code, *map(str, words)],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(places)},
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout
