"""Names and places that are odd: each command ends with a sentence that moves no cursor."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import pytest
from hdf5edit import edit_hdf5
from resultfiles import writer
from typer.main import get_command
from typer.testing import CliRunner

from flexmb import untrusted
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
    "run": ["FILE"], "resume": ["FILE"], "inverse": ["FILE"], "check": ["FILE"],
    "check-all": ["FILE"], "compare": ["FILE", "FILE"], "reduce": ["FILE"], "stress": ["FILE"],
    "part": ["FILE"], "info": ["FILE"], "export": ["FILE"], "render": ["FILE"],
    "film": ["FILE"], "view": ["FILE"], "plot": ["FILE"], "report": ["FILE"],
    "modes": ["FILE"], "response": ["FILE", "a", "b"], "statics": ["FILE"],
    "study": ["FILE", "-v", "accuracy=1e-3"], "audit": ["FILE"],
    "sweep": ["FILE", "-v", "a=1..2"], "budget": ["FILE"],
}  # fmt: skip
OTHERS = {"list", "schema", "help", "doctor", "warmup", "new"}
"""Commands that read no file; `new` makes a folder."""


def make_loop(path: Path) -> None:
    path.symlink_to(path)


def make_zero(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_foreign(path: Path) -> None:
    """A file of another program in the same format."""
    if path.suffix == ".h5":
        with h5py.File(path, "w") as file:
            file["temperatures"] = [1.0, 2.0]
    else:
        path.write_text('[tool.poetry]\nname = "x"\n' if path.suffix == ".toml" else "solid x\n")


def make_future(path: Path) -> None:
    """A file of a later flexmb."""
    if path.suffix == ".h5":
        with writer(path):
            pass
        with edit_hdf5(path) as file:
            file.attrs["version"] = 99
    else:
        text = "[warp_drives.a]\nfactor = 9\n" if path.suffix == ".toml" else "$MeshFormat\n9 0 8\n"
        path.write_text(text)


def make_damaged(path: Path) -> None:
    """A file with a byte that has changed, or that is cut."""
    if path.suffix == ".h5":
        with writer(path):
            pass
        path.write_bytes(path.read_bytes()[:-9] + b"x" * 9)
    else:
        path.write_text("[bodies.a]\nmass = " if path.suffix == ".toml" else "$Nodes\n1 9")


FILES: dict[str, Callable[[Path], object]] = {
    "loop": make_loop, "pipe": os.mkfifo, "zero": make_zero, "folder": Path.mkdir,
    "empty": Path.touch, "bytes": lambda path: path.write_bytes(bytes(range(256))),
    "missing": lambda path: None, "foreign": make_foreign, "future": make_future,
    "damaged": make_damaged, "deep": lambda path: path.write_text("a = " + "[" * 9999),
}  # fmt: skip
NAMES = ("x" * 500, "a\x1b]0;x\x07\nb", "a\0b", os.fsdecode(b"a\xff"), "\u202eä", "-x", " ")
APPLICATION = get_command(app)


def test_no_command_is_left_out():
    assert APPLICATION.commands.keys() == {*COMMANDS} | OTHERS


@pytest.mark.parametrize("name", COMMANDS)
def test_a_file_that_is_none_ends_a_command_with_a_sentence(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(untrusted, "_first_reading", lambda *_: None)  # it would also be read apart
    for ending in (".h5", ".toml", ".msh"):
        files = [f"{odd}{ending}" for odd in NAMES]
        for kind, make in FILES.items():
            make(tmp_path / f"{kind}{ending}")
            files.append(f"{kind}{ending}")
        for file in files:
            words = [file if word == "FILE" else word for word in COMMANDS[name]]
            with pytest.raises(SystemExit) as done:
                APPLICATION.main([name, *words], prog_name="flexmb")
            said = "".join(capsys.readouterr())
            assert done.value.code == MISTAKE, (file, said)
            assert said == printable(said)


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
