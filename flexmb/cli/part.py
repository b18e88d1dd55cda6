"""``flexmb part``: one body of a scene by itself; ``flexmb stress``: stress of a stored result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from flexmb.cli import screen
from flexmb.cli.app import (
    FAILED_CHECK,
    NoPicture,
    Overrides,
    RunFile,
    Scene,
    command,
    output_option,
    parse_names,
    parse_numbers,
    parse_pairs,
)
from flexmb.errors import FlexmbError, OutputError
from flexmb.units import UnitSystem, unit_system

_ROUND_OFF = 1e-11  # forces of supports and loads out of balance, over the largest
_UNITS = {  # by the first letter of a component
    "section force": {"N": "N", "V": "N", "T": "N m", "M": "N m"},
    "shell force": {"N": "N/m", "M": "N", "Q": "N/m"},
}


ROUNDING = 1e-6  # of the largest component of the same unit: less is rounding


@command()
def part(
    scene: Scene,
    overrides: Overrides = None,
    no_picture: NoPicture = False,
    vtu: Annotated[
        bool, typer.Option("--vtu", help="Write the fields for ParaView too: <body>.part.vtu.")
    ] = False,
    output: Annotated[
        Path | None, output_option("Folder to write to; out/<scene> by default.")
    ] = None,
) -> None:
    """Solve one body of a scene by itself: static solution, frequencies, buckling.

    The section [part] says what holds and loads it. Prints displacements, reactions, stresses and
    frequencies, checks the scene's known answers, and leaves <body>.part.h5 and its pictures.

    Example: flexmb part cases/supported_plate/scene.toml --set part.buckling=3
    """
    from flexmb.workflow import part_analysis

    with screen.Bars() as progress:
        report = part_analysis.run_part(
            scene,
            output=output,
            overrides=parse_pairs(overrides, "--set"),
            pictures=not no_picture,
            progress=progress,
        )
    show_part(report.result, unit_system(report.units))
    for note in report.notes:
        screen.line(f"note: {note}")
    screen.line(f"written: {report.path}")
    if vtu:
        from flexmb.results.export import write_vtu

        screen.line(f"written: {write_vtu(report.result, report.path.with_suffix('.vtu'))}")
    for picture in report.pictures:
        screen.line(f"written: {picture}")
    if report.checks:
        screen.known_answers(report.checks, "s")
    if any(not outcome.passed for outcome in report.checks):
        raise typer.Exit(FAILED_CHECK)


def show_part(result: Any, units: UnitSystem) -> None:
    """Show displacements, reactions, stresses, frequencies and load factors of a part."""
    from flexmb.flexbody.part_result import STATIC

    screen.heading(f"part {result.name}")
    rows = [("mass", units.say(result.mass, "kg"))]
    if STATIC in result.fields:
        rows += _static_rows(result, units)
    screen.table(("", ""), rows)
    if result.supports or result.loads:
        columns = ("on the part", "", units.label("N", raised=True), f"moment {units.label('N m')}")
        parts = [("load", one) for one in result.loads]
        parts += [("support", one) for one in result.supports]
        both = [(np.abs(one.force).max(), np.abs(one.moment).max()) for _, one in parts]
        size = float(np.ptp(result.nodes.position, axis=0).max())
        largest = np.max(both, axis=0)
        largest[1] = max(largest[1], 1e-3 * size * largest[0])
        lines = [
            (
                one.name,
                kind,
                units.components(one.force, "N", largest[0]),
                units.components(one.moment, "N m", 1e3 * largest[1]),
            )
            for kind, one in parts
        ]
        screen.table((columns[0], columns[1], f"force {columns[2]}", columns[3]), lines)
        balance = "in balance but for round-off"
        if result.imbalance > _ROUND_OFF:
            balance = f"out of balance by {result.imbalance:.1e} of the largest"
        screen.line(
            "moments of supports about their own points, of loads about the centre of mass; "
            + balance
        )
    if len(result.frequencies):
        shares = 100.0 * result.effective_mass / result.mass
        modes = [
            (str(k), f"{units.outward(f, 'Hz'):.6g}", *(f"{share:.2f}" for share in row))
            for k, f, row in zip(result.numbers, result.frequencies, shares, strict=True)
        ]
        names = ("mode", f"f [{units.label('Hz')}]", "mass x [%]", "y [%]", "z [%]")
        screen.table(names, modes, right=range(5))
    if len(result.load_factors):
        factors = [(str(k + 1), f"{factor:.6g}") for k, factor in enumerate(result.load_factors)]
        screen.table(("buckling", "factor on the loads"), factors, right=(0, 1))


def _static_rows(result: Any, units: UnitSystem) -> list[tuple[str, str]]:
    from flexmb.flexbody.stress_modes import SECTION_FORCES, SHELL_FORCES

    u = result.displacements()
    size = np.linalg.norm(u, axis=1)
    k = int(size.argmax())
    at = f"at node {result.nodes.ids[k]}, ({units.components(result.nodes.position[k], 'm')})"
    rows = [("largest displacement", f"{units.say(size[k], 'm')} {at}")]
    if result.stress is not None:
        for title, values, pick in (
            ("largest von Mises stress", result.von_mises(), np.argmax),
            ("largest principal stress", result.principal()[:, 0], np.argmax),
            ("least principal stress", result.principal()[:, 2], np.argmin),
        ):
            k = int(pick(values))
            layer = result.stress.layers[result.stress.layer[k]]
            at = f"at node {result.stress.ids[k]}, {layer}"
            rows.append((title, f"{units.say(values[k], 'Pa')} {at}"))
    for noun, names, part in (
        ("section force", SECTION_FORCES, result.section_forces),
        ("shell force", SHELL_FORCES, result.shell_forces),
    ):
        if part is None:
            continue
        forces = part.at(result.column())
        largest = np.abs(forces).reshape(-1, len(names)).max(axis=0)
        kinds = [_UNITS[noun][name[0]] for name in names]
        for c, (name, kind) in enumerate(zip(names, kinds, strict=True)):
            index = np.unravel_index(np.abs(forces[..., c]).argmax(), forces.shape[:-1])
            alike = max(x for x, other in zip(largest, kinds, strict=True) if other == kind)
            value = forces[(*index, c)] if largest[c] > ROUNDING * alike else 0.0
            at = f"at node {part.ids[index[0]]}" if len(index) == 1 else (
                f"in element {index[0]}, end {index[1] + 1}"
            )  # fmt: skip
            rows.append(
                (f"extreme {noun} {name}", f"{units.say(value, kind)} {at if value else ''}")
            )
    return rows


@command()
def stress(
    result: RunFile,
    body: Annotated[
        str | None, typer.Option(help="A flexible body; all of them by default.")
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="At this time, 0.013 in the scene's units or '13 ms'; over the whole run by "
            "default.",
        ),
    ] = None,
    nodes: Annotated[
        str | None,
        typer.Option(
            "--nodes",
            "--node",
            metavar="NUMBERS",
            help="Histories at these mesh nodes: 7, 1..6 or 1,3,5, or hot for the hot spots; they "
            "need --output.",
        ),
    ] = None,
    layer: Annotated[str | None, typer.Option(help="Layer such as top; all by default.")] = None,
    count: Annotated[int, typer.Option("--hot-spots", help="How many hot spots.", min=1)] = 5,
    distance: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTH",
            help="Between hot spots, 0.005 in the scene's units or '5 mm'; a twentieth of the body "
            "by default.",
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
        output_option(
            "A .csv or .h5 file: the envelope over the run at all places, with --time all "
            "places at that time, with --nodes histories, such as for durability."
        ),
    ] = None,
) -> None:
    """Show hot spots and extreme section forces of a run, or write stresses; nothing is run again.

    Example: flexmb stress out/slider_crank --nodes hot --output rod.h5
    """
    from flexmb.model.scenes.parameters import read_quantity
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
    moment = None if time is None else read_quantity(run.model, time, "time", "s")
    gap = None if distance is None else read_quantity(run.model, distance, "distance", "m")
    words: dict[str, Any] = {"layer": layer, "mode_acceleration": mode_acceleration}
    for name in names:
        if run.flexbody(name).stress is None and body is None:
            screen.line(f'{name}: no stress in its file; reduce the mesh with stress = "surface"')
            continue
        spots = run.hot_spots(name, count, distance=gap, **words) if moment is None else []
        _show(run, name, moment, spots, words)
        if output is None:
            continue
        numbers = None
        if nodes is not None:
            hot = parse_names(nodes) == ["hot"]
            numbers = [s.node for s in spots] if hot else parse_numbers(nodes, "--nodes")
        written = export_stress(run, output, name, time=moment, nodes=numbers, **words)
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
    from flexmb.flexbody.stress_modes import SECTION_FORCES, SHELL_FORCES

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
