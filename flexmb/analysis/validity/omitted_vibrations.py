"""Vibrations that kinetostatic modes exclude: their response along a run, over the deformation.

These are the vibrations of all flexible bodies in the first pose with the kinetostatic modes as
massless springs (static condensation), less those that remain with these modes fixed; such as a
heavy body on the compliance of a beam. Springs, gravity and other forces are not counted. The
response d of each, beyond the static one, is integrated along the run: d̈ + 2ζω ḋ + ω² d = −ä,
with a its modal part of the computed deformation, a cubic by values and rates of two rows. If a
load or an acceleration of a driver jumps or has a kink between them, a has the shape of that
function of time. So d is that of a shock spectrum: |a| for a step; 2|a sin(ωT/2)|/(ωT) after a ramp
of duration T, and |a|/(ωT) during it (Biggs, Introduction to Structural Dynamics, 1964, ch. 2).
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy

import numpy as np
from scipy.linalg import block_diag

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, n_free
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.functions_of_time import AT_ONCE, kinked_functions
from flexmb.analysis.monitors import Indicator
from flexmb.engine.bodies.static_modes import static_bodies, static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.method_selection import NONSTIFF_METHOD, STIFF_METHOD
from flexmb.errors import AssemblyError
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock

#: Words of the sentence on omitted vibrations.
LEFT_OUT = "quasi-static modes leave out vibrations"
_SAME_FREQUENCY = 0.05  # largest relative difference of frequencies of the same vibration
_WARNING_LEVEL = 0.04  # missing over whole deformation
_DAMPING = 0.002  # damping ratio of omitted vibrations: they decay to 1/e in 80 periods
_PARTS = 8  # straight lines for the shape of a function between two of its kinks
# Largest difference of the slope between two rows from the mean of both rates, over the larger,
# with which a cubic by these rates is used; the same after a kink, where a rate may be that before
# it.
_MAX_RATE_ERROR, _MAX_RATE_ERROR_AFTER_BEND = 0.3, 0.02
# Net change of a function between two rows, over its range there, from which on the change of the
# deformation between them shows its influence.
_MIN_NET_CHANGE = 0.5
_SERIES_LIMIT = 1e-2  # |λ h| below which integrals are computed by series


class VibrationResponse:
    """Response of vibrations beyond their static response, integrated step by step.

    Parameters
    ----------
    omega : (k,) array
        Their frequencies [rad/s].

    Attributes
    ----------
    turning : (k,) complex array
        ḋ − λ̄ d, with d that response and λ = −ζω + iω√(1−ζ²). Without load it is multiplied by
        exp(λ h) in a time h.
    """

    def __init__(self, omega: Array) -> None:
        self._decay = omega * complex(-_DAMPING, np.sqrt(1.0 - _DAMPING**2))
        self.turning = np.zeros(len(omega), complex)
        self._rate = np.zeros(
            len(omega)
        )  # rate of the static response at the end of the last piece

    @property
    def amplitude(self) -> Array:
        """(k,) amplitude of d if the loads stay as they are."""
        return np.asarray(np.abs(self.turning / self._decay))

    def jump(self, change: Array) -> None:
        """Change of the static response (k,) at once."""
        self.turning = self.turning + np.conj(self._decay) * change

    def follow(self, h: float, before: Array, after: Array, rates: tuple[Array, Array]) -> Array:
        """Integrate over h seconds, with the static response a cubic from `before` to `after` (k,).

        `rates` (k,) are those at both ends. A difference of the first one from the last rate, a
        kink, is an impulse on the vibrations. Returns the largest |d| (k,) in this time: the
        amplitude, if d passes it.
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
        small = np.abs(x) < _SERIES_LIMIT
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
    """Response of omitted vibrations, over the deformation.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions, which satisfy the constraints.
    """

    def __init__(self, compiled: Compiled, model: Model, q: Array) -> None:
        explicit = model.dynamics is not None and model.dynamics.method == NONSTIFF_METHOD
        still = static_coordinates(compiled.system, kinetostatic=not explicit)
        self._cure = 'deformation = "automatic" has them'
        if explicit:
            self._cure = f'method = "{STIFF_METHOD}" has those of bodies not "quasi-static"'
        self._bodies = [body for body in compiled.layout.bodies if body.m]
        self._omega, self._parts = np.zeros(0), np.zeros((0, 0))
        self._largest = np.zeros(3)  # largest response, its time, and largest deformation
        self._last = np.zeros((0, 0))  # (3, k) time, modal parts, their rates in the last row
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
            k
            for k, w in enumerate(free.omega)
            if not np.any(np.abs(remaining - w) < _SAME_FREQUENCY * w)
        ]
        self._omega = free.omega[gone]
        self._K = block_diag(*(compiled.flexbodies[body.name].K for body in self._bodies))
        self._parts = free.eta[:, gone].T @ self._K / self._omega[:, None]  # a ω per unit of eta
        self._last = np.full((3, len(gone)), np.nan)
        self._response = VibrationResponse(self._omega)
        self._bent = np.array([False])  # whether there was a kink before the last row
        spec = model.dynamics
        self._undeformed = spec is not None and spec.start == "undeformed"
        self._duration = spec.duration if spec is not None else 0.0
        self._loads = kinked_functions(compiled, self._duration) if len(gone) else []
        self._influence = np.full((len(self._loads), len(gone)), np.nan)  # of loads on the parts

    @property
    def _frequency(self) -> float:
        return float(self._omega[0]) / (2.0 * np.pi)

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
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
                    self._update_largest(self._response.amplitude, 0.0)
            elif t > last[0, 0]:
                self._advance(last, now)

    def _update_largest(self, missing: Array, time: float) -> None:
        size = float(np.linalg.norm(missing))
        if size > self._largest[0]:
            self._largest[:2] = size, time

    def _advance(self, last: Array, now: Array) -> None:
        """Integrate from one row to the next."""
        t, end = float(last[0, 0]), float(now[0, 0])
        for time, h, before, after in self._path(last, now):
            line = (after - before) / h
            rates = (line, line)
            if h == end - t:  # without kinks
                mean = 0.5 * (last[2] + now[2])
                size = max(np.linalg.norm(one) for one in (line, last[2], now[2]))
                limit = _MAX_RATE_ERROR_AFTER_BEND if self._bent[0] else _MAX_RATE_ERROR
                if np.linalg.norm(line - mean) <= limit * size:
                    rates = last[2], now[2]
            self._update_largest(self._response.follow(h, before, after, rates), time)
        self._bent = np.array([h < end - t])

    def _path(self, last: Array, now: Array) -> Iterator[tuple[float, float, Array, Array]]:
        """Start and length [s] of each piece between two rows, and the modal parts at its ends."""
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
        if abs(net) > _MIN_NET_CHANGE * np.ptp(load):
            self._influence = self._influence.copy()
            self._influence[bent] = (now[1] - last[1]) / net
        share = (grid - begin) / (end - begin)
        path = last[1] + np.outer(share, now[1] - last[1])
        beside = np.outer(load - load[0] - share * net, np.nan_to_num(self._influence[bent]))
        path += beside
        for k in range(len(grid) - 1):
            yield float(grid[k]), float(grid[k + 1] - grid[k]), path[k], path[k + 1]

    def indicators(self) -> Iterator[Indicator]:
        """One indicator of all bodies together."""
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
            yield Indicator(
                self._names[0], "vibrations", share, time, _WARNING_LEVEL, lambda: sentence
            )
