"""How vibrations of a run differ for want of the geometric stiffening of its bars and blades.

A stiffness that is small changes frequencies little, and the phase of a vibration more and more.
To first order the difference δ of the motion from that with stiffening satisfies

    M δ̈ + D δ̇ + K δ = −(f − f₀),   f = Kj(t) η(t),

with Kj the geometric stiffness by the loads of each row, η the deformation, and f₀ of the first
row, about whose equilibrium a run may begin. It is solved as of modes that bodies lack
(:mod:`flexmb.analysis.validity.frequency_error`), with −∫(f − f₀) dt as the rate of S; a vibration
differs by twice its amplitude at most.

Nothing is told after bodies have turned against each other or changed their speeds by what makes
other vibrations: what is slow in one pose looks fast in the next. Loads are those of the motion
without stiffening. They lack what the shortening of a bent bar accelerates, which may be as much
again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.validity.frequency_error import NEAR, FrequencyErrorMonitor
from flexmb.analysis.validity.joined_body import bars_without_stiffening
from flexmb.analysis.validity.load_factor import LoadFactorMonitor
from flexmb.analysis.validity.modal_basis import ModalBasisMonitor
from flexmb.analysis.validity.omitted_stiffening import WIDE
from flexmb.analysis.validity.pose_vibrations import LEAST_PHASE, RESOLVED, PoseVibrations
from flexmb.engine.compile import Compiled
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent


class StiffeningResponseMonitor(FrequencyErrorMonitor):
    """Estimates what stiffening left out changes of the vibrations that sensors measure.

    Parameters
    ----------
    compiled, model, basis
        As of `FrequencyErrorMonitor`.
    load_factor : LoadFactorMonitor
        It computes the forces at all markers.
    """

    quantity = "stiffening_response"

    def __init__(
        self, compiled: Compiled, model: Model, basis: ModalBasisMonitor,
        load_factor: LoadFactorMonitor,
    ) -> None:  # fmt: skip
        super().__init__(compiled, model, basis)
        self._loads = load_factor.loads
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        bars = {one.columns.name: one for one in bars_without_stiffening(compiled, model, WIDE)}
        self._bars = [bars.get(one.name) for one in self._bodies]
        # for want of modes they would not vibrate as the run does, and get out of phase with it
        self._bodies = [
            replace(one, force=0.0 * one.force, rest=0.0 * one.rest) for one in self._bodies
        ]
        if not any(self._bars):
            self._bodies = []
        self._markers = compiled.system.parts.markers["body"]
        # largest energies of each body: of f acting on it, and of its deformation
        self._energies = np.zeros((2, len(self._bodies)))
        self._impulse = np.zeros(0)  # −∫(f − f₀) dt up to the last row
        self._first = np.zeros(0)  # −f₀
        self._left = np.zeros(1, bool)  # whether the first pose is left

    def _table(self, rows: OutputBlock) -> Array:
        """(t, columns) time; −f of each body; zero for modes left out; angular velocities."""
        loads, forces, most = self._loads(rows, np.arange(len(rows.t))), [], self._energies.copy()
        for k, (one, bar) in enumerate(zip(self._bodies, self._bars, strict=True)):
            force = np.zeros((len(rows.t), one.C.shape[1]))
            if bar is not None:
                on = np.flatnonzero(self._markers == bar.number)
                whole, own = bar.stiffness(bar.section_loads(loads, on, self._gravity))
                eta = rows.q[:, one.columns.iq + 7 : one.columns.iq + 7 + one.columns.m]
                force[:, 6:] = np.einsum("tij,tj->ti", own - whole, eta)
                moved = np.linalg.solve(one.body.K, force[:, 6:].T).T
                pairs = (force[:, 6:], moved), (eta @ one.body.K, eta)
                now = [np.einsum("ti,ti->t", *pair).max() for pair in pairs]
                most[:, k] = np.fmax(most[:, k], now)
            forces.append(force)
        self._energies = most
        modes = np.zeros((len(rows.t), sum(len(one.omega) for one in self._bodies)))
        turns = [one.accelerations.omega(rows) for one in self._bodies]
        return np.column_stack([rows.t, *forces, modes, *turns])

    def _slopes(self, every: Array, h: Array) -> tuple[Array, Array]:
        """Mean −∫(f − f₀) dt (t, forces) in the steps h between rows."""
        force = every[:, 1 : every.shape[1] - 3 * len(self._bodies)]
        if not len(self._first):
            self._first, self._impulse = force[0].copy(), np.zeros(force.shape[1])
        force = force - self._first
        before, after = force[:-1], force[1:]
        ends = self._impulse + np.cumsum(0.5 * h[:, None] * (before + after), axis=0)
        begins = np.vstack([self._impulse, ends[:-1]])
        self._impulse = ends[-1]
        rates = begins + h[:, None] * (3.0 * before + after) / 8.0
        return rates, rates

    def _may_count(self, steps: Array) -> bool:
        """Whether the stiffness that is left out may put a vibration out of phase so far."""
        stiffness = np.sqrt(self._energies[0] / self._energies[1].clip(1e-300)).max()
        return bool(0.5 * stiffness * RESOLVED * self._duration > LEAST_PHASE * self._interval[0])

    def _near(self, rows: OutputBlock) -> NDArray[np.int64]:
        """(t,) zero up to the row at which the first pose is left, and one from there on."""
        marks = self._marks(rows)
        if not self._poses:
            self._poses.append((marks[0], self._pose(rows, 0)))
        away = np.linalg.norm(marks - self._poses[0][0], axis=1) > NEAR
        away = np.maximum.accumulate(np.append(self._left, away))[1:]
        self._left = away[-1:]
        return away.astype(np.int64)

    def _integrate(
        self, number: int, t: Array, h: Array, slopes: tuple[Array, Array], table: Array,
        motions: Array,
    ) -> None:  # fmt: skip
        """Integrate over the next steps in the first pose."""
        if number == 0:
            super()._integrate(number, t, h, slopes, table, motions)

    def _pose(self, rows: OutputBlock, k: int) -> PoseVibrations:
        """The vibrations about row k; any of them may get out of phase."""
        pose = super()._pose(rows, k)
        return replace(pose, own=replace(pose.own, drift=np.abs(pose.own.values)))

    def _act_back(self, t: Array, y: Array) -> None:
        """The modes that are left out are those of another monitor."""

    def _update(self, pose: PoseVibrations, *rows: Array) -> None:
        """Keep the largest changes; the cause is the body on which f acts most."""
        super()._update(pose, *rows)
        self._body = np.full_like(self._body, self._energies[0].argmax())

    def _sentence(
        self, body: str, what: str, share: float, t: float, hertz: float, shift: float
    ) -> str:
        say = self._units.say
        return (
            f"bodies.{body}: geometric stiffening is left out, which changes a vibration of the "
            f"scene, {say(hertz * (1.0 + shift), 'Hz', 3)}, in phase or size: {what} is off by "
            f"about {percent(share)} of its range (t = {say(t, 's', 4)}); reduce it with "
            'geometric_stiffening = "full"'
        )
