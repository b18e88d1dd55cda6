"""Errors of natural frequencies by modes that flexible bodies do not have, in the motion of a run.

The modes that a body has are static responses and some vibrations. Those of the joined machine are
combinations of them, and too fast: what the body lacks would move with them, and has mass. Near a
resonance a small error of a frequency is a large one of the motion.

What a body lacks follows its accelerations x as y = C x/ω² (a static response), or as oscillators
where it is stored as modes (:class:`flexmb.flexbody.OmittedModes`), and acts on the body by −Cᵀ ÿ.
Tension of a bar with geometric stiffening raises their frequencies ω (`LackingBody.tightening`).
So the difference δ of the motion from that of the full model satisfies, in the mechanism and
linearised about a row of the run,

    (M + ΔM) δ̈ + D δ̇ + K δ = d²S/dt²,   S = R x,   R = Σ CᵀC/ω²,

with R the strain energy that is missing under accelerations, and ΔM such that the frequencies are
lowered as they should be (:mod:`flexmb.analysis.validity.pose_vibrations`). Accelerations x and the
second derivative of S are those in space, where a shaft that turns faster than it whirls moves
slowly (:mod:`flexmb.analysis.validity.body_accelerations`). Where the modes begin at rest those
that are left out do too, so that the rate of S jumps from zero there. S is taken as linear between
rows, which is solved exactly. Of vibrations that the rows do not resolve the amplitudes count, and
their phase (:mod:`flexmb.analysis.validity.unresolved_vibrations`). Matrices are those of the row,
with the springs, forces and damping there; they are computed again where the pose or the speed of
rotation differs, and used for all rows near it. Loads at nodes move what is left out too.

An undamped vibration is δ = ∫ cos ω(t − s) dS(s), so that the total variation of S, in norms of the
mass matrices of the bodies, is a bound of δ whatever the frequencies, poses and joints. While it is
too small to matter at any marker, nothing else is computed.

What impacts make of S is larger than what the run vibrates with. A vibration of the run differs by
its phase, the drift of its frequency times time less what damping forgets, times its amplitude, and
by twice that at most: no more is counted (`PoseVibrations.phase_limits`).
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, one_blas_thread
from flexmb.analysis.assembly.mechanism_modes import mobilities
from flexmb.analysis.linear.observer import MinimalEquations, RowsAlongMotion, body_axes
from flexmb.analysis.linear.state_equations import (
    StateEquations,
    amplitudes_of,
    by_unit,
    channel_groups,
    least_ranges,
    relative_poses,
    relative_rotations,
    which_move,
)
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.body_accelerations import (
    MAX_PHASE_STEP,
    LackingBody,
    in_axes_of_bodies,
)
from flexmb.analysis.validity.linear_elasticity import flexible_columns
from flexmb.analysis.validity.modal_basis import ModalBasisMonitor
from flexmb.analysis.validity.pose_vibrations import (
    RESOLVED,
    PoseVibrations,
    energies_of_vibrations,
)
from flexmb.analysis.validity.unresolved_vibrations import UnresolvedChanges, UnresolvedVibrations
from flexmb.engine.allocation import new_state
from flexmb.engine.bodies.static_modes import static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.flexbody.arrays import Array
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

#: Change of a sensor or reaction over its range from which a run says so.
LARGEST_CHANGE = 0.01
_NEAR = 0.4  # rotation between two bodies [rad], or speed over frequency, of another pose
_MOST_POSES = 24
_EXACT_POSES = 3  # with exact frequencies, after which no others are computed
_SMALL_CHANGE = 0.5 * LARGEST_CHANGE  # below which the bound of a change needs no further look
_MOST_TURN = 2.0 * np.pi  # of a body between two rows [rad]: what it lacks is not known beyond


class FrequencyErrorMonitor:
    """Estimates what errors of natural frequencies change at sensors and reactions of a run.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    basis : ModalBasisMonitor
        Tells the loads at nodes, and is told the energy of modes that are left out. It has the rows
        before this one.
    """

    def __init__(self, compiled: Compiled, model: Model, basis: ModalBasisMonitor) -> None:
        self._basis = basis
        self._compiled, self._model, self._units = compiled, model, model.units
        gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        still = len(static_coordinates(compiled.system)) > 0
        small = compiled.layout.nv <= MAX_COORDINATES
        pairs = flexible_columns(compiled) if small and not still else ()
        every = [LackingBody.of(*pair, gravity) for pair in pairs]
        self._bodies = [one for one in every if one is not None]
        self._places = [k for k, one in enumerate(every) if one is not None]  # in the basis
        self._numbers = [compiled.layout.bodies.index(one.columns) for one in self._bodies]
        self._n = len(compiled.layout.channels) + 12 * len(compiled.layout.reactions)
        groups = channel_groups(compiled, model, self._n) if self._bodies else ()
        self._groups = [one for one in groups if one.derivatives >= 0]
        self._powers = np.array([one.derivatives for one in self._groups], np.int64)
        self._columns = np.array([k for one in self._groups for k in one.columns], np.int64)
        self._poses: list[tuple[Array, PoseVibrations, UnresolvedVibrations]] = []
        self._equations: StateEquations | None = None
        self._reach: tuple[Array, list[Array]] | None = None
        self._variation, self._counts = np.zeros(1), np.zeros(1, bool)
        self._joined = relative_rotations(compiled, model)
        n_o, nv = sum(len(one.omega) for one in self._bodies), compiled.layout.nv
        self._duration = model.dynamics.duration if model.dynamics else 0.0
        self._mass = float(compiled.system.parts.bodies["mass"].sum())
        self._slowest = 1.0 / (self._duration or np.inf)
        self._least_ranges = least_ranges(compiled, self._groups, self._duration)
        # States of the mean tensions; means up to each of the rows at hand.
        self._tensions, self._tension = np.full((len(self._bodies), 3), np.nan), np.zeros((0, 0))
        self._tightest = np.zeros(len(self._bodies))  # largest mean tension so far
        self._interval = np.zeros(1)  # between rows, s
        self._since = np.full(1, np.inf)  # when the integration began
        self._row = np.zeros((0, 1))  # time and forces of the last row, and their last rate
        self._limits, self._limited = np.zeros((2, 0)), np.array(-1)  # of vibrations; their pose
        self._unresolved = UnresolvedChanges()
        self._state = np.zeros(2 * (nv + n_o))  # difference of the motion, body axes; of y; rates
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # range of all channels
        self._largest = np.zeros((4, len(self._groups)))  # change; time; mode: frequency, shift
        self._body = np.zeros(len(self._groups), np.int64)  # that has the largest share in it

    @one_blas_thread()
    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._bodies or not self._groups or not len(rows.t):
            return
        values = np.zeros((len(rows.t), self._n))  # an audit's rows have no reactions
        values[:, : rows.sensors.shape[1]] = rows.sensors
        values[:, self._n - rows.reactions.shape[1] :] = rows.reactions
        self._least = np.minimum(self._least, values.min(axis=0))
        self._most = np.maximum(self._most, values.max(axis=0))
        pairs = zip(self._bodies, self._tensions, strict=True)
        self._tension = np.array([one.mean_tension(rows, state) for one, state in pairs])
        table = self._table(rows)
        if not len(self._row):  # modes that are left out begin at rest if the others do
            at_rest = all(not rows.v[0, one.part][6:].any() for one in self._bodies)
            rates = np.full(table.shape[1], 0.0 if at_rest else np.nan)
            self._row = np.vstack([table[0], rates])
        every = np.vstack([self._row[0], table])
        h = np.diff(every[:, 0])
        if not self._interval[0]:
            if not h.any():
                return
            self._interval = np.array([np.median(h[h > 0.0])])
        slopes = self._slopes(every, h)
        self._unresolved = copy(self._unresolved)
        v = in_axes_of_bodies(self._compiled.layout, rows, rows.v)
        changes = self._unresolved.add(self._compiled.layout, rows, v, self._bodies)
        self._counts |= self._may_count(slopes[1] * h[:, None])
        if not self._counts[0]:
            self._rest(table[-1])
            return
        near = self._near(rows)
        for part in np.split(np.arange(len(near)), np.flatnonzero(np.diff(near)) + 1):
            at, number = slice(part[0], part[-1] + 1), near[part[0]]
            both = slopes[0][at], slopes[1][at]
            own = changes[:, at.start : changes.shape[1] - len(h) + at.stop]
            motions = own[[2, 4], -len(h[at]) :]
            self._integrate(number, rows.t[at], h[at], both, table[at], motions)
            self._add_unresolved(number, rows.t[at], h[at], own)

    def _table(self, rows: OutputBlock) -> Array:
        """(t, columns) time; forces: S of each body, in body axes, then y of its modes;
        angular velocities of the bodies."""
        parts, modes = [], []
        loads = self._basis.node_loads(rows)
        for one, k, tension in zip(self._bodies, self._places, self._tension, strict=True):
            x = one.accelerations.of_material(rows)
            y = (x @ one.force.T + one.load_forces(loads[k])) / one.omega_squares(tension)
            parts.append((x @ one.rest + y @ one.force) @ one.C)
            modes.append(y)
        turns = [one.accelerations.omega(rows) for one in self._bodies]
        return np.column_stack([rows.t, *parts, *modes, *turns])

    def _slopes(self, every: Array, h: Array) -> tuple[Array, Array]:
        """Rates (t, forces) in the steps h between rows, in body axes before and after them."""
        first, turns = 0, every.shape[1] - 3 * len(self._bodies)
        forces = every[:, 1:turns]
        after = np.diff(forces, axis=0)
        before = after.copy()
        for k, one in enumerate(self._bodies):
            own = slice(first, first + one.C.shape[1])
            omega = every[:, turns + 3 * k : turns + 3 * k + 3]
            angle = 0.5 * h[:, None] * (omega[1:] + omega[:-1])
            small = (np.linalg.norm(angle, axis=1) < _MOST_TURN)[:, None]
            angle = np.where(small, angle, 0.0)
            turn = one.accelerations.in_turned_axes
            after[:, own] = small * (forces[1:, own] - turn(forces[:-1, own], angle))
            before[:, own] = turn(after[:, own], -angle)
            first = own.stop
        steps = np.maximum(h, 1e-300)[:, None]
        return before / steps, after / steps

    def _may_count(self, steps: Array) -> bool:
        """Whether the variation of the forces so far may change a sensor by what counts."""
        self._reach = reach, roots = self._reach or mobilities(self._compiled)
        first, squares = 0, np.zeros(len(steps))
        for one, number in zip(self._bodies, self._numbers, strict=True):
            own = slice(first, first + one.C.shape[1])
            squares += ((steps[:, own] @ roots[number]) ** 2).sum(axis=1)
            first = own.stop
        self._variation += np.sqrt(squares).sum()
        fastest = RESOLVED / self._interval[0]
        force, size = float(np.sqrt(self._mass)), self._compiled.length
        bounds = by_unit(self._groups, force, force * size, reach[1], reach[0])
        size = max(self._variation[0], self._unresolved.largest / fastest**2)
        changes = 2.0 * size * bounds * fastest**self._powers  # of both ends
        return not bool(np.all(changes <= _SMALL_CHANGE * self._ranges()))

    def _ranges(self) -> Array:
        """Range of each group so far; infinite for one that does not move."""
        ranges = self._most - self._least
        sizes = np.array([ranges[one.columns].max() for one in self._groups])
        moves = which_move(self._groups, sizes) & (sizes > self._least_ranges)
        return np.where(moves, sizes, np.inf)

    def _near(self, rows: OutputBlock) -> NDArray[np.int64]:
        """(t,) number of the pose whose vibrations count for each row; new ones are computed."""
        marks, near = self._marks(rows), np.zeros(len(rows.t), np.int64)
        if not self._poses:
            self._poses.append((marks[0], *self._pose(rows, 0)))
        away = [np.linalg.norm(marks - mark, axis=1) for mark, *_ in self._poses]
        first = 0
        while first < len(marks):
            exact = all(pose.is_exact(self._duration) for _, pose, _ in self._poses)
            most = _EXACT_POSES if exact else _MOST_POSES
            to_pose = np.array(away)[:, first:]
            far = np.flatnonzero(to_pose.min(axis=0) > _NEAR)
            last = first + int(far[0]) if len(far) and len(away) < most else len(marks)
            near[first:last] = to_pose[:, : last - first].argmin(axis=0)
            if last < len(marks):
                self._poses.append((marks[last], *self._pose(rows, last)))
                near[last] = len(away)
                away.append(np.linalg.norm(marks - marks[last], axis=1))
            first = last + 1
        return near

    def _marks(self, rows: OutputBlock) -> Array:
        """(t, n) poses of bodies; speeds of flexible ones over a frequency; tension."""
        parts = relative_poses(self._compiled, self._joined, rows.q)
        for n, (one, tension) in enumerate(zip(self._bodies, self._tension, strict=True)):
            mass = max(np.linalg.eigvalsh(one.body.M_eta)[-1], 1e-300)  # the largest modal one
            lowest = np.sqrt(np.linalg.eigvalsh(one.body.K)[0] / mass)
            iv = one.columns.iv
            parts.append(rows.v[:, iv + 3 : iv + 6] / lowest)
            largest = np.maximum.accumulate(np.append(self._tightest[n], tension))[1:]
            own = np.arange(len(self._bodies)) == n
            self._tightest = np.where(own, largest[-1], self._tightest)
            parts.append(np.log1p(largest / one.tightening[1])[:, None])
        return np.hstack(parts)

    def _pose(self, rows: OutputBlock, k: int) -> tuple[PoseVibrations, UnresolvedVibrations]:
        """The vibrations about row k."""
        compiled = self._compiled
        if self._equations is None:
            state = new_state(compiled.system, len(compiled.layout.channels))
            self._equations = StateEquations(compiled, state)
        equations, state = self._equations, self._equations.state
        equations.set_row(rows, k)
        fastest = max(self._bodies, key=lambda one: float(np.linalg.norm(state.v[one.part][3:6])))
        along, tangents = RowsAlongMotion(compiled, state), equations.tangents()
        of = MinimalEquations(along, tangents, fastest.columns.name)
        moves = ~of.coordinates.states
        N, Nd = of.coordinates.N[:, moves], of.coordinates.Nd[:, moves]
        M, D, K = (X[np.ix_(moves, moves)] for X in (of.mass, of.damping, of.stiffness))
        try:
            squares, T = eigh(0.5 * (K + K.T), 0.5 * (M + M.T))
        except np.linalg.LinAlgError:  # a motion without inertia
            squares, T = np.zeros(0), np.zeros((len(M), 0))
        omega = np.sqrt(squares.clip(0.0))
        seen = omega * self._interval[0] < RESOLVED
        S = of.change.S  # from the axes of the observer to those of the engine
        axes = np.eye(len(S))  # from those to body axes
        for body, A in zip(compiled.layout.bodies, body_axes(compiled, state.q), strict=True):
            axes[body.iv : body.iv + 3, body.iv : body.iv + 3] = A.T
        X, Xd = axes @ S @ N @ T, axes @ S @ Nd @ T
        project = T.T @ N.T @ of.at.M @ np.linalg.inv(axes @ S)
        times = float(self._interval[0]), self._duration
        bodies = [
            replace(one, omega=np.sqrt(one.omega_squares(tension[[k]])[0]))
            for one, tension in zip(self._bodies, self._tension, strict=True)
        ]
        some = seen | UnresolvedVibrations.drift_in(bodies, X, omega, times)
        T, X, Xd, project = T[:, some], X[:, some], Xd[:, some], project[some]
        omega, seen = omega[some], seen[some]
        moved = amplitudes_of(equations, tangents, S @ N @ T, np.fmax(omega, self._slowest))
        D, K = T.T @ D @ T, T.T @ K @ T
        all_ = bodies, (X, project), omega, D.diagonal(), moved, self._groups, times
        fast = UnresolvedVibrations.of(*all_)
        of_rows, turns = np.ix_(seen, seen), [rows.v[k, one.part][3:6] for one in self._bodies]
        motions = X[:, seen], Xd[:, seen], project[seen]
        matrices, moved = (D[of_rows], K[of_rows]), moved[..., seen]
        return PoseVibrations.of(bodies, motions, omega[seen], matrices, moved, turns, times), fast

    def _integrate(
        self, number: int, t: Array, h: Array, slopes: tuple[Array, Array], table: Array,
        motions: Array,
    ) -> None:  # fmt: skip
        """Integrate over steps h to times t, with rows of the table and motions of the run."""
        pose, before = self._poses[number][1], self._poses[self._limited][1]
        nv, d = self._compiled.layout.nv, len(pose.omega)
        if pose.is_exact(self._duration) or not len(pose.values):
            self._rest(table[-1])
            return
        half = len(self._state) // 2
        now = pose.project @ self._state[:nv]
        rates = pose.project @ (self._state[half : half + nv] - pose.shape_rates @ now)
        parts = now, self._state[nv:half], rates, self._state[half + nv :]
        z = pose.start @ np.concatenate(parts)
        n_forces = slopes[1].shape[1]
        last = None if np.isnan(self._row[1, 1]) else self._row[1, 1 : 1 + n_forces]
        amplitudes = np.zeros((len(h) + 1, len(pose.values)), complex)
        amplitudes[0], kicks = z, np.zeros((len(h), len(z)), complex)
        for k in range(len(h)):
            if h[k] > 0.0:
                if last is not None:
                    kicks[k] = pose.kick @ (slopes[0][k] - last)
                last = slopes[1][k]
            z = np.exp(pose.values * h[k]) * (z + kicks[k])
            amplitudes[k + 1] = z
        row = np.full(table.shape[1], np.nan)
        if last is not None:
            row[1 : 1 + n_forces] = last
        self._row = np.vstack([table[-1], row])
        states = (amplitudes @ pose.vectors.T).real
        n = states.shape[1] // 2
        times = np.append(t[0] - h[0], t)
        self._since = np.minimum(self._since, times[0])
        mean = (amplitudes[:-1] + 0.5 * kicks) * pose.values
        mean += kicks / np.where(h > 0.0, h, np.inf)[:, None]
        accelerations = (mean @ pose.vectors.T).real[:, n : n + d]
        if self._limited < 0:
            self._limits = np.zeros((2, 2 * d))
        elif self._limited != number:
            self._limits = pose.sizes_of(before, self._limits, self._duration)
        self._limited = np.array(number)
        limits = pose.phase_limits(h, motions, self._limits)
        both = states[:-1, :d], states[:-1, n : n + d]
        self._update(pose, times[:-1], *both, accelerations, limits)
        self._act_back(times, states[:, d:n])
        end = states[-1]
        rates = pose.shapes @ end[n : n + d] + pose.shape_rates @ end[:d]
        self._state = np.concatenate([pose.shapes @ end[:d], end[d:n], rates, end[n + d :]])

    def _add_unresolved(self, number: int, t: Array, h: Array, changes: Array) -> None:
        """Update the largest changes by vibrations that the rows do not resolve."""
        (_, pose, fast), poses = self._poses[number], [one for *_, one in self._poses]
        limits = self._unresolved.limits(poses, number, h, changes, float(self._interval[0]))
        counts = ~((self._powers == 2) & pose.own.is_turned(self._duration))
        largest, body = fast.largest_changes(limits, t, self._largest, self._body)
        self._largest = np.where(counts, largest, self._largest)
        self._body = np.where(counts, body, self._body)

    def _rest(self, row: Array) -> None:
        """Go to a row of the table without a difference of the motion."""
        self._row = np.vstack([row, np.full_like(row, np.nan)])
        self._state = np.zeros_like(self._state)
        self._since = np.full(1, np.inf)

    def _act_back(self, t: Array, y: Array) -> None:
        """Tell the modal basis the vibrations y (t, o) of modes that are left out."""
        first = 0
        for one, k in zip(self._bodies, self._places, strict=True):
            own = y[:, first : first + len(one.omega)]
            resolved = one.omega * self._interval[0] < MAX_PHASE_STEP
            since = np.where(resolved, self._since, np.inf)
            energy = energies_of_vibrations(one.omega, own)
            self._basis.act_back(k, energy, t, since)
            first += len(one.omega)

    def _update(
        self, pose: PoseVibrations, t: Array, amplitudes: Array, rates: Array,
        accelerations: Array, limits: Array,
    ) -> None:  # fmt: skip
        """Keep the largest change of each group of channels.

        Where they measure accelerations or forces, those of the vibrations count, -ω² δ, and not
        more than those of the whole difference, in which slow motions have smaller ones. Nothing is
        said of them where a body turns so fast that its axes show other frequencies.
        """
        by_place, by_rate, omega = *pose.seen, np.fmax(pose.omega, self._slowest)
        own, largest, number = pose.own, self._largest.copy(), self._body.copy()
        some = np.flatnonzero(own.get_out_of_phase(self._duration))
        shapes, inverse = own.shapes[:, some], own.inverse[some].T
        turning = shapes * own.values[some]
        parts = np.hstack([amplitudes, rates]) @ inverse
        sizes = np.maximum(np.abs(parts), 1e-300)
        excess = parts * (1.0 - np.minimum(1.0, limits[:, some] / sizes))
        parts = parts - excess
        amplitudes = amplitudes - (excess @ shapes.T).real
        rates = rates - (excess @ turning.T).real
        accelerations = accelerations - (excess @ (turning * own.values[some]).T).real
        change = amplitudes @ by_place.T + rates @ by_rate.T
        whole = -accelerations / omega**2 @ by_place.T + rates @ by_rate.T
        first = np.cumsum([0, *(len(one.columns) for one in self._groups[:-1])])
        every = (one[:, self._columns] ** 2 for one in (change, whole))
        squares, whole = (np.add.reduceat(one, first, axis=1) for one in every)
        whole *= not own.is_turned(self._duration)
        sizes = np.sqrt(np.minimum(squares, np.where(self._powers == 2, whole, np.inf)))
        for k, row in enumerate(sizes.argmax(axis=0)):
            if sizes[row, k] > largest[0, k]:
                at = self._groups[k].columns
                moved = by_place[at] @ shapes + by_rate[at] @ turning
                j = some[np.argmax(np.abs(parts).max(axis=0) * np.linalg.norm(moved, axis=0))]
                ratio = np.sqrt(1.0 + 2.0 * own.drift[j] / own.frequency[j])
                hertz = own.frequency[j] / ratio / (2.0 * np.pi)
                largest[:, k] = sizes[row, k], t[row], hertz, ratio - 1.0
                number[k] = int(own.shares[:, j].argmax())
        self._largest, self._body = largest, number

    def indicators(self) -> Iterator[Indicator]:
        """The largest change over its range, by the body that is its cause."""
        if not self._bodies or not self._groups or not self._most.ndim:
            return
        shares = self._largest[0] / self._ranges()
        k = int(np.argmax(shares))
        _, t, hertz, shift = self._largest[:, k]
        body, share = self._bodies[self._body[k]].columns.name, float(shares[k])
        text = partial(self._sentence, body, self._groups[k].name, share, t, hertz, shift)
        yield Indicator(body, "frequency", share, t, LARGEST_CHANGE, text)

    def _sentence(
        self, body: str, what: str, share: float, t: float, hertz: float, shift: float
    ) -> str:
        say = self._units.say
        return (
            f"bodies.{body}: for want of modes a natural frequency of the scene, "
            f"{say(hertz, 'Hz', 3)}, is too high by {percent(shift)}, and the motion excites "
            f"it: {what} is off by about {percent(share)} of its range (t = {say(t, 's', 4)}); "
            "reduce the body with more modes"
        )
