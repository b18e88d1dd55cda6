"""Kinds: what a model may hold, and which units each kind brings for the stages of the equations.

A stage of the equations (`engine.kernels.stages`) walks over the kinds that the scene holds and
knows none of them by name. A kind is declared once, in the file of its kernels, and listed in
`engine.kinds`. Signatures of the units, with `run` the Run, `tables` the kind's own record, `at`
the Point where the stage is evaluated:

    stage                     returns
    constants   (run, tables, at)           status; what never changes in a run
    functions   (run, tables, at)           status; functions of time, into Constraints.fun
    position    (run, tables, at)           status; poses from t and q
    inertia     (run, tables, at)           status; what depends on positions alone
    velocity    (run, tables, at)           status; after position
    bias        (run, tables, at)           status; accelerations at zero v̇, after velocity
    axes        (run, tables, at)           status; poses that only outputs need
    feedback    (run, tables, at)           status; forces by what is measured
    reaction    (run, tables, at)           number; loads by multipliers, their largest change
    wrench      (run, tables, at)           status; forces, into the wrenches of markers
    force       (run, tables, at)           status; forces, into the residual
    matrix      (run, tables, at, cv, cp)   status; tangents, into the iteration matrix
    jacobian    (run, tables, at)           status; constraint rows, into the iteration matrix
    coupling    (run, tables, at, cv, cp)   status; unsymmetric terms beside the rows
    mass        (run, tables, at)           status; Factor.sol = M Trial.res
    energy      (run, tables, at)           status; adds to Work.energies
    power       (run, tables, at)           status; adds to Work.powers
    begin       (run, tables, at)           status; first history
    remember    (run, tables, at)           status; history at an accepted state
    events      (run, tables, at)           status; what is watched, into Events.now
    limits      (run, tables, at)           status; whether the state may be taken
    angles      (run, tables, at)           status; carries what counts turns to this position
    wrenches    (run, tables, at, channel)  number; wrench pair of one element, for sensors
    unit_force  (run, tables, at, part)     number; force per unit of a function, for feedback;
                                            part = 6 row + 3 (0: on J, 1: on I) + component
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from flexmb.engine.jit import Unit

__all__ = ["Couple", "Kind"]

Couple = tuple[str, str, str]
"""Field of a row with the LINK of two bodies, and the fields of the two markers that it couples."""


@dataclass(frozen=True)
class Kind:
    """One kind of what a model may hold.

    Attributes
    ----------
    name : str
        Its name in `System.kinds`.
    tables : type
        Class of the record of its tables; rows of what joins markers are its field `rows`.
    units : mapping of str to Unit
        Its units by stage.
    lower : callable, optional
        Makes its tables from the model (`engine.compile.lowering`), None if the model has none;
        those of the kinds that every model has are made elsewhere (`engine.compile.core`).
    place : callable, optional
        Tells its tables where they stand in the iteration matrix (`engine.compile.lowering`).
    couples : tuple of Couple
        Pairs of markers whose bodies each row couples in the iteration matrix.
    uses_velocity : bool
        Whether its wrenches need the velocities of markers.
    works : bool
        Whether it does work, or may.
    stiff : bool
        Whether it may be stiff.
    unsymmetric : callable, optional
        Tells of its tables whether its tangent is far from symmetric.
    """

    name: str
    tables: type
    units: Mapping[str, Unit] = field(default_factory=dict)
    lower: Callable[..., Any] | None = None
    place: Callable[..., None] | None = None
    couples: tuple[Couple, ...] = ()
    uses_velocity: bool = False
    works: bool = False
    stiff: bool = False
    unsymmetric: Callable[[Any], bool] | None = None

    @property
    def core(self) -> bool:
        """Whether every model has it."""
        return self.lower is None

    def is_unsymmetric(self, tables: Any) -> bool:
        """Whether its tangent is far from symmetric."""
        return self.unsymmetric is not None and self.unsymmetric(tables)
