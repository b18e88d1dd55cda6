"""``flexmb part``: one body of a scene by itself, with supports and loads."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from flexmb.cli import screen
from flexmb.cli.app import FAILED_CHECK, NoPicture, Overrides, Scene, command, parse_pairs
from flexmb.cli.stress import ROUNDING
from flexmb.units import UnitSystem, unit_system

_UNITS = {  # by the first letter of a component
    "section force": {"N": "N", "V": "N", "T": "N m", "M": "N m"},
    "shell force": {"N": "N/m", "M": "N", "Q": "N/m"},
}


@command()
def part(
    scene: Scene,
    overrides: Overrides = None,
    no_picture: NoPicture = False,
    vtu: Annotated[
        bool, typer.Option("--vtu", help="Write the fields for ParaView too: <body>.part.vtu.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder to write to; out/<scene> by default."),
    ] = None,
) -> None:
    """Solve one body of a scene by itself: static solution, frequencies, buckling.

    The section [part] says what holds and loads it. Prints displacements, reactions, stresses and
    frequencies, checks the scene's known answers, and leaves <body>.part.h5 and its pictures.

    Example: flexmb part cases/supported_plate/scene.toml --set part.buckling=3
    """
    from flexmb import workflow

    with screen.Bars() as progress:
        report = workflow.run_part(
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
        from flexmb.results import write_vtu

        screen.line(f"written: {write_vtu(report.result, report.path.with_suffix('.vtu'))}")
    for picture in report.pictures:
        screen.line(f"written: {picture}")
    if report.checks:
        screen.known_answers(report.checks, "s")
    if any(not outcome.passed for outcome in report.checks):
        raise typer.Exit(FAILED_CHECK)


def show_part(result: Any, units: UnitSystem) -> None:
    """Show displacements, reactions, stresses, frequencies and load factors of a part."""
    from flexmb.flexbody import STATIC

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
        screen.line(
            "moments of supports about their own points, of loads about the centre of mass; "
            f"out of balance by {result.imbalance:.1e} of the largest"
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
    from flexmb.flexbody import SECTION_FORCES, SHELL_FORCES

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
