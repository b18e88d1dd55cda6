"""The blocks of the README and of the manual's pages run, and print what the pages show."""

from __future__ import annotations

from difflib import unified_diff
from pathlib import Path

import pytest
from manualkit import blocks, pages, run_page

PAGES = pages()
LONG = {"README", "audit", "first-machine", "flexible-bodies", "pictures", "reduction", "results",
        "scenes", "statics"}  # fmt: skip
"""Pages whose blocks take seconds."""
SLOW = [
    name
    for name, path in PAGES.items()
    if any("slow" in block.options for block in blocks(path.read_text(encoding="utf-8")))
]


def _check(name: str, folder: Path, slow: bool) -> None:
    wrong = [
        "\n".join(unified_diff(printed.expected, printed.actual, "shown", "printed", lineterm=""))
        for printed in run_page(PAGES[name], folder, slow=slow)
        if not printed.agrees
    ]
    cure = (
        f"python -m tests.manualkit {'--slow ' * slow}{name} writes into the page what is printed"
    )
    assert not wrong, "\n".join([cure, *wrong])


@pytest.mark.parametrize(
    "name", [pytest.param(k, marks=pytest.mark.seconds) if k in LONG else k for k in PAGES]
)
def test_the_blocks_of_a_page_run_and_print_what_it_shows(name: str, tmp_path: Path) -> None:
    _check(name, tmp_path, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_its_slow_blocks_do_so_too(name: str, tmp_path: Path) -> None:
    _check(name, tmp_path, slow=True)


@pytest.mark.parametrize("name", PAGES)
def test_a_block_of_commands_says_what_they_are(name: str) -> None:
    for block in blocks(PAGES[name].read_text(encoding="utf-8")):
        assert block.language in ("console", "sh", "toml", "python", "text"), block.lines[:1]
        if block.language == "console":
            assert block.lines[0].startswith("$ ")
