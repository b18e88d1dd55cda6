"""Vibrations that quasi-static modes exclude: their response along a run, over the deformation, and
at sensors and reactions.

These are the vibrations of the scene in the first pose with the mass of all modes. Springs, gravity
and other forces are not counted. The response d of each, beyond that of the run, is integrated
along it: d̈ + 2ζω ḋ + ω² d = −ä. With kinetostatic modes a is its modal part of the deformation of
the run, zero for vibrations that the run has with these modes fixed. Others are massless springs
that move with the masses at their ends: a = φᵀ ΔM η, ΔM the mass that they lack. All begin in
elastic equilibrium, also where their vibrations would not. a is a cubic by values and rates of two
rows. If a load or an acceleration of a driver jumps or has a kink between them, a has the shape of
that function of time. So d is that of a shock spectrum: |a| for a step; 2|a sin(ωT/2)|/(ωT) after a
ramp of duration T, and |a|/(ωT) during it (Biggs, Introduction to Structural Dynamics, 1964,
ch. 2).

A vibration of amplitude d moves a sensor, and adds Cqᵀ λ = ω² M φ − K φ to the reactions, in the
pose that the scene has then. Those of several vibrations are added as in shock spectra, by the root
of the sum of their squares; of one frequency, as in symmetric bodies, with their phases, since any
two combinations of such vibrations may stand for them.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy

import numpy as np
from scipy.linalg import block_diag

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, n_free
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.functions_of_time import AT_ONCE, kinked_functions
from flexmb.analysis.linear.state_equations import (
    Complex,
    StateEquations,
    channel_groups,
    least_ranges,
    sensor_amplitudes,
    which_move,
)
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.pose_vibrations import RESOLVED
from flexmb.engine.allocation import new_state
from flexmb.engine.bodies.static_modes import static_bodies, static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.method_selection import NONSTIFF_METHOD, STIFF_METHOD
from flexmb.errors import AssemblyError
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

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
# Parts of a run, in each of which sensors are looked at in one pose; where in it, as irregular
# fractions, so that not all poses of a machine that turns are one.
_POSES, _GOLDEN, _INNER = 16, 0.6180339887, 0.9
_SMALL = 1e-3  # response over the deformation below which sensors are not looked at
# Share of the mass of a vibration from which on that left out changes it; that up to which the
# run has it.
_LEAST_SHARE, _MOST_SHARE = 1e-3, 0.9
_LARGE = 0.1  # amplitude over the largest of a vibration whose frequency is told


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
        self._rate = np.zeros(len(omega))  # of the static response at the end of the last piece

    @property
    def amplitude(self) -> Complex:
        """(k,) amplitude of d, with its phase, if the loads stay as they are."""
        return np.asarray(self.turning / np.abs(self._decay))

    def jump(self, change: Array) -> None:
        """Change of the static response (k,) at once."""
        self.turning = self.turning + np.conj(self._decay) * change

    def follow(self, h: float, before: Array, after: Array, rates: tuple[Array, Array]) -> Complex:
        """Integrate over h seconds, with the static response a cubic from `before` to `after` (k,).

        `rates` (k,) are those at both ends. A difference of the first one from the last rate, a
        kink, is an impulse on the vibrations. Returns the largest |d| (k,) in this time, the
        amplitude if d passes it, with the phase of d.
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
        motion, d = self.amplitude, np.abs(self.turning.imag / self._decay.imag)
        most = np.where(np.abs(motion) > np.abs(largest), motion, largest)
        return np.where(passes, most, d * np.exp(1j * np.angle(motion)))


class OmittedVibrationMonitor:
    """Response of omitted vibrations, over the deformation and at sensors and reactions.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions, which satisfy the constraints.
    """

    def __init__(self, compiled: Compiled, model: Model, q: Array) -> None:
        self._compiled, self._model, self._units = compiled, model, model.units
        explicit = model.dynamics is not None and model.dynamics.method == NONSTIFF_METHOD
        self._bodies = [body for body in compiled.layout.bodies if body.m]
        self._omega, self._parts = np.zeros(0), np.zeros((2, 0, 0))
        self._largest = np.zeros(3)  # largest response, its time, and largest deformation
        self._last = np.zeros((0, 0))  # (3, k) time, modal parts, their rates in the last row
        if not len(static_coordinates(compiled.system)) or n_free(compiled) > MAX_COORDINATES:
            return
        every, kinetostatic = static_bodies(compiled.system)
        self._names = [compiled.layout.bodies[k].name for k in every]
        still = static_coordinates(compiled.system, kinetostatic=not explicit)
        self._cure = f'deformation = "{"automatic" if kinetostatic else "dynamic"}" has them'
        if explicit:
            self._cure = f'method = "{STIFF_METHOD}" has those of bodies not "quasi-static"'
        scene = MechanismModes(compiled, q, list(range(len(compiled.layout.bodies))))
        flexible = [k for k, body in enumerate(compiled.layout.bodies) if body.m]
        try:
            self._omega, X, _ = self._vibrations(q)
            remaining = scene.vibrations(*flexible, still=still).omega
        except (AssemblyError, np.linalg.LinAlgError):  # motions without inertia
            self._omega = np.zeros(0)
            return
        near = np.abs(remaining - self._omega[:, None]) < _SAME_FREQUENCY * self._omega[:, None]
        self._gone = gone = np.asarray(~near.any(axis=1))
        self._K = block_diag(*(compiled.flexbodies[body.name].K for body in self._bodies))
        self._modal = np.concatenate([one.iv + 6 + np.arange(one.m) for one in self._bodies])
        self._places = np.concatenate([one.iq + 7 + np.arange(one.m) for one in self._bodies])
        self._shapes = X[self._modal]
        by_deformation = self._shapes.T @ self._K / self._omega[:, None]  # a ω per unit of eta
        lacking, beginning = by_deformation * gone[:, None], by_deformation
        apart = np.diff(self._omega, prepend=self._omega[:1]) > _DAMPING * self._omega
        self._frequency = np.cumsum(apart)  # (k,) number: vibrations of one are in phase
        self._share = np.zeros(len(gone))  # of the mass of each vibration that the run lacks
        if len(still):
            beginning = lacking
        else:
            lacking = self._shapes.T @ self._missing_mass()
            self._share = (lacking * self._shapes.T).sum(axis=1).clip(0.0, _MOST_SHARE)
            lacking = lacking * self._omega[:, None]
        self._rates = np.zeros(len(gone), complex)  # largest of vibrations that rows do not resolve
        self._slope = np.full(len(gone), np.nan)  # of the modal parts, to the last row
        self._begun = np.full(1, np.nan)  # time of the first row
        self._parts = np.stack([lacking, beginning])
        self._last = np.full((3, len(gone)), np.nan)
        self._response = VibrationResponse(self._omega)
        self._bent = np.array([False])  # whether there was a kink before the last row
        spec = model.dynamics
        self._undeformed = spec is not None and spec.start == "undeformed"
        self._duration = spec.duration if spec is not None else 0.0
        self._loads = kinked_functions(compiled, self._duration) if len(gone) else []
        self._influence = np.full((len(self._loads), len(gone)), np.nan)  # of loads on the parts
        self._begin = np.zeros(1)  # response to the start
        # Largest d ω of each part of the run, with their phases.
        self._amplitudes = np.zeros((_POSES, len(gone)), complex)
        self._changes: dict[int, Array] = {}  # of channels and reactions, in a pose of each part
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # of these in the run
        self._equations: StateEquations | None = None

    def _vibrations(self, q: Array) -> tuple[Array, Array, Array]:
        """Those of the scene with the mass of all modes, in the pose q."""
        every = list(range(len(self._compiled.layout.bodies)))
        return MechanismModes(self._compiled, q, every, every_mass=True).vibrations_with_reactions()

    def _missing_mass(self) -> Array:
        """(m, m) mass of the modes of all bodies that quasi-static modes lack."""
        parts, blocks = self._compiled.system.parts, list[Array]()
        for one in self._bodies:
            row = parts.bodies[parts.bodies["iv"] == one.iv][0]
            at = int(row["flex"]) + 12 * one.m
            mass = parts.pool[at : at + one.m**2].reshape(one.m, one.m)
            blocks.append(self._compiled.bodies[one.name].M_eta - mass)
        return np.asarray(block_diag(*blocks))

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not len(self._omega) or not len(rows.t):
            return
        self._response, self._amplitudes = copy(self._response), self._amplitudes.copy()
        every = np.hstack([rows.sensors, rows.reactions])
        self._least = np.minimum(self._least, every.min(axis=0))
        self._most = np.maximum(self._most, every.max(axis=0))
        for k, t in enumerate(rows.t):
            eta, rate = rows.q[k, self._places], rows.v[k, self._modal]
            self._largest[2] = max(self._largest[2], np.sqrt(eta @ self._K @ eta))
            parts = self._parts[0]
            now = np.array([np.full(len(self._omega), t), parts @ eta, parts @ rate])
            last, self._last = self._last, now
            self._begun = np.where(np.isnan(self._begun), t, self._begun)
            if np.isnan(last[0, 0]):
                if t == 0.0 and self._undeformed:
                    self._response.jump(self._parts[1] @ eta)
                    self._update_largest(self._response.amplitude, 0.0)
                    self._begin = self._largest[:1].copy()
            elif t > last[0, 0]:
                self._advance(last, now)
            self._add_pose(rows, k)

    def _add_pose(self, rows: OutputBlock, k: int) -> None:
        """Compute what vibrations change in the pose of row k, if its part of the run has none."""
        share = _POSES * rows.t[k] / self._duration if self._duration else 0.0
        part = min(int(share), _POSES - 1)
        large = self._largest[0] > _SMALL * self._largest[2]
        if large and part not in self._changes and share - part >= part * _GOLDEN % 1.0 * _INNER:
            try:
                self._changes[part] = self._changes_of(rows, k)
            except np.linalg.LinAlgError:
                self._changes[part] = np.zeros((2, len(self._least), len(self._omega)))

    def _changes_of(self, rows: OutputBlock, k: int) -> Array:
        """(2, n, k) changes of channels and reactions in the pose of a row, per unit of d ω."""
        compiled = self._compiled
        if self._equations is None:
            state = new_state(compiled.system, len(compiled.layout.channels))
            self._equations = StateEquations(compiled, state)
        equations = self._equations
        equations.set_row(rows, k)
        omega, X, forces = self._vibrations(rows.q[k])
        Cq = equations.tangents().Cq
        lam = np.asarray(np.linalg.lstsq(Cq.T, forces, rcond=None)[0], np.float64)
        change = sensor_amplitudes(equations, omega, X, lam)
        turn = X[self._modal].T @ self._K @ self._shapes / omega[:, None] ** 2
        change = change[:, : len(self._least)]  # an audit's rows have no reactions
        return np.asarray(change @ turn / self._omega)

    def _larger(self, now: Complex, before: Complex) -> Complex:
        """(k,) of the vibrations of each frequency those that are larger."""
        sizes = (np.bincount(self._frequency, np.abs(x) ** 2) for x in (now, before))
        return np.where(np.greater(*sizes)[self._frequency], now, before)

    def _update_largest(self, missing: Complex, time: float) -> None:
        part = min(int(_POSES * time / self._duration), _POSES - 1) if self._duration else 0
        self._amplitudes[part] = self._larger(missing, self._amplitudes[part])
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
            missing = self._response.follow(h, before, after, rates)
            self._update_largest(missing, time)
        self._bent = np.array([h < end - t])
        slope = (now[1] - last[1]) / (end - t)
        rates, self._slope = last[2] - 0.5 * (slope + self._slope), slope
        self._update_largest(self._beats(end - t, rates, end), end)

    def _beats(self, h: float, rates: Array, time: float) -> Complex:
        """(k,) amplitude of d where the run itself vibrates faster than rows show.

        `rates` (k,) are those of a in a row, less the mean slope of the steps h beside it. With the
        share μ of the mass left out, the run vibrates with ω' = ω/√(1−μ), and d is twice its
        amplitude times sin((ω' − ω) t/2).
        """
        fast = (self._omega * h > RESOLVED) & (self._share > _LEAST_SHARE)
        self._rates = self._larger(np.where(fast, rates, 0.0), self._rates)
        own, share = self._omega / np.sqrt(1.0 - self._share), self._share.clip(_LEAST_SHARE)
        beat = np.sin(np.minimum(0.5 * (own - self._omega) * (time - self._begun), 0.5 * np.pi))
        return np.asarray(2.0 * beat * self._rates / (own * share))

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
        if missing <= 0.0:
            return
        share, (where, change) = missing / deformation, self._largest_change()
        parts = [
            (share, "the deformation", f"{min(share, 1.0):.0%} of its largest value"),
            (change, where, f"about {percent(change)} of its range with them"),
        ]
        large = [one for one in parts if one[0] > _WARNING_LEVEL] or parts[:1]
        words = f"{large[0][1]} would differ by {large[0][2]}"
        words += "".join(f" and {one[1]} by {one[2]}" for one in large[1:])
        names, most = ", bodies.".join(self._names), np.abs(self._amplitudes).max(axis=0)
        most = most * self._gone if self._gone.any() else most
        lowest = self._omega[most >= _LARGE * most.max()].min() / (2.0 * np.pi)
        begin = bool(self._begin[0] > 0.5 * missing)
        cure = 'start = "quasi-static" begins without them, ' * begin + self._cure
        sentence = (
            f"bodies.{names}: {LEFT_OUT} from {lowest:.4g} Hz on, by which {words}, most at t = "
            f"{0.0 if begin else time:.4g} s; {cure}"
        )
        value = max(share, change)
        yield Indicator(self._names[0], "vibrations", value, time, _WARNING_LEVEL, lambda: sentence)

    def _largest_change(self) -> tuple[str, float]:
        """The sensor or reaction that vibrations change most, and that over its range with them."""
        if not self._changes:
            return "", 0.0
        first, parts = np.unique(self._frequency, return_index=True)[1], list[Array]()
        for part in np.flatnonzero(self._amplitudes.any(axis=1)):
            change = self._changes[min(self._changes, key=lambda k: abs(k - part))]
            own = np.add.reduceat(change * self._amplitudes[part], first, axis=2)
            parts.append((np.abs(own) ** 2).sum(axis=(0, 2)))
        changes, ranges = np.sqrt(np.max(parts, axis=0)), self._most - self._least
        groups = list(channel_groups(self._compiled, self._model, len(ranges)))
        change, wide = (
            np.array([np.linalg.norm(x[one.columns]) for one in groups]) for x in (changes, ranges)
        )
        wide = np.maximum(2.0 * change, wide)
        least = least_ranges(self._compiled, groups, self._duration)
        moves = which_move(groups, wide) & (wide > least)
        shares = np.where(moves, change / np.maximum(wide, 1e-300), 0.0)
        k = int(shares.argmax()) if groups else 0
        return (groups[k].name, float(shares[k])) if shares.any() else ("", 0.0)
