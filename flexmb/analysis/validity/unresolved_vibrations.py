"""Vibrations of a machine that the rows of a run do not resolve.

Between rows of a slow motion accelerations change along lines. A vibration of amplitude a with a
phase φ from row to row leaves these by ω² a (1 − cos φ) cos ωt, and that sequence again by as much
of itself, (1 − cos φ)², of which a slow motion has less. So its amplitude is known, and what it
differs by as its phase is lost. Displacements tell it from forced motions. A jump is in two rows, a
vibration lasts. Where φ is near a multiple of a turn, it looks slow, and frequencies must be known:
they differ in other poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexmb.analysis.linear.state_equations import ChannelGroup
from flexmb.analysis.validity.body_accelerations import (
    LackingBody,
    displacements_in_axes_of_bodies,
    in_axes_of_bodies,
)
from flexmb.analysis.validity.pose_vibrations import LEAST_PHASE
from flexmb.engine.tables import Layout
from flexmb.flexbody.arrays import Array
from flexmb.results.output_block import OutputBlock

_NEARLY_RESOLVED = 1.4  # phase between two rows [rad] from which on some poses may not show one
_LASTING = 5  # successive rows of which a vibration is in most
# Least frequency, over that of a vibration, of what counts as one: in slow motions accelerations
# are smaller against velocities.
_SLOW = 0.1
# Displacements in a vibration are its accelerations over ω²; what they differ by, times this, is
# of forced motions: none below half of ω counts, and less of those above twice that. Rows that
# meet one twice in its period may see its accelerations and none of its velocities.
_FORCED = 1.0 / 3.0
_MOST_TURN = 0.1  # of a body between two rows [rad]
_SAME_SHAPE = 0.5  # share of a vibration in one of another pose that is the same
_SPREAD = 0.03  # of frequencies in poses that are near one
_SHARE_LEFT = 0.9  # least amplitude in the next row, over that in one: it may be damped by a method
# What is seen of an amplitude: at least; of nearly all vibrations.
_LEAST_GAIN, _MOST_GAIN = 0.09, 0.3


@dataclass(frozen=True, eq=False)
class UnresolvedVibrations:
    """Those about one row."""

    shapes: Array  # (nv, k), of unit mass, in body axes
    project: Array  # (k, nv) amplitudes of a motion in body axes
    omega: Array  # (k,) frequencies, rad/s
    damping: Array  # (k,) rate at which they decay, 1/s
    drift: Array  # (k,) by which frequencies are too large, rad/s
    shares: Array  # (bodies, k) of each body in that
    moved: Array  # (groups, k) amplitude of sensors and reactions by each

    @classmethod
    def of(
        cls, bodies: Sequence[LackingBody], motions: tuple[Array, Array], omega: Array,
        damping: Array, moved: Array, groups: Sequence[ChannelGroup], times: tuple[float, float],
    ) -> UnresolvedVibrations:  # fmt: skip
        """Of vibrations those that are unresolved and get out of phase.

        Parameters
        ----------
        bodies : sequence of LackingBody
            The bodies.
        motions : tuple of arrays
            `shapes` and `project`.
        omega, damping : (k,) array
            Frequencies [rad/s]; twice the rates at which they decay [1/s].
        moved : (2, n, k) array
            Change of channels and reactions by amplitudes, and by rates.
        groups : sequence of ChannelGroup
            These.
        times : tuple of float
            Interval between rows and duration of the run [s].
        """
        fast = cls.drift_in(bodies, motions[0], omega, times)
        X, project, omega = motions[0][:, fast], motions[1][fast], omega[fast]
        shares, decay = _drifts(bodies, X, omega), 0.5 * damping[fast].clip(0.0)
        sizes = np.hypot(moved[0, :, fast], omega[:, None] * moved[1, :, fast]).T
        by_group = np.array([np.linalg.norm(sizes[one.columns], axis=0) for one in groups])
        return cls(X, project, omega, decay, shares.sum(axis=0), shares, by_group)

    @staticmethod
    def drift_in(
        bodies: Sequence[LackingBody], X: Array, omega: Array, times: tuple[float, float]
    ) -> NDArray[np.bool_]:
        """(k,) which vibrations X (nv, k) rows may not resolve, and get out of phase in a run.

        `times` are the interval between rows and the duration of the run [s].
        """
        out_of_phase = 2.0 * _drifts(bodies, X, omega).sum(axis=0) * times[1] >= LEAST_PHASE
        return np.asarray((omega * times[0] >= _NEARLY_RESOLVED) & out_of_phase)

    def sizes(self, changes: Array, interval: float) -> Array:
        """(t, k) amplitudes by the changes of `UnresolvedChanges` in rows at an interval [s]."""
        phase, apart = self.omega * interval, _SPREAD * self.omega * interval / np.pi
        squares = 1.5 - 2.0 * np.cos(phase) * np.sinc(apart)  # mean of (1 − cos φ)²
        squares += 0.5 * np.cos(2.0 * phase) * np.sinc(2.0 * apart)
        gain = np.sqrt(np.maximum(squares, _LEAST_GAIN**2))
        once, twice, rates, places = np.abs(changes[:4] @ self.project.T)
        sizes = np.minimum(once / gain, twice / gain**2) / self.omega**2
        moved = places / gain**2
        other = np.hypot(_SLOW * rates / gain / self.omega, _FORCED * (sizes - moved))
        return _lasting((np.minimum(sizes, moved) - other).clip(0.0))

    def largest_changes(
        self, limits: Array, t: Array, largest: Array, body: NDArray[np.int64]
    ) -> tuple[Array, NDArray[np.int64]]:
        """The largest changes of each group (4, groups) and their bodies, of those so far and of
        those by limits (t, k): change, time, frequency of the mode [Hz] and its shift."""
        sizes = np.sqrt(limits**2 @ self.moved.T**2)
        largest, body = largest.copy(), body.copy()
        for k, row in enumerate(sizes.argmax(axis=0) if len(self.omega) else ()):
            if sizes[row, k] > largest[0, k]:
                j = int(np.argmax(limits[row] * self.moved[k]))
                ratio = np.sqrt(1.0 + 2.0 * self.drift[j] / self.omega[j])
                hertz = self.omega[j] / ratio / (2.0 * np.pi)
                largest[:, k] = sizes[row, k], t[row], hertz, ratio - 1.0
                body[k] = int(self.shares[:, j].argmax())
        return largest, body


class UnresolvedChanges:
    """What accelerations of a run show of vibrations that its rows do not resolve.

    Attributes
    ----------
    largest : float
        Largest acceleration of bodies by them so far, in the norm of their mass.
    """

    def __init__(self) -> None:
        self.largest = 0.0
        self._before: Array | None = None  # time and motions of the last rows
        self._number = -1  # of the pose in the last rows
        self._limits = np.zeros((2, 0))  # what its vibrations differ by; their amplitudes

    def add(
        self, layout: Layout, rows: OutputBlock, v: Array, bodies: Sequence[LackingBody]
    ) -> Array:
        """(5, t + n, nv) changes of accelerations beside those of other rows, of these changes,
        of velocities, and of the changes of positions, and velocities, up to two rows before the
        last, with those of earlier rows by which it is known what lasts.

        `v` (t, nv) are the velocities of the rows in body axes, as the changes are.
        """
        now = np.column_stack([rows.t, v, in_axes_of_bodies(layout, rows, rows.vd), rows.q])
        before = np.repeat(now[:1], _LASTING + 3, axis=0) if self._before is None else self._before
        every = np.concatenate([before, now])
        self._before = every[-_LASTING - 3 :]
        times, nv = every[:, 0], v.shape[1]
        v, a, q = np.split(every[:, 1:], [nv, 2 * nv], axis=1)
        rates, once, places = (_changes(times, one) for one in (v, a, q))
        twice, moved = (_changes(times[1:-1], one) for one in (once, places))
        displaced = displacements_in_axes_of_bodies(layout, q[2:-2], moved)
        changes = np.array([once[1:-1], twice, rates[1:-1], displaced, v[2:-2]])
        squares, h = np.zeros((2, changes.shape[1])), np.diff(times[1:-1])[1:]
        for one in bodies:  # in axes that turn far between rows slow motions are fast
            omega = v[3:-1, one.part][:, 3:6]
            changes[:2, np.linalg.norm(omega, axis=1) * h > _MOST_TURN] = 0.0
            own = changes[:2, :, one.part]
            squares += ((own @ one.accelerations.mass) * own).sum(axis=2)
        once, twice = np.sqrt(squares)[..., None]
        sizes = _lasting(np.minimum(once / _MOST_GAIN, twice / _MOST_GAIN**2))
        self.largest = max(self.largest, float(sizes.max(initial=0.0)))
        return changes

    def limits(
        self, poses: Sequence[UnresolvedVibrations], number: int, h: Array,
        changes: Array, interval: float,
    ) -> Array:  # fmt: skip
        """(t, k) what vibrations in the pose of a number can differ by after steps h (t,):
        their drift times time, twice their amplitude."""
        pose, before = poses[number], poses[self._number]
        if self._number < 0:
            self._limits = np.zeros((2, len(pose.omega)))
        elif self._number != number:
            same = np.abs(pose.project @ before.shapes)
            self._limits = self._limits @ np.where(same > _SAME_SHAPE, same, 0.0).T
        self._number, self._limits = number, self._limits.copy()
        sizes = pose.sizes(changes, interval)
        left, limits = np.exp(-np.outer(h, pose.damping)), np.empty_like(sizes)
        for k, now in enumerate(sizes):
            self._limits[1] = np.maximum(_SHARE_LEFT * left[k] * self._limits[1], now)
            differ = left[k] * self._limits[0] + pose.drift * h[k] * now
            self._limits[0] = limits[k] = np.minimum(differ, 2.0 * self._limits[1])
        return limits


def _drifts(bodies: Sequence[LackingBody], X: Array, omega: Array) -> Array:
    """(bodies, k) by which frequencies of motions X (nv, k) are too large, by each [rad/s]."""
    missing = [(X[one.part] * (one.missing @ X[one.part])).sum(axis=0) for one in bodies]
    return np.asarray(0.5 * omega**3 * missing)


def _changes(t: Array, values: Array) -> Array:
    """(t - 2, n) values of rows less those on the line between the rows beside."""
    h = np.maximum(np.diff(t), 1e-300)[:, None]
    beside = (h[1:] * values[:-2] + h[:-1] * values[2:]) / (h[1:] + h[:-1])
    return np.asarray(values[1:-1] - beside)


def _lasting(sizes: Array) -> Array:
    """(t, n) amplitudes of what is in most of the last rows."""
    lasting = np.median(sliding_window_view(sizes, _LASTING, axis=0), axis=-1)
    return np.asarray(np.sqrt(2.0) * lasting)
