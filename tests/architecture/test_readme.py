"""The first Python example of the README runs as it stands."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

_PYTHON_BLOCK = re.compile(r"^```python\n(.*?)^```", re.DOTALL | re.MULTILINE)


def test_the_first_python_example_runs(project: Path, tmp_path: Path) -> None:
    readme = project / "README.md"
    assert readme.is_file(), "README.md is missing"
    found = _PYTHON_BLOCK.search(readme.read_text(encoding="utf-8"))
    assert found, "README.md has no ```python example"
    for folder in ("meshes", "cases"):  # what the example may name, as in a checkout
        if (project / folder).is_dir():
            shutil.copytree(project / folder, tmp_path / folder)
    example = tmp_path / "example.py"
    example.write_text(found[1], encoding="utf-8")
    done = subprocess.run(
        [sys.executable, example.name],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        pytest.fail(f"the README's example fails:\n{found[1]}\n{done.stdout}\n{done.stderr}")
