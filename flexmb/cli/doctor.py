"""What works on this machine, and what to install for the rest."""

from __future__ import annotations

import typer

from flexmb.cli import show
from flexmb.cli.bars import Bars
from flexmb.cli.guard import MISTAKE


def examine() -> None:
    """Show versions, rendering, cache folder and compiler; exit code 2 if something is missing."""
    from flexmb import workflow

    with Bars() as progress:
        found = workflow.examine_installation(progress)
    show.heading(f"flexmb {found.version}")
    show.line(f"Python {found.python}")
    show.line(found.system)
    rows = [(name, installed or "MISSING", purpose) for name, installed, purpose in found.packages]
    rows += [
        (name, installed or "not installed (optional)", purpose)
        for name, installed, purpose in found.optional
    ]
    show.table(("package", "version", "for"), rows)
    show.table(("part", "state", ""), found.parts)
    if found.missing:
        show.line(f"missing: python -m pip install {' '.join(found.missing)}")
        raise typer.Exit(MISTAKE)
