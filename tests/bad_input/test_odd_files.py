"""Names and places that are odd: each command ends with a sentence that moves no cursor."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flexmb.cli import app
from flexmb.cli.app import MISTAKE
from flexmb.errors import SceneError, printable
from flexmb.folders import partial_path, temporary_folder, whole_file
from flexmb.model import quantities
from flexmb.model.quantities import read_number
from flexmb.model.reading import ReadContext
from flexmb.model.scenes.study import sweep_values
from flexmb.units import SI

pytestmark = pytest.mark.skipif(os.name == "nt", reason="names and files as POSIX has them")
DEAD = 2**22 + 1  # above the largest number of a process on Linux

COMMANDS = {
    "info": ["info", "FILE"],
    "check": ["check", "FILE"],
    "export": ["export", "FILE"],
    "resume": ["resume", "FILE"],
    "compare": ["compare", "FILE", "FILE"],
    "part": ["part", "FILE"],
    "study": ["study", "FILE"],
}
ODD = ("loop", "long", "pipe", "zero", "folder", "escape", "null", "bytes")


def odd_file(kind: str, ending: str, folder: Path) -> str:
    """The name of a file that is none."""
    path = folder / f"odd{ending}"
    if kind == "loop":
        path.symlink_to(path)
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "zero":
        path.symlink_to("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    names = {"long": "x" * 500 + ending, "escape": f"a\x1b]0;x\x07\nb{ending}",
             "null": f"a\0b{ending}", "bytes": os.fsdecode(b"a\xff") + ending}  # fmt: skip
    return names.get(kind, str(path))


@pytest.mark.parametrize("kind", ODD)
@pytest.mark.parametrize("name", COMMANDS)
def test_a_file_that_is_none_ends_a_command_with_a_sentence(name, kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for ending in (".h5", ".toml", ".msh"):
        folder = tmp_path / ending
        folder.mkdir()
        file = odd_file(kind, ending, folder)
        words = [file if word == "FILE" else word for word in COMMANDS[name]]
        done = CliRunner().invoke(app, words)
        assert done.exit_code == MISTAKE, done.output
        assert "unexpectedly" not in done.output
        assert done.output == printable(done.output)


def test_a_title_moves_no_cursor(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'title = "\\u001b]0;owned\\u0007"\n[bodies.b]\nmass = 1\ninertia = [1, 1, 1]\n'
    )
    done = CliRunner().invoke(app, ["check", str(scene)])
    assert done.exit_code == 0 and done.output == printable(done.output)


def test_a_text_of_thousands_of_words_is_no_quantity(monkeypatch):
    """Each gap could stand before a unit: looking at all that follows took 11 s for 8 kB."""
    calls = []
    monkeypatch.setattr(quantities, "parse_unit", calls.append)
    with pytest.raises(SceneError, match="longer than 2000 characters"):
        read_number("1 " * 4000, ReadContext({}, SI, Path()))
    assert not calls


@pytest.mark.parametrize("text", ["1e-5..1e308", "1..1e308", "1e308..1e-308", "1e400..1"])
def test_ranges_to_the_end_of_numbers_end(text):
    try:
        values = sweep_values(text)
    except SceneError:
        return
    assert 300 < len(values) < 700 and all(0 < value < float("inf") for value in values)


def test_what_killed_processes_left_is_removed(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    mine, folder = partial_path(tmp_path / "a.csv"), temporary_folder()
    assert mine.suffix == ".csv" and len(mine.name) < 40
    for path in (mine, folder):
        left = path.with_name(path.name.replace(f"-{os.getpid()}", f"-{DEAD}"))
        left.mkdir() if path.is_dir() else left.write_text("half")
    with whole_file(tmp_path / "a.csv") as partial:
        partial.write_text("whole")
    again = temporary_folder()
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "a.csv", folder, again])
