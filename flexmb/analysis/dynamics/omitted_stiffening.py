"""What geometric stiffening would change in slender bodies that are computed without it.

A bar under an axial force N(x) has the geometric stiffness Kg = ∫ N w'ᵢ w'ⱼ dx, with w' the slopes
of its modes in the body frame (Timoshenko & Gere, Theory of Elastic Stability, §1.11). N has two
parts: the forces at markers with the inertia of the bar, which are in equilibrium along its axis,
and the tension of a bow whose ends the joints hold. These ends approach each other by δ = ∫ w'²/2
dx. Joints that prevent it leave the tension h k δ, with k the axial stiffness between the ends and
h = 1 − k c, where c is the compliance between them in the mechanism: 0 if they are held, 1/k if
they are free. The body frame of mean axes turns with a deflection, and so the engine has a part of
the geometric stiffness, Kj − Kg with Kj by the slopes relative to the joints. A row has the
deformation η, C F = (1 + C (Kj − Kg)) η for a load F and the compliance C of the modes in the
mechanism, all bodies in equilibrium; with stiffening it is η' = (1 + C Kj)⁻¹ C F. The difference
η' − η is told at the position sensors on the body and on bodies joined to it, over their range,
and over the deflection.

The load factor, whether the forces would buckle the body, is the largest eigenvalue of −C Kj.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import brentq

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, one_blas_thread
from flexmb.analysis.dynamics.joined_body import (
    ModalCompliance,
    largest_sensor_change,
    position_sensors,
)
from flexmb.analysis.dynamics.linear_elasticity import (
    flexible_columns,
    joined_frame,
    joined_interfaces,
    largest_lengths,
    relative_motion,
)
from flexmb.analysis.dynamics.load_factor import (
    LoadFactorMonitor,
    Loads,
    masses_along,
    slender_axis,
)
from flexmb.analysis.dynamics.period_mean import period_mean, slow_shares, stretch
from flexmb.analysis.monitors import Indicator
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.static_response import LEAST_MOTION
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

#: Change over the deflection of the body, and of a sensor over its range, from which a run says so.
LARGEST_CHANGE, LARGEST_SENSOR_CHANGE = 0.1, 0.01
#: Load factor of a body without geometric stiffening above which a run has a note.
LARGEST_LOAD_FACTOR = 0.1
# Ratio of second moments of mass across and along a body, and distance of its middle line from a
# straight one over its length, up to which it bends as a bar.
_SLENDER, _STRAIGHT = 0.3, 0.05
_DIVISIONS = 24  # of a bar along its axis; its slopes are those between their ends
_SAME_PLACE = 5e-3  # nodes closer along the axis than this share of the length are averaged
_MIN_SHARE_OF_RUN = 0.1  # share of a run after which it may be refused
_VISIBLE = 1e-3  # change of a sensor below which that of the deflection does not matter
# Share of the largest change so far from which on the first estimate of a row is made exact.
_WORTH = 0.5


@dataclass(frozen=True, eq=False)
class _Bar:
    """A slender body without geometric stiffening, divided along its axis."""

    columns: BodyColumns
    body: FlexBody
    number: int  # in the tables of the engine
    axis: Array  # (3,) in body axes
    ends: Array  # (s + 1,) of the divisions, along the axis from the centre of mass, m
    mass: Array  # (2, s) of the divisions, and of these beyond their middles, kg
    slopes: Array  # (s, 2, m) in the body frame per unit eta
    joined: Array  # (s, 2, m) relative to the joints
    bow: Array  # (m, m) of unit force between the joined ends; zero without two of these
    span: Array  # (m,) by which these ends move apart, m per unit eta
    points: Array  # (3 k, m) displacements relative to the joints, over the length
    is_mean_axis: bool  # its frame; in one at an interface moments lack N times the deflection
    sensors: tuple[tuple[Array, Array], ...]  # channels; (3 k, m) motion of their markers

    def loaded(self, N: Array, eta: Array, compliance: Array) -> tuple[Array, Array]:
        """(t, m, m) geometric stiffness of forces N (t, s), by the slopes relative to the joints,
        and C F (t, m) of the loads by which the engine has the deformation eta."""
        weights, joined, own = N * np.diff(self.ends), self.joined, self.slopes
        Kj = np.tensordot(weights, joined.transpose(0, 2, 1) @ joined, 1)
        Kg = np.tensordot(weights, own.transpose(0, 2, 1) @ own, 1)
        return Kj, eta + np.einsum("tij,tj->ti", Kj - Kg, eta) @ compliance

    def load_factors(self, N: Array, root: Array) -> Array:
        """(t,) of axial forces N (t, s), with root rootᵀ the compliance of the modes."""
        bent = self.joined @ root
        Kg = np.tensordot(N * np.diff(self.ends), bent.transpose(0, 2, 1) @ bent, 1)
        return np.asarray(np.linalg.eigvalsh(-Kg)[:, -1].clip(0.0))

    def axial_forces(self, loads: Loads, on: IntArray, gravity: Array) -> Array:
        """(t, s) of the forces at its markers `on` and its inertia; positive if it is pulled."""
        iv = self.columns.iv + 3
        A, w, alpha = loads.A[:, self.number], loads.v[:, iv : iv + 3], loads.vd[:, iv : iv + 3]
        middle = 0.5 * (self.ends[:-1] + self.ends[1:])
        arms = self.body.center + middle[:, None] * self.axis
        far = np.einsum("ti,tij->tj", loads.vd[:, iv - 3 : iv] - gravity, A)
        turned = np.cross(alpha[:, None], arms) + np.cross(w[:, None], np.cross(w[:, None], arms))
        inertia, outer = ((far[:, None] + turned) @ self.axis) * self.mass[:, None]
        beyond = inertia.sum(axis=1, keepdims=True) - np.cumsum(inertia, axis=1) + outer
        along = np.einsum("tki,tij,j->tk", loads.forces[:, on], A, self.axis)
        places = (loads.s[:, on] - self.body.center) @ self.axis
        return np.asarray(np.einsum("tks,tk->ts", places[:, :, None] > middle, along) - beyond)

    def tension(self, compliance: Array) -> float:
        """Tension of held ends per length by which a bow would bring them together [N/m]."""
        if not self.span.any():
            return 0.0
        free = float(self.span @ np.linalg.solve(self.body.K, self.span))
        share = 1.0 - float(self.span @ compliance @ self.span) / free
        return max(share, 0.0) / free

    def change(self, N: Array, eta: Array, compliance: Array) -> tuple[Array, float]:
        """(m,) of the deformation eta by forces N (s,) and held ends; the tension of these."""
        K, loaded = (rows[0] for rows in self.loaded(N[None], eta[None], compliance))
        per_length, one = self.tension(compliance), np.eye(len(eta))

        def stiffened(tension: float) -> Array:
            both = one + compliance @ (K + tension * self.bow)
            return np.asarray(np.linalg.solve(both, loaded))

        def excess(tension: float) -> float:
            bent = stiffened(tension)
            return tension - 0.5 * per_length * float(bent @ self.bow @ bent)

        tension = 0.5 * per_length * float(eta @ self.bow @ eta)
        if tension > 0.0 and excess(tension) > 0.0:
            tension = float(brentq(excess, 0.0, tension, xtol=1e-6 * tension))
        return stiffened(tension) - eta, tension


class OmittedStiffeningMonitor:
    """Estimates what omitted geometric stiffening would change in slender bodies.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions.
    load_factor : LoadFactorMonitor
        It computes the forces at all markers.
    is_motion : bool
        Whether the rows are a motion, not separate equilibria.
    """

    def __init__(
        self,
        compiled: Compiled,
        model: Model,
        q: Array,
        load_factor: LoadFactorMonitor,
        is_motion: bool,
    ) -> None:
        self._units, self._loads, self._is_motion = model.units, load_factor.loads, is_motion
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        self._bars = [] if compiled.layout.nv > MAX_COORDINATES else list(_bars(compiled, model))
        n, most = len(self._bars), max((one.columns.m for one in self._bars), default=0)
        self._markers = [
            np.flatnonzero(compiled.system.parts.markers["body"] == one.number)
            for one in self._bars
        ]
        self._mechanism = ModalCompliance(compiled) if n else None
        self._first = (
            self._mechanism.of(q, [one.columns.name for one in self._bars])
            if self._mechanism
            else []
        )
        self._roots = [_root(C) for C in self._first]
        self._periods = np.array(
            [_period(*pair) for pair in zip(self._bars, self._first, strict=True)]
        )
        self._forces = np.full((n, _DIVISIONS), np.nan)  # mean over a period
        self._last = np.full((n, 3), np.nan)  # as of `slow_shares`: time first
        self._deflection = np.zeros(n)  # largest so far, over the length
        self._change = np.zeros((n, most))  # of the modes, in the row where it is largest
        self._load_factor = np.zeros((2, n))  # largest so far, and its time
        self._largest = np.zeros((4, n))  # deflection; time; forces; tension of a bow, N
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # range of all channels
        duration = model.dynamics.duration if model.dynamics and is_motion else 0.0
        self._settled, self._begin = _MIN_SHARE_OF_RUN * duration, np.full(1, np.nan)

    @property
    def bows(self) -> set[str]:
        """Names of the bodies of which it knows the tension of their bow."""
        return {one.columns.name for one in self._bars if one.span.any()}

    @one_blas_thread()
    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._bars or not len(rows.t):
            return
        self._begin[:] = np.where(np.isnan(self._begin), rows.t[0], self._begin)
        if rows.sensors.shape[1]:
            self._least = np.minimum(self._least, rows.sensors.min(axis=0))
            self._most = np.maximum(self._most, rows.sensors.max(axis=0))
        loads = self._loads(rows, np.arange(len(rows.t)))
        for k, one in enumerate(self._bars):
            first = one.columns.iq + 7
            eta = rows.q[:, first : first + one.columns.m]
            deflection = largest_lengths(eta, one.points)
            self._deflection[k] = max(self._deflection[k], deflection.max())
            now = one.axial_forces(loads, self._markers[k], self._gravity)
            forces = self._means(k, rows, now)
            C = self._first[k]
            factors = one.load_factors(forces, self._roots[k])
            row = int(factors.argmax())
            if factors[row] > self._load_factor[0, k]:
                self._load_factor[:, k] = factors[row], rows.t[row]
            bow = 0.5 * one.tension(C) * np.einsum("ti,ij,tj->t", eta, one.bow, eta)
            K, load = one.loaded(forces, eta, C)
            both = np.eye(len(C)) + C @ (K + bow[:, None, None] * one.bow)
            about = np.linalg.solve(both, load[..., None])[..., 0] - eta
            about = largest_lengths(about, one.points)
            for row in np.argsort(-np.minimum(about, 2 * deflection))[:2]:
                if about[row] > _WORTH * self._largest[0, k]:
                    self._solve(k, rows, int(row), forces[row], eta[row])

    def _solve(self, k: int, rows: OutputBlock, row: int, N: Array, eta: Array) -> None:
        """Compute the change of one row, in its pose, and keep it if it is the largest."""
        assert self._mechanism is not None
        one = self._bars[k]
        compliance = self._mechanism.of(rows.q[row], [one.columns.name])[0]
        change, tension = one.change(N, eta, compliance)
        moved = float(largest_lengths(change[None], one.points)[0])
        if np.isfinite(moved) and moved > self._largest[0, k]:
            lengths = np.diff(one.ends)
            self._largest[:, k] = moved, rows.t[row], float(N @ lengths / lengths.sum()), tension
            self._change[k, : one.columns.m] = change

    def _means(self, k: int, rows: OutputBlock, forces: Array) -> Array:
        """(t, s) means of the forces over a vibration period."""
        means, one, mean, last = (
            np.empty_like(forces),
            self._bars[k],
            self._forces[k],
            self._last[k],
        )
        slow, end = slow_shares(one.columns, stretch(one.body, one.axis), rows, last)
        passed = np.diff(np.append(last[0], rows.t)) / self._periods[k]
        for row in range(len(forces)):
            since = passed[row] if self._is_motion else np.nan
            mean, means[row] = period_mean(mean, since, forces[row], slow[row])
        self._forces[k], self._last[k] = mean, end
        return means

    def indicators(self) -> Iterator[Indicator]:
        """The change of each body: at its sensors, or else over its deflection."""
        for k, one in enumerate(self._bars):
            value, t = self._load_factor[:, k]
            text = partial(self._buckled, one.columns.name, value, t)
            yield Indicator(one.columns.name, "load_factor", value, t, LARGEST_LOAD_FACTOR, text)
            moved, t, force, tension = self._largest[:, k]
            if moved <= LEAST_MOTION:
                continue
            share, seen = moved / self._deflection[k], self._sensor_change(k)
            bends = share > LARGEST_CHANGE and (
                seen is None or seen > _VISIBLE or not one.is_mean_axis
            )
            value, level = share, LARGEST_CHANGE
            if seen is not None and (seen > LARGEST_SENSOR_CHANGE or not bends):
                value, level = seen, LARGEST_SENSOR_CHANGE
            text = partial(self._sentence, one, share, seen, t, force, tension)
            early = self._last[k, 0] - self._begin[0] < self._settled
            bound = 0.0 if early else min(share, share if seen is None else seen)
            yield Indicator(one.columns.name, "stiffening", value, t, level, text, bound)

    def _sensor_change(self, k: int) -> float | None:
        """Largest change of the position sensors on the body, over their range; None: no sensor."""
        one = self._bars[k]
        change, ranges = self._change[k, : one.columns.m], self._most - self._least
        return largest_sensor_change(one.body, one.sensors, ranges, change)

    def _sentence(
        self, one: _Bar, share: float, seen: float | None, t: float, force: float, tension: float
    ) -> str:
        at, say = self._units.say(t, "s", 4), partial(self._units.say, unit="N", digits=2)
        cause = f"it is {'pulled' if force > 0 else 'compressed'} with {say(abs(force))}"
        if tension > abs(force):
            cause = f"its joints hold the ends that its bow pulls together, with {say(tension)}"
        sensors = "" if not seen else f" and a sensor by {percent(seen)} of its range"
        return (
            f"bodies.{one.columns.name}: geometric stiffening is left out, which would change its "
            f"deflection by about {percent(share)}{sensors} (t = {at}: {cause}); reduce it with "
            'geometric_stiffening = "full"'
        )

    def _buckled(self, name: str, value: float, t: float) -> str:
        return (
            f"bodies.{name}: at t = {self._units.say(t, 's', 4)} it is compressed by about "
            f"{value:.2g} of the load that buckles it, yet its forces do not soften it; reduce it "
            'with geometric_stiffening = "full"'
        )


def _bars(compiled: Compiled, model: Model) -> Iterator[_Bar]:
    """The straight slender bodies without geometric stiffening."""
    numbers = compiled.system.parts.bodies["iv"]
    for columns, body in flexible_columns(compiled):
        axis, length = slender_axis(body, _SLENDER)
        if body.centrifugal_stiffness is not None or not length or body.nodes is None:
            continue
        number = int(np.flatnonzero(numbers == columns.iv)[0])
        frame = joined_frame(body, columns.name, model)
        along = (body.nodes.position - body.center) @ axis
        ends = np.linspace(along.min(), along.max(), _DIVISIONS + 1)
        across = np.linalg.svd(axis[None])[2][1:]
        middle = _means(body.nodes.position @ across.T, along, ends)
        if np.ptp(middle, axis=0).max() > _STRAIGHT * (ends[-1] - ends[0]):
            continue
        moved = _means(across @ body.nodes.Phi_t, along, ends)
        slopes = np.diff(moved, axis=0) / np.diff(ends)[:, None, None]
        joined_slopes = slopes - across @ np.cross(frame.turn.T, axis).T
        bow, span = np.zeros((columns.m,) * 2), np.zeros(columns.m)
        joined = [body.interface(place) for place in joined_interfaces(body, columns.name, model)]
        if len(joined) > 1:
            places = np.array([(one.position - body.center) @ axis for one in joined])
            a, b = int(places.argmin()), int(places.argmax())
            inside = np.clip(
                np.minimum(ends[1:], places[b]) - np.maximum(ends[:-1], places[a]), 0, None
            )
            bow = np.einsum("s,sai,saj->ij", inside.clip(0.0), slopes, slopes)
            span = axis @ (joined[b].Phi_t - joined[a].Phi_t)
        frame_of = getattr(model.bodies[columns.name], "frame_interface", None)
        points = relative_motion(body, frame)[0]
        sensors = tuple(position_sensors(compiled, model, columns, body))
        yield _Bar(
            columns, body, number, axis, ends, masses_along(body, axis, ends), slopes,
            joined_slopes, bow, span, points, frame_of is None, sensors,
        )  # fmt: skip


def _means(values: Array, along: Array, ends: Array) -> Array:
    """(s + 1, ...) means across the axis of values (k, ...) at nodes, at the `ends`."""
    step = _SAME_PLACE * (ends[-1] - ends[0])
    _, group, count = np.unique(
        np.round((along - ends[0]) / step), return_inverse=True, return_counts=True
    )
    sums = np.zeros((len(count), *values.shape[1:]))
    np.add.at(sums, group, values)
    means, places = sums.reshape(len(count), -1).T / count, np.bincount(group, along) / count
    at = np.array([np.interp(ends, places, one) for one in means])
    return at.T.reshape(len(ends), *values.shape[1:])


def _root(C: Array) -> Array:
    """A matrix R with R Rᵀ = C."""
    values, X = np.linalg.eigh(C)
    return np.asarray(X * np.sqrt(values.clip(0.0)))


def _period(bar: _Bar, compliance: Array) -> float:
    """About the longest period of a body as it is joined [s]."""
    largest = np.linalg.eigvals(compliance @ bar.body.M_eta)
    return float(2.0 * np.pi * np.sqrt(np.abs(largest).max(initial=0.0)))
