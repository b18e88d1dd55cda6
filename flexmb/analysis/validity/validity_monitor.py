"""All limits of the theory of flexible bodies in a run: warnings, and bounds at which it stops.

Monitors receive the rows of a run in order and give indicators: one number for each body and limit,
with the time of its largest value. Above its warning level an indicator becomes a note of the run;
above the bound of `[validity]` the run is refused at that time. The audit of effects uses the same
indicators.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from contextlib import suppress
from copy import deepcopy
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.initial_state import StartValues, assemble
from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, one_blas_thread
from flexmb.analysis.linear.linearization import Linearization
from flexmb.analysis.linear.observer import MinimalEquations, RowsAlongMotion
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.analysis.monitors import Indicator, Monitor
from flexmb.analysis.validity.body_accelerations import Complex
from flexmb.analysis.validity.frequency_error import FrequencyErrorMonitor
from flexmb.analysis.validity.linear_elasticity import (
    LARGEST_SOFTENING,
    LEAST_SPEED,
    SLOW,
    LinearElasticityMonitor,
    flexible_columns,
)
from flexmb.analysis.validity.load_factor import (
    LARGEST_ERROR,
    LoadFactorMonitor,
    loads_without_response,
    loads_without_stiffening,
)
from flexmb.analysis.validity.modal_basis import ModalBasisMonitor
from flexmb.analysis.validity.omitted_stiffening import (
    OmittedBendMonitor,
    OmittedStiffeningMonitor,
    omitted_stiffness,
)
from flexmb.analysis.validity.omitted_vibrations import OmittedVibrationMonitor, VibrationResponse
from flexmb.analysis.validity.pose_vibrations import LEAST_CYCLES, errors_by_omission
from flexmb.analysis.validity.unresolved_vibrations import UnresolvedChanges
from flexmb.engine.bodies.static_mode_tables import StaticModes
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.errors import FlexmbError
from flexmb.model.flexible_body import stretches
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import ValiditySpec
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

if TYPE_CHECKING:
    from flexmb.analysis.validity.deformed_inertia import DeformedInertiaMonitor

_SMALL = 0.5  # change of a frequency, over the smallest that is told, that is not looked at
# Least number of cycles in the run of a vibration that rotation changes: round-off leaves free
# motions a frequency.
_FREE_MOTION = 0.01
_TWICE = 1.0  # error of a frequency above which its size has no meaning


class ValidityMonitor:
    """All monitors of a run: its warnings, and the sentence with which it is refused.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions.
    is_motion : bool
        Whether the rows are a motion, not separate equilibria.
    is_judged : bool
        Whether rows are examined; without, only the cause of a failure is.
    """

    def __init__(
        self, compiled: Compiled, model: Model, q: NDArray[np.float64], is_motion: bool = True,
        *, is_judged: bool = True,
    ) -> None:  # fmt: skip
        self._spec, self._compiled, self._model = model.validity or ValiditySpec(), compiled, model
        self._elasticity = LinearElasticityMonitor(compiled, model, q, is_motion)
        self._basis = ModalBasisMonitor(compiled, model, is_motion)
        self._load_factor = LoadFactorMonitor(compiled, model, q, is_motion)
        self._inertia = _inertia_monitor(compiled, model, q)
        self._monitors: tuple[Monitor, ...] = ()  # all of them are of flexible bodies
        self._bars: OmittedStiffeningMonitor | None = None
        duration = model.dynamics.duration if model.dynamics and is_motion else 0.0
        self._slowest = LEAST_CYCLES / duration if duration else 0.0  # of a vibration in it, Hz
        linear = not any(map(stretches, model.bodies.values()))  # else frequencies change
        if is_judged and compiled.system.parts.bodies["m"].any():
            of = compiled, model
            self._bars = bars = OmittedStiffeningMonitor(*of, q, self._load_factor, is_motion)
            self._monitors = (
                self._elasticity,
                self._load_factor,
                bars,
                OmittedBendMonitor(compiled, model),
                *_membrane_monitors(compiled, model, bars.bows),
                *((self._inertia,) if self._inertia else ()),
                self._basis,
                *((OmittedVibrationMonitor(compiled, model, q),) if is_motion else ()),
                *((FrequencyErrorMonitor(*of, self._basis),) if is_motion and linear else ()),
            )
        self._notes = (
            *loads_without_stiffening(compiled, model),
            *loads_without_response(compiled, model),
        )

    def add(self, rows: OutputBlock) -> int:
        """Add the next rows; returns their number, up to the row at which the run is refused."""
        n, before = len(rows.t), [_arrays(monitor) for monitor in self._monitors]

        def refused(k: int) -> bool:
            for monitor, arrays in zip(self._monitors, before, strict=True):
                vars(monitor).update(deepcopy(arrays))
                monitor.add(rows.part(0, k))
            return bool(self.refusal())

        if not n or not refused(n):
            return n
        last = bisect_left(range(1, n), True, key=refused) + 1
        refused(last)
        return last

    def indicators(self) -> Iterator[Indicator]:
        """Indicators of all bodies, including those below their warning level."""
        for monitor in self._monitors:
            yield from monitor.indicators()

    @property
    def beyond(self) -> dict[str, str]:
        """A sentence on each body that is driven faster than its omitted modes are known."""
        return self._basis.beyond

    def notes(self) -> Iterator[str]:
        """A sentence on each body and limit that is exceeded."""
        yield from self._notes
        yield from self._basis.notes()
        for one in self.exceeded():
            yield one.text()

    def exceeded(self) -> Iterator[Indicator]:
        """Indicators above their warning level, less those that another one tells too."""
        bars, errors = self._frequency_errors() if self._monitors else ((), ())
        own = [one for one in self.indicators() if not (_is_speed(one) and one.body in bars)]
        exceeded = [one for one in (*own, *errors) if one.value > one.warning]
        for one in exceeded:
            if not any(other.body == one.body and _tells(other, one) for other in exceeded):
                yield one

    @one_blas_thread()
    def _frequency_errors(self) -> tuple[list[str], list[Indicator]]:
        """What stiffening and inertia coupling, left out, change where bodies rotate fastest, and
        where the forces of bars are largest.

        Names of the bodies of which stiffening is known, and an indicator of each one.
        """
        bars, errors = list[str](), list[Indicator]()
        if self._compiled.layout.nv > MAX_COORDINATES:
            return bars, errors
        bent = self._bars.bent_states() if self._bars else ()
        free = _FREE_MOTION / LEAST_CYCLES * self._slowest
        states = [(*one, free) for one in self._elasticity.fast_states()]
        for begin, names, slowest in (*states, *((*one, self._slowest) for one in bent)):
            if set(names) <= set(bars):
                continue
            with suppress(FlexmbError, np.linalg.LinAlgError):  # no equilibrium, or no inertia
                made = _without_vibrations(self._compiled, self._model, begin, names[0])
                row, contains = _row_of(made.state), self._elasticity.contains
                of = self._load_factor, contains, slowest
                every = _frequency_errors(made, row, *of)
                bars += [one for one in every[0] if one in names]
                errors += [one for one in every[1] if one.body in names]
        return bars, errors

    def diverging(self, state: State) -> str:
        """The sentence on a body whose equations have lost their mass or all stiffness, or "".

        By its inertia coupling in its frame, by rotation without stiffening, or by loads that
        buckle it, up to the last state of the run.
        """
        last = _row_of(state)
        if all(np.isfinite(one).all() for one in (last.q, last.v, last.vd, last.lam)):
            self._elasticity.add(last)
            self._load_factor.add_last(last)
            if self._inertia:
                self._inertia.add(last)
        return (
            (self._inertia.diverging() if self._inertia else "")
            or self._elasticity.diverging()
            or self._load_factor.diverging()
        )

    def making_energy(self) -> str:
        """The sentence on a body whose inertia coupling does not keep energy, or ""."""
        return self._inertia.making_energy() if self._inertia else ""

    def refusal(self) -> str:
        """The sentence on the first bound that is exceeded, or ""."""
        for one in self.indicators():
            bound = getattr(self._spec, one.quantity, "any")
            if one.quantity == "stiffening" and isinstance(self._spec.speed, str):
                continue  # asked for without stiffening
            value = one.value if one.against_bound is None else one.against_bound
            if not isinstance(bound, str) and value > bound:
                way_on = f'{one.quantity} = "any" under [validity] runs on'
                unbalanced = self._inertia.diverging() if self._inertia else ""
                if unbalanced:
                    return f"{unbalanced}; so {one.quantity} passes its bound {bound:g}"
                buckled = self._load_factor.diverging()
                cause = (
                    f"{one.text()}; {buckled}" if buckled != one.text() and buckled else one.text()
                )
                return f"{cause} (bound {bound:g}; {way_on})"
        return ""


def limits_of_vibrations(made: Linearization) -> list[str]:
    """Sentences on bodies whose modes, loads or omitted terms spoil vibrations about a state."""
    of, row = (made.compiled, made.model), _row_of(made.state)
    monitor = LoadFactorMonitor(*of, made.state.q, is_motion=False)
    monitor.add(row)
    notes = [one.text() for one in monitor.indicators() if one.value > one.warning]
    notes += ModalBasisMonitor(*of, is_motion=False).notes_of_modes(made)
    if made.compiled.layout.nv > MAX_COORDINATES:
        return notes
    bars, errors = _frequency_errors(made, row, monitor, _every_mode)
    notes += [one.text() for one in errors if one.value > LARGEST_ERROR]
    elasticity = LinearElasticityMonitor(*of, made.state.q, every_mode=True)
    elasticity.add(row)
    least = LEAST_SPEED * (LARGEST_ERROR / LARGEST_SOFTENING) ** 0.5
    speeds = [one for one in elasticity.indicators() if _is_speed(one) and one.body not in bars]
    return [*notes, *(one.text() for one in speeds if one.value > least)]


def _frequency_errors(
    made: Linearization,
    row: OutputBlock,
    load_factor: LoadFactorMonitor,
    counts: Callable[[str, Complex], NDArray[np.bool_]],
    slowest: float = 0.0,
) -> tuple[list[str], list[Indicator]]:
    """What stiffening or inertia coupling, left out, change of natural frequencies.

    Stiffening is known of bars, which are named; of other bodies the speed tells it. `counts` and
    `slowest` as of `errors_by_omission`.
    """
    compiled, model, units = made.compiled, made.model, made.model.units
    terms = list(omitted_stiffness(compiled, model, row, load_factor))
    bars, turns, below = [one.name for one in terms], dict[str, float](), np.inf
    for columns, body in flexible_columns(compiled):
        spec, name, omitted = model.bodies[columns.name], columns.name, body.omitted_modes
        if omitted is not None:
            below = min(below, omitted.frequency.min(initial=np.inf))
        if getattr(spec, "deformation", "") == "quasi-static":
            continue
        speed = float(np.linalg.norm(made.state.v[columns.iv + 3 : columns.iv + 6]))
        if speed > 0.0 and (name in bars or body.centrifugal_stiffness is not None):
            turns[name] = speed
    coupled = [
        name for name in turns if getattr(model.bodies[name], "inertia_coupling", "full") != "full"
    ]
    if coupled:
        from flexmb.analysis.validity.deformed_inertia import omitted_coupling

        terms += omitted_coupling(made, coupled)
    errors, least = list[Indicator](), _SMALL * LARGEST_SOFTENING
    static: StaticModes | None = compiled.system.kinds.get(STATIC_MODES.name)
    counts_of_modes = () if static is None else zip(static.rows, np.diff(static.first), strict=True)
    bodies = compiled.layout.bodies
    massless = [bodies[k].name for k, count in counts_of_modes if count == bodies[k].m]
    band = slowest, below
    every = errors_by_omission(made, terms, band, least, counts) if terms else ()
    for error, mode, causes in every:
        name = causes[0].name
        hertz, where = made.frequencies[mode], ""
        if turns.get(name, 0.0) > SLOW * 2.0 * np.pi * hertz:
            where = f" turns with {units.say(turns[name], 'rad/s', 3)}"
        what, cures = (
            " and ".join(words)
            for words in zip(*((one.cause, one.cure) for one in causes), strict=True)
        )
        effect = _frequency_error(error, units.say(hertz, "Hz", 3) if hertz else "")
        if name in massless:
            effect = _deformation_error(error)
        text = partial(str, f"bodies.{name}{where}: {what}, so that {effect}; {cures}")
        quantity = "omitted_terms"
        if len(causes) == 1 and name in bars and not causes[0].M.any() and not causes[0].D.any():
            quantity = "omitted_stiffening"
        size, t = abs(error), float(row.t[0])
        errors.append(Indicator(name, quantity, size, t, LARGEST_SOFTENING, text))
    return bars, errors


def _every_mode(_: str, shapes: Complex) -> NDArray[np.bool_]:
    return np.ones(shapes.shape[1], bool)


def _without_vibrations(
    compiled: Compiled, model: Model, begin: StartValues, observer: str
) -> Linearization:
    """The equations linearised about the motion of a run at a time, less the vibrations in it.

    They are written in the axes of a body.
    """
    v = begin.v.copy()
    for columns, _ in flexible_columns(compiled):
        v[columns.iv + 6 : columns.iv + 6 + columns.m] = 0.0
    state = assemble(compiled, model, begin=begin._replace(v=v, vibrates=False)).state
    tangents = StateEquations(compiled, state).tangents()
    seen = MinimalEquations(RowsAlongMotion(compiled, state), tangents, observer)
    return Linearization(compiled, model, state, tangents, seen, 0.0, ())


def _is_speed(one: Indicator) -> bool:
    return one.quantity.partition(",")[0] == "speed"


def _frequency_error(error: float, hertz: str) -> str:
    """Words on the relative error of a natural frequency; `hertz` is "" if it does not vibrate."""
    if not hertz:
        return "a motion does not vibrate as it does with all terms"
    how = f"too {'high' if error > 0.0 else 'low'} by about {percent(abs(error))}"
    if error > _TWICE:
        how = "none with all terms" if np.isinf(error) else "more than twice that with all terms"
    return f"a natural frequency, {hertz}, is {how}"


def _deformation_error(error: float) -> str:
    """Words on the deformation of a body without modal inertia, by its error of a frequency."""
    change = max(1.0 + error, np.finfo(float).eps) ** -2 - 1.0
    how = f"too {'large' if change > 0.0 else 'small'} by about {percent(abs(change))}"
    if change > _TWICE:
        how = "more than twice that with all terms"
    return f"its deformation is {how}"


def _row_of(state: State) -> OutputBlock:
    """The row of a state, without sensors and reactions."""
    motion = (state.q, state.v, state.vd, state.lam)
    none = np.zeros((1, 0))
    return OutputBlock(state.t[:1].copy(), *(one[None] for one in motion), *[none] * 4)


def _inertia_monitor(
    compiled: Compiled, model: Model, q: NDArray[np.float64]
) -> DeformedInertiaMonitor | None:
    """The monitor of bodies whose inertia coupling or frame may lose mass, if there are any."""
    if all(
        getattr(spec, "inertia_coupling", "full") == "full"
        and getattr(spec, "frame_interface", None) is None
        for spec in model.bodies.values()
    ):
        return None
    from flexmb.analysis.validity.deformed_inertia import DeformedInertiaMonitor

    return DeformedInertiaMonitor(compiled, model, q)


def _membrane_monitors(compiled: Compiled, model: Model, bows: set[str]) -> Iterator[Monitor]:
    """The monitor of plates and shells, if there are any beside those that bend as bars."""
    every = compiled.flexbodies.items()
    if any(body.membrane_stiffness and name not in bows for name, body in every):
        from flexmb.analysis.validity.membrane_forces import MembraneForcesMonitor

        yield MembraneForcesMonitor(compiled, model, bows)


def _tells(other: Indicator, one: Indicator) -> bool:
    """Whether the sentence of the other indicator of a body tells what that of one does.

    What stiffening does two indicators tell: the larger number counts, of a change of stiffness.
    """
    pair = {one.quantity, other.quantity}
    if pair == {"omitted_stiffening", "stiffening"}:
        frequency, change = (one, other) if other.quantity == "stiffening" else (other, one)
        return (change.value < 2.0 * frequency.value) == (other is frequency)
    better = {"stiffening": {"load_factor"}, "membrane_forces": {"stiffening", "load_factor"}}
    return other.quantity in better.get(one.quantity, ())


def _arrays(monitor: Monitor) -> dict[str, Any]:
    """The state of a monitor: its arrays, which it replaces when it changes them, and tables."""
    kinds = (np.ndarray, VibrationResponse, UnresolvedChanges, dict)
    return {name: value for name, value in vars(monitor).items() if isinstance(value, kinds)}
