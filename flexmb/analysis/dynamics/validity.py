"""What a run cannot vouch for, of flexible bodies: warnings, and bounds beyond which it stops.

Monitors take the rows of a run in order and give indicators: one number for each body and limit,
with the moment at which it was largest. Above its warning level an indicator is a note of the run,
above the bound of `[validity]` the run is refused, at the moment when that is certain. The audit of
effects reads the same indicators.

Omitted vibrations are those that kinetostatic modes exclude: the vibrations of all flexible bodies
in the first pose with these modes as massless springs (static condensation), less those that remain
with these modes fixed; such as a heavy body on the compliance of a beam. Springs, gravity and other
forces are not counted. The response d of each, beyond the static one, is integrated along the run:
d̈ + 2ζω ḋ + ω² d = −ä, a its part of the computed deformation, a cubic by values and rates at two
rows. Where a load or an acceleration of a driver has a jump or a bend between them, a follows that
function of time. So d is what a shock spectrum has: of a step |a|; of a ramp that takes T,
2|a sin(ωT/2)|/(ωT), and |a|/(ωT) while it rises (Biggs, Introduction to Structural Dynamics, 1964,
ch. 2).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from copy import copy, deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, n_free
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.dynamics.kinked_functions import AT_ONCE, kinked_functions
from flexmb.analysis.dynamics.linear_elasticity import (
    LinearElasticityMonitor,
    loads_without_response,
    loads_without_stiffening,
)
from flexmb.analysis.dynamics.load_factor import LoadFactorMonitor
from flexmb.analysis.dynamics.modal_basis import ModalBasisMonitor
from flexmb.analysis.monitors import Indicator, Monitor
from flexmb.engine.bodies.static_modes import static_bodies, static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.method_selection import NONSTIFF_METHOD, STIFF_METHOD
from flexmb.engine.state import State
from flexmb.errors import AssemblyError
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import ValiditySpec
from flexmb.results.output_block import OutputBlock

Array = NDArray[np.float64]
#: Words of the sentence on omitted vibrations.
LEFT_OUT = "quasi-static modes leave out vibrations"
_EQUAL = 0.05  # frequencies of the same vibration differ by less
_WARNING = 0.04  # of the deformation
_DAMPING = 0.002  # ratio of vibrations that are left out: in 80 periods a start is forgotten
_PARTS = 8  # lines for the shape of a function between two of its bends
# Of a change: what rates at both ends may say otherwise of it; and where one may lack its past.
_SMOOTH, _SMOOTH_AFTER_BEND = 0.3, 0.02
_NET = 0.5  # share of the range of a function within rows from which on their difference tells it
_SERIES = 1e-2  # of a turn: below, integrals are by their series


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
        self._notes = (
            *loads_without_stiffening(compiled, model),
            *loads_without_response(compiled, model),
        )

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
    """What a monitor has gathered, in things that it replaces."""
    kinds = (np.ndarray, VibrationResponse)
    return {name: value for name, value in vars(monitor).items() if isinstance(value, kinds)}


class VibrationResponse:
    """What vibrations would do beyond following their static response, step by step.

    Parameters
    ----------
    omega : (k,) array
        Their frequencies [rad/s].

    Attributes
    ----------
    turning : (k,) complex array
        ḋ − λ̄ d, with d what they do beyond and λ = −ζω + iω√(1−ζ²): it turns and decays.
    """

    def __init__(self, omega: Array) -> None:
        self._decay = omega * complex(-_DAMPING, np.sqrt(1.0 - _DAMPING**2))
        self.turning = np.zeros(len(omega), complex)
        self._rate = np.zeros(len(omega))  # of the static response, at the end of the last piece

    @property
    def amplitude(self) -> Array:
        """(k,) amplitude of d that the loads of the moment leave."""
        return np.asarray(np.abs(self.turning / self._decay))

    def jump(self, change: Array) -> None:
        """Let the static response jump."""
        self.turning = self.turning + np.conj(self._decay) * change

    def follow(self, h: float, before: Array, after: Array, rates: tuple[Array, Array]) -> Array:
        """Let the static response go from `before` to `after` [k] in h seconds as a cubic.

        Its rates at the ends may be those of the line between. Where the piece begins, a bend kicks
        the vibrations. Returns the largest |d| (k,), the amplitude where d passes it.
        """
        begin, end = rates
        self.turning = self.turning - (begin - self._rate)
        largest, change = self.amplitude, (after - before) / h
        phase = np.angle(self.turning) / np.pi - 0.5
        passes = np.floor(phase) != np.floor(phase + self._decay.imag * h / np.pi)
        first = (6.0 * change - 4.0 * begin - 2.0 * end) / h
        last = (2.0 * begin + 4.0 * end - 6.0 * change) / h
        x = self._decay * h
        turn = np.exp(x)
        small = np.abs(x) < _SERIES
        x = np.where(small, 1.0, x)
        once = np.where(small, h * (1 + self._decay * h / 2), h * (turn - 1) / x)
        twice = np.where(
            small, h / 2 * (1 + self._decay * h / 3), h * (turn - 1 - x) / x**2
        )  # ∫ e^{λ(h − s)} s ds / h
        self.turning = turn * self.turning - first * once - (last - first) * twice
        self._rate = end
        d = self.turning.imag / self._decay.imag
        return np.where(passes, np.maximum(largest, self.amplitude), np.abs(d))


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
        explicit = model.dynamics is not None and model.dynamics.method == NONSTIFF_METHOD
        still = static_coordinates(compiled.system, kinetostatic=not explicit)
        self._cure = 'deformation = "automatic" has them'
        if explicit:
            self._cure = f'method = "{STIFF_METHOD}" has those of bodies not "quasi-static"'
        self._bodies = [body for body in compiled.layout.bodies if body.m]
        self._omega, self._parts = np.zeros(0), np.zeros((0, 0))
        self._largest = np.zeros(3)  # of what is missing, with its time, and of the deformation
        self._last = np.zeros((0, 0))  # (3, k) time, parts, their rates in the last row
        if not len(still) or n_free(compiled) > MAX_COORDINATES:
            return
        every, kinetostatic = static_bodies(compiled.system)
        rows = every if explicit else kinetostatic
        self._names = [compiled.layout.bodies[k].name for k in rows]
        scene = MechanismModes(compiled, q, list(range(len(compiled.layout.bodies))))
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
        self._last = np.full((3, len(gone)), np.nan)
        self._response = VibrationResponse(self._omega)
        self._bent = np.array([False])  # whether there was a bend before the last row
        spec = model.dynamics
        self._undeformed = spec is not None and spec.start == "undeformed"
        self._duration = spec.duration if spec is not None else 0.0
        self._loads = kinked_functions(compiled, self._duration) if len(gone) else []
        self._influence = np.full((len(self._loads), len(gone)), np.nan)  # of each on the parts

    @property
    def _frequency(self) -> float:
        return float(self._omega[0]) / (2.0 * np.pi)

    def add(self, rows: OutputBlock) -> None:
        """Take the next rows."""
        if len(self._omega):
            self._response = copy(self._response)
        for t, q, v in zip(rows.t, rows.q, rows.v, strict=True) if len(self._omega) else ():
            eta = np.concatenate([q[one.iq + 7 : one.iq + 7 + one.m] for one in self._bodies])
            rate = np.concatenate([v[one.iv + 6 : one.iv + 6 + one.m] for one in self._bodies])
            self._largest[2] = max(self._largest[2], np.sqrt(eta @ self._K @ eta))
            now = np.array([np.full(len(self._omega), t), self._parts @ eta, self._parts @ rate])
            last, self._last = self._last, now
            if np.isnan(last[0, 0]):
                if t == 0.0 and self._undeformed:
                    self._response.jump(now[1])
                    self._take(self._response.amplitude, 0.0)
            elif t > last[0, 0]:
                self._pass(last, now)

    def _take(self, missing: Array, time: float) -> None:
        size = float(np.linalg.norm(missing))
        if size > self._largest[0]:
            self._largest[:2] = size, time

    def _pass(self, last: Array, now: Array) -> None:
        """From row to row."""
        t, end = float(last[0, 0]), float(now[0, 0])
        for time, h, before, after in self._path(last, now):
            line = (after - before) / h
            rates = (line, line)
            if h == end - t:  # without bends
                mean = 0.5 * (last[2] + now[2])
                size = max(np.linalg.norm(one) for one in (line, last[2], now[2]))
                limit = _SMOOTH_AFTER_BEND if self._bent[0] else _SMOOTH
                if np.linalg.norm(line - mean) <= limit * size:
                    rates = last[2], now[2]
            self._take(self._response.follow(h, before, after, rates), time)
        self._bent = np.array([h < end - t])

    def _path(self, last: Array, now: Array) -> Iterator[tuple[float, float, Array, Array]]:
        """Beginning and length [s] of each piece, and the parts at its ends."""
        begin, end = float(last[0, 0]), float(now[0, 0])
        tiny = AT_ONCE * self._duration
        bent, grid, widest = -1, np.zeros(0), 0.0
        for k, (bends, shape, scale) in enumerate(self._loads):
            inside = bends[(bends >= begin) & (bends <= end)]
            if not len(inside):
                continue
            ends = np.unique(np.clip([begin, *(inside - tiny), *(inside + tiny), end], begin, end))
            times = np.unique(
                [a + (b - a) * x for a, b in zip(ends, ends[1:], strict=False)
                 for x in (np.arange(_PARTS + 1) / _PARTS if b - a > 3 * tiny else (0.0, 1.0))]
            )  # fmt: skip
            values = np.array([shape(float(t)) for t in times])
            if np.ptp(values) > widest * scale:
                bent, grid, load, widest = k, times, values, float(np.ptp(values)) / scale
        if bent < 0:
            yield begin, end - begin, last[1], now[1]
            return
        net = load[-1] - load[0]
        if abs(net) > _NET * np.ptp(load):
            self._influence = self._influence.copy()
            self._influence[bent] = (now[1] - last[1]) / net
        share = (grid - begin) / (end - begin)
        path = last[1] + np.outer(share, now[1] - last[1])
        beside = np.outer(load - load[0] - share * net, np.nan_to_num(self._influence[bent]))
        path += beside
        for k in range(len(grid) - 1):
            yield float(grid[k]), float(grid[k + 1] - grid[k]), path[k], path[k + 1]

    def indicators(self) -> Iterator[Indicator]:
        """One of all bodies together."""
        missing, time, deformation = self._largest
        if missing > 0.0:
            share = missing / deformation
            names = ", bodies.".join(self._names)
            begin = 'start = "quasi-static" begins without them, ' if time == 0.0 else ""
            sentence = (
                f"bodies.{names}: {LEFT_OUT} from "
                f"{self._frequency:.4g} Hz on, by which the deformation would differ by "
                f"{min(share, 1.0):.0%} of its largest value, most at t = {time:.4g} s; "
                f"{begin}{self._cure}"
            )
            yield Indicator(self._names[0], "vibrations", share, time, _WARNING, lambda: sentence)
