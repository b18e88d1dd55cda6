"""A quality report as tables and as text.

In: a :class:`flexmb.fe.QualityReport`. Out: tables of short texts, for the command line, a page or
plain text.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.fe.checks.quality import QualityReport
from flexmb.fe.reduction.basis import DIRECTIONS
from flexmb.flexbody.arrays import FloatArray

__all__ = ["ReportTable", "report_tables", "report_text"]

_NOTHING = 1e-12  # of a share: rounding
_MAC = 12  # rows and columns of the MAC table that are shown
_INERTIA = ("mass kg", "x m", "y m", "z m", "Jxx", "Jyy", "Jzz", "Jxy", "Jyz", "Jzx")


@dataclass(frozen=True)
class ReportTable:
    """A table: title, columns, rows of texts, and a sentence on how to read it."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def report_tables(report: QualityReport) -> tuple[ReportTable, ...]:
    """The tables of a report, most important first."""
    found = [_verdict(report), _frequencies(report), _mac(report)]
    if report.effective is not None:
        found.append(_effective(report))
    found += [_shares(report), _static(report), _inertia(report), _phases(report)]
    return tuple(table for table in found if table.rows)


def report_text(report: QualityReport) -> str:
    """All tables as plain text."""
    return "\n\n".join(_text(table) for table in report_tables(report)) + "\n"


def _verdict(report: QualityReport) -> ReportTable:
    rows = [("modal coordinates", str(report.coordinates))]
    check = report.frequencies
    if len(check.full):
        worst = int(np.argmax(np.nan_to_num(np.abs(check.error), nan=np.inf)))
        rows += [
            ("frequencies compared up to", f"{check.full[-1]:.5g} Hz"),
            ("largest frequency error", f"{check.error[worst]:.2e} in mode {worst + 1}"),
            ("least MAC with its partner", f"{check.likeness.min():.4f}"),
        ]
    if report.effective is not None:
        rows.append(("effective interface mass", f"{report.effective.interface.sum():.4f} of 1"))
    if report.static.interfaces is not None:
        rows.append(("error of interface compliance", f"{report.static.interfaces:.1e}"))
    missing = report.static.missing[np.isfinite(report.static.missing)]
    if len(missing):
        rows.append(("largest share of compliance missing", _share(missing.max())))
    rows.append(("mass matrix against integrals", f"{report.inertia.error:.1e}"))
    return ReportTable("In short", ("what", "value"), tuple(rows))


def _frequencies(report: QualityReport) -> ReportTable:
    check = report.frequencies
    rows = tuple(
        (str(k + 1), f"{f:.6g}", f"{check.reduced[j]:.6g}", f"{e:+.2e}", f"{alike:.4f}")
        if j >= 0
        else (str(k + 1), f"{f:.6g}", "none", "", "")
        for k, (f, j, e, alike) in enumerate(
            zip(check.full, check.partner, check.error, check.likeness, strict=True)
        )
    )
    columns = ("mode", "full Hz", "reduced Hz", "error", "MAC")
    note = "Free body, interfaces tied as in the reduction; each mode with its most alike."
    return ReportTable("Frequencies against the full model", columns, rows, note)


def _mac(report: QualityReport) -> ReportTable:
    mac = report.frequencies.mac[:_MAC, :_MAC]
    columns = ("full \\ reduced", *(str(j + 1) for j in range(mac.shape[1])))
    rows = tuple(
        (str(k + 1), *("." if v < 0.005 else f"{v:.2f}" for v in row)) for k, row in enumerate(mac)
    )
    note = f"Share of kinetic energy in common; the first {_MAC} modes, a point is below 0.005."
    return ReportTable("Modal assurance criterion", columns, rows, note)


def _effective(report: QualityReport) -> ReportTable:
    found = report.effective
    assert found is not None
    axes = DIRECTIONS if found.share.shape[1] == 6 else ("1", "2", "3")
    rows = [
        (label, f"{f:.6g}", *(_share(v) for v in row), _share(part))
        for label, f, row, part in zip(
            found.labels, found.frequency, found.share, found.interface, strict=True
        )
    ]
    total = found.share.sum(axis=0)
    rows.append(("all kept", "", *(_share(v) for v in total), _share(found.interface.sum())))
    note = (
        "Effective mass over the body's own as all interfaces move together, and share in the "
        "effective interface mass, of which all modes together have 1."
    )
    columns = ("mode", "Hz", *axes, "interface")
    return ReportTable("Effective masses", columns, tuple(rows), note)


def _shares(report: QualityReport) -> ReportTable:
    shares = report.shares
    columns = ("coordinate", "Hz", "kinetic x", "y", "z")
    columns += shares.kinds
    both = np.concatenate([shares.direction, shares.strain], axis=1)
    rows = tuple(
        (str(j), f"{f:.6g}", *(_share(v) for v in row))
        for j, (f, row) in enumerate(zip(report.frequencies.reduced, both, strict=True))
    )
    note = (
        "Kinetic energy by direction; strain energy, and kinetic as well, by kind of column of the "
        "basis."
    )
    return ReportTable("Energy shares", columns, rows, note)


def _static(report: QualityReport) -> ReportTable:
    static = report.static
    rows = []
    if static.interfaces is not None:
        rows.append(("interfaces, loads without resultant", f"error {static.interfaces:.1e}"))
    rows += [
        (label, _share(value) if np.isfinite(value) else "does not deform the free body")
        for label, value in zip(static.labels, static.missing, strict=True)
    ]
    note = "Share of each load's own compliance that the modes lack; the free body, relieved."
    return ReportTable("Static compliance", ("load", "missing"), tuple(rows), note)


def _inertia(report: QualityReport) -> ReportTable:
    check = report.inertia
    rows = tuple(
        (name, f"{a:.9g}", f"{b:.9g}")
        for name, a, b in zip(_INERTIA, check.matrix, check.integrals, strict=True)
    )
    note = "Inertia about the centre of mass, kg m^2."
    return ReportTable("Mass and inertia", ("", "mass matrix", "integrals"), rows, note)


def _phases(report: QualityReport) -> ReportTable:
    rows = tuple(
        (p.name, f"{p.wall:.2f}", f"{p.cpu:.2f}", f"{p.peak / 2**30:.2f}" if p.peak else "-")
        for p in report.phases
    )
    columns = ("phase", "wall s", "processor s", "peak GiB")
    note = "Peak memory of the process until the phase ended."
    return ReportTable("Time and memory", columns, rows, note)


def _share(value: float | FloatArray) -> str:
    """A share with four digits; rounding about zero and one is told as such."""
    number = float(value)
    if abs(number) < _NOTHING:
        return "0"
    return f"{number:.1e}" if 0 < abs(number) < 5e-5 else f"{number:.4f}"


def _text(table: ReportTable) -> str:
    widths = [
        max(len(row[k]) for row in (table.columns, *table.rows)) for k in range(len(table.columns))
    ]
    lines = [table.title]
    for row in (table.columns, *table.rows):
        first = row[0].ljust(widths[0])
        rest = (cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))
        lines.append("  ".join(["", first, *rest]).rstrip())
    if table.note:
        lines.append(f"  {table.note}")
    return "\n".join(lines)
