"""Commands to begin with: what there is, a new scene, a schema for editors, compiling ahead."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import Annotated

import typer

from flexmb.cli import show
from flexmb.cli.app import app
from flexmb.cli.bars import Bars
from flexmb.cli.guard import guarded

__all__ = ["list_topic", "new", "schema", "warmup"]

_WIDTH = 100  # columns of running text


@app.command("list")
@guarded
def list_topic(
    topic: Annotated[
        str | None,
        typer.Argument(help="joints, forces, drivers, functions, ...", show_default=False),
    ] = None,
) -> None:
    """List what scenes may use: joints, forces, materials, ...

    Without a topic: says what can be listed.

    Example: flexmb list joints
    """
    from flexmb import workflow

    if topic is None:
        rows = [(name, about) for name, (about, _) in workflow.TOPICS.items()]
        show.table(("flexmb list", "what"), rows)
        return
    listing = workflow.listing(topic)
    show.heading(listing.title)
    for about, table in listing.tables:
        show.line("")
        for row in textwrap.wrap(about, _WIDTH):
            show.line(row)
        show.table(table.columns, table.rows)


@app.command()
@guarded
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
    show.line(f"written: {scene}")
    show.line(f"run it with: flexmb run {scene}")


@app.command()
@guarded
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
    from flexmb.errors import OutputError
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
    show.line(f"written: {output}")
    show.line(f"name it in the first line of a scene: #:schema {output.name}")


@app.command()
@guarded
def warmup() -> None:
    """Compile ahead all that runs would compile at first.

    Takes about a minute, once per machine and version. Without it the first run of a scene compiles
    the parts that it uses. Ctrl-C keeps what is compiled already.

    Example: flexmb warmup
    """
    from flexmb import workflow

    with Bars() as progress:
        done = workflow.warmup(progress)
    show.line(
        f"{done.units} units, {done.compiled} of them compiled in {done.seconds:.1f} s; "
        f"{done.size / 1e6:.1f} MB in {done.cache}"
    )
