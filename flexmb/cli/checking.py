"""What `flexmb check` shows of a valid scene: counts, mobility, redundant equations, tables."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, is_dataclass
from typing import Any

from flexmb.cli import show

__all__ = ["as_json", "check_report"]

_DERIVED = ("count", "delta", "delta_without_drivers", "redundant", "singular")


def check_report(report: Any) -> None:
    """Counts of a scene, what can move, and what is worth noting."""
    show.heading(report.title)
    show.table(("", ""), [(name, str(n)) for name, n in report.counts.items()], right=(1,))
    for body, rows in report.bodies.items():
        show.line(f"flexible body {body}")
        show.table(("", ""), list(rows.items()))
    if report.mobility is not None:
        _mobility(report.mobility)
    for title, table in report.definition:
        show.heading(title)
        show.table(table.columns, table.rows, whole=True)
    for note in report.notes:
        show.line(f"note: {note}")
    show.line("the scene is valid")


def _mobility(found: Any) -> None:
    """Coordinates, equations, rank and what follows from them."""
    show.heading("mobility, in the assembled pose")
    modes = f", {found.modes} of them modes" if found.modes else ""
    rows = [
        ("coordinates", str(found.coordinates), f"of {_count(found.bodies, 'body')}{modes}"),
        ("equations s", str(found.count), _drivers_among(found.drivers)),
        ("their rank", str(found.rank), f"{found.redundant} redundant"),
        ("freedoms δ", str(found.delta), _without_drivers(found)),
    ]
    show.table(("", "", ""), rows, right=(1,))
    for group in found.redundancies:
        joints = ", ".join(_plain(group.joints))
        show.line(f"{_count(group.count, 'redundant equation')} among {joints}")
        for word, cure in zip(("cured by", "      or"), group.cures, strict=False):
            show.line(f"  {word}  {'; '.join(str(exchange) for exchange in cure)}")
        if not group.cures:
            show.line("  no exchange of these joints for weaker ones was found that cures it")
    doubtful: dict[str, list[str]] = {}
    for told in found.undetermined:
        doubtful.setdefault(", ".join(told.components), []).append(told.path)
    shared = [(", ".join(_plain(paths)), components) for components, paths in doubtful.items()]
    show.table(("reactions not unique at", "components, in the axes of marker J"), shared)
    motions = [("idle" if m.idle else "free", m.sentence) for m in found.motions]
    show.table(("motion", "what moves"), motions)


def _drivers_among(drivers: int) -> str:
    return f"{drivers} of them drivers'" if drivers else "no drivers"


def _without_drivers(found: Any) -> str:
    if found.drivers:
        return f"{found.delta_without_drivers} without drivers"
    return f"kinematics needs {_count(found.delta, 'driver')}" if found.delta > 0 else ""


def _plain(paths: Iterable[str]) -> list[str]:
    return [path.removeprefix("joints.") for path in paths]


def _count(n: int, thing: str) -> str:
    plural = "bodies" if thing == "body" else f"{thing}s"
    return f"{n} {thing if n == 1 else plural}"


def as_json(report: Any) -> str:
    """The whole report as JSON."""
    told = {
        "title": report.title,
        "counts": report.counts,
        "notes": list(report.notes),
        "bodies": report.bodies,
        "mobility": None if report.mobility is None else _mobility_data(report.mobility),
        "definition": {
            title: [dict(zip(table.columns, row, strict=True)) for row in table.rows]
            for title, table in report.definition
        },
    }
    return json.dumps(told, indent=1)


def _mobility_data(found: Any) -> dict[str, Any]:
    """Fields, and the counts that follow from them; cures also as sentences."""
    data = asdict(found) if is_dataclass(found) and not isinstance(found, type) else {}
    data |= {name: getattr(found, name) for name in _DERIVED}
    for told, group in zip(data["redundancies"], found.redundancies, strict=True):
        told["cured_by"] = ["; ".join(str(exchange) for exchange in cure) for cure in group.cures]
    return data
