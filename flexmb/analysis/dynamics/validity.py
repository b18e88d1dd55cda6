"""What a run cannot vouch for, of flexible bodies: warnings, and bounds beyond which it stops.

Monitors take the rows of a run in order and give indicators: one number for each body and limit,
with the moment at which it was largest. Above its warning level an indicator is a note of the run,
above the bound of `[validity]` the run is refused, at the moment when that is certain. The audit of
effects reads the same indicators.

Of vibrations that are left out because quasi-static modes stay as they are within a step: those of
all flexible bodies in their first pose with these modes as springs without mass (static
condensation), beside those with these modes still; what is only among the former is left out, such
as a heavy body on the compliance of a beam. Springs, gravity and other forces are not counted.
Along the run, a of such a vibration ω being its part of the deformation, what is missing is ä/ω²,
as ä + ω² (a − a_static) = 0 says; where a changes at once, at the start of an undeformed body under
load or by a function of time that jumps, the change.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, n_free
from flexmb.analysis.assembly.joined_damping import JoinedScene
from flexmb.analysis.dynamics.linear_elasticity import (
    LinearElasticityMonitor,
    loads_without_stiffening,
)
from flexmb.analysis.dynamics.load_factor import LoadFactorMonitor
from flexmb.analysis.dynamics.modal_basis import ModalBasisMonitor
from flexmb.analysis.monitors import Indicator, Monitor
from flexmb.engine.bodies.static_modes import static_bodies, static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import FINE_METHOD, STIFF_METHOD
from flexmb.engine.state import State
from flexmb.errors import AssemblyError
from flexmb.model.functions.derivatives import derivative_jumps, evaluate
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import ValiditySpec
from flexmb.results.writer import OutputBlock

Array = NDArray[np.float64]
_EQUAL = 0.05  # frequencies of the same vibration differ by less
_WARNING = 0.04  # of the deformation
_SUDDEN = 0.05  # of the largest value of a function


class ValidityMonitor:
    """The warnings of a run, and the sentence with which it is refused.

    Parameters
    ----------
    compiled, model : Compiled, Model
        What is run.
    q : (nq,) array
        First positions.
    is_motion : bool
        Whether the rows are a motion, and not equilibria of their own.
    """

    def __init__(
        self, compiled: Compiled, model: Model, q: NDArray[np.float64], is_motion: bool = True
    ) -> None:
        self._spec = model.validity or ValiditySpec()
        self._elasticity = LinearElasticityMonitor(compiled, model, q)
        self._basis = ModalBasisMonitor(compiled, model, is_motion)
        self._load_factor = LoadFactorMonitor(compiled, model, q)
        self._monitors: tuple[Monitor, ...] = ()  # all are of flexible bodies
        if compiled.system.parts.bodies["m"].any():
            self._monitors = (
                self._elasticity,
                self._load_factor,
                self._basis,
                *((OmittedVibrationMonitor(compiled, model, q),) if is_motion else ()),
            )
        self._notes = tuple(loads_without_stiffening(compiled, model))

    def add(self, rows: OutputBlock) -> int:
        """Take the next rows; returns how many, up to that with which the run is refused."""
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
        """Those of all bodies, below their warning level too."""
        for monitor in self._monitors:
            yield from monitor.indicators()

    @property
    def beyond(self) -> dict[str, str]:
        """A sentence on each body that is driven faster than its omitted modes are known."""
        return self._basis.beyond

    def notes(self) -> Iterator[str]:
        """A sentence for each body and limit that was left."""
        yield from self._notes
        yield from self._basis.notes()
        for one in self.indicators():
            if one.value > one.warning:
                yield one.text()

    def diverging(self, state: State) -> str:
        """The sentence for a body whose equations lose all stiffness, or "".

        By its rotation without stiffening or by loads that buckle it, up to the state in which a
        run ends.
        """
        none = np.zeros((1, 0))
        motion = (state.q, state.v, state.vd, state.lam)
        if all(np.isfinite(one).all() for one in motion):
            last = OutputBlock(state.t[:1].copy(), *(one[None] for one in motion), *[none] * 4)
            self._elasticity.add(last)
            self._load_factor.add_last(last)
        return self._elasticity.diverging() or self._load_factor.diverging()

    def refusal(self) -> str:
        """The sentence for the first bound that was passed, or ""."""
        for one in self.indicators():
            bound = getattr(self._spec, one.quantity, "any")
            value = one.value if one.against_bound is None else one.against_bound
            if not isinstance(bound, str) and value > bound:
                way_on = f'{one.quantity} = "any" under [validity] runs on'
                buckled = self._load_factor.diverging()
                cause = (
                    f"{one.text()}; {buckled}" if buckled != one.text() and buckled else one.text()
                )
                return f"{cause} (bound {bound:g}; {way_on})"
        return ""


def _arrays(monitor: Monitor) -> dict[str, Any]:
    """What a monitor has gathered: its arrays."""
    return {name: value for name, value in vars(monitor).items() if isinstance(value, np.ndarray)}


class OmittedVibrationMonitor:
    """How much of the deformation the vibrations that are left out would change.

    Parameters
    ----------
    compiled, model : Compiled, Model
        What is run.
    q : (nq,) array
        First positions, closed.
    """

    def __init__(self, compiled: Compiled, model: Model, q: Array) -> None:
        explicit = model.dynamics is not None and model.dynamics.method == FINE_METHOD
        still = static_coordinates(compiled.system, kinetostatic=not explicit)
        self._cure = 'deformation = "automatic" has them'
        if explicit:
            self._cure = f'method = "{STIFF_METHOD}" has those of bodies not "quasi-static"'
        self._bodies = [body for body in compiled.layout.bodies if body.m]
        self._omega, self._parts = np.zeros(0), np.zeros((0, 0))
        self._largest = np.zeros(3)  # of what is missing, with its time, and of the deformation
        self._samples = np.zeros((0, 1))  # (3, 1 + k) times and parts
        self._rows = np.zeros((0, 1))  # (2, 1 + k) of the last rows
        if not len(still) or n_free(compiled) > MAX_COORDINATES:
            return
        every, kinetostatic = static_bodies(compiled.system)
        rows = every if explicit else kinetostatic
        self._names = [compiled.layout.bodies[k].name for k in rows]
        scene = JoinedScene(compiled, q, list(range(len(compiled.layout.bodies))))
        flexible = [k for k, body in enumerate(compiled.layout.bodies) if body.m]
        try:
            free = scene.vibrations(*flexible)
            remaining = scene.vibrations(*flexible, still=still).omega
        except AssemblyError:  # motions without inertia
            return
        gone = [
            k for k, w in enumerate(free.omega) if not np.any(np.abs(remaining - w) < _EQUAL * w)
        ]
        self._omega = free.omega[gone]
        self._K = block_diag(*(compiled.flexbodies[body.name].K for body in self._bodies))
        self._parts = free.eta[:, gone].T @ self._K / self._omega[:, None]  # a ω, of strain energy
        self._samples = np.full((3, 1 + len(gone)), np.nan)
        self._rows = np.full((2, 1 + len(gone)), np.nan)
        spec = model.dynamics
        self._undeformed = spec is not None and spec.start == "undeformed"
        self._waiting = np.full(2 + len(gone), np.nan)  # for the end of a jump: then, a, its time
        self._sudden = (
            _sudden_changes(compiled, spec.duration, 0.5 / self._omega[0])
            if len(gone) and spec is not None
            else np.zeros((0, 2))
        )

    def _deformation(self, q: Array) -> Array:
        return np.concatenate([q[body.iq + 7 : body.iq + 7 + body.m] for body in self._bodies])

    @property
    def _frequency(self) -> float:
        return float(self._omega[0]) / (2.0 * np.pi)

    def add(self, rows: OutputBlock) -> None:
        """Take the next rows: three that stand apart by 1/ω at least give ä."""
        for t, q in zip(rows.t, rows.q, strict=True) if len(self._omega) else ():
            eta = self._deformation(q)
            self._largest[2] = max(self._largest[2], np.sqrt(eta @ self._K @ eta))
            self._add_jumps(float(t), self._parts @ eta)
            if (t - self._samples[-1, 0]) * self._omega[0] < 1.0:
                continue
            self._samples = np.vstack([self._samples[1:], np.append(t, self._parts @ eta)])
            rates = np.diff(self._samples[:, 1:], axis=0) / np.diff(self._samples[:, :1], axis=0)
            second = 2.0 * (rates[1] - rates[0]) / (t - self._samples[0, 0])
            self._take(second / self._omega**2, self._samples[1, 0])

    def _take(self, missing: Array, time: float) -> None:
        size = float(np.linalg.norm(missing))
        if size > self._largest[0]:
            self._largest[:2] = size, time

    def _add_jumps(self, t: float, a: Array) -> None:
        """What changes at once: at the start, and from the row before a jump to the one after."""
        last, slope = self._rows[1], 0.0
        if t == 0.0 and self._undeformed:
            self._take(a, t)
        for begin, end in self._sudden:
            if last[0] <= begin < t:
                if last[0] > self._rows[0, 0]:
                    slope = (last[1:] - self._rows[0, 1:]) / (last[0] - self._rows[0, 0])
                carried = last[1:] + slope * (end - last[0])
                self._waiting = np.concatenate([[end], carried, [begin]])
        if t >= self._waiting[0]:
            self._take(a - self._waiting[1:-1], self._waiting[-1])
            self._waiting = np.full_like(self._waiting, np.nan)
        self._rows = np.vstack([last, np.append(t, a)])

    def indicators(self) -> Iterator[Indicator]:
        """One of all bodies together."""
        missing, time, deformation = self._largest
        if missing > 0.0:
            share = missing / deformation
            names = ", bodies.".join(self._names)
            begin = 'start = "quasi-static" begins without them, ' if time == 0.0 else ""
            sentence = (
                f"bodies.{names}: quasi-static modes leave out vibrations from "
                f"{self._frequency:.4g} Hz on, by which the deformation would differ by "
                f"{min(share, 1.0):.0%} of its largest value, most at t = {time:.4g} s; "
                f"{begin}{self._cure}"
            )
            yield Indicator(self._names[0], "vibrations", share, time, _WARNING, lambda: sentence)


def _sudden_changes(compiled: Compiled, duration: float, span: float) -> Array:
    """(n, 2) from when to when a function of time jumps, or nearly so: within the span [s]."""
    changes = []
    for program in compiled.functions:
        if program.channels:
            continue
        times = derivative_jumps(program.ops, duration)
        largest = max(abs(evaluate(program.ops, t)[0]) for t in (0.0, *times, duration))
        for t in times:
            before, rate, _ = evaluate(program.ops, t - 1e-9 * span)
            if abs(evaluate(program.ops, t + span)[0] - before - span * rate) > _SUDDEN * largest:
                changes.append((t - 1e-9 * span, t + span))
    return np.reshape(sorted(changes), (-1, 2))
