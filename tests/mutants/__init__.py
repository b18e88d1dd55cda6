"""One-line changes of physics that a fast test must notice: a file of them for each room.

``python -m tests.mutants`` makes each change in a copy of the package and runs its tests.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]


@dataclass(frozen=True)
class Mutant:
    """A text that stands once in a file of the package, and what stands there instead.

    `tests` are tried first, then those of its file; `survives` says why none can notice.
    """

    room: str
    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...] = ()
    survives: str = ""

    def changed(self, root: Path = ROOT) -> str:
        """The file with the change; ValueError unless the text stands there exactly once."""
        text = (root / "flexmb" / self.file).read_text(encoding="utf-8")
        if (count := text.count(self.old)) != 1 or self.old == self.new:
            raise ValueError(f"{self.name}: {self.file} holds it {count} times: {self.old}")
        return text.replace(self.old, self.new)


@cache
def rooms() -> dict[str, dict]:
    """Tables of `tests/mutants/*.toml` by room."""
    files = sorted(FOLDER.glob("*.toml"))
    return {file.stem: tomllib.loads(file.read_text(encoding="utf-8")) for file in files}


def all_mutants() -> list[Mutant]:
    return [
        Mutant(room, name, **{**words, "tests": tuple(words.get("tests", ()))})
        for room, table in rooms().items()
        for name, words in table.items()
        if name != "tests"
    ]


def relevant_tests(mutant: Mutant, quick: bool = False) -> tuple[str, ...]:
    """Files and folders of tests: those it names, of its file, and unless `quick` of its room."""
    by_file = rooms()[mutant.room]["tests"]
    paths = (*mutant.tests, *by_file.get(mutant.file, ()), *(() if quick else by_file["*"]))
    return tuple(dict.fromkeys(paths))
