"""The variational equations of a model: its equations of motion, linearised about a motion.

In: a compiled model and the rows (states) of a motion. Out: the coefficients at every row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import numerical_rank
from flexmb.analysis.effects.stored_motion import Motion, WeightedCoordinates, blocks, equations_of
from flexmb.engine.compile import Compiled
from flexmb.flexbody.arrays import Array, IntArray

_REGULARISATION = 1e-20  # added to Cq Cqᵀ, over its largest eigenvalue
# Least over largest eigenvalue of Cq Cqᵀ without the modes that follow loads, below which the
# compliance of these modes is needed to distribute reactions.
_NEEDS_COMPLIANCE = 1e-8
_ADDED_INERTIA = 1e-12  # inertia added to each coordinate, over the trace of the metric
_MODES_LAST = 1e-6  # weight of modes in the selection of dependent coordinates
_TABLES = ("M", "D", "K", "Cq", "F", "C", "Omega", "rows", "turns")
_TURNING = 2 * np.pi  # rotation of a body over the run that doubles the weight of its coordinates


@dataclass(frozen=True, eq=False)
class VariationalEquations:
    """M δv̇ + D δv + K δq + (Cqᵀ + friction) δλ = −F, Cq δq = −C at every row of a motion.

    Coordinates are weighted. The rows of Cq are independent: combinations `rows` of those of the
    model, orthogonal ones if the model has redundant rows. D contains the rotation of the axes in
    δv̇; Omega is that in δv; `turns` rotate vectors from body axes to those of the ground. A
    coordinate with a large `prefer` is selected as a dependent one
    before others.
    """

    frames: WeightedCoordinates
    weights: Array
    prefer: Array
    M: Array
    D: Array
    K: Array
    Cq: Array
    F: Array
    C: Array
    Omega: Array
    rows: Array
    turns: Array
    friction: Array | None = None

    def part(self, rows: slice | IntArray, names: tuple[str, ...] = _TABLES) -> Self:
        """The equations at some rows, with all tables or those of these names."""
        tables = {name: getattr(self, name)[rows] for name in names}
        friction = None if self.friction is None else self.friction[rows]
        return replace(self, friction=friction, **tables)

    def between(self, load: Array, begins: bool, ends: bool) -> Self:
        """The equations with F + load (n, nu).

        `begins`, `ends`: a bristle changes at the first or last row. D, K, F and friction there are
        then those of the neighbouring row.
        """
        if not (load.any() or begins or ends):
            return self
        rows = np.arange(len(self.F))
        if begins and len(rows) > 2:
            rows[0] = 1
        if ends:
            rows[-1] = rows[-2]
        return replace(self.part(rows, ("D", "K")), F=self.F + load[rows])

    def without_motions(self, places: Sequence[IntArray]) -> Self:
        """The equations without the motions that joints leave to some coordinates alone.

        Each of them has an equation without a reaction. `places` are those of each set of
        coordinates.
        """
        made = self
        for at in places:
            _, sizes, Vt = np.linalg.svd(made.Cq[:, :, at])
            rank = numerical_rank(sizes[0])
            rows = np.zeros((len(Vt), Vt.shape[1] - rank, made.Cq.shape[2]))
            rows[:, :, at] = Vt[:, rank:]
            n, k, nu = rows.shape
            none = np.zeros((n, k, made.rows.shape[2]))
            by_load = made.friction
            if by_load is not None:
                by_load = np.concatenate([by_load, np.zeros((n, nu, k))], axis=2)
            both = [(made.Cq, rows), (made.C, np.zeros((n, k))), (made.rows, none)]
            Cq, C, rows = (np.concatenate(pair, axis=1) for pair in both)
            made = replace(made, Cq=Cq, C=C, rows=rows, friction=by_load)
        return made

    def projection(self, Z: Array) -> Array:
        """Zᵀ (n, d, nu) for forces, less the joint friction that their reactions cause."""
        Zt = Z.transpose(0, 2, 1)
        if self.friction is None:
            return np.asarray(Zt)
        squares = self.Cq @ (self.Cq.transpose(0, 2, 1) + self.friction)
        return np.asarray(Zt - Zt @ self.friction @ np.linalg.solve(squares, self.Cq))

    def closure(self, stiffness: Array) -> Array:
        """Motions (n, nu, rank) that change one row of Cq by one, of least norm M + stiffness."""
        W = self.M + stiffness
        W += _ADDED_INERTIA * np.trace(W, axis1=1, axis2=2).max() * np.eye(W.shape[1])
        moved = np.linalg.solve(W, self.Cq.transpose(0, 2, 1))
        return np.asarray(moved @ np.linalg.inv(self.Cq @ moved))

    def shares(self, force: Array, follows: NDArray[np.bool_]) -> Array:
        """λ (n, rank) with Cqᵀ λ nearest to forces (n, nu), on all coordinates but `follows`."""
        if self.friction is not None:
            force = times(self.projection(np.eye(force.shape[1])[None]), force)
        rows = self.Cq * ~follows
        squares = rows @ rows.transpose(0, 2, 1)
        least, most = np.linalg.eigvalsh(squares)[:, [0, -1]].T if rows.size else np.zeros((2, 1))
        if follows.any() and np.any(least < _NEEDS_COMPLIANCE * most):  # joints need the compliance
            return replace(self, friction=None).shares(force, np.zeros_like(follows))
        squares += _REGULARISATION * max(most.max(), 1e-300) * np.eye(rows.shape[1])
        return np.asarray(np.linalg.solve(squares, rows @ force[:, :, None])[:, :, 0])


def linearise(compiled: Compiled, motion: Motion, balance: Array) -> VariationalEquations:
    """Linearise a model about a motion; arguments as of `perturbation.respond`."""
    frames, equations, n = (
        WeightedCoordinates(compiled, motion),
        equations_of(compiled),
        len(motion.t),
    )
    nv, used, scale = compiled.layout.nv, frames.used, compiled.system.row_weights
    nu, nc = len(used), len(scale)
    M, D, K, Omega = (np.zeros((n, nu, nu)) for _ in range(4))
    F, C, U = np.zeros((n, nv)), np.zeros((n, nc)), np.eye(nc)[None]
    Cq, friction = np.zeros((2, n, nc, nu))
    for part in blocks(n):
        own = range(n)[part]
        tangents = []
        for k in own:
            motion.put(k, equations)
            tangents.append(equations.tangents())
            F[k], C[k] = equations.work.trial.res, equations.work.con.C
        mass, *others = (np.stack([x[j] for x in tangents]) for j in range(5))
        M[part] = frames.congruence(mass, part)
        D[part], K[part] = (frames.congruence(X, part) for X in others[:2])
        Omega[part], shift = frames.spin(part)
        for at in frames.vectors()[::2]:  # of translations: all others have none
            D[part][:, :, at] += M[part][:, :, at] @ shift[:, at[:, None], at]
        Cq[part] = frames.turned(others[2], part)
        if np.any(loads := others[3].transpose(0, 2, 1) - others[2]):
            friction[part] = frames.turned(loads, part)
    F = frames.turned((F - balance)[:, None])[:, 0]
    rank = numerical_rank(np.linalg.svd(scale[:, None] * Cq[0], compute_uv=False))
    if rank < nc:  # redundant rows: take independent combinations
        U = np.linalg.svd(scale[:, None] * Cq, full_matrices=False)[0][:, :, :rank]
    rows = np.broadcast_to(U.transpose(0, 2, 1) * scale, (n, rank, nc))
    Cq, C = rows @ Cq, np.einsum("trc,tc->tr", rows, C)
    by_load = (rows @ friction).transpose(0, 2, 1) if friction.any() else None
    prefer, v = np.ones(compiled.layout.nv), motion.v
    for body in compiled.layout.bodies:
        prefer[body.iv + 6 : body.iv + 6 + body.m] = _MODES_LAST
        spin = np.linalg.norm(v[:, body.iv + 3 : body.iv + 6], axis=1).max()
        prefer[body.iv : body.iv + 6] += spin * (motion.t[-1] - motion.t[0]) / _TURNING
    weights = 1.0 / frames.inverse[used]
    return VariationalEquations(
        frames, weights, prefer[used], M, D, K, Cq, F, C, Omega, rows, frames.turns(), by_load
    )


def times(X: Array, x: Array) -> Array:
    """Product X x in each row."""
    return np.asarray(np.einsum("tij,tj->ti", X, x))


def spin(of: VariationalEquations, motions: Array, rows: IntArray) -> Array:
    """Ω X of motions X (n, k, d) of some coordinates: Ω couples those of a vector only."""
    made, every = np.zeros(motions.shape), np.arange(len(motions))
    for at in of.frames.vectors():
        own = np.searchsorted(rows, at)
        made[:, own] = of.Omega[np.ix_(every, at, at)] @ motions[:, own]
    return made
