"""``flexmb list``, ``new``, ``schema``, ``help``; ``doctor`` and ``warmup``.

The words of scenes, templates, the manual; the state of this installation, compiling ahead.
"""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import MISTAKE, command, output_option
from flexmb.errors import OutputError
from flexmb.manual import Page

_WIDTH = 100  # columns of running text


@command("list")
def list_topic(
    topic: Annotated[
        str | None, typer.Argument(help="joints, forces, drivers, functions, ...")
    ] = None,
    entry: Annotated[
        str | None, typer.Argument(help="One of them: contact, spring, steel, ...")
    ] = None,
) -> None:
    """List what scenes may contain: joints, forces, materials, ...

    Without a topic: lists the topics.

    Example: flexmb list joints

    Example: flexmb list forces contact
    """
    from flexmb.workflow import listings

    if topic is None:
        rows = [(name, topic.words) for name, topic in listings.TOPICS.items()]
        screen.table(("flexmb list", "what"), rows)
        return
    listing = listings.listing(topic, entry)
    screen.heading(listing.title)
    for about, table in listing.tables:
        screen.line("")
        for row in textwrap.wrap(about, _WIDTH):
            screen.line(row)
        screen.table(table.columns, table.rows)


@command()
def new(
    name: Annotated[Path, typer.Argument(help="Folder to make.")],
    template: Annotated[
        str | None,
        typer.Option(
            "--template",
            "-t",
            help="What to start from (flexmb list templates); by default the one of that name, or "
            "the pendulum.",
        ),
    ] = None,
) -> None:
    """Write a new folder with a commented scene that runs.

    Nothing that exists is overwritten.

    Example: flexmb new my_beam --template flexible-beam
    """
    from flexmb.workflow import listings

    scene = listings.new_scene(name, template)
    screen.line(f"written: {scene}")
    screen.line(f"run it with: flexmb run {quote(str(scene))}")


@command()
def schema(
    output: Annotated[Path | None, output_option("File to write; the screen by default.")] = None,
) -> None:
    """Write the JSON schema of scenes, for editors.

    With it a TOML editor completes keys and marks mistakes as you type.

    Example: flexmb schema --output scene.schema.json
    """
    from flexmb.model import scene_schema

    text = json.dumps(scene_schema(), indent=1) + "\n"
    if output is None:
        typer.echo(text, nl=False)
        return
    try:
        output.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        why = error.strerror or error
        raise OutputError(f"{output}: cannot be written ({why})") from None
    screen.line(f"written: {output}")
    screen.line(f"name it in the first line of a scene: #:schema {output.name}")


_LINK = re.compile(r"\[([^\]]+)\]\(([\w-]+)\.md(?:#[\w-]+)?\)")
_THUMBNAIL = re.compile(r"!\[[^]]*\]\(pictures/case-[^)]*\)")  # in the table of cases
_PICTURE = re.compile(r"^!\[([^\]]*)\]\([^)]*\)$", re.MULTILINE)
_MAX_SECTIONS = 20


@command("help")
def help_pages(
    words: Annotated[
        list[str] | None, typer.Argument(help="A page, or words to search for.")
    ] = None,
    search: Annotated[
        bool, typer.Option("--search", help="Search for the words, even if a page has that name.")
    ] = False,
    html: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write the manual as HTML pages with a search."),
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

    text = _THUMBNAIL.sub("", page.text)
    text = _PICTURE.sub(r"(picture: \1)", text)
    text = _LINK.sub(lambda link: f"{link[1]} (`flexmb help {link[2]}`)", text)
    screen.console().print(Markdown(text, hyperlinks=False))


def _show_sections(words: list[str]) -> None:
    from flexmb import manual

    sections = manual.search(words)
    rows = [(section.page, section.heading, section.line) for section in sections[:_MAX_SECTIONS]]
    screen.table(("flexmb help", "section", "text"), rows)
    if len(sections) > len(rows):
        screen.line(f"and {len(sections) - len(rows)} more sections; more words find fewer")


@command()
def doctor() -> None:
    """Report what works on this machine and what to install: versions, rendering, cache, compiler.

    Ends in exit code 2 if something is missing.
    """
    from flexmb.workflow import installation

    with screen.Bars() as progress:
        state = installation.examine_installation(progress)
    screen.heading(f"flexmb {state.version}")
    screen.line(f"Python {state.python}")
    screen.line(state.system)
    rows = [(name, version or "MISSING", purpose) for name, version, purpose in state.packages]
    rows += [
        (name, version or "not installed (optional)", purpose)
        for name, version, purpose in state.optional
    ]
    screen.table(("package", "version", "for"), rows)
    screen.table(("part", "state", ""), state.parts)
    if state.missing:
        screen.line(f"missing: python -m pip install {' '.join(state.missing)}")
        raise typer.Exit(MISTAKE)


@command()
def warmup() -> None:
    """Compile ahead all that runs would compile at first.

    Takes about a minute, once per machine and version. Without it the first run of a scene compiles
    the parts that it uses. Ctrl-C keeps what is compiled already.

    Example: flexmb warmup
    """
    from flexmb.workflow import installation

    with screen.Bars() as progress:
        done = installation.warmup(progress)
    screen.line(
        f"{done.units} units, {done.compiled} of them compiled in {done.seconds:.1f} s; "
        f"{done.size / 1e6:.1f} MB in {done.cache}"
    )
