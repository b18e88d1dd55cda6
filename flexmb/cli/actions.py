"""What the commands do: call the library with bars, then show what came out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from flexmb.cli import show, words
from flexmb.cli.bars import Bars
from flexmb.cli.guard import FAILED_CHECK, INTERRUPTED

__all__ = ["check_scene", "run_scene", "show_run"]


def run_scene(
    scene: Path, output: Path | None, overrides: list[str], options: dict[str, Any]
) -> None:
    """Run a scene and show its summary."""
    from flexmb import workflow

    changes = words.pairs(overrides, "--set")
    with Bars() as progress:
        report = workflow.run_scene(
            scene,
            output=output,
            overrides=changes,
            progress=progress,
            **options,
        )
    show_run(report)


def show_run(report: Any) -> None:
    """Show the summary of a run, and end in the exit code that it deserves."""
    status = show.run_report(report)
    if status == "stopped":
        if report.resumable:
            show.line(f"resume with: flexmb resume {report.output}")
        raise typer.Exit(INTERRUPTED)
    if any(not outcome.passed for outcome in report.checks):
        raise typer.Exit(FAILED_CHECK)


def check_scene(scene: Path, overrides: list[str], tables: bool, as_json: bool) -> None:
    """Validate a scene and show its counts and what can move."""
    from flexmb import workflow
    from flexmb.cli import checking

    report = workflow.check_scene(scene, words.pairs(overrides, "--set"), tables=tables)
    if as_json:
        show.line(checking.as_json(report))
    else:
        checking.check_report(report)
