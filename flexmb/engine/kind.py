"""Kinds of elements of a model, and the compiled units of each kind.

Three modules list them: `engine.kind_registry` the kinds that take part in the stages of the
equations, `engine.joints` the constraint rows of joints and drivers, `engine.sensors` the sensors.
A kind is declared once, in the file of its kernels. Loops over rows, terms or channels call its
units through a table, by its number there, and name none of them. A scene loads and compiles only
the units of the kinds that it has.

Stages (`engine.equations_of_motion`): signatures of the units of a `Kind`, with `run` the Run,
`tables` the kind's own record, `at` the Point where the stage is evaluated:

    stage                     returns
    constants   (run, tables, at)           status; constants of a run
    functions   (run, tables, at)           status; functions of time, into Constraints.fun
    position    (run, tables, at)           status; poses from t and q
    inertia     (run, tables, at)           status; inertia of deformed bodies, after position
    velocity    (run, tables, at)           status; after position
    bias        (run, tables, at)           status; accelerations at zero v̇, after velocity
    constraint  (run, tables, at)           status; C of its rows, after position
    rate        (run, tables, at)           status; Cq v + C_t of its rows, after velocity
    axes        (run, tables, at)           status; poses that only outputs need
    feedback    (run, tables, at)           status; forces that depend on sensor channels
    reaction    (run, tables, at)           number; loads by multipliers, their largest change
    static      (run, tables, at)           number; equilibrium of η_s with loads, largest change
    static_hold (run, tables, at)           status; zero residual of modes with prescribed rates
    static_rates (run, tables, at)          status; η̇_s and η̈_s by interpolation of the past
    static_force (run, tables, at)          status; Trial.mode_force that prescribes η̈_s
    static_path (run, tables, at)           status; the prescribed η̈_s at all collocation stages
    static_lag  (run, tables, at)           number; difference of η_s from its extrapolated value
    static_ahead (run, tables, at)          number; past of η_s, by the state and three points ahead
    static_begin (run, tables, at)          status; delete the past of η_s
    wrench      (run, tables, at)           status; forces, into the wrenches of markers
    force       (run, tables, at)           status; forces, into the residual
    matrix      (run, tables, at, cv, cp)   status; tangents, into the iteration matrix
    jacobian    (run, tables, at)           status; constraint rows, into the iteration matrix
    coupling    (run, tables, at, cv, cp)   status; unsymmetric terms in addition to the rows
    mass        (run, tables, at)           status; Factor.sol = M Trial.res
    energy      (run, tables, at)           status; adds to Work.energies
    power       (run, tables, at)           status; adds to Work.powers
    begin       (run, tables, at)           status; first history
    update_history (run, tables, at)        status; history at an accepted state
    jump        (run, tables, at)           status; history just after a jump of forces
    events      (run, tables, at)           status; event functions, into Events.now
    limits      (run, tables, at)           status; whether the state is admissible
    angles      (run, tables, at)           status; continues angles that count turns to here
    angle_path  (run, tables, at)           status; continues Trial.angles, or REPEAT: too far
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
    gradient    (run, sensors, at, t)       number without meaning; adds the derivative to
                                            FeedbackWork.g: by poses g[0], by velocities or
                                            accelerations g[1]
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
    """One kind of elements of a model.

    Attributes
    ----------
    name : str
        Its name in `System.kinds`.
    tables : type
        Class of the record of its tables; its field `rows` has the elements that join markers.
    units : mapping of str to Unit
        Its units by stage.
    lower : callable, optional
        Makes its tables from the model (`engine.lowering`), those of a force from the forces of its
        `types`; returns None if the model has no such element. Tables of the kinds that every model
        has are made by `engine.compile`.
    types : tuple of str
        Of a force: its types in a scene.
    place : callable, optional
        Sets the places of its blocks in the iteration matrix in its tables (`engine.lowering`).
    couples : tuple of Couple
        Pairs of markers whose bodies each row couples in the iteration matrix.
    uses_velocity : bool
        Whether its wrenches need the velocities of markers.
    does_work : bool
        Whether it may do work.
    stiff : bool or callable
        Whether it may be stiff, or a function of its tables that returns it.
    unsymmetric : callable, optional
        Function of its tables: whether its tangent is far from symmetric.
    scratch : callable, optional
        Makes the scratch memory of its units from its tables (`Work.kinds`). Units find it in the
        field `scratch` of their tables.
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
        Text for names of rows, in which `{a}` and `{b}` are its axes.
    value, gradient, curvature : Unit
        Its measure, and the derivatives of it.
    tangent : Unit, optional
        None if the gradient never changes.
    angular : bool
        Whether it measures an angle or a cosine, not a length.
    is_distance : bool
        Whether it measures a distance, which has no gradient at zero.
    period : float
        Period of an angle: C is reduced by multiples of it to the value nearest to zero. 0: none.
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
    """One kind of terms, of which channels are sums.

    Attributes
    ----------
    value, gradient : Unit
        Its value, and its gradient, which functions of channels that act on the model need.
    level : int
        Highest time derivative that it depends on: 0 positions, 1 velocities, 2 accelerations.
    of_row : tuple of str
        Units of a kind of row (`RowKind`) that its value calls, if it measures as a row does.
    gradient_of_row : tuple of str
        Units of a kind of row that its gradient calls.
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
        Its present value; of an angle that counts turns, the one nearest to the last accepted one.
    reads : str
        What it is computed from: "terms", "state", "coordinate", "forces", or other "channels".
    counts_turns : bool
        Whether it is an angle that counts full turns.
    """

    value: CompiledUnit
    reads: str
    counts_turns: bool = False


GLOBAL_AXES = -1
"""Stands for a marker in terms and channels whose components are along global axes."""


class Term(NamedTuple):
    """A term of a channel: the fields of `tables.TERM` without the channel."""

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
        The measures and kinds of channels that it defines.
    """

    types: tuple[str, ...]
    add: Callable[..., None]
    measures: tuple[Measure, ...] = ()
    channels: tuple[ChannelKind, ...] = ()
