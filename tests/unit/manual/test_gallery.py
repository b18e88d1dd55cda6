"""The index of cases is what its command makes, and its thumbnails are small."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

from flexmb.manual.pages import FOLDER


@pytest.fixture
def gallery(project: Path) -> dict[str, Any]:
    return runpy.run_path(str(project / "cases" / "gallery.py"))


def test_the_index_is_up_to_date(gallery: dict[str, Any]) -> None:
    page = (FOLDER / "cases.md").read_text(encoding="utf-8")
    assert gallery["index"]() == page, "run: python cases/gallery.py"


def test_every_case_has_a_small_thumbnail(gallery: dict[str, Any], project: Path) -> None:
    cases = {path.parent.name for path in (project / "cases").glob("*/scene.toml")}
    thumbnails = {
        path.stem.removeprefix("case-"): path.stat().st_size
        for path in (FOLDER / "pictures").glob("case-*.png")
    }
    assert thumbnails.keys() == cases
    assert sum(thumbnails.values()) < 500_000
    assert max(thumbnails.values()) < 20_000
