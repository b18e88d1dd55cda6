"""How a scene is run: dynamics with its method and numbers, kinematics, assembly.

The methods are described in the modules of `flexmb.engine.integrators`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import repeat
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import SerializationInfo, StrictBool, ValidationInfo, model_validator

from flexmb.errors import Problem, SceneError
from flexmb.model.functions.tabulated import check_order
from flexmb.model.quantities import (
    Angle,
    AngularVelocity,
    Integer,
    Length,
    Quantity,
    Time,
    WordOr,
    plain,
    read_numbers,
)
from flexmb.model.reading import (
    NUMBER,
    Entry,
    Form,
    Reader,
    Spec,
    context_of,
    fail,
    fail_if,
    list_form,
)

METHODS: dict[str, str] = {
    "auto": "explicit-rk, or radau for flexible bodies and where stiffness limits its steps; "
    "generalized-alpha for fixed steps",
    "generalized-alpha": "implicit, second order, numerical damping by spectral_radius: "
    "the choice for flexible bodies and stiff springs",
    "explicit-rk": "Dormand-Prince 8(5,3) or 5(4), by order, with projection onto the joints: for "
    "what is not stiff",
    "radau": "Radau IIA, implicit, fifth order, damps stiff modes: for stiff parts",
    "hht": "Hilber-Hughes-Taylor, generalized-alpha with the damping of alpha: as other programs "
    "know it",
    "newmark": "Newmark's method with its beta and gamma: for teaching; of first order unless "
    "gamma is 1/2",
    "trapezoidal": "trapezoidal rule, Newmark's method with 1/4 and 1/2: second order without "
    "numerical damping",
    "baumgarte": "explicit, augmented equations with Baumgarte's stabilization in place of "
    "projection: for teaching; joints drift, and the summary says how far",
    "coordinate-partitioning": "explicit, integrates independent coordinates and solves the "
    "joints for the dependent ones: for teaching",
}
"""What each integrator is suited for."""

_EXPLICIT = ("explicit-rk", "baumgarte", "coordinate-partitioning")
_IMPLICIT = ("generalized-alpha", "hht", "newmark", "trapezoidal", "radau")

OPTIONS: dict[str, tuple[str, ...]] = {
    "order": _EXPLICIT,
    "spectral_radius": ("generalized-alpha",),
    "newton_tolerance": _IMPLICIT,
    "alpha": ("hht",),
    "beta": ("newmark",),
    "gamma": ("newmark",),
    "baumgarte_alpha": ("baumgarte",),
    "baumgarte_beta": ("baumgarte",),
}
"""Fields of `[dynamics]` that only some methods have, with these methods."""


if TYPE_CHECKING:
    MethodName = str
else:
    MethodName = Literal[*METHODS]
    """Words of `dynamics.method`."""


INSTEAD = {"accuracy": "step", "step": "accuracy"}
"""Two options that exclude each other: one given later replaces the other."""

ACCURACY = 1e-4
"""The accuracy if a scene gives neither accuracy nor step."""

ROUND_OFF = 1e-12
"""Accuracy below which round-off dominates the errors of a run."""

_AUTO_BY_STEP = "generalized-alpha"
"""The method for ``method = "auto"`` with fixed steps."""

_SAME_TIME = 1e-12  # times that differ by less than this fraction of the run are equal


def _idle_options(table: Mapping[str, Any]) -> Iterator[str]:
    """The options in a table of `[dynamics]` that its method, or a fixed step, does not use."""
    method, fixed = table.get("method", "auto"), table.get("step") is not None
    if method == "auto" and fixed:
        method = _AUTO_BY_STEP
    for option, methods in OPTIONS.items():
        if table.get(option) is not None and method in tuple(METHODS) and method not in methods:
            yield option


def drop_idle_options(table: dict[str, Any], changes: Collection[str]) -> None:
    """Drop options that became meaningless when the method or its steps were changed.

    Parameters
    ----------
    table : dict
        The changed table `[dynamics]`.
    changes : collection of str
        Names of the changed fields; options among them are kept, so that they are refused.
    """
    if not {"method", "step", "accuracy"}.isdisjoint(changes):
        for option in [*_idle_options(table)]:
            if option not in changes:
                del table[option]


def _tolerance(value: Any, info: ValidationInfo) -> float:
    number = Quantity("", "positive").read(value, info)
    if number >= 1:
        raise fail(Problem("", f"is relative and must be less than 1, is {number:g}"))
    return number


def _accuracy(value: Any, info: ValidationInfo) -> float:
    number = _tolerance(value, info)
    if number < ROUND_OFF:
        what = f"must be at least {ROUND_OFF:g}, is {number:g}; smaller errors are round-off"
        raise fail(Problem("", what))
    return number


_Rate = Annotated[float, Quantity("1/s", "not negative")]

MOST_OUTPUTS = 10_000_000
"""Largest number of rows that a run records."""


MOST_STEPS = 1e10
"""Largest number of fixed steps of a run: hours for a small model."""


def _outputs(value: Any, info: ValidationInfo) -> int | tuple[float, ...]:
    """The number of output intervals, or increasing output times in SI."""
    value = plain(value)
    if not isinstance(value, list | tuple):
        return Integer(1, MOST_OUTPUTS).read(value, info)
    if not value:
        raise fail(Problem("", "the list of output times is empty"))
    if len(value) > MOST_OUTPUTS:
        raise fail(Problem("", f"at most {MOST_OUTPUTS} are recorded, given {len(value)}"))
    names = context_of(info)
    try:
        times = read_numbers(value, names, repeat("s"))
    except SceneError as error:
        raise fail(*error.problems[:_MAX_PROBLEMS]) from None
    check_order(times, names.units, "s", "times")
    return tuple(times)


def _write_outputs(value: int | tuple[float, ...], info: SerializationInfo) -> Any:
    if isinstance(value, int):
        return value
    units = context_of(info).units
    return [units.written(time, "s") for time in value]


_OUTPUTS: Form = {
    "anyOf": [{"type": ["integer", "string"], "minimum": 1}, {**list_form(NUMBER), "minItems": 1}],
    "description": "or times [s]",
}


_MAX_PROBLEMS = 5  # number of problems reported of one list


class DynamicsSpec(Spec):
    """Run in time.

    ``duration`` [s]. ``outputs`` intervals of equal length are recorded, both ends included; or a
    list of increasing times [s] from 0 to the duration, and only those are recorded. The run always
    lasts until the duration. Either ``accuracy`` (1e-4 by default): the largest error over the
    outputs of each position sensor, over its peak-to-peak; or ``step`` [s]: steps of fixed length.
    The error is measured by a comparison run with longer steps unless ``verify`` is false; that of
    fixed steps only if it is true, by a run with half as long steps, at about three times the cost.
    ``start = "quasi-static"`` starts the flexible bodies in elastic equilibrium with the initial
    motion, ``"undeformed"`` without deformation; ``"static"`` starts in the equilibrium of the
    whole machine, with the initial velocities.

    Options that only some methods have, and that others refuse: ``order`` of the explicit ones, 8
    (by default) or 5; ``newton_tolerance`` of the implicit ones, relative to the displacement that
    the accelerations cause in a step, by default 1e-8 (of radau 1e-10) with fixed steps and a
    fraction of the allowed error with error control; ``spectral_radius`` of generalized-alpha at
    infinite frequency, from 0 to 1 (1 means no numerical damping), by default 0.8; ``alpha`` of
    hht, from -1/3 to 0 (no numerical damping), by default -0.1; ``gamma`` of newmark, by default
    1/2, and ``beta``, by default (gamma + 1/2)²/4; ``baumgarte_alpha`` and ``baumgarte_beta`` [1/s]
    of baumgarte, α and β in C̈ + 2α Ċ + β² C = 0, by default 20 over the duration, at most one over
    a fixed step.
    """

    duration: Time
    accuracy: Annotated[float, Reader(_accuracy)] | None = None
    verify: StrictBool | None = None
    step: Time | None = None
    outputs: Annotated[int | tuple[float, ...], Reader(_outputs, _write_outputs, _OUTPUTS)] = 200
    method: MethodName = "auto"
    order: Literal[5, 8] | None = None
    spectral_radius: Annotated[float, Quantity(limits=(0.0, 1.0))] | None = None
    alpha: Annotated[float, Quantity(limits=(-1.0 / 3.0, 0.0))] | None = None
    beta: Annotated[float, Quantity(limits=(0.25, 1.0))] | None = None
    gamma: Annotated[float, Quantity(limits=(0.5, 1.0))] | None = None
    baumgarte_alpha: _Rate | None = None
    baumgarte_beta: _Rate | None = None
    newton_tolerance: Annotated[float, Reader(_tolerance)] | None = None
    start: Literal["undeformed", "quasi-static", "static"] = "undeformed"

    @model_validator(mode="after")
    def _check_step(self) -> Self:
        if self.step is not None and self.accuracy is not None:
            what = "accuracy chooses the steps itself: give either accuracy or a fixed step"
            raise fail(Problem("step", what))
        if self.step is not None and self.step > self.duration:
            what = f"must not exceed the duration {self.duration:g} s, is {self.step:g} s"
            raise fail(Problem("step", what))
        if self.step is not None and not self.duration <= MOST_STEPS * self.step:
            least = f"{self.duration / MOST_STEPS:.3g} s"
            what = f"at most {MOST_STEPS:.0e} steps are run: at least {least}, is {self.step:g} s"
            raise fail(Problem("step", what))
        return self

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        table = {name: getattr(self, name) for name in ("method", "step", *OPTIONS)}
        problems = [Problem(option, self._idle(option)) for option in _idle_options(table)]
        fail_if(problems)
        return self

    def _idle(self, option: str) -> str:
        """The sentence for an option without effect."""
        method = f'method "{self.method}"'
        if self.method == "auto":
            method += (
                f", with a fixed step {_AUTO_BY_STEP}," if self.step else " with error control"
            )
        *first, last = OPTIONS[option]
        owners = f"{', '.join(first)} and {last}" if first else last
        return (
            f"{method} has no {option}, an option of {owners}: choose such a method, or remove the "
            "option"
        )

    @model_validator(mode="after")
    def _check_newmark(self) -> Self:
        gamma = 0.5 if self.gamma is None else self.gamma
        if self.beta is not None and 2.0 * self.beta < gamma:
            what = f"must be at least gamma/2 = {0.5 * gamma:g} for a stable method"
            raise fail(Problem("beta", f"{what}, is {self.beta:g}"))
        if gamma != 0.5 and self.step is None:
            what = "other than 1/2 makes newmark a method of first order, without error control"
            raise fail(Problem("gamma", f"{what}: give a fixed step, or gamma = 0.5"))
        return self

    @model_validator(mode="after")
    def _check_output_times(self, info: ValidationInfo) -> Self:
        if isinstance(self.outputs, tuple):
            units = context_of(info).units
            end = units.say(self.duration, "s")
            for i in (0, len(self.outputs) - 1):
                time = self.outputs[i]
                if not -_SAME_TIME * self.duration <= time <= self.duration * (1.0 + _SAME_TIME):
                    what = (
                        f"{units.say(time, 's')} lies outside the run, which goes from 0 to {end}"
                    )
                    raise fail(Problem(f"outputs[{i}]", what))
        return self

    @property
    def n_rows(self) -> int:
        """Number of recorded rows."""
        return len(self.outputs) if isinstance(self.outputs, tuple) else self.outputs + 1


class KinematicsSpec(Spec):
    """Motion that is determined by joints and drivers alone, without integration.

    ``duration`` [s]; ``outputs`` intervals of equal length are recorded, with positions,
    velocities, accelerations and the reactions of that motion. They are exact to round-off for any
    number of outputs.
    """

    duration: Time
    outputs: Annotated[int, Integer(1)] = 200


class StaticsSpec(Spec):
    """Equilibrium at rest, of rigid and flexible bodies under their weight and loads.

    Functions and drivers have their values at ``time`` [s]. With a ``duration`` [s] the equilibrium
    is computed at the ends of ``outputs`` intervals: a quasi-static motion. With ``spin`` [rad/s]
    the whole machine rotates steadily about an axis through the ground's origin, and the
    equilibrium is relative to the rotating axes.
    """

    time: Annotated[float, Quantity("s", "not negative")] = 0.0
    duration: Time | None = None
    outputs: Annotated[int, Integer(1)] | None = None
    spin: AngularVelocity = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        problems = []
        if self.duration is not None and self.time:
            what = "belongs to one equilibrium; a duration follows it from 0 on: remove one"
            problems.append(Problem("time", what))
        if self.outputs is not None and self.duration is None:
            problems.append(Problem("outputs", "one equilibrium has no outputs: give a duration"))
        fail_if(problems)
        return self

    @property
    def times(self) -> tuple[float, ...]:
        """Times of all equilibria [s]."""
        if self.duration is None:
            return (self.time,)
        n = self.outputs or 50
        return tuple(self.duration * k / n for k in range(n + 1))


_Bound = Annotated[float | Literal["any"], WordOr("any", "a bound", "", "positive")]


class ValiditySpec(Spec):
    """Limits of flexible bodies at which a run stops, because its equations are no longer valid.

    ``deflection``: displacement of points over the body's length, relative to its joints;
    ``rotation`` [rad] of points likewise; ``speed``: angular velocity over the lowest natural
    frequency with the joints, for bodies without geometric stiffening; ``inertia_loads``: the share
    of the response to a body's own inertia that its modes lack; ``node_loads``: the same for the
    response to loads besides its interfaces; ``truncation``: the change of sensors over their range
    if a mode that was left out would vibrate, or without sensors of motion and reactions its share
    of the deformation; ``load_factor``: the loads over those that buckle the body;
    ``stiffening``: the change of the sensors on a slender body, over their range, by geometric
    stiffening that it does not have, or without sensors the change of its deflection;
    ``membrane_forces``: the same for plates and shells, by their membrane forces. A run warns
    before it stops. ``"any"`` removes a limit; that of ``speed`` with the one of ``stiffening``.
    """

    deflection: _Bound = 0.3
    rotation: _Bound = 1.0
    speed: _Bound = 1.0
    inertia_loads: _Bound = 0.5
    node_loads: _Bound = 0.5
    truncation: _Bound = 0.5
    load_factor: _Bound = 1.0
    stiffening: _Bound = 0.5
    membrane_forces: _Bound = 0.5


class GuessSpec(Spec):
    """Coordinates of a joint near which the assembly starts: ``angle``, ``stroke`` or both."""

    angle: Angle | None = None
    stroke: Length | None = None

    @model_validator(mode="after")
    def _check_coordinates(self) -> Self:
        if self.angle is None and self.stroke is None:
            raise fail(Problem("", 'give "angle", "stroke" or both'))
        return self

    @property
    def coordinates(self) -> dict[str, float]:
        """The guessed values by the name of the coordinate."""
        values = {"angle": self.angle, "stroke": self.stroke}
        return {name: value for name, value in values.items() if value is not None}


class AssemblySpec(Spec):
    """How the first pose is computed.

    ``weights`` by body: bodies move as little as is needed to close the joints; one with weight 10
    as if it had ten times its mass, a ``"fixed"`` one not at all; 1 by default. ``guess`` by joint:
    coordinates near which the assembly starts; if the mechanism can be assembled in several ways,
    the nearest is taken.
    """

    weights: dict[
        str,
        Annotated[float | Literal["fixed"], WordOr("fixed", "a positive number", "", "positive")],
    ] = {}
    guess: dict[str, Annotated[GuessSpec, Entry()]] = {}
