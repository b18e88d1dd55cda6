"""Quality report of a reduced body: all comparisons with the full model, as numbers and tables.

:func:`quality_report` returns frequencies and modal assurance criterion, effective masses, energy
shares, static compliance, mass and inertia, time and memory. The full model is factorised and
solved again for it, which takes about as long as the reduction did.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.component_modes import free_count, free_modes_of
from flexmb.fe.reduction.eigenmodes import SymmetryPlane
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.fe.reduction.free_body import lowest_free, relieved_inverse
from flexmb.fe.reduction.inertia_relief import InertiaRelief
from flexmb.fe.reduction.missing_response import inertia_response
from flexmb.fe.reduction.quality import (
    EffectiveMass,
    EnergyShares,
    FrequencyCheck,
    StaticCheck,
    compare_modes,
    effective_masses,
    energy_shares,
    interface_error,
    missing_compliance,
    unit_loads,
)
from flexmb.fe.reduction.reduced_basis import DIRECTIONS, ReducedBasis, ReducedModes
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody
from flexmb.progress import Phase, Progress, Stopwatch, silent


@dataclass(frozen=True, eq=False)
class InertiaCheck:
    """Rigid data from the mass matrix, R^T M R, and from the integrals of the body.

    Parameters
    ----------
    matrix, integrals : (10,) float
        Mass [kg], centre of mass [m], moments xx, yy, zz and xy, yz, zx of inertia about it
        [kg m^2].
    error : float
        Largest difference of the two (6, 6) mass matrices, entries over the geometric mean of
        their diagonal ones.
    """

    matrix: FloatArray
    integrals: FloatArray
    error: float


@dataclass(frozen=True, eq=False)
class QualityReport:
    """The result of :func:`quality_report`; formatted tables by
    :func:`flexmb.fe.reduction.quality_report.report_tables`.

    Parameters
    ----------
    coordinates : int
        Modal coordinates of the body.
    frequencies : FrequencyCheck
        Comparison with the full model.
    effective : EffectiveMass or None
        Effective masses of the fixed-interface modes; None if the basis has none.
    shares : EnergyShares
        Energy shares of the modal coordinates.
    static : StaticCheck
        Static comparison with the full model.
    inertia : InertiaCheck
        Rigid-body data of the mass matrix against those of the integrals.
    phases : tuple of Phase
        Time and memory of the reduction, where it was measured, and of this report.
    inertia_missing : dict of str to float
        Share of the strain energy under the body's own inertia that the modes lack, by motion.
    """

    coordinates: int
    frequencies: FrequencyCheck
    effective: EffectiveMass | None
    shares: EnergyShares
    static: StaticCheck
    inertia: InertiaCheck
    phases: tuple[Phase, ...]
    inertia_missing: dict[str, float] = field(default_factory=dict)


def quality_report(
    fe: FEMatrices,
    basis: ReducedBasis,
    elastic: ReducedModes,
    body: FlexBody | None = None,
    up_to: float | None = None,
    *,
    nodes: Sequence[int] = (),
    mirror: SymmetryPlane | None = None,
    phases: Sequence[Phase] = (),
    progress: Progress = silent,
) -> QualityReport:
    """Assess a reduced body by the model it was made of.

    Parameters
    ----------
    fe, basis, elastic
        The model, its reduced basis and the modes made of it.
    body : FlexBody, optional
        The body, whose mass components are then used; else they are integrated again.
    up_to : float, optional
        Compare frequencies up to this one [Hz]; without it half as many modes as the body has,
        twenty at most, since the upper ones serve static deformation.
    nodes : sequence of int
        Mesh nodes where unit forces are applied, besides the loads of the basis.
    mirror : SymmetryPlane, optional
        The plane of a planar reduction.
    phases : sequence of Phase
        Time and memory of the reduction, from a :class:`Stopwatch`.
    progress : Progress
        Called with the phases ``"order"``, ``"factor"`` and ``"modes"``.

    Raises
    ------
    ReductionError
        A node that is not of the body.
    """
    watch = Stopwatch(progress)
    directions = basis.directions
    patterns = [*basis.loads, *unit_loads(fe, nodes, directions)]
    if mirror is not None:
        patterns = [_symmetric(load, mirror) for load in patterns]
    relief = InertiaRelief(fe.M, fe.rigid[:, directions])
    fixed = (
        FixedInterfaceModel(fe, basis.interfaces, directions, watch) if basis.interfaces else None
    )
    respond, lowest, limit = _full_model(fe, fixed, relief, mirror, watch)
    frequencies = compare_modes(fe, elastic, lowest, limit, up_to)
    watch("modes", 1.0)
    error = None if fixed is None else interface_error(fixed, basis, elastic)
    missing = missing_compliance(elastic, relief, respond, patterns)
    has_fixed = fixed is not None and basis.columns("fixed-interface").any()
    Mab = fe.reduced_mass(elastic.Phi) if body is None else body.Mab
    effective = effective_masses(basis, fixed) if fixed is not None and has_fixed else None
    shares = energy_shares(basis, elastic, Mab)
    response = inertia_response(fe, basis, elastic) if body is None else body.inertia_response
    watch("compare", 1.0)
    spent = [Phase(f"report: {part.name}", part.wall, part.cpu, part.peak) for part in watch.phases]
    return QualityReport(
        len(elastic.omega2),
        frequencies,
        effective,
        shares,
        StaticCheck(error, tuple(load.name for load in patterns), missing),
        _inertia_check(fe),
        (*phases, *spent),
        {} if response is None else response.missing_shares,
    )


def _full_model(
    fe: FEMatrices,
    fixed: FixedInterfaceModel | None,
    relief: InertiaRelief,
    mirror: SymmetryPlane | None,
    progress: Progress,
) -> tuple[Callable[[FloatArray], FloatArray], Callable[[int], tuple[FloatArray, FloatArray]], int]:
    """Static response and lowest modes of the full free model, and how many it has."""
    if fixed is None:
        inverse = relieved_inverse(fe, InertiaRelief(fe.M, fe.rigid), progress)
        limit = fe.numbering.n - 6
        return inverse, lambda k: lowest_free(fe, inverse, k, mirror, progress), limit
    return (
        lambda f: relief.fields(fixed.free(f)),
        lambda k: free_modes_of(fixed, relief, k, mirror, progress),
        free_count(fixed),
    )


def _symmetric(load: LoadPattern, mirror: SymmetryPlane) -> LoadPattern:
    f = 0.5 * (load.f + mirror.S.T @ load.f)
    return LoadPattern(load.name, f, load.force, load.moment, load.residual)


def _inertia_check(fe: FEMatrices) -> InertiaCheck:
    matrix = fe.rigid.T @ (fe.M @ fe.rigid)
    inertia = fe.inertia
    S = inertia.S0 - np.outer(inertia.S1, inertia.S1) / inertia.mass
    J = np.trace(S) * np.eye(3) - S
    exact = np.zeros((6, 6))
    exact[:3, :3], exact[3:, 3:] = inertia.mass * np.eye(3), J
    size = np.sqrt(np.diag(exact))
    size = np.where(size > 0, size, 1.0)
    error = float(np.abs((matrix - exact) / np.outer(size, size)).max())
    # -m c~, with c from the integrals' centre of mass to that of the matrix
    moment = matrix[:3, 3:]
    offset = np.array([moment[1, 2], moment[2, 0], moment[0, 1]]) / matrix[0, 0]
    center = fe.center + offset
    return InertiaCheck(
        _row(matrix[0, 0], center, matrix[3:, 3:]), _row(inertia.mass, fe.center, J), error
    )


def _row(mass: float, center: FloatArray, J: FloatArray) -> FloatArray:
    return np.array([mass, *center, J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[1, 2], J[2, 0]])


_ZERO_SHARE = 1e-12  # shares below this are round-off
_MAC = 12  # number of rows and columns of the MAC table that are shown
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
    tables = [_summary_table(report), _frequency_table(report), _mac_table(report)]
    if report.effective is not None:
        tables.append(_effective_mass_table(report))
    tables += [
        _share_table(report),
        _static_table(report),
        _inertia_table(report),
        _phase_table(report),
    ]
    return tuple(table for table in tables if table.rows)


def report_text(report: QualityReport) -> str:
    """All tables as plain text."""
    return "\n\n".join(_table_text(table) for table in report_tables(report)) + "\n"


def _summary_table(report: QualityReport) -> ReportTable:
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
        rows += [("largest share of compliance missing", _share_text(missing.max()))]
    if report.inertia_missing:
        motion, share = max(report.inertia_missing.items(), key=lambda item: item[1])
        rows.append(("inertia loads not answered", f"{_share_text(share)} under {motion}"))
    rows.append(("mass matrix against integrals", f"{report.inertia.error:.1e}"))
    return ReportTable("In short", ("what", "value"), tuple(rows))


def _frequency_table(report: QualityReport) -> ReportTable:
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


def _mac_table(report: QualityReport) -> ReportTable:
    mac = report.frequencies.mac[:_MAC, :_MAC]
    columns = ("full \\ reduced", *(str(j + 1) for j in range(mac.shape[1])))
    rows = tuple(
        (str(k + 1), *("." if v < 0.005 else f"{v:.2f}" for v in row)) for k, row in enumerate(mac)
    )
    note = f"Share of kinetic energy in common; the first {_MAC} modes; a point: below 0.005."
    return ReportTable("Modal assurance criterion", columns, rows, note)


def _effective_mass_table(report: QualityReport) -> ReportTable:
    masses = report.effective
    assert masses is not None
    columns = ("mode", "Hz", *(DIRECTIONS if masses.share.shape[1] == 6 else "123"), "interface")
    rows = [
        (label, f"{f:.6g}", *(_share_text(v) for v in row), _share_text(part))
        for label, f, row, part in zip(
            masses.labels, masses.frequency, masses.share, masses.interface, strict=True
        )
    ]
    total = masses.share.sum(axis=0)
    rows.append(
        ("all kept", "", *(_share_text(v) for v in total), _share_text(masses.interface.sum()))
    )
    note = (
        "Effective mass over the body's own as all interfaces move together, and share in the "
        "effective interface mass, of which all modes together have 1."
    )
    return ReportTable("Effective masses", columns, tuple(rows), note)


def _share_table(report: QualityReport) -> ReportTable:
    shares = report.shares
    columns = ("coordinate", "Hz", "kinetic x", "y", "z")
    columns += shares.kinds
    both = np.concatenate([shares.direction, shares.strain], axis=1)
    rows = tuple(
        (str(j), f"{f:.6g}", *(_share_text(v) for v in row))
        for j, (f, row) in enumerate(zip(report.frequencies.reduced, both, strict=True))
    )
    note = "Kinetic energy by direction; strain energy, and kinetic too, by kind of column."
    return ReportTable("Energy shares", columns, rows, note)


def _static_table(report: QualityReport) -> ReportTable:
    static = report.static
    rows = []
    if static.interfaces is not None:
        rows.append(("interfaces, loads without resultant", f"error {static.interfaces:.1e}"))
    rows += [
        (label, _share_text(value) if np.isfinite(value) else "does not deform the free body")
        for label, value in zip(static.labels, static.missing, strict=True)
    ]
    rows += [(motion, _share_text(share)) for motion, share in report.inertia_missing.items()]
    note = (
        "What the modes lack: of compliance, free and relieved; of inertia's strain energy, held."
    )
    return ReportTable("Static compliance", ("load", "missing"), tuple(rows), note)


def _inertia_table(report: QualityReport) -> ReportTable:
    values = zip(_INERTIA, report.inertia.matrix, report.inertia.integrals, strict=True)
    rows = tuple((name, f"{a:.9g}", f"{b:.9g}") for name, a, b in values)
    note = "Inertia about the centre of mass, kg m^2."
    return ReportTable("Mass and inertia", ("", "mass matrix", "integrals"), rows, note)


def _phase_table(report: QualityReport) -> ReportTable:
    columns = ("phase", "wall s", "processor s", "peak GiB")
    rows = tuple(
        (p.name, f"{p.wall:.2f}", f"{p.cpu:.2f}", f"{p.peak / 2**30:.2f}" if p.peak else "-")
        for p in report.phases
    )
    note = "Peak memory of the process until the phase ended."
    return ReportTable("Time and memory", columns, rows, note)


def _share_text(value: float | FloatArray) -> str:
    """A share with four digits; round-off is shown as 0."""
    number = float(value)
    if abs(number) < _ZERO_SHARE:
        return "0"
    return f"{number:.1e}" if 0 < abs(number) < 5e-5 else f"{number:.4f}"


def _table_text(table: ReportTable) -> str:
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
