"""What the commands do: call the library with bars, then show what came out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from flexmb.cli import show, words
from flexmb.cli.bars import Bars
from flexmb.cli.guard import FAILED_CHECK, INTERRUPTED

__all__ = ["check_scene", "reduce_mesh", "render_result", "run_scene", "show_run"]


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
        show.line(f"resume with: flexmb resume {report.output}")
        raise typer.Exit(INTERRUPTED)
    if any(not outcome.passed for outcome in report.checks):
        raise typer.Exit(FAILED_CHECK)


def reduce_mesh(
    mesh: Path,
    material: str,
    interfaces: list[str],
    sections: list[str],
    options: dict[str, Any],
    output: Path | None,
) -> None:
    """Reduce a mesh and show the body."""
    from flexmb import workflow

    with Bars() as progress:
        body, path = workflow.reduce_mesh(
            mesh,
            material=words.word_or_table(material, "--material"),
            interfaces=words.pairs(interfaces, "--interface"),
            sections=words.tables(sections, "--section"),
            output=output,
            progress=progress,
            **options,
        )
    show.flexible_body(body)
    show.line(f"written: {path}")


def render_result(
    path: Path, time: float | None, look: dict[str, str | None], output: Path | None
) -> None:
    """Draw a picture and say where it is."""
    exaggeration = words.exaggeration(look["exaggeration"])
    direction, size = words.direction(look["direction"]), words.size(look["size"])
    from flexmb.results import Result
    from flexmb.view import backend, render

    result = Result(path)
    with Bars() as progress:
        progress("picture", 0.0)
        file = render(
            result,
            time,
            exaggeration=exaggeration,
            color=look["color"] or "displacement",
            direction=direction,
            size=size,
            output=output or result.path.parent / "picture.png",
        )
        progress("picture", 1.0)
    verdict = backend.probe()
    if not verdict.works:
        show.line(f"note: {verdict.how}; a simple picture was drawn instead. {verdict.advice}")
    show.line(f"written: {file}")


def check_scene(scene: Path, overrides: list[str]) -> None:
    """Validate a scene and show its counts."""
    from flexmb import workflow

    show.check_report(workflow.check_scene(scene, words.pairs(overrides, "--set")))
