"""Kinds: what a model may hold, and which units each kind brings.

Three modules list them: `engine.kind_registry` what takes part in the stages of the equations,
`engine.joints` the constraint rows of joints and drivers, `engine.sensors` the sensors. A kind is
declared once, in the file of its kernels; what walks over rows, terms or channels calls its units
through a table, by its number there, and names none of them. A scene loads and compiles only the
units of what it holds.

Stages (`engine.equations_of_motion`): signatures of the units of a `Kind`, with `run` the Run,
`tables` the kind's own record, `at` the Point where the stage is evaluated:

    stage                     returns
    constants   (run, tables, at)           status; what never changes in a run
    functions   (run, tables, at)           status; functions of time, into Constraints.fun
    position    (run, tables, at)           status; poses from t and q
    inertia     (run, tables, at)           status; what depends on positions alone
    velocity    (run, tables, at)           status; after position
    bias        (run, tables, at)           status; accelerations at zero v̇, after velocity
    constraint  (run, tables, at)           status; C of its rows, after position
    rate        (run, tables, at)           status; Cq v + C_t of its rows, after velocity
    axes        (run, tables, at)           status; poses that only outputs need
    feedback    (run, tables, at)           status; forces by what is measured
    reaction    (run, tables, at)           number; loads by multipliers, their largest change
    static      (run, tables, at)           number; deformation by loads, its largest change
    static_hold (run, tables, at)           status; zero residual of modes with prescribed rates
    static_rates (run, tables, at)          status; η̇_s and η̈_s by interpolation of the past
    static_force (run, tables, at)          status; Trial.mode_force that prescribes η̈_s
    static_path (run, tables, at)           status; the prescribed η̈_s at all collocation stages
    static_lag  (run, tables, at)           number; how far it is from where a step took it
    static_ahead (run, tables, at)          number; its past, from the state and three points ahead
    static_begin (run, tables, at)          status; no past
    wrench      (run, tables, at)           status; forces, into the wrenches of markers
    force       (run, tables, at)           status; forces, into the residual
    matrix      (run, tables, at, cv, cp)   status; tangents, into the iteration matrix
    jacobian    (run, tables, at)           status; constraint rows, into the iteration matrix
    coupling    (run, tables, at, cv, cp)   status; unsymmetric terms in addition to the rows
    mass        (run, tables, at)           status; Factor.sol = M Trial.res
    energy      (run, tables, at)           status; adds to Work.energies
    power       (run, tables, at)           status; adds to Work.powers
    begin       (run, tables, at)           status; first history
    remember    (run, tables, at)           status; history at an accepted state
    jump        (run, tables, at)           status; history behind a jump of forces
    events      (run, tables, at)           status; what is watched, into Events.now
    limits      (run, tables, at)           status; whether the state may be taken
    angles      (run, tables, at)           status; carries what counts turns to this position
    angle_path  (run, tables, at)           status; carries Trial.angles there, or REPEAT: too far
    wrenches    (run, tables, at, channel)  number; wrench pair of one element, for sensors
    unit_force  (run, tables, at, part)     number; force per unit of a function, for feedback;
                                            part = 6 row + 3 (0: on J, 1: on I) + component

Constraint rows: units of a `RowKind`, `at` the RowWork, a and b axes of the markers i and j:

    value       (at, a, b, i, j)            number; what the row measures
    gradient    (at, a, b, i, j)            status; into at.g
    curvature   (at, a, b, i, j)            number; its second time derivative at zero accelerations
    tangent     (at, a, b, i, j, f)         status; f times the change of at.g, into at.H

A row is C = measure − f, f its constant and its function of time. The gradient g (12) holds the
partial derivatives of the measure for the virtual motion (δx_I, δφ_I, δx_J, δφ_J) in global axes,
so λ g is the pair of wrenches of the row. The tangent H (12, 12), rows and columns as g, is the
change of g with that motion; what the change of the moment arms adds is in `bodies.wrench`. A
tangent may use at.g as scratch.

Sensors: units of a `Measure` (a term of a sum) and of a `ChannelKind`, with `sensors` the Sensors:

    value       (run, sensors, at, t)       number; term t; after position, velocity, bias stages
    gradient    (run, sensors, at, t)       number, of no meaning; into FeedbackWork.g: with poses
                                            g[0], with velocities or accelerations g[1], zero before
    value       (run, sensors, at, c)       number; channel c
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from flexmb.engine.jit import CompiledUnit

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
        Makes its tables from the model (`engine.lowering`), those of a force from the forces of its
        types too; None if the model has none. Those of the kinds that every model has are made
        elsewhere (`engine.compile`).
    types : tuple of str
        Of a force: its types in a scene.
    place : callable, optional
        Tells its tables where they stand in the iteration matrix (`engine.lowering`).
    couples : tuple of Couple
        Pairs of markers whose bodies each row couples in the iteration matrix.
    uses_velocity : bool
        Whether its wrenches need the velocities of markers.
    works : bool
        Whether it does work, or may.
    stiff : bool or callable
        Whether it may be stiff, or what tells that of its tables.
    unsymmetric : callable, optional
        Tells of its tables whether its tangent is far from symmetric.
    scratch : callable, optional
        Makes from its tables what its units write into (`Work.kinds`); these find it in the field
        `scratch` of the tables that they are handed.
    """

    name: str
    tables: type
    units: Mapping[str, CompiledUnit] = field(default_factory=dict)
    lower: Callable[..., Any] | None = None
    types: tuple[str, ...] = ()
    place: Callable[..., None] | None = None
    couples: tuple[Couple, ...] = ()
    uses_velocity: bool = False
    does_work: bool = False
    stiff: bool | Callable[[Any], bool] = False
    unsymmetric: Callable[[Any], bool] | None = None
    scratch: Callable[[Any], Any] | None = None

    @property
    def core(self) -> bool:
        """Whether every model has it."""
        return self.lower is None

    def is_stiff(self, tables: Any) -> bool:
        """Whether it may be stiff."""
        return self.stiff(tables) if callable(self.stiff) else self.stiff

    def is_unsymmetric(self, tables: Any) -> bool:
        """Whether its tangent is far from symmetric."""
        return self.unsymmetric is not None and self.unsymmetric(tables)


@dataclass(frozen=True)
class RowKind:
    """One kind of constraint row between two marker frames.

    Attributes
    ----------
    word : str
        What a row is, for names of rows; `{a}` and `{b}` are its axes.
    value, gradient, curvature : Unit
        What it measures.
    tangent : Unit, optional
        None if the gradient never changes.
    angular : bool
        Whether it measures an angle or a cosine, no length.
    is_distance : bool
        Whether it measures a distance, which has no gradient where it is zero.
    period : float
        Of an angle, 0 of all others: C is then the one nearest to zero.
    """

    word: str
    value: CompiledUnit
    gradient: CompiledUnit
    curvature: CompiledUnit
    tangent: CompiledUnit | None = None
    angular: bool = False
    is_distance: bool = False
    period: float = 0.0


@dataclass(frozen=True)
class Measure:
    """One kind of terms that channels are sums of.

    Attributes
    ----------
    value, gradient : Unit
        Its value, and for functions that act what it changes with.
    level : int
        Derivative in time that it is of: 0 of positions, 1 of velocities too, 2 of accelerations.
    of_row : tuple of str
        Units of a kind of row (`RowKind`) that its value calls, if it measures as a row does.
    gradient_of_row : tuple of str
        And those that its gradient calls.
    """

    value: CompiledUnit
    gradient: CompiledUnit
    level: int
    of_row: tuple[str, ...] = ()
    gradient_of_row: tuple[str, ...] = ()


@dataclass(frozen=True)
class ChannelKind:
    """One kind of channels of sensors.

    Attributes
    ----------
    value : Unit
        Its value now, of an angle that counts turns the one nearest to the last accepted state.
    reads : str
        What it is read from: "terms", "state", "coordinate", "forces", or other "channels".
    counts_turns : bool
        Whether it is an angle that counts full turns.
    """

    value: CompiledUnit
    reads: str
    counts_turns: bool = False


GLOBAL_AXES = -1
"""In place of the marker whose axes a term or a channel has."""


class Term(NamedTuple):
    """A term of a channel as `tables.TERM` says, but for its channel."""

    measure: Measure
    kind: int  # of a row, -1
    I: int  # noqa: E741
    J: int
    a: int
    b: int = 0
    factor: float = 1.0


@dataclass(frozen=True)
class SensorKind:
    """One kind of sensors.

    Attributes
    ----------
    types : tuple of str
        Types of sensors in a scene.
    add : callable
        Adds the channels of one sensor (`engine.sensors.sensor.Channels`, its specification).
    measures, channels : tuple
        The measures and kinds of channels that it brings.
    """

    types: tuple[str, ...]
    add: Callable[..., None]
    measures: tuple[Measure, ...] = ()
    channels: tuple[ChannelKind, ...] = ()
