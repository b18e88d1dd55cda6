"""``flexmb help``: the pages of the manual on the screen, a search through them, a site of HTML."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import command
from flexmb.manual import Page

_LINK = re.compile(r"\[([^\]]+)\]\(([\w-]+)\.md(?:#[\w-]+)?\)")
_PICTURE = re.compile(r"^!\[([^\]]*)\]\([^)]*\)$", re.MULTILINE)
_MAX_SECTIONS = 20


@command("help")
def help_pages(
    words: Annotated[
        list[str] | None,
        typer.Argument(help="A page, or words to search for.", show_default=False),
    ] = None,
    search: Annotated[
        bool, typer.Option("--search", help="Search for the words, even if a page has that name.")
    ] = False,
    html: Annotated[
        Path | None,
        typer.Option(
            "--html", metavar="FOLDER", help="Write the manual as HTML pages with a search."
        ),
    ] = None,
) -> None:
    """Show the manual: its pages, one page, or the sections that hold some words.

    Example: flexmb help contact
    """
    from flexmb import manual

    if html is not None:
        screen.line(f"written: {manual.write_site(html)}")
    elif not words:
        rows = [(page.name, page.summary) for page in manual.pages()]
        screen.table(("flexmb help", "what"), rows)
        screen.line("flexmb help WORDS searches all pages, flexmb help --html FOLDER writes a site")
    elif not search and "-".join(words).lower() in manual.PAGES:
        _show_page(manual.page("-".join(words).lower()))
    else:
        _show_sections(words)


def _show_page(page: Page) -> None:
    from rich.markdown import Markdown

    text = _PICTURE.sub(r"(picture: \1)", page.text)
    text = _LINK.sub(lambda link: f"{link[1]} (`flexmb help {link[2]}`)", text)
    screen.console().print(Markdown(text, hyperlinks=False))


def _show_sections(words: list[str]) -> None:
    from flexmb import manual

    sections = manual.search(words)
    rows = [(section.page, section.heading, section.line) for section in sections[:_MAX_SECTIONS]]
    screen.table(("flexmb help", "section", "text"), rows)
    if len(sections) > len(rows):
        screen.line(f"and {len(sections) - len(rows)} more sections; more words find fewer")
