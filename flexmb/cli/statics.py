"""``flexmb statics``: the equilibria of a scene, and one of them over a parameter or time."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer

from flexmb.cli import screen
from flexmb.cli.app import Overrides, Scene, command, parse_names, parse_pairs, refuse_options
from flexmb.cli.modes import parse_values

_ROUND_OFF = 1e-12  # of the largest value of an equilibrium
_SHOWN = 6  # channels in the table of the screen


@command()
def statics(
    scene: Scene,
    vary: Annotated[
        str | None,
        typer.Option(
            "--vary",
            "-v",
            metavar="NAME=VALUES",
            help="A parameter, an entry by its path, or time, with values 0,10,20 or 0..100:11 "
            "(eleven at equal distances).",
            show_default=False,
        ),
    ] = None,
    channels: Annotated[
        str | None,
        typer.Option(
            help="Channels of sensors that are shown and drawn, with commas.", show_default=False
        ),
    ] = None,
    starts: Annotated[
        int, typer.Option(help="Without --vary: poses from which equilibria are sought.", min=1)
    ] = 30,
    overrides: Overrides = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="With --vary: plot (.png, .pdf, .svg).", show_default=False
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option("--table", help="With --vary: all channels (.csv).", show_default=False),
    ] = None,
) -> None:
    """Show the equilibria of a scene at rest, or follow one over a parameter or time.

    Without --vary: those that are reached from many poses, stable or not. With it: each from the
    one before, its stability, limit points, and values from which there is no equilibrium.

    `flexmb run --analysis statics` leaves a result file and a picture of one.

    Example: flexmb statics scene.toml --vary load=0..100:21 -o sweep.svg
    """
    from flexmb import workflow
    from flexmb.view.plot import writable_file

    changes = parse_pairs(overrides, "--set")
    if vary is None:
        refuse_options({"output": output, "table": table}, "shows what --vary computes")
        with screen.Bars() as progress:
            equilibria = workflow.equilibria(
                scene, starts=starts, overrides=changes, progress=progress
            )
        _show_equilibria(equilibria, parse_names(channels))
        return
    if output is not None:
        writable_file(output, (".png", ".pdf", ".svg"))
    if table is not None:
        writable_file(table, (".csv",))
    [(name, text)] = parse_pairs([vary], "--vary").items()
    with screen.Bars() as progress:
        sweep = workflow.sweep_statics(
            scene, name, parse_values(text, "--vary"), overrides=changes, progress=progress
        )
    _show_sweep(sweep, parse_names(channels))
    if table is not None:
        screen.line(f"written: {sweep.to_csv(table)}")
    if output is not None:
        from flexmb.view import save_figure
        from flexmb.view.mode_plots import equilibria_figure

        figure = equilibria_figure(sweep, parse_names(channels))
        screen.line(f"written: {save_figure(figure, output)}")


def _show_equilibria(equilibria: Any, channels: list[str]) -> None:
    unit = equilibria[0].model.units
    names = channels or list(equilibria[0].compiled.layout.channels)[:_SHOWN]
    rows = []
    for k, one in enumerate(equilibria):
        growth, stable = one.growth()
        values = one.channels(names)
        values[abs(values) < _ROUND_OFF * abs(values).max(initial=0.0)] = 0.0
        energy = unit.outward(one.energy, "J")
        rows.append((str(k + 1), _stability(growth, stable), f"{energy:.6g}",
                     *(f"{value:.6g}" for value in values)))  # fmt: skip
    columns = ("equilibrium", "stable", f"energy [{unit.label('J')}]", *names)
    screen.table(columns, rows, right=range(2, len(columns)), whole=True)
    for k, one in enumerate(equilibria):
        growth, stable = one.growth()
        if not stable:
            screen.line(f"{k + 1} is unstable: a disturbance grows by a factor of e in "
                        f"{1.0 / growth:.3g} s")  # fmt: skip


def _show_sweep(sweep: Any, channels: list[str]) -> None:
    names = channels or [name for name in sweep.names if sweep[name].any()][:_SHOWN]
    units = [sweep.units[sweep.names.index(name)] for name in names if sweep[name] is not None]
    rows = [
        (f"{p.value:.6g}", _stability(p.growth, p.stable),
         *(f"{sweep[name][k]:.6g}" for name in names))
        for k, p in enumerate(sweep.points)
    ]  # fmt: skip
    shown = (f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=True))
    screen.table((sweep.parameter, "stable", *shown), rows, right=range(2, 2 + len(names)),
                 whole=True)  # fmt: skip
    for event in sweep.events:
        screen.line(event.sentence)


def _stability(growth: float, stable: bool) -> str:
    return "?" if isnan(growth) else "yes" if stable else "no"
