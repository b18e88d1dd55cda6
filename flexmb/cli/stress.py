"""``flexmb stress``: stress of a stored result, without running it again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from flexmb.cli import screen
from flexmb.cli.app import RunFile, command, parse_names, parse_numbers
from flexmb.errors import FlexmbError, OutputError

ROUNDING = 1e-6  # of the largest component of the same unit: less is rounding


@command()
def stress(
    result: RunFile,
    body: Annotated[
        str | None, typer.Option(help="A flexible body; all of them by default.")
    ] = None,
    time: Annotated[
        float | None,
        typer.Option(help="At this time, in the scene's units; over the whole run by default."),
    ] = None,
    nodes: Annotated[
        str | None,
        typer.Option(
            "--nodes",
            "--node",
            metavar="NUMBERS",
            help="Histories at these mesh nodes: 7, 1..6 or 1,3,5, or hot for the hot spots; they "
            "need --output.",
            show_default=False,
        ),
    ] = None,
    layer: Annotated[
        str | None, typer.Option(help="Layer such as top; all by default.", show_default=False)
    ] = None,
    count: Annotated[int, typer.Option("--hot-spots", help="How many hot spots.", min=1)] = 5,
    distance: Annotated[
        float | None,
        typer.Option(
            help="Between hot spots, in the scene's units; a twentieth of the body by default."
        ),
    ] = None,
    mode_acceleration: Annotated[
        bool,
        typer.Option(
            "--mode-acceleration",
            help="Add the static response to the body's own acceleration that its modes lack.",
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace what exists.")] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="A .csv or .h5 file: the envelope over the run at all places, with --time all "
            "places at that time, with --nodes histories, such as for durability.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Show hot spots and extreme section forces of a run, or write stresses; nothing is run again.

    Example: flexmb stress out/slider_crank --nodes hot --output rod.h5
    """
    from flexmb.results import Result, export_stress

    run = Result(result)
    names = [body] if body is not None else list(run.flexbodies)
    if not names:
        raise FlexmbError(f"{run.path}: the run has no flexible body")
    if nodes is not None and output is None:
        raise FlexmbError("--nodes writes histories: give --output, a .csv or .h5 file")
    if output is not None and output.is_file() and not force:
        raise OutputError(f"{output}: exists; --force replaces it")
    if output is not None and len(names) > 1:
        raise FlexmbError(f"--output is of one body: give --body, one of {', '.join(names)}")
    words: dict[str, Any] = {"layer": layer, "mode_acceleration": mode_acceleration}
    for name in names:
        if run.flexbody(name).stress is None and body is None:
            screen.line(f'{name}: no stress in its file; reduce the mesh with stress = "surface"')
            continue
        spots = run.hot_spots(name, count, distance=distance, **words) if time is None else []
        _show(run, name, time, spots, words)
        if output is None:
            continue
        numbers = None
        if nodes is not None:
            hot = parse_names(nodes) == ["hot"]
            numbers = [s.node for s in spots] if hot else parse_numbers(nodes, "--nodes")
        written = export_stress(run, output, name, time=time, nodes=numbers, **words)
        screen.line(f"written: {written}")


def _show(run: Any, name: str, time: float | None, spots: list[Any], words: dict[str, Any]) -> None:
    units, flexbody = run.units, run.flexbody(name)
    pressure, second = units.label("Pa"), units.label("s")
    when = "over the run" if time is None else f"at t = {time:g} {second}"
    also = ", with mode acceleration" if words["mode_acceleration"] else ""
    screen.heading(f"stress of {name} {when}{also}")
    if time is None:
        rows = [
            (str(k + 1), f"{s.value:.6g}", f"{s.time:.6g}", str(s.node), s.layer, s.part,
             ", ".join(f"{x:.4g}" for x in s.position))
            for k, s in enumerate(spots)
        ]  # fmt: skip
        columns = ("hot spot", f"von Mises [{pressure}]", f"t [{second}]", "node", "layer",
                   "section", f"at [{units.label('m')}]")  # fmt: skip
        screen.table(columns, rows, right=(0, 1, 2, 3))
    else:
        one = run.von_mises(name, time, **words)
        k = int(one.values.argmax())
        screen.line(
            f"largest von Mises stress {one.values[k]:.6g} {pressure} at node {one.node[k]}, "
            f"{one.layer[k]}"
        )
    correction = {"mode_acceleration": words["mode_acceleration"]}
    if flexbody.section_forces is not None:
        forces = run.section_forces(name, time, **correction)
        values = np.concatenate([forces.force, forces.moment], axis=-1)
        _extremes(run, time, values, "section force", ("N",) * 3 + ("N m",) * 3)
    if flexbody.shell_forces is not None:
        shells = run.shell_forces(name, time, **correction)
        kinds = ("N/m",) * 3 + ("N",) * 3 + ("N/m",) * 2
        _extremes(run, time, shells.values, "shell force", kinds, shells.node)


def _extremes(
    run: Any, time: float | None, values: Any, noun: str, kinds: tuple[str, ...], nodes: Any = None
) -> None:
    """The value of largest magnitude of each component, where and when."""
    from flexmb.flexbody import SECTION_FORCES, SHELL_FORCES

    names = SECTION_FORCES if nodes is None else SHELL_FORCES
    values = values[None] if time is not None else values
    largest = np.abs(values).reshape(-1, len(names)).max(axis=0)
    rows = []
    for c, (name, kind) in enumerate(zip(names, kinds, strict=True)):
        at = np.unravel_index(np.abs(values[..., c]).argmax(), values.shape[:-1])
        place = f"element {at[1]}, end {at[2] + 1}" if nodes is None else f"node {nodes[at[1]]}"
        moment = run.time[at[0]] if time is None else time
        alike = max(size for size, other in zip(largest, kinds, strict=True) if other == kind)
        number = values[(*at, c)] if largest[c] > ROUNDING * alike else 0.0
        value = f"{number:.6g} {run.units.label(kind)}"
        where = (f"{moment:.6g}", place) if number else ("", "")
        rows.append((f"{noun} {name}", value, *where))
    screen.table(("extreme", "value", f"t [{run.units.label('s')}]", "where"), rows, right=(1, 2))
