"""What the commands write on the screen: tables and lines on the standard output."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from flexmb.cli import summary
from flexmb.units import UnitSystem, unit_system

__all__ = [
    "checks",
    "flexible_body",
    "heading",
    "line",
    "quality",
    "result",
    "run_report",
    "table",
]

_NARROW = 100  # columns of tables where the output is a file or a pipe
_NAMES = 24  # letters of names in the first column that are not folded
_ENDLESS = 10_000  # columns that no table fills


def line(text: str) -> None:
    """One line, never wrapped or coloured: paths stay whole for copying."""
    _console().print(text, markup=False, highlight=False, soft_wrap=True)


def heading(text: str) -> None:
    """The title of what follows."""
    _console().print(text, style="bold", markup=False, highlight=False, soft_wrap=True)


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    right: Sequence[int] = (),
    *,
    whole: bool = False,
) -> None:
    """A table; the columns numbered in `right` are set flush right.

    A `whole` one is as wide as it needs to be where the output is a file or a pipe.
    """
    named = any(columns)
    shown = Table(
        box=SIMPLE_HEAD if named else None,
        show_header=named,
        pad_edge=False,
        header_style="bold",
    )
    rows = list(rows)
    short = max((len(row[0]) for row in rows), default=0) <= _NAMES
    for i, name in enumerate(columns):
        justify: Literal["left", "right"] = "right" if i in right else "left"
        keep = i == 0 and short
        shown.add_column(escape(name), justify=justify, overflow="fold", no_wrap=keep)
    for row in rows:
        shown.add_row(*(escape(cell) for cell in row))
    console = _console()
    if whole and not console.is_terminal:
        console.width = max(console.width, Console(width=_ENDLESS).measure(shown).maximum)
    if shown.row_count:
        console.print(shown)


def run_report(report: Any) -> str:
    """The summary of a run; returns how it ended."""
    from flexmb.results import Result

    run = Result(report.result)
    result(run)
    for note in report.notes:
        line(f"note: {note}")
    if report.checks:
        checks(report.checks, run.units.label("s"))
    files = [*report.flexbodies.values(), report.result, report.picture, report.history]
    heading("files")
    for path in files:
        if path is not None:
            line(f"  {path}")
    said = summary.sentence(run.statistics)
    if said:
        line(said)
    return run.status


def result(run: Any) -> None:
    """What a result holds: how it ended, statistics, times, energies, drift."""
    from flexmb.model.scenes.conversion import gravity_in_words

    heading(run.title or str(run.path))
    rows = len(run.time)
    unit = run.units.label("s")
    span = f", {rows} rows to t = {run.time[-1]:g} {unit}" if rows else ", no rows"
    line(f"{run.status}{span}" + (f": {run.message}" if run.message else ""))
    line(gravity_in_words(run.model.get("gravity"), run.units))
    if run.status == "running":
        line("note: the run is still going on, or it was killed; what is here is whole")
        line(f"if it was killed, resume with: flexmb resume {run.path.parent}")
    table(("the run", "", ""), summary.work(run.statistics, run.units), right=(1,))
    table(("wall time by phase", "s", ""), summary.costs(run.statistics), right=(1,))
    if rows:
        _energies(run)
    if run.reactions_not_unique:
        line(f"reactions not unique at: {', '.join(run.reactions_not_unique)}")
    if rows and "largest_position_drift" not in run.statistics:
        position, velocity = run.drift.max(axis=0)
        line(f"largest constraint drift: position {position:.2g}, velocity {velocity:.2g}")


def flexible_body(body: Any) -> None:
    """Mass, centre, inertia, interfaces and modes of a flexible body, in the mesh's units."""
    from flexmb.flexbody import MODE_COLUMNS, mode_table

    heading(f"flexible body {body.name}")
    J = body.inertia_about_center
    units = unit_system(body.provenance.get("units", "SI"))
    rows = [
        ("mass", units.say(body.mass, "kg")),
        ("centre of mass", _vector(body.center, "m", units)),
        ("inertia about it xx, yy, zz", _vector(J.diagonal(), "kg m^2", units)),
        ("inertia about it xy, xz, yz", _vector(J[[0, 0, 1], [1, 2, 2]], "kg m^2", units)),
        ("modal coordinates", str(body.m)),
        ("damping", "none" if not body.D.any() else "modal"),
    ]
    places = {i.name: _vector(i.position, "m", units) for i in body.interfaces}
    rows += [(f"interface {name}", f"at {place}") for name, place in places.items()]
    rows += [("stress", _stress(body))]
    if body.section_forces is not None:
        rows += [("section forces", f"of {len(body.section_forces.elements)} beam elements")]
    rows += [
        (f"load {load.name}", f"{_vector(load.force, 'N', units)}, work on the modes in the file")
        for load in body.loads
    ]
    table(("", ""), rows)
    if body.modes:
        table(MODE_COLUMNS, mode_table(body), right=(0, 2))


def quality(report: Any) -> None:
    """The tables of a quality report."""
    from flexmb.fe.reduction.quality_report import report_tables

    for part in report_tables(report):
        heading(part.title)
        table(part.columns, part.rows, right=range(1, len(part.columns)), whole=True)
        if part.note:
            line(part.note)


def checks(outcomes: Sequence[Any], unit: str) -> None:
    """Known answers of a scene beside what came out; the time of each if any has one."""
    timed = any(o.time is not None for o in outcomes)
    rows = [
        (
            "ok" if o.passed else "FAILED",
            o.sensor,
            *(("" if o.time is None else f"{o.time:g}",) if timed else ()),
            f"{o.value:.12g}",
            f"{o.expected:.12g}",
            f"{abs(o.value - o.expected):.2g}",
            f"{o.tolerance:.2g}",
        )
        for o in outcomes
    ]
    when = (f"t [{unit}]",) if timed else ()
    columns = ("check", "of", *when, "value", "expected", "off by", "allowed")
    table(columns, rows, right=range(2, len(columns)), whole=True)
    for o in outcomes:
        if not o.passed:
            line(f"failed: {o.place(unit)}; the expected value is from: {o.source}")


def _energies(run: Any) -> None:
    """Energies and works that are not zero all along, and what is left of their balance."""
    balance = {"stored less works, change": run.balance} if run.has_columns("balance") else {}
    rows = [
        (name.replace("_", " "), _energy(values[-1]), _energy(values.min()), _energy(values.max()))
        for name, values in {**run.energy, **balance}.items()
        if values.any()
    ]
    if rows:
        label = f"energy [{run.units.label('J')}]"
        table((label, "at the end", "least", "greatest"), rows, right=(1, 2, 3))


def _energy(value: float) -> str:
    return f"{value:.6g}"


def _stress(body: Any) -> str:
    """Where a body tells its stress."""
    if body.stress is None:
        return "none"
    nodes = len(set(body.stress.ids.tolist()))
    inside = "" if body.nodes is None else f" of {len(body.nodes.ids)}"
    return f"at {nodes}{inside} nodes, in the layers {', '.join(body.stress.layers)}"


def _vector(values: Any, unit: str, units: UnitSystem) -> str:
    """Components of an SI vector; those that are round-off or below 1e-15 are shown as 0."""
    noise = max(1e-12 * max(abs(float(v)) for v in values), 1e-15)
    kept = (float(v) if abs(v) > noise else 0.0 for v in values)
    shown = ", ".join(f"{units.outward(v, unit):.6g}" for v in kept)
    return f"({shown}) {units.label(unit, raised=True)}"


def _console() -> Console:
    console = Console()
    return console if console.is_terminal else Console(width=_NARROW)
