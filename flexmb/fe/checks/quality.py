"""How good a reduced body is, in numbers, against the full model it comes from.

In: a model, its reduced basis, the modes made of it. Out: :class:`QualityReport`: frequencies and
modal assurance criterion, effective masses, energy shares, static compliance, mass and inertia,
time and memory. The full model is factorised and solved anew for it, which takes about as long as
the reduction did; the report says how long.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.checks.phases import Phase, Stopwatch
from flexmb.fe.checks.quality_modes import (
    EffectiveMass,
    EnergyShares,
    FrequencyCheck,
    compare_modes,
    effective_masses,
    energy_shares,
)
from flexmb.fe.checks.quality_static import (
    StaticCheck,
    interface_error,
    missing_compliance,
    unit_loads,
)
from flexmb.fe.reduction.basis import ReducedBasis
from flexmb.fe.reduction.free_interface import free_count, free_modes_of
from flexmb.fe.reduction.free_modes import lowest_free, relieved_inverse
from flexmb.fe.reduction.held import Held
from flexmb.fe.reduction.orthonormal import ReducedModes
from flexmb.fe.reduction.planar import Mirror
from flexmb.fe.reduction.relief import Relief
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody
from flexmb.progress import Progress, silent

__all__ = ["InertiaCheck", "QualityReport", "quality_report"]


@dataclass(frozen=True, eq=False)
class InertiaCheck:
    """Rigid data from the mass matrix, R^T M R, beside the integrals the body carries.

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
    """What :func:`quality_report` found; tables for reading by
    :func:`flexmb.fe.checks.quality_text.report_tables`.

    Parameters
    ----------
    coordinates : int
        Modal coordinates of the body.
    frequencies : FrequencyCheck
        Against the full model.
    effective : EffectiveMass or None
        Of the fixed-interface modes; None in a basis without.
    shares : EnergyShares
        Of the modal coordinates.
    static : StaticCheck
        Against the full model.
    inertia : InertiaCheck
        Mass matrix against integrals.
    phases : tuple of Phase
        Time and memory of the reduction, where it was measured, and of this report.
    """

    coordinates: int
    frequencies: FrequencyCheck
    effective: EffectiveMass | None
    shares: EnergyShares
    static: StaticCheck
    inertia: InertiaCheck
    phases: tuple[Phase, ...]


def quality_report(
    fe: FEMatrices,
    basis: ReducedBasis,
    elastic: ReducedModes,
    body: FlexBody | None = None,
    up_to: float | None = None,
    *,
    nodes: Sequence[int] = (),
    mirror: Mirror | None = None,
    phases: Sequence[Phase] = (),
    progress: Progress = silent,
) -> QualityReport:
    """Judge a reduced body by the model it was made of.

    Parameters
    ----------
    fe, basis, elastic
        The model, its reduced basis and the modes made of it.
    body : FlexBody, optional
        The body, to take the modes' mass components from; else they are integrated again.
    up_to : float, optional
        Compare frequencies up to this one [Hz]; without it half as many modes as the body has,
        twenty at most: the upper ones serve static deformation.
    nodes : sequence of int
        Mesh nodes where unit forces are tried, besides the loads the basis knows.
    mirror : Mirror, optional
        The plane of a planar reduction.
    phases : sequence of Phase
        Time and memory of the reduction, from a :class:`Stopwatch`.
    progress : Progress
        Told the phases ``"order"``, ``"factor"`` and ``"modes"``.

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
    relief = Relief(fe.M, fe.rigid[:, directions])
    held = Held(fe, basis.interfaces, directions, watch) if basis.interfaces else None
    respond, lowest, limit = _full_model(fe, held, relief, mirror, watch)
    frequencies = compare_modes(fe, elastic, lowest, limit, up_to)
    watch("modes", 1.0)
    error = None if held is None else interface_error(held, basis, elastic)
    missing = missing_compliance(elastic, relief, respond, patterns)
    has_fixed = held is not None and basis.columns("fixed-interface").any()
    Mab = fe.reduced_mass(elastic.Phi) if body is None else body.Mab
    effective = effective_masses(basis, held) if held is not None and has_fixed else None
    shares = energy_shares(basis, elastic, Mab)
    watch("compare", 1.0)
    spent = [Phase(f"report: {part.name}", part.wall, part.cpu, part.peak) for part in watch.phases]
    return QualityReport(
        len(elastic.omega2),
        frequencies,
        effective,
        shares,
        StaticCheck(error, tuple(load.name for load in patterns), missing),
        _inertia(fe),
        (*phases, *spent),
    )


def _full_model(
    fe: FEMatrices,
    held: Held | None,
    relief: Relief,
    mirror: Mirror | None,
    progress: Progress,
) -> tuple[Callable[[FloatArray], FloatArray], Callable[[int], tuple[FloatArray, FloatArray]], int]:
    """Static response and lowest modes of the full free model, and how many it has."""
    if held is None:
        inverse = relieved_inverse(fe, Relief(fe.M, fe.rigid), progress)
        limit = fe.numbering.n - 6
        return inverse, lambda k: lowest_free(fe, inverse, k, mirror, progress), limit
    return (
        lambda f: relief.fields(held.free(f)),
        lambda k: free_modes_of(held, relief, k, mirror, progress),
        free_count(held),
    )


def _symmetric(load: LoadPattern, mirror: Mirror) -> LoadPattern:
    f = 0.5 * (load.f + mirror.S.T @ load.f)
    return LoadPattern(load.name, f, load.force, load.moment, load.residual)


def _inertia(fe: FEMatrices) -> InertiaCheck:
    found = fe.rigid.T @ (fe.M @ fe.rigid)
    inertia = fe.inertia
    S = inertia.S0 - np.outer(inertia.S1, inertia.S1) / inertia.mass
    J = np.trace(S) * np.eye(3) - S
    told = np.zeros((6, 6))
    told[:3, :3], told[3:, 3:] = inertia.mass * np.eye(3), J
    size = np.sqrt(np.diag(told))
    size = np.where(size > 0, size, 1.0)
    error = float(np.abs((found - told) / np.outer(size, size)).max())
    moment = found[:3, 3:]  # -m c~ with c from the integrals' centre to that of the matrix
    offset = np.array([moment[1, 2], moment[2, 0], moment[0, 1]]) / found[0, 0]
    center = fe.center + offset
    return InertiaCheck(
        _row(found[0, 0], center, found[3:, 3:]), _row(inertia.mass, fe.center, J), error
    )


def _row(mass: float, center: FloatArray, J: FloatArray) -> FloatArray:
    return np.array([mass, *center, J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[1, 2], J[2, 0]])
