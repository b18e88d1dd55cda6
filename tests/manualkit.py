"""Runs the blocks of the README and of the manual's pages, and compares what they print.

The blocks of a page run in one folder, in order: ``console`` and ``sh`` blocks call ``flexmb``,
``python`` blocks run in one namespace, a ``toml`` block is written to a file where a comment names
it, else validated by the schema of scenes. Compared are the lines below each ``$`` command, and
the ``text`` block right after a ``python`` block; a line ``...`` stands for any lines.

A comment before a block, ``<!-- test: ... -->``, says more: ``varies``: numbers are not compared;
``quiet``: its output is not shown; ``slow``: runs with the slow tests only; ``none``: never runs.
``python -m tests.manualkit [--slow] [--all] [PAGES]`` writes what is printed now into the pages
where it differs, or everywhere (times, say).
"""

from __future__ import annotations

import contextlib
import functools
import io
import re
import shlex
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from typer.testing import CliRunner

from flexmb.cli import app

ROOT = Path(__file__).resolve().parents[1]
_MANUAL = ROOT / "flexmb" / "manual"
_COMMENT = re.compile(r"^<!-- (test|file): (.+) -->$")
_VARYING = ("note:", "compile", "load", "ten")  # first words of lines that a second run may lack
_NUMBER = re.compile(r"(?<![A-Za-z_])[-+<]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?%?")


@dataclass
class Block:
    """A fenced block: its language, lines, where its lines begin, and what comments say of it."""

    language: str
    lines: list[str]
    begin: int
    options: set[str] = field(default_factory=set)
    file: str = ""

    @property
    def end(self) -> int:
        return self.begin + len(self.lines)


class Printed(NamedTuple):
    """What a block printed, the lines of the page that show it, and whether numbers vary."""

    begin: int
    expected: list[str]
    actual: list[str]
    varies: bool

    @property
    def agrees(self) -> bool:
        pattern = [_tokens(part, self.varies) for part in _parts(self.expected)]
        return _matches(pattern, _tokens(self.actual, self.varies))


def pages() -> dict[str, Path]:
    """The README and the pages of the manual, by name."""
    return {
        "README": ROOT / "README.md",
        **{path.stem: path for path in sorted(_MANUAL.glob("*.md"))},
    }


def blocks(text: str) -> list[Block]:
    """The fenced blocks of a page."""
    found: list[Block] = []
    options: set[str] = set()
    file, inside = "", False
    for i, line in enumerate(text.splitlines()):
        comment = _COMMENT.match(line)
        if line.startswith("```"):
            if not inside:
                found.append(Block(line[3:].strip(), [], i + 1, options, file))
                options, file = set(), ""
            inside = not inside
        elif inside:
            found[-1].lines.append(line)
        elif comment and comment[1] == "file":
            file = comment[2]
        elif comment:
            options = set(comment[2].split())
    return found


def run_page(path: Path, folder: Path, *, slow: bool) -> Iterator[Printed]:
    """Run the blocks of a page in a folder; yields what they print.

    Blocks that are slow are left out unless `slow`. Raises an AssertionError where a block fails.
    """
    for name in ("meshes", "cases"):  # what a page may name, as in a checkout
        shutil.copytree(ROOT / name, folder / name, dirs_exist_ok=True)
    text = path.read_text(encoding="utf-8")
    namespace: dict[str, Any] = {"__name__": "__main__"}
    found = blocks(text)
    with contextlib.chdir(folder):
        for i, block in enumerate(found):
            if "none" in block.options or ("slow" in block.options and not slow):
                continue
            if block.language in ("console", "sh"):
                yield from _run_commands(block)
            elif block.language == "toml":
                _use_toml(block)
            elif block.language == "python":
                follows = found[i + 1] if i + 1 < len(found) else block
                between = text.splitlines()[block.end + 1 : follows.begin - 1]
                shown = follows.language == "text" and not "".join(between).strip()
                yield from _run_python(block, follows if shown else None, namespace)


def _run_commands(block: Block) -> Iterator[Printed]:
    """Run the commands of a block, each with the lines below it as its output."""
    lines, i = block.lines, 0
    while i < len(lines):
        command = lines[i].removeprefix("$ ")
        while command.endswith("\\"):
            i += 1
            command = command[:-1] + lines[i].strip()
        i += 1
        begin = i
        while block.language == "console" and i < len(lines) and not lines[i].startswith("$ "):
            i += 1
        printed = _call(command)
        if block.language == "console" and printed is not None and "quiet" not in block.options:
            yield Printed(block.begin + begin, lines[begin:i], printed, "varies" in block.options)


def _call(command: str) -> list[str] | None:
    """The lines that a command of flexmb prints; None of other commands, which are not run."""
    words = shlex.split(command, comments=True)
    if "&&" in words:
        parts = [part.strip() for part in command.split("&&")]
        return [_call(part) for part in parts][-1]
    if words[:2] == ["python", "-m"]:
        assert find_spec(words[2]), f"{command}: there is no such module"
    if Path(words[0]).name != "flexmb":
        return None
    done = CliRunner().invoke(app, words[1:])
    refused = done.stderr.startswith("error: ")
    assert done.exit_code == (2 if refused else 0), f"{command}\n{done.output}"
    text = done.stderr if refused else done.stdout  # else standard error has the progress
    return [line.rstrip() for line in text.rstrip().splitlines()]


@functools.cache
def _validator() -> Any:
    import jsonschema

    from flexmb.model import scene_schema

    return jsonschema.Draft4Validator(scene_schema())


def _use_toml(block: Block) -> None:
    """Write a scene to its file; hold a part of one against the schema."""
    text = "\n".join(block.lines) + "\n"
    if block.file:
        Path(block.file).write_text(text, encoding="utf-8")
        return
    for error in _validator().iter_errors(tomllib.loads(text)):
        missing = error.validator == "required" and not error.absolute_path
        assert missing, f"{text}\n{'.'.join(map(str, error.absolute_path))}: {error.message}"


def _run_python(block: Block, shown: Block | None, namespace: dict[str, Any]) -> Iterator[Printed]:
    """Run a block; yields what it prints if the page shows it."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile("\n".join(block.lines), f"block at line {block.begin}", "exec"), namespace)
    if shown is not None:
        actual = out.getvalue().rstrip().splitlines()
        yield Printed(shown.begin, shown.lines, actual, "varies" in block.options)


def _parts(lines: list[str]) -> list[list[str]]:
    """Lines split where a line ``...`` stands."""
    parts: list[list[str]] = [[]]
    for line in lines:
        if line == "...":
            parts.append([])
        else:
            parts[-1].append(line)
    return parts


def _tokens(lines: list[str], varies: bool) -> list[str]:
    """Words of lines without rules of tables; where numbers vary, without these."""
    if varies:
        lines = [line for line in lines if line.split()[:1] not in [[w] for w in _VARYING]]
        lines = [_NUMBER.sub("#", line) for line in lines]
    return [word for line in lines for word in line.split() if word.strip("─")]


def _matches(pattern: list[list[str]], words: list[str]) -> bool:
    """Whether words consist of the parts of a pattern, with any words between them."""
    first, *others = pattern
    if not others:
        return words == first
    if words[: len(first)] != first:
        return False
    at = len(first)
    for part in others[:-1]:
        at = next((i for i in range(at, len(words)) if words[i : i + len(part)] == part), -1)
        if at < 0:
            return False
        at += len(part)
    last = others[-1]
    return not last or (len(words) - at >= len(last) and words[-len(last) :] == last)


def update(path: Path, *, slow: bool, all_blocks: bool) -> int:
    """Write into a page what its blocks print now, if it differs; returns how many were written."""
    with tempfile.TemporaryDirectory() as folder:
        printed = list(run_page(path, Path(folder), slow=slow))
    lines = path.read_text(encoding="utf-8").splitlines()
    fixed = [each for each in printed if "..." not in each.expected]
    changed = [each for each in fixed if all_blocks or not each.agrees]
    for each in reversed(changed):
        lines[each.begin : each.begin + len(each.expected)] = each.actual
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return len(changed)


if __name__ == "__main__":
    arguments = set(sys.argv[1:])
    names = arguments - {"--slow", "--all"} or set(pages())
    for name, path in pages().items():
        if name in names:
            slow, all_blocks = "--slow" in arguments, "--all" in arguments
            count = update(path, slow=slow, all_blocks=all_blocks)
            print(f"{name}: {count} blocks written", flush=True)
