"""A few hundred of the hostile inputs of `python -m tests.hard.fuzz`."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from random import Random

import pytest

from flexmb.errors import FlexmbError
from tests.hard.hostile import KINDS
from tests.hard.hostile_seeds import PROJECT


@pytest.mark.parametrize("kind", ["expression", "words", "section", "table", "unit"])
@pytest.mark.filterwarnings("ignore")
def test_hostile_inputs_end_in_a_sentence(kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cases").symlink_to(PROJECT / "cases")
    import typer

    for number in range(60):
        with contextlib.suppress(FlexmbError, typer.BadParameter):
            KINDS[kind][1](Random(f"{kind} {number}"), tmp_path)
    assert not (tmp_path / "owned").exists()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits and forks as Linux has them")
def test_hostile_inputs_of_every_kind_do_no_harm(tmp_path):
    command = [sys.executable, "-m", "tests.hard.fuzz", "--share", "0.01", "--folder", tmp_path]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
