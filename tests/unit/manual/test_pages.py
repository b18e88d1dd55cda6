"""The pages of the manual: complete, linked, searchable, shown by the command line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from flexmb import manual
from flexmb.cli import app
from flexmb.errors import FlexmbError
from flexmb.manual.pages import FOLDER

ROOMS = (
    "analysis|cases|cli|engine|fe|flexbody|manual|meshes|model|results|studies|templates|tests|view"
    "|workflow"
)
PATH = re.compile(rf"`((?:{ROOMS})/[\w/.-]*)`")
LINK = re.compile(r"\]\(([^)\s]+)\)")


def call(*words: str) -> Any:
    return CliRunner().invoke(app, list(words))


def test_every_file_is_a_page_of_the_list() -> None:
    assert {path.stem for path in FOLDER.glob("*.md")} == set(manual.PAGES)


@pytest.mark.parametrize("name", manual.PAGES)
def test_a_page_has_a_title_a_sentence_and_links_that_lead_somewhere(name: str) -> None:
    page = manual.page(name)
    assert page.text.startswith(f"# {page.title}\n")
    assert page.summary.endswith(".") and len(page.summary) <= 120
    assert "<!--" not in page.text
    for target in LINK.findall(re.sub(r"```.*?```", "", page.text, flags=re.DOTALL)):
        if not target.startswith("http"):
            assert (FOLDER / target.partition("#")[0]).is_file(), target


def test_the_readme_is_short_and_its_links_lead_somewhere(project: Path) -> None:
    text = (project / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 250
    targets = [target for target in LINK.findall(text) if not target.startswith("http")]
    assert len(targets) > 20
    assert [target for target in targets if not (project / target).exists()] == []


def test_files_that_pages_name_exist(project: Path) -> None:
    texts = [manual.page(name).text for name in manual.PAGES]
    texts.append((project / "README.md").read_text(encoding="utf-8"))
    named = {path for text in texts for path in PATH.findall(text)}
    assert len(named) > 30
    homes = (project, project / "flexmb")
    assert {path for path in named if not any((home / path).exists() for home in homes)} == set()


def test_tables_are_filled_from_the_descriptions_of_the_model() -> None:
    text = manual.page("forces").text
    assert "**bushing**" in text and "`free_length`" in text.replace(
        "free\\_length", "`free_length`"
    )
    assert "| rotational\\_stiffness | number" in text


def test_help_lists_and_shows_pages() -> None:
    shown = call("help").stdout
    assert all(name in shown for name in manual.PAGES)
    contact = call("help", "contact").stdout
    assert "restitution" in contact and "<!--" not in contact and "](" not in contact
    assert call("help", "flexible", "bodies").stdout == call("help", "flexible-bodies").stdout


@pytest.mark.slow
def test_words_that_are_no_page_are_searched_for() -> None:
    hits = manual.search(["hertz", "contact"])
    assert hits[0].page == "contact"
    shown = call("help", "Hertz").stdout
    assert "contact" in shown and "Hertz" in shown
    assert call("help", "--search", "contact").stdout.count("contact") > 3


def test_words_that_nothing_holds_are_told_with_the_nearest_names() -> None:
    wrong = call("help", "contct")
    assert wrong.exit_code == 2
    assert "nearest: contact" in wrong.stderr
    with pytest.raises(FlexmbError, match="nearest: joints"):
        manual.page("joint")


@pytest.mark.slow
def test_a_site_of_html_pages_needs_no_network(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs", reason='needs pip install ".[manual]"')
    done = call("help", "--html", str(tmp_path / "site"))
    assert done.exit_code == 0, done.output
    for name in manual.PAGES:
        html = (tmp_path / "site" / f"{name}.html").read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|link|img)\b[^>]*(?:src|href)=\"?([^\">\s]+)", html)
        assert not [address for address in loaded if "//" in address], name
    assert "var sections = [" in (tmp_path / "site/search/main.js").read_text(encoding="utf-8")
    again = call("help", "--html", str(tmp_path / "site"))
    assert again.exit_code == 0, again.output
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").write_text("x", encoding="utf-8")
    assert "holds other files" in call("help", "--html", str(tmp_path / "other")).stderr


def test_without_mkdocs_the_cure_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mkdocs.commands.build", None)
    wrong = call("help", "--html", str(tmp_path / "site"))
    assert wrong.exit_code == 2
    assert 'pip install "flexmb[manual]"' in wrong.stderr
