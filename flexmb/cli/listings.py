"""``flexmb list``, ``new`` and ``schema``: what a scene may contain, templates, editors."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli import screen
from flexmb.cli.app import command
from flexmb.errors import OutputError

_WIDTH = 100  # columns of running text


@command("list")
def list_topic(
    topic: Annotated[
        str | None,
        typer.Argument(help="joints, forces, drivers, functions, ...", show_default=False),
    ] = None,
) -> None:
    """List what scenes may contain: joints, forces, materials, ...

    Without a topic: lists the topics.

    Example: flexmb list joints
    """
    from flexmb import workflow

    if topic is None:
        rows = [(name, topic.words) for name, topic in workflow.TOPICS.items()]
        screen.table(("flexmb list", "what"), rows)
        return
    listing = workflow.listing(topic)
    screen.heading(listing.title)
    for about, table in listing.tables:
        screen.line("")
        for row in textwrap.wrap(about, _WIDTH):
            screen.line(row)
        screen.table(table.columns, table.rows)


@command()
def new(
    name: Annotated[Path, typer.Argument(help="Folder to make.", show_default=False)],
    template: Annotated[
        str | None,
        typer.Option(
            "--template",
            "-t",
            help="What to start from (flexmb list templates); the pendulum by default.",
        ),
    ] = None,
) -> None:
    """Write a new folder with a commented scene that runs.

    Nothing that exists is overwritten.

    Example: flexmb new my_beam --template flexible-beam
    """
    from flexmb import workflow

    scene = workflow.new_scene(name, template)
    screen.line(f"written: {scene}")
    screen.line(f"run it with: flexmb run {scene}")


@command()
def schema(
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File to write; the screen by default."),
    ] = None,
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
