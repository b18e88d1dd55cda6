"""Monitors of the rows of a run: lost contact, singular orientations, unbounded growth.

A monitor receives the rows in order and returns sentences, or indicators of how close a limit is. A
motion grows without bound if it is larger than anything in the scene explains, and has grown by the
same large factor several times in succession. No power of time does that (a fall, a rocket, a rotor
that spins up), nor a planned motion that ends, nor a pendulum that leaves its upper equilibrium,
whose energy limits it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexmb.engine.compile import Compiled
from flexmb.engine.tables import Layout
from flexmb.model.control import feedback_functions, resolved
from flexmb.model.model import Model
from flexmb.model.sensor import OrientationSensorSpec, ReactionSensorSpec, SensorSpec
from flexmb.results.output_block import OutputBlock

Array = NDArray[np.float64]

_PULL_ROUND_OFF = 1e-6  # tensile force over the largest force of a joint that is round-off
_NEAR_SINGULAR = 0.1  # angle from a singular orientation that is reported [deg]
MAX_TURN_OF_A_STEP = 1.0  # largest rotation of a body in a fixed step without a note [rad]
_TURN_ROUND_OFF = 1e-9  # of that limit
_ADVISED_TURN = 0.95  # rotation of an advised step, so that its rounded text is below the limit
# Alternating reactions. Their amplitude is reported above the first share of the range of the
# reaction. A range counts as at least the second share of the largest reaction of the joint, and as
# at least the force that moves the mass of the model by the third share of its size within the run.
# Steps are equal if they differ by less than the fourth share.
_RINGING_SHARE, _LEAST_SHARE, _NO_MOTION, _SAME_STEP = 0.05, 1e-3, 1e-6, 1e-6
# Alternation lasts if this share of its amplitude is left after two steps; largest ratio of the
# amplitudes of two steps that is used to extrapolate; a divisor that is not zero.
_LASTING_SHARE, _MAX_RATIO, _MIN_DIVISOR = 0.08, 3.0, 1e-300
_MAX_SAMPLES = 256  # samples stored of a run
# The second half of the run so far is divided into _GROWTH_PARTS parts. A motion grows without
# bound if its largest value increases by _GROWTH_FACTOR in each: powers of time up to the eighth do
# not.
_GROWTH_PARTS, _GROWTH_FACTOR = 4, 3.0
# Values that nothing in a scene explains are larger than these: translations and deformations over
# the size of the model, states over their scale, rotation of a body within one part [rad].
_MAX_TRANSLATION, _MAX_DEFORMATION, _MAX_STATE, _MAX_TURN = 100.0, 1.0, 1e6, 1e3
_TENFOLD = math.log(10.0)


@dataclass(frozen=True)
class Indicator:
    """A number that shows how close a body is to a limit of its equations.

    Parameters
    ----------
    body : str
        Name of the body.
    quantity : str
        A field of `[validity]`, or another word if there is no bound.
    value, time : float
        The largest value so far, and its time [s].
    warning : float
        Value above which a run has a note.
    text : callable
        Returns the sentence.
    against_bound : float, optional
        Number that is compared with the bound of `[validity]`, if not the value.
    """

    body: str
    quantity: str
    value: float
    time: float
    warning: float
    text: Callable[[], str]
    against_bound: float | None = None


class Monitor(Protocol):
    """An object that evaluates the rows of a run, block by block, and has indicators."""

    def add(self, rows: OutputBlock) -> None:
        """Evaluate the next rows."""

    def indicators(self) -> Iterable[Indicator]:
        """The indicators from the rows so far."""


class ContactLossMonitor:
    """Finds the first time at which a joint that can only push, as of a cam, would have to pull."""

    def __init__(self, compiled: Compiled) -> None:
        self._contacts = compiled.contacts
        self._largest = np.zeros(len(self._contacts))
        self._first: dict[str, float] = {}

    def add(self, rows: OutputBlock) -> None:
        """Evaluate the next rows."""
        for k, contact in enumerate(self._contacts if len(rows.t) else ()):
            push = contact.compressed * rows.lam[:, contact.row]
            self._largest[k] = max(self._largest[k], float(np.abs(push).max()))
            pulls = push < -_PULL_ROUND_OFF * self._largest[k]
            if contact.joint not in self._first and pulls.any():
                self._first[contact.joint] = float(rows.t[np.argmax(pulls)])

    def notes(self) -> list[str]:
        """A sentence for each such joint."""
        return [
            f"joints.{joint} pulls its follower towards the cam, first at t = {time:.6g} s, where "
            "the joint holds it; use a stronger spring, or a contact with a tappet that its lift "
            "drives"
            for joint, time in self._first.items()
        ]


class TurningMonitor:
    """Largest rotation of bodies in one step of fixed size `step` [s]; 0: steps are controlled."""

    def __init__(self, compiled: Compiled, model: Model, step: float) -> None:
        self._bodies, self._units, self._step = compiled.layout.bodies, model.units, step
        self._largest = np.zeros(len(self._bodies))

    def add(self, rows: OutputBlock) -> None:
        """Evaluate the next rows."""
        for k, body in enumerate(self._bodies if self._step and len(rows.t) else ()):
            turning = np.linalg.norm(rows.v[:, body.iv + 3 : body.iv + 6], axis=1).max()
            self._largest[k] = max(self._largest[k], float(turning) * self._step)

    def notes(self) -> list[str]:
        """A sentence for the body with the largest rotation, if it exceeds the limit."""
        if self._largest.max() <= MAX_TURN_OF_A_STEP * (1.0 + _TURN_ROUND_OFF):
            return []
        k = int(self._largest.argmax())
        turn, step = float(self._largest[k]), self._units.say(self._step, "s", 3)
        enough = self._units.say(_ADVISED_TURN / turn * self._step, "s", 2)
        return [
            f"bodies.{self._bodies[k].name} turns by {turn:.3g} rad in a step of {step}: what "
            f"varies within a turn is not resolved; take steps of {enough} at most, or leave out "
            "dynamics.step, so that the accuracy is controlled"
        ]


class RingingMonitor:
    """Reactions that alternate from step to step, in runs with fixed steps of generalized-α.

    Rates that such a method does not resolve, such as that of a stiff damper, alternate in sign
    from step to step (Hairer & Wanner, II, §IV.3). Second differences over the steps then change
    their sign, and are four times the amplitude. Second differences at a jump or an impact do so
    too, but not four in a row. The reported amplitude is that of the first of four; it is bounded
    by the second one, extrapolated with the ratio of the second to the third.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model of the run.
    step : float
        Size of the steps [s]; 0: nothing is examined.

    Attributes
    ----------
    looks : bool
        Whether reactions are examined.
    """

    def __init__(self, compiled: Compiled, model: Model, step: float) -> None:
        self._names, self._units, self._step = compiled.layout.reactions, model.units, step
        self.looks = bool(step and self._names)
        span = 1.0 if model.dynamics is None else model.dynamics.duration
        mass, length = float(compiled.system.parts.bodies["mass"].sum()), compiled.length
        least = _NO_MOTION * mass * length / span**2  # a force that causes no motion in the run
        self._least = least * np.array([1.0, length])
        n = 2 * len(self._names)  # force and moment of each joint
        self._range = np.stack([np.full((n, 3), np.inf), np.full((n, 3), -np.inf)])
        self._largest = np.zeros((2, n))  # largest amplitude, and its time
        self._rows = np.zeros((0, 1 + 3 * n))  # time and reactions of the last five rows

    def add(self, rows: OutputBlock) -> None:
        """Evaluate the next rows, wherever six in a row are one step apart."""
        if not self.looks or not len(rows.t):
            return
        n = len(self._names)
        values = rows.reactions.reshape(len(rows.t), n, 4, 3)[:, :, :2].reshape(len(rows.t), -1)
        by_joint = values.reshape(-1, 2 * n, 3)
        np.minimum(self._range[0], by_joint.min(axis=0), out=self._range[0])
        np.maximum(self._range[1], by_joint.max(axis=0), out=self._range[1])
        table = np.vstack([self._rows, np.column_stack([rows.t, values])])
        self._rows = table[-5:]
        near = np.abs(np.diff(table[:, 0]) / self._step - 1.0) < _SAME_STEP
        if len(near) < 5:
            return
        at = np.flatnonzero(sliding_window_view(near, 5).all(axis=1))
        if not len(at):
            return
        bend = np.diff(table[:, 1:], 2, axis=0).reshape(len(table) - 2, -1, 3)
        turns = np.einsum("ijk,ijk->ij", bend[1:], bend[:-1]) < 0.0
        sizes = np.sqrt(np.einsum("ijk,ijk->ij", bend, bend)) / 4.0
        one, two, three, four = (sizes[at + k] for k in range(4))
        falls = np.clip(two / np.maximum(three, _MIN_DIVISOR), 1.0, _MAX_RATIO)
        size = np.minimum(one, falls * two) * falls
        lasts = turns[at] & turns[at + 1] & turns[at + 2] & (four > _LASTING_SHARE * two)
        rings = np.where(lasts, size, 0.0)
        k = rings.argmax(axis=0)
        most = rings.max(axis=0)
        rises = most > self._largest[0]
        self._largest[:, rises] = most[rises], table[at[k], 0][rises]

    def add_apart(self, rows: OutputBlock) -> None:
        """Evaluate rows that are not consecutive with those before and after."""
        before, self._rows = self._rows, self._rows[:0]
        self.add(rows)
        self._rows = before

    def notes(self) -> list[str]:
        """A sentence for the joint whose reactions alternate most, if above `_RINGING_SHARE`."""
        if not self._largest[0].any():
            return []
        span = (self._range[1] - self._range[0]).max(axis=1).reshape(-1, 2)
        size = np.abs(self._range).max(axis=(0, 2)).reshape(-1, 2).max(axis=0)
        span = np.maximum(span, np.maximum(_LEAST_SHARE * size, self._least)).reshape(-1)
        share = self._largest[0] / span
        k = int(share.argmax())
        if share[k] <= _RINGING_SHARE:
            return []
        what, at = ("force", "moment")[k % 2], self._units.say(self._largest[1, k], "s", 4)
        return [
            f"the {what} at {self._names[k // 2]} alternates from step to step by "
            f"{100 * share[k]:.2g} % of its range, most at t = {at}: steps "
            f"of {self._units.say(self._step, 's', 3)} are too long for a stiff damper or spring, "
            'whose force changes within one; shorten them, take method = "radau", or leave out '
            "dynamics.step, so that the accuracy is controlled"
        ]


class SingularOrientationMonitor:
    """Least distance of orientation sensors from the orientation where alpha and gamma coincide."""

    def __init__(self, layout: Layout, model: Model) -> None:
        self._nearest: dict[str, tuple[float, float]] = {}
        column = {channel: k for k, channel in enumerate(layout.channels)}
        self._columns = {
            name: (column[f"{name}.beta"], spec.sequence)
            for name, spec in model.sensors.items()
            if isinstance(spec, OrientationSensorSpec)
        }

    def add(self, rows: OutputBlock) -> None:
        """Evaluate the next rows."""
        for name, (column, sequence) in self._columns.items():
            beta = rows.sensors[:, column]
            if not len(beta):
                continue
            size = np.sin(beta) if sequence[0] == sequence[2] else np.cos(beta)
            off = np.degrees(np.arcsin(np.maximum(size, 0.0)))  # size < 0: it was passed through
            k = int(np.argmin(off))
            nearest = float(off[k]), float(rows.t[k])
            self._nearest[name] = min(nearest, self._nearest.get(name, (np.inf, 0.0)))

    def notes(self) -> list[str]:
        """A note for every sensor that reached or passed a singular orientation."""
        return [
            f"sensors.{name}: at t = {time:.6g} s within {off:.2g} deg of the singular pose of "
            f'"{self._columns[name][1]}", where alpha and gamma turn about one axis and only their '
            "sum or difference is known; take another sequence"
            for name, (off, time) in self._nearest.items()
            if off < _NEAR_SINGULAR
        ]


class SampledHistory:
    """Values at evenly spaced rows of a run, at most 256 samples.

    The interval begins with one row. When the table is full, every second sample is dropped and the
    interval doubled.

    Attributes
    ----------
    count : (3,) int
        Rows so far, samples, and rows per sample.
    table : (256, 1 + n) float
        Times and values of the samples; NaN after them.
    """

    def __init__(self, n: int) -> None:
        self.count = np.array([0, 0, 1])
        self.table = np.full((_MAX_SAMPLES, 1 + n), np.nan)

    def add(self, t: Array, values: Array) -> None:
        """Add values (k, n) of the next rows at the times t (k,)."""
        count, row = self.count, int(-self.count[0] % self.count[2])
        while row < len(t):
            if count[1] == _MAX_SAMPLES:
                self.table[: _MAX_SAMPLES // 2] = self.table[::2].copy()
                self.table[_MAX_SAMPLES // 2 :] = np.nan
                count[1], count[2] = _MAX_SAMPLES // 2, 2 * count[2]
            every, here = int(count[2]), int(count[1])
            new = t[row::every][: _MAX_SAMPLES - here]
            samples = self.table[here : here + len(new)]
            samples[:, 0], samples[:, 1:] = new, values[row::every][: len(new)]
            count[1] += len(new)
            row += every * len(new)
        count[0] += len(t)


class _Quantity(NamedTuple):
    """A quantity that may grow: its columns in the table (q, v), their weights, and the bound."""

    name: str
    columns: range
    weights: Array
    bound: float
    from_start: bool = False  # whether its distance from the first value counts
    is_rate: bool = False  # whether the bound is for the value times the duration of a part


class GrowthMonitor:
    """Detects quantities that grow exponentially without bound, as with an unstable controller.

    Attributes
    ----------
    sentence : str
        Names the quantity that grows, with its rate; empty if there is none.
    ends_run : bool
        Whether such growth ends the run: the model has forces that follow measured quantities.
    """

    def __init__(self, compiled: Compiled, model: Model) -> None:
        self.ends_run = any(where.startswith("forces.") for where, _ in feedback_functions(model))
        self.sentence = ""
        self._units = model.units
        self._quantities = every = _quantities(compiled)
        sizes = [len(one.columns) for one in every]
        self._starts = np.cumsum(sizes, dtype=np.intp) - np.array(sizes, dtype=np.intp)
        self._columns = np.array([k for one in every for k in one.columns], dtype=np.intp)
        self._weights = np.concatenate([np.zeros(0), *(one.weights for one in every)])
        self._from_start = np.repeat([one.from_start for one in every], sizes)
        self._first: Array | None = None
        self._largest = np.zeros(len(every))
        self._history = SampledHistory(len(self._quantities))

    def add(self, rows: OutputBlock) -> None:
        """Evaluate the next rows."""
        if not len(rows.t) or self.sentence:
            return
        values = np.hstack([rows.q, rows.v])[:, self._columns]
        if self._first is None:
            self._first = values[0] * self._from_start
        apart = np.abs(values - self._first) * self._weights
        sizes = np.maximum.reduceat(apart, self._starts, axis=1)
        largest = np.maximum.accumulate(np.vstack([self._largest, sizes]), axis=0)[1:]
        self._history.add(rows.t, largest)
        self._largest = largest[-1]
        self._check()

    def _check(self) -> None:
        """Set `sentence` if the largest value of a quantity grows in all parts, above its bound."""
        samples = self._history.table[: self._history.count[1]]
        if len(samples) <= _GROWTH_PARTS:
            return
        samples = samples[np.isfinite(samples).all(axis=1)]
        if not len(samples):
            return
        begin, now = samples[0, 0], samples[-1, 0]
        part = (now - begin) / (2 * _GROWTH_PARTS)
        at = np.searchsorted(samples[:, 0], now - part * np.arange(_GROWTH_PARTS, -1, -1))
        at = np.minimum(at, len(samples) - 1)
        if len(set(at.tolist())) <= _GROWTH_PARTS:
            return
        values = samples[at, 1:]
        grows = (values[1:] >= _GROWTH_FACTOR * values[:-1]).all(axis=0) & (values[0] > 0.0)
        for k in np.flatnonzero(grows):
            q = self._quantities[k]
            if values[-1, k] * (part if q.is_rate else 1.0) > q.bound:
                span = float(samples[at[-1], 0] - samples[at[0], 0])
                rate = float(np.log(values[-1, k] / values[0, k])) / span
                self.sentence = self._growth(q.name, float(now), rate)
                return

    def _growth(self, name: str, t: float, rate: float) -> str:
        at, tenfold = self._units.say(t, "s", 4), self._units.say(_TENFOLD / rate, "s", 3)
        return (
            f"{name} grows without bound at t = {at}, by a factor of ten every {tenfold}: the "
            "motion is unstable; check the signs and gains of what follows a measured quantity, "
            "and of stiffness and damping"
        )


def _quantities(compiled: Compiled) -> list[_Quantity]:
    """Translation, angular velocity and deformation of all bodies, and states."""
    layout, weights, quantities = compiled.layout, compiled.system.weights, list[_Quantity]()
    for body in layout.bodies:
        iq, iv, m, name = body.iq, layout.nq + body.iv, body.m, f"bodies.{body.name}"
        w, turning = weights[body.iv : body.iv + 6 + m], f"the angular velocity of {name}"
        quantities += [
            _Quantity(name, range(iq, iq + 3), w[:3], _MAX_TRANSLATION, from_start=True),
            _Quantity(turning, range(iv + 3, iv + 6), np.ones(3), _MAX_TURN, is_rate=True),
        ]
        if m:
            deformation, shape = f"the deformation of {name}", range(iq + 7, iq + 7 + m)
            quantities.append(_Quantity(deformation, shape, w[6:], _MAX_DEFORMATION))
    first = layout.nv - len(layout.coordinates)
    for k, name in enumerate(layout.coordinates, start=first):
        if name.startswith("states."):
            column = range(layout.nq + k, layout.nq + k + 1)
            quantities.append(_Quantity(name, column, weights[k : k + 1], _MAX_STATE))
    return quantities


def algebraic_loop_notes(model: Model) -> list[str]:
    """A note for every force that depends on accelerations or reactions: an algebraic loop."""
    notes = []
    for where, function in feedback_functions(model):
        if not where.startswith("forces."):
            continue
        channels = resolved(model, function.expression).channels
        loops = [
            channel
            for channel in channels
            if _depends_on_forces(
                model.sensors.get(channel) or model.sensors.get(channel.rpartition(".")[0])
            )
        ]
        if loops:
            notes.append(
                f"{where} depends on {', '.join(loops)}, which depends on forces at the same "
                "moment: an algebraic loop, solved by iteration"
            )
    return notes


def _depends_on_forces(spec: SensorSpec | None) -> bool:
    """Whether a sensor measures accelerations or reactions."""
    return spec is not None and (
        "acceleration" in spec.type
        or isinstance(spec, ReactionSensorSpec)
        or getattr(spec, "derivative", 0) == 2
    )
