"""``flexmb plot``: mistakes on the command line, each with one sentence and no file."""

from __future__ import annotations

from pathlib import Path

import pytest
import slidercrank
from typer.testing import CliRunner

from flexmb.cli import app


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return slidercrank.make(tmp_path_factory.mktemp("run")).parent


def plot(*words: str | Path) -> tuple[int, str]:
    done = CliRunner().invoke(app, ["plot", *map(str, words)])
    return done.exit_code, done.output


@pytest.mark.seconds
def test_it_draws_into_a_file_that_it_replaces_only_by_force(folder: Path, tmp_path) -> None:
    file = tmp_path / "a.svg"
    assert plot(folder, "slider.x", "-o", file) == (0, f"written: {file}\n")
    before = file.read_bytes()
    code, said = plot(folder, "slider.y", "-o", file)
    assert code == 2 and "exists; give --force" in said and file.read_bytes() == before
    assert plot(folder, "slider.y", "-o", file, "--force")[0] == 0
    assert file.read_bytes() != before


@pytest.mark.seconds
def test_every_kind_is_drawn(folder: Path, tmp_path) -> None:
    for kind, name in {
        "campbell": "slider.x", "hodograph": "slider", "energy": "", "modes": "",
    }.items():  # fmt: skip
        file = tmp_path / f"{kind}.svg"
        names = [name] if name else []
        code, said = plot(folder, *names, "--kind", kind, "-o", file)
        assert code == 0 and file.stat().st_size > 1000, said


def test_the_list_has_everything_with_units(folder: Path) -> None:
    code, said = plot(folder, "--list")
    assert code == 0
    for line in ("slider.{x, y, z} [m]", "energy.{", "rod.big_end.velocity.{x, y, z} [m/s]"):
        assert line in said
    assert plot(folder, "slider.?", "--list")[1].splitlines() == [
        "slider.x [m]", "slider.y [m]", "slider.z [m]",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["slidr.x"], "nearest: slider.x"),
        (["slider.x", "--kind", "histry"], "nearest: history"),
        (["slider.x", "--times", "5..6"], "which covers 0 to 0.08 s"),
        (["slider.x", "--times", "2..1"], "must begin before they end, 2 s to 1 s do not"),
        (["slider.x", "--log"], "--log belongs to"),
        (["--kind", "hodograph"], "needs the name of a channel"),
        (["slider.x", "--kind", "energy", "--against", "slider.y"], "--against belongs to"),
        (["rod.big_end.velocty.x"], "nearest: rod.big_end.velocity.x"),
        (["rod.von_mises"], "holds no stress"),
    ],
)
def test_a_mistake_is_one_sentence_and_no_file(folder: Path, tmp_path, words, said) -> None:
    file = tmp_path / "p.png"
    code, message = plot(folder, *words, "-o", file)
    assert code == 2 and said in " ".join(message.split()) and not file.exists()
    assert "Traceback" not in message


def test_a_file_of_another_kind_and_a_missing_result_are_refused(folder: Path, tmp_path) -> None:
    assert "must end in .png" in plot(folder, "slider.x", "-o", tmp_path / "a.doc")[1]
    code, said = plot("nothing", "slider.x")
    assert code == 2 and "there is no such result" in said


def test_a_channel_that_one_of_two_results_lacks_is_told(folder: Path, tmp_path) -> None:
    other = tmp_path / "other"
    slidercrank.make(other)
    code, said = plot(folder, other, "slider.x", "-o", tmp_path / "a.png")
    assert code == 0 and "has no" not in said
