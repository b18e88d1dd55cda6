"""The stored motion of a run, in the coordinates of its own model and of a neighbouring one.

In: the rows of a run, compiled models. Out: their states, and the residuals of their equations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexmb.analysis.assembly.jacobian import ConstraintRows, column_scales, numerical_rank
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.engine.allocation import new_state
from flexmb.engine.bodies.static_modes import static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.forces.bristle import BALL_HISTORY, POINT_HISTORY
from flexmb.engine.forces.friction import BRISTLE, FREE
from flexmb.engine.tables import BodyColumns, Layout, System
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray, skew
from flexmb.results import Result

_GAP = 0.05  # relative difference of velocities and integrated accelerations that rows should keep
_TURN, _PHASE = 0.3, 0.75  # largest rotation of a body and phase of a load between rows [rad]
_AT_REST = 1e-9  # velocity that is round-off, over the size of the model per duration
_STEP, _NOTHING = 1e-9, 1e-30  # step of finite differences, zero, over the size of the model
_INTERFACE_WEIGHT = 1e4  # weight of the motion of interfaces over that of nodes
_BLOCK = 64  # number of rows whose matrices fit into the cache of a processor


@dataclass(frozen=True, eq=False)
class Motion:
    """Rows of a run, SI: t (n,), q (n, nq), v, vd (n, nv), lam (n, nc), channels (n, k).

    `history` (n, h): history of the elements of a model, such as the impact velocity of a contact;
    None: no history.
    """

    t: Array
    q: Array
    v: Array
    vd: Array
    lam: Array
    channels: Array
    history: Array | None = None

    def put(self, k: int, equations: StateEquations) -> None:
        """Set the state of the equations to row k."""
        state = equations.state
        state.t[0], state.angles[:] = self.t[k], self.channels[k]
        state.q[:], state.v[:] = self.q[k], self.v[k]
        state.vd[:], state.lam[:] = self.vd[k], self.lam[k]
        if self.history is not None:
            state.history[:] = self.history[k]

    def gap(self, compiled: Compiled) -> float:
        """Relative difference (rms) of velocities of bodies from their integrated accelerations.

        It is large if rows are too far apart to resolve the motion.
        """
        rigid = [body.iv + k for body in compiled.layout.bodies for k in range(6)]
        weights = compiled.system.weights[rigid]
        change = np.diff(self.v[:, rigid] * weights, axis=0)
        mean = 0.5 * (self.vd[1:, rigid] + self.vd[:-1, rigid]) * weights
        missing = change - mean * np.diff(self.t)[:, None]
        total = float(np.sqrt((change**2).sum()))
        rests = total * (self.t[-1] - self.t[0]) < _AT_REST
        return 0.0 if rests else float(np.sqrt((missing**2).sum())) / total

    def finer(self, compiled: Compiled, fastest: float) -> float:
        """Factor of the number of rows that resolves it and loads of a frequency `fastest` [Hz]."""
        gap = float(np.sqrt(self.gap(compiled) / _GAP))
        return max(gap, self.turns(compiled, fastest))

    def turns(self, compiled: Compiled, fastest: float) -> float:
        """Factor of the number of rows that resolves rotations and loads of a frequency [Hz]."""
        steps = np.diff(self.t)[:, None]
        parts = (self.v[1:, body.iv + 3 : body.iv + 6] * steps for body in compiled.layout.bodies)
        turn = max((float(np.linalg.norm(x, axis=1).max(initial=0.0)) for x in parts), default=0.0)
        phase = 2.0 * np.pi * fastest * float(steps.max(initial=0.0))
        return max(turn / _TURN, phase / _PHASE)

    def thinned(self, most: int) -> Motion:
        """The motion with at most so many rows, every second, third, ... of its own."""
        every = slice(None, None, -(-len(self.t) // most))
        tables = {name: one[every] for name, one in vars(self).items() if one is not None}
        return replace(self, **tables)

    def with_history(self, compiled: Compiled) -> Motion:
        """The motion with the history of a model's elements along the rows.

        It is that of the row before, from which bristles deform; for an open contact it is the
        approach velocity in the row itself, with which a small motion would close it.
        """
        if not compiled.system.history:
            return self
        equations, motion = equations_of(compiled), replace(self, history=None)
        contacts = compiled.system.kinds.get("contacts")
        speeds = [] if contacts is None else contacts.rows["history"].tolist()
        rows = np.zeros((len(self.t), compiled.system.history))
        for k in range(len(rows)):
            motion.put(k, equations)
            if k == 0:
                equations.update_history(is_first=True)
            rows[k] = equations.state.history
            equations.update_history(is_first=False)
            rows[k, speeds] = equations.state.history[speeds]
        return replace(self, history=rows)

    def with_least_reactions(self, compiled: Compiled) -> Motion:
        """The motion with the least reactions of redundant joints that carry the same loads."""
        rows, scale = ConstraintRows(compiled), compiled.system.row_weights
        sizes, lam = column_scales(compiled), self.lam.copy()
        for k, q in enumerate(self.q):
            U, values, _ = np.linalg.svd(scale[:, None] * rows.evaluate(q).Cq * sizes)
            rank = numerical_rank(values)
            if rank == len(scale):
                return self
            lam[k] = scale * (U[:, :rank] @ (U[:, :rank].T @ (lam[k] / scale)))
        return replace(self, lam=lam)

    def with_channels(self, compiled: Compiled) -> Motion:
        """The motion with the channels that a model has along it."""
        motion, equations = self.with_history(compiled), equations_of(compiled)
        channels = np.empty((len(self.t), len(compiled.layout.channels)))
        for k in range(len(channels)):
            motion.put(k, equations)
            channels[k] = equations.channels()
        return replace(self, channels=channels)


class Bristles:
    """Change of the history of friction bristles by small motions, to first order.

    A bristle that sticks is attached where it began to stick. A small motion that has slid until
    then moves this position, which causes a load. `bends` are the rows at which one begins to stick
    or to slide, `changes` (n, h) are changes of the history.
    """

    def __init__(self, compiled: Compiled, motion: Motion) -> None:
        self.motion, self.equations = motion, equations_of(compiled)
        self.changes = np.zeros((len(motion.t), compiled.system.history))
        history = self.changes if motion.history is None else motion.history
        modes, self._stretched = _bristle_places(compiled.system)
        sticks = (
            np.append(history[1:], history[-1:], axis=0)[:, modes] == FREE
        )  # at the end of each row
        self.bends = np.flatnonzero((sticks[1:] != sticks[:-1]).any(axis=1)) + 1

    def load(self, rows: range, dq: Array, dv: Array) -> Array:
        """Change of F (rows, nv) by the history, with small motions dq, dv (nv,) in the first row.

        The rows must follow those of the last call.
        """
        first, loads = rows[0], np.zeros((len(rows), len(dq)))
        if not self._stretched:
            return loads
        self.changes[first] = self._next(max(first - 1, 0), dq, dv, is_first=first == 0)
        for i, k in enumerate(rows):
            loads[i] = self._force(k)
            if k + 1 < len(self.changes):
                self.changes[k + 1] = self._next(k, dq, dv)
            dq, dv = np.zeros_like(dq), np.zeros_like(dv)
        return loads

    def _next(self, k: int, dq: Array, dv: Array, *, is_first: bool = False) -> Array:
        """Change of the history after row k, by that before it and the small motions there."""
        equations, size = self.equations, self._size(self.changes[k], dq, dv)
        if size < _NOTHING:
            return np.zeros_like(self.changes[k])
        both = []
        for f in (0.0, _STEP / size):
            self.motion.put(k, equations)
            equations.state.q[:] = equations.moved(self.motion.q[k], f * dq)
            equations.state.v[:] += f * dv
            equations.state.history[:] += f * self.changes[k]
            equations.update_history(is_first=is_first)
            both.append(equations.state.history.copy())
        change: Array = np.zeros_like(both[0])
        before, after = (one[self._stretched] for one in both)
        change[self._stretched] = (after - before) * (size / _STEP)
        return change

    def _force(self, k: int) -> Array:
        """Change of F in row k."""
        size, both = self._size(self.changes[k]), []
        if size < _NOTHING:
            return np.zeros(len(self.motion.v[k]))
        for f in (0.0, _STEP / size):
            self.motion.put(k, self.equations)
            self.equations.state.history[:] += f * self.changes[k]
            both.append(self.equations.residual())
        return np.asarray((both[1] - both[0]) * (size / _STEP))

    def _size(self, change: Array, *motions: Array) -> float:
        """The largest component of a change, over the size of the model."""
        weights = self.equations.compiled.system.weights
        parts = [change * weights[:3].max(initial=0.0), *(motion * weights for motion in motions)]
        return max(float(np.abs(part).max(initial=0.0)) for part in parts)


def _bristle_places(system: System) -> tuple[list[int], list[int]]:
    """Indices in the history: of the states of bristles (free or not), and of their deflections."""
    modes: list[int] = []
    stretched: list[int] = []
    contacts, joints = (system.kinds.get(name) for name in ("contacts", "joint_frictions"))
    for row in [] if contacts is None else contacts.rows[contacts.rows["model"] == BRISTLE]:
        modes.append(int(row["bristle"]))
        n = BALL_HISTORY if row["ri"] > 0.0 else POINT_HISTORY
        stretched += range(modes[-1] + 1, modes[-1] + n)
    for row in [] if joints is None else joints.rows[joints.rows["model"] == BRISTLE]:
        stretched.append(int(row["history"]))
        modes.append(stretched[-1] + 1)
    return modes, stretched


def blocks(n: int) -> Iterator[slice]:
    """Slices of n rows, in blocks whose matrices are processed together."""
    for first in range(0, n, _BLOCK):
        yield slice(first, min(first + _BLOCK, n))


class WeightedCoordinates:
    """Weighted coordinates of small motions, with translations and rotations in body axes."""

    def __init__(self, compiled: Compiled, motion: Motion) -> None:
        from scipy.spatial.transform import Rotation

        self.compiled, system = compiled, compiled.system
        still = static_coordinates(system, kinetostatic=True)  # they have no coordinates here
        self.used = np.setdiff1d(np.flatnonzero(system.kkt.column >= 0), still).astype(np.int64)
        weights = np.where(system.weights > 0.0, system.weights, 1.0)
        self.inverse = 1.0 / weights
        axes = [
            Rotation.from_quat(np.roll(motion.q[:, body.iq + 3 : body.iq + 7], -1, axis=1))
            for body in compiled.layout.bodies
        ]
        self._axes = [one.as_matrix() for one in axes]
        self._v = motion.v

    def turned(self, X: Array, rows: slice = slice(None)) -> Array:
        """X S of matrices (n, i, nv) in velocity coordinates of these rows: (n, i, used)."""
        Y = np.array(X.transpose(0, 2, 1), order="C")
        for body, A in zip(self.compiled.layout.bodies, self._axes, strict=True):
            own = slice(body.iv, body.iv + 3)
            Y[:, own] = A[rows].transpose(0, 2, 1) @ Y[:, own]
        Y = Y[:, self.used] * self.inverse[self.used, None]
        return np.asarray(Y.transpose(0, 2, 1))

    def congruence(self, X: Array, rows: slice = slice(None)) -> Array:
        """Sᵀ X S of matrices (n, nv, nv) of these rows."""
        Y = np.array(X, order="C")
        for body, A in zip(self.compiled.layout.bodies, self._axes, strict=True):
            own = slice(body.iv, body.iv + 3)
            Y[:, own] = A[rows].transpose(0, 2, 1) @ Y[:, own]
            Y[:, :, own] = Y[:, :, own] @ A[rows]
        if len(self.used) < Y.shape[1]:
            Y = Y[:, self.used][:, :, self.used]
        Y *= np.outer(*2 * [self.inverse[self.used]])
        return Y

    def spin(self, rows: slice = slice(None)) -> tuple[Array, Array]:
        """Ω of δv = δq̇ + Ω δq and Ω of δv̇ = d δv/dt + Ω δv, (n, used, used) of these rows."""
        v, used = self._v[rows], self.used
        both = np.zeros((len(v), len(used), len(used)))
        shift, factors = both.copy(), self.inverse[used] / self.inverse[used, None]
        for body in self.compiled.layout.bodies:
            cross = skew(v[:, body.iv + 3 : body.iv + 6])
            for W, first in ((both, body.iv), (both, body.iv + 3), (shift, body.iv)):
                at = np.flatnonzero((used >= first) & (used < first + 3))
                own = used[at] - first
                W[:, at[:, None], at] = cross[:, own[:, None], own] * factors[at[:, None], at]
        return both, shift

    def vectors(self) -> list[IntArray]:
        """Places among the coordinates of each translation and rotation of a body."""
        firsts = (body.iv + k for body in self.compiled.layout.bodies for k in (0, 3))
        return [np.flatnonzero((self.used >= at) & (self.used < at + 3)) for at in firsts]

    def rigid(self, names: Sequence[str]) -> IntArray:
        """Places of the six coordinates of each of the bodies with these names."""
        firsts = [body.iv for body in self.compiled.layout.bodies if body.name in names]
        mine = [(self.used >= iv) & (self.used < iv + 6) for iv in firsts]
        return np.flatnonzero(np.any(mine, axis=0))

    def turns(self) -> Array:
        """Rotations (n, used, used) of these vectors from body axes to those of the ground."""
        made = np.tile(np.eye(len(self.used)), (len(self._v), 1, 1))
        for k, at in enumerate(self.vectors()):
            own = (self.used[at] - self.compiled.layout.bodies[k // 2].iv) % 3
            made[:, at[:, None], at] = self._axes[k // 2][:, own[:, None], own]
        return made

    def to_coordinates(self, k: int, motion: Array) -> Array:
        """Weighted coordinates in row k of a motion (nv,); the columns of S are orthogonal."""
        turned = self.turned(motion[None, None], slice(k, k + 1))[0, 0]
        return np.asarray(turned / self.inverse[self.used] ** 2)

    def stiffness_of(self, names: Sequence[str]) -> Array | None:
        """Stiffness of the modes of bodies of these names; None without any."""
        bodies = [body for body in self.compiled.layout.bodies if body.name in names and body.m]
        places = [np.arange(body.iv + 6, body.iv + 6 + body.m) for body in bodies]
        return self.elastic(np.concatenate(places)) if places else None

    def elastic(self, places: IntArray | None = None) -> Array:
        """Stiffness of the modes of all bodies, or of those with some indices."""
        K = np.zeros((self.compiled.layout.nv,) * 2)
        for body in self.compiled.layout.bodies:
            own = slice(body.iv + 6, body.iv + 6 + body.m)
            if body.m:
                K[own, own] = self.compiled.flexbodies[body.name].K
        if places is not None:
            K *= np.outer(*2 * [np.isin(np.arange(len(K)), places)])
        return np.asarray(self.congruence(K[None], slice(0, 1))[0])

    def to_motions(self, part: Array, rows: slice = slice(None)) -> Array:
        """Motions (n, nv) of weighted coordinates (n, used) in these rows."""
        motion = np.zeros((len(part), len(self.inverse)))
        motion[:, self.used] = part * self.inverse[self.used]
        for body, A in zip(self.compiled.layout.bodies, self._axes, strict=True):
            own = slice(body.iv, body.iv + 3)
            motion[:, own] = np.einsum("tij,tj->ti", A[rows], motion[:, own])
        return motion


def out_of_balance(compiled: Compiled, motion: Motion) -> Array:
    """Residual F (n, nv) of the rows of a run in their own model."""
    equations, rows = equations_of(compiled), np.zeros((len(motion.t), compiled.layout.nv))
    motion = motion.with_history(compiled)
    for k in range(len(rows)):
        motion.put(k, equations)
        rows[k] = equations.residual()
    return rows


def equations_of(compiled: Compiled) -> StateEquations:
    """The equations of a model, without a state."""
    return StateEquations(compiled, new_state(compiled.system, len(compiled.layout.channels)))


def read_motion(run: Result, compiled: Compiled) -> Motion:
    """The rows of a run in the coordinates of its model."""
    rows = slice(None)
    q, v, vd, *tables = (run.part(name, rows) for name in ("q", "v", "vd", "lam", "sensors"))
    motion = compiled.layout.of_equations(q, v, vd)
    return Motion(run.time * run.units.scale("s"), *motion, *tables)


def shapes_of(body: FlexBody, finer: FlexBody) -> Array:
    """(m of the finer, m) modal coordinates of a finer body per unit of each of a body's own.

    By least squares of the motion of all nodes, with that of the interfaces met first: a gap of a
    joint would be an effect.
    """
    if not body.m:
        return np.zeros((finer.m, 0))
    fields = []
    for one in (finer, body):
        ends = (_INTERFACE_WEIGHT * np.vstack([part.Phi_t, part.Phi_r]) for part in one.interfaces)
        nodes = [] if one.nodes is None else [one.nodes.Phi_t.reshape(-1, one.m)]
        fields.append(np.vstack([*ends, *nodes]))
    return np.asarray(np.linalg.lstsq(fields[0], fields[1], rcond=None)[0])


def carry_motion(
    motion: Motion, own: Compiled, other: Compiled, shapes: Mapping[str, Array]
) -> tuple[Motion, Array]:
    """A motion in the coordinates of another model, and its residual in its own model there.

    Bodies, rows and scalar coordinates are matched by name. `shapes` are, by body, the modal
    coordinates (m of the other, m) per unit of each of its own. Without shapes, modes are matched
    if their numbers agree; otherwise the body is undeformed.
    """
    n, layout = len(motion.t), other.layout
    q = np.tile(other.initial_q, (n, 1))
    v, vd, balance = (np.zeros((n, layout.nv)) for _ in range(3))
    residual = out_of_balance(own, motion)
    mine, moved = {body.name: body for body in own.layout.bodies}, motion
    points = [(one.origin, one.references) for one in (own.layout, layout)]
    if points[0] != points[1]:  # in between, the motion of frames
        frames = own.layout.of_frames(motion.q, motion.v, motion.vd)
        moved = replace(motion, q=frames[0], v=frames[1], vd=frames[2])
        _move_moments(residual, motion.q, own.layout, layout)
    for body in layout.bodies:
        stiffness = [one.flexbodies[body.name].K for one in (own, other) if body.m]
        tables = q, v, vd, balance
        _carry_body(
            moved, residual, mine[body.name], body, shapes.get(body.name), stiffness, tables
        )
    if points[0] != points[1]:
        q, v, vd = layout.of_equations(q, v, vd)
    names = own.layout.coordinates
    for k, name in enumerate(layout.coordinates):
        if name in names:
            a = names.index(name) - len(names)
            b = k - len(layout.coordinates)
            q[:, b], v[:, b], vd[:, b] = motion.q[:, a], motion.v[:, a], motion.vd[:, a]
            balance[:, b] = residual[:, a]
    lam = np.zeros((n, layout.nc))
    places = {name: k for k, name in enumerate(own.layout.rows)}
    for k, name in enumerate(layout.rows):
        if name in places:
            lam[:, k] = motion.lam[:, places[name]]
    return Motion(motion.t, q, v, vd, lam, motion.channels), balance


def _move_moments(forces: Array, q: Array, old: Layout, new: Layout) -> None:
    """Refer the moments of forces (n, nv of the old layout) to the points of the new one."""
    from scipy.spatial.transform import Rotation

    names, none = [body.name for body in new.bodies], np.zeros((len(new.bodies), 3))
    points = np.array(new.references) if new.references else none
    for k, body in enumerate(old.bodies):
        before = np.array(old.references[k]) if old.references else np.zeros(3)
        arm = before - points[names.index(body.name)]
        axes = Rotation.from_quat(np.roll(q[:, body.iq + 3 : body.iq + 7], -1, axis=1))
        force = axes.inv().apply(forces[:, body.iv : body.iv + 3])
        forces[:, body.iv + 3 : body.iv + 6] += np.cross(arm, force)


def _carry_body(
    motion: Motion, residual: Array, old: BodyColumns, new: BodyColumns,
    shape: Array | None, stiffness: Sequence[Array], into: tuple[Array, Array, Array, Array],
) -> None:  # fmt: skip
    q, v, vd, balance = into
    q[:, new.iq : new.iq + 7] = motion.q[:, old.iq : old.iq + 7]
    q[:, new.iq + 7 : new.iq + 7 + new.m] = 0.0
    tables = ((motion.v, v), (motion.vd, vd), (residual, balance))
    for have, put in tables:
        put[:, new.iv : new.iv + 6] = have[:, old.iv : old.iv + 6]
    if shape is None and new.m == old.m:
        shape = np.eye(new.m)
    if shape is not None and old.m:
        # forces hold deformations that are off, and reactions with their static responses
        back = np.linalg.solve(stiffness[0], shape.T @ stiffness[1])
        q[:, new.iq + 7 : new.iq + 7 + new.m] = (
            motion.q[:, old.iq + 7 : old.iq + 7 + old.m] @ shape.T
        )
        for (have, put), T in zip(tables, (shape.T, shape.T, back), strict=True):
            put[:, new.iv + 6 : new.iv + 6 + new.m] = have[:, old.iv + 6 : old.iv + 6 + old.m] @ T
