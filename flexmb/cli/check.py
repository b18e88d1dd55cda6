"""``flexmb check``: counts of a scene, its mobility, tables; known answers; ``flexmb compare``."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    FAILED_CHECK,
    Overrides,
    Scene,
    command,
    output_option,
    parse_names,
    parse_pairs,
)

_DERIVED = ("count", "delta", "delta_without_drivers", "redundant", "singular")


@command()
def check(
    scene: Scene,
    overrides: Overrides = None,
    tables: Annotated[
        bool, typer.Option("--tables", help="Show the tables that define the model.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write the report as JSON.")] = False,
) -> None:
    """Validate a scene, count what is in it and what can move, without running it.

    Reports all mistakes at once: where, what was given, what is allowed, and the nearest name. Of a
    valid scene it shows coordinates, constraint equations, their rank and the degrees of freedom;
    which joints share redundant equations and the exchange of joints that removes them; which
    reactions are then not unique; and the motions that are left free.

    Example: flexmb check cases/slider_crank/scene.toml --tables
    """
    from flexmb.workflow import check

    report = check.check_scene(scene, parse_pairs(overrides, "--set"), tables=tables)
    if as_json:
        screen.line(_report_json(report))
    else:
        show_check(report)


def show_check(report: Any) -> None:
    """Show the counts of a scene, its mobility, tables and notes."""
    screen.heading(report.title)
    screen.table(("", ""), [(name, str(n)) for name, n in report.counts.items()], right=(1,))
    for body, rows in report.bodies.items():
        screen.line(f"flexible body {body}")
        screen.table(("", ""), list(rows.items()))
    if report.mobility is not None:
        _show_mobility(report.mobility)
    for title, table in report.definition:
        screen.heading(title)
        screen.table(table.columns, table.rows, whole=True)
    for note in report.notes:
        screen.line(f"note: {note}")
    screen.line("the scene is valid")


def _show_mobility(mobility: Any) -> None:
    screen.heading("mobility, in the assembled pose")
    modes = f", {mobility.modes} of them modes" if mobility.modes else ""
    drivers = f"{mobility.drivers} of them drivers'" if mobility.drivers else "no drivers"
    freedom = f"kinematics needs {_count(mobility.delta, 'driver')}" if mobility.delta > 0 else ""
    if mobility.drivers:
        freedom = f"{mobility.delta_without_drivers} without drivers"
    rows = [
        ("coordinates", str(mobility.coordinates), f"of {_count(mobility.bodies, 'body')}{modes}"),
        ("constraint equations", str(mobility.count), drivers),
        ("their rank", str(mobility.rank), f"{mobility.redundant} redundant"),
        ("degrees of freedom", str(mobility.delta), freedom),
    ]
    screen.table(("", "", ""), rows, right=(1,))
    for group in mobility.redundancies:
        joints = ", ".join(_joint_names(group.joints))
        screen.line(f"{_count(group.count, 'redundant equation')} among {joints}")
        for word, cure in zip(("cured by", "      or"), group.cures, strict=False):
            screen.line(f"  {word}  {'; '.join(str(exchange) for exchange in cure)}")
        if not group.cures:
            screen.line("  no exchange of these joints for weaker ones was found that cures it")
    shared: dict[str, list[str]] = {}  # joints by components
    for reaction in mobility.undetermined:
        shared.setdefault(", ".join(reaction.components), []).append(reaction.path)
    reactions = [(", ".join(_joint_names(paths)), text) for text, paths in shared.items()]
    screen.table(("reactions not unique at", "components, in the axes of marker J"), reactions)
    motions = [("idle" if m.idle else "free", m.sentence) for m in mobility.motions]
    screen.table(("motion", "what moves"), motions)


def _joint_names(paths: Iterable[str]) -> list[str]:
    return [path.removeprefix("joints.") for path in paths]


def _count(n: int, thing: str) -> str:
    plural = "bodies" if thing == "body" else f"{thing}s"
    return f"{n} {thing if n == 1 else plural}"


def _report_json(report: Any) -> str:
    """The report as JSON; the mobility with the counts that follow from it, cures as sentences."""
    mobility = None
    if report.mobility is not None:
        mobility = asdict(report.mobility)
        mobility |= {name: getattr(report.mobility, name) for name in _DERIVED}
        groups = zip(mobility["redundancies"], report.mobility.redundancies, strict=True)
        for data, group in groups:
            data["cured_by"] = ["; ".join(str(item) for item in cure) for cure in group.cures]
    data = {
        "title": report.title,
        "counts": report.counts,
        "notes": list(report.notes),
        "bodies": report.bodies,
        "mobility": mobility,
        "definition": {
            title: [dict(zip(table.columns, row, strict=True)) for row in table.rows]
            for title, table in report.definition
        },
    }
    return json.dumps(data, indent=1)


@command("check-all")
def check_all(
    folder: Annotated[Path, typer.Argument(help="Folder of scenes, with its subfolders.")],
    output: Annotated[Path, output_option("Folder for everything that is written.")] = Path(
        "out/check-all"
    ),
    workers: Annotated[int, typer.Option(help="Scenes that are run at the same time.")] = 2,
) -> None:
    """Run all scenes of a folder and compare them with their known answers ([[check]]).

    Draws no pictures. Ends with exit code 3 if a check failed or a run did not finish.

    Example: flexmb check-all cases
    """
    from flexmb.workflow import check_all

    with screen.Bars() as progress:
        scenes = check_all.check_all(folder, output=output, workers=workers, progress=progress)
    rows = []
    for scene in scenes:
        path = scene.scene.relative_to(folder) if folder.is_dir() else Path(scene.scene.name)
        name = path.with_suffix("").as_posix().removesuffix("/scene")
        for o in scene.outcomes:
            place = o.place(scene.time_unit)
            rows.append((name, screen.verdict(o), place, *screen.outcome_figures(o)))
        if scene.failure or not scene.outcomes:
            what = "the run failed" if scene.failure else "no [[check]]"
            rows.append((name, "FAILED" if scene.failure else "", what, "", "", "", ""))
    columns = ("scene", "check", "of", *screen.OUTCOME_FIGURES)
    screen.table(columns, rows, right=range(3, len(columns)), whole=True)
    for scene in scenes:
        if scene.failure:
            screen.line(f"failed: {scene.scene}: {scene.failure}")
        screen.failed_outcomes(scene.outcomes, scene.time_unit, f"{scene.scene}: ")
    outcomes = [o for scene in scenes for o in scene.outcomes]
    passed = sum(o.passed for o in outcomes)
    runs = sum(bool(scene.failure) for scene in scenes)
    text = f"{_count(len(scenes), 'scene')}: {passed} of {_count(len(outcomes), 'check')} passed"
    screen.line(text + (f", {_count(runs, 'run')} failed" if runs else ""))
    if not all(scene.passed for scene in scenes):
        raise typer.Exit(FAILED_CHECK)


@command()
def compare(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="Scene files (TOML), results or their folders; the first is what the others are "
            "compared with."
        ),
    ],
    channels: Annotated[
        str | None,
        typer.Option(help="What is compared, with commas; the sensors that all have by default."),
    ] = None,
    overrides: Overrides = None,
    output: Annotated[
        Path | None,
        output_option("Overlaid plot of the channels that differ most (.png, .pdf, .svg)."),
    ] = None,
    folder: Annotated[Path, typer.Option(help="Folder for the results of scenes.")] = Path(
        "out/compare"
    ),
    within: Annotated[
        float | None,
        typer.Option(
            help="Largest difference over the peak-to-peak that is allowed; more ends in exit "
            "code 3."
        ),
    ] = None,
) -> None:
    """Compare several models of one object: counts, sensors, times, a plot.

    Scenes are run; results are taken as they are. Differences are those from the first model, of
    the sensors that all have.

    Example: flexmb compare cases/quick_return/scene.toml cases/quick_return/pin_in_slot.toml
    """
    from flexmb.view.plot import writable_file
    from flexmb.workflow import comparison
    from flexmb.workflow.comparison import STILL

    if output is not None:
        writable_file(output, (".png", ".pdf", ".svg"))
    with screen.Bars() as progress:
        made = comparison.compare(
            *sources, channels=parse_names(channels), output=folder,
            overrides=parse_pairs(overrides, "--set"), progress=progress,
        )  # fmt: skip
    _show_counts(made.models)
    unit = made.models[0].result.units.label("s")
    shown = [d for d in made.differences if d.moves or d.relative > STILL]
    rows = [
        (d.channel, d.model, f"{d.largest:.2g} {d.unit}".rstrip(), f"{d.relative:.1e}",
         f"{d.time:.6g}")
        for d in shown
    ]  # fmt: skip
    columns = ("sensor", "model", "largest difference", "over peak-to-peak", f"at t [{unit}]")
    screen.table(columns, rows, right=(2, 3, 4), whole=True)
    moving = {d.channel for d in shown}
    still = [name for name in made.channels if name not in moving]
    if still:
        screen.line(f"still in all models: {', '.join(still)}")
    for note in made.notes:
        screen.line(f"note: {note}")
    screen.line(f"largest difference from {made.models[0].name}: {made.largest:.1e} of the "
                "peak-to-peak of a sensor")  # fmt: skip
    if output is not None:
        made.plot(*parse_names(channels), output=output)
        screen.line(f"written: {output}")
    if within is not None and made.largest > within:
        screen.line(f"more than the {within:g} that --within allows")
        raise typer.Exit(FAILED_CHECK)


def _show_counts(models: Any) -> None:
    rows = []
    for one in models:
        m = one.mobility
        counts: tuple[str, ...] = ("?",) * 6
        if m is not None:
            equations = m.count - m.drivers
            redundant = equations - m.joint_rank
            figures = (
                m.coordinates,
                m.modes,
                equations,
                redundant,
                m.delta_without_drivers,
                m.drivers,
            )
            counts = tuple(str(n) for n in figures)
        times = (f"{s:.3g}" if isfinite(s) else "" for s in (one.seconds, one.cpu_seconds))
        rows.append((one.name, str(len(one.result.layout.bodies)), *counts, *times))
    columns = ("model", "bodies", "coordinates", "of modes", "equations", "redundant", "freedom",
               "driven", "analysis [s]", "CPU, whole run [s]")  # fmt: skip
    screen.table(columns, rows, right=range(1, 10), whole=True)
