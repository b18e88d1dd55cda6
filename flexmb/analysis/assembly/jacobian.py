"""Constraint rows at any positions: values, gradients, markers, and the Jacobian with its rank.

The rows are those of the engine's units (`engine.initial_conditions`). Nothing is compiled for
them: units that are not in the cache run as plain Python, from the same source. Ranks are those of
the weighted Jacobian, with rows and columns in radians and in metres over the size of the model, so
that entries are comparable. Scalar coordinates of couplers and curves are unknowns in addition to
those of the bodies; each is determined by one equation of its own.

Dependent rows are reported as circuits: left null vectors with as few non-zero entries as possible.
The reduced row echelon form of a null space, with pivots selected by size, has one fundamental
circuit in every row (Strang, Linear Algebra and Its Applications, ch. 2).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import scipy.linalg  # its threads are limited with those of NumPy
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.bodies.motion import move
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import row_evaluator
from flexmb.engine.compiled_units import call_without_compiling
from flexmb.engine.joints import ROW_KINDS
from flexmb.engine.state import Work, rows_between
from flexmb.flexbody.arrays import Array

MAX_COORDINATES = 600
"""Coordinates up to which dense decompositions are made; larger models are treated as having
degrees of freedom, which only reduces the accuracy of reported reactions."""
RANK_TOLERANCE = 1e-8
"""Singular values below this share of the largest one are zero; round-off leaves 1e-13."""
_ZERO_COEFFICIENT = 1e-7  # share of the largest coefficient of a circuit that is round-off
_ASIDE = 0.01  # size of the motion to a pose at which no coordinate is at its dead point


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit dense linear algebra to one thread; also a decorator.

    Up to `MAX_COORDINATES` two threads are no faster, and if other processes run they wait for each
    other: a chain of 100 bars takes 0.4 s with one thread, 1 to 4 s with two.
    """
    with _pools().limit(limits=1, user_api="blas"):
        yield


@cache
def _pools() -> ThreadpoolController:
    # NumPy and SciPy have loaded theirs; cached, as a search takes longer than a decomposition
    return ThreadpoolController()


def numerical_rank(singular_values: Array, largest: float | None = None) -> int:
    """Number of singular values, largest first, that are not round-off of the largest one."""
    if not singular_values.size:
        return 0
    scale = singular_values[0] if largest is None else largest
    return int(np.sum(singular_values > RANK_TOLERANCE * scale))


@dataclass(frozen=True)
class Decomposition:
    """A = U S Vᵀ: U (rows, rows), S (min(rows, columns),), V (columns, columns)."""

    U: Array
    S: Array
    V: Array

    @classmethod
    def of(cls, A: Array) -> Decomposition:
        """Decomposition of a matrix A (rows, columns)."""
        U, S, Vt = np.linalg.svd(A)
        return cls(U, S, Vt.T)

    @cached_property
    def rank(self) -> int:
        """Number of independent rows."""
        return numerical_rank(self.S)

    @property
    def free(self) -> Array:
        """(columns, k) orthonormal basis of the null space: free motions."""
        return self.V[:, self.rank :]

    @property
    def condition(self) -> float:
        """Smallest non-zero singular value over the largest."""
        return float(self.S[self.rank - 1] / self.S[0]) if self.rank else 1.0

    @cached_property
    def row_dependencies(self) -> Array:
        """(n, rows) coefficients of sets of dependent rows."""
        return row_dependencies(self.U[:, self.rank :].T)

    def unreachable(self, values: Array) -> Array:
        """The part of row values (rows,) that no motion can change."""
        null = self.U[:, self.rank :]
        return np.asarray(null @ (null.T @ values))


def null_space(A: Array, largest: float | None = None) -> Array:
    """(columns, k) orthonormal basis of the null space of A (rows, columns).

    Singular values are zero relative to `largest`, by default the largest one of A.
    """
    _, values, Vt = np.linalg.svd(A, full_matrices=len(A) < A.shape[1])
    return np.asarray(Vt[numerical_rank(values, largest) :].T)


def row_dependencies(N: Array) -> Array:
    """A basis of the rows of N (k, n) with as many zeros as possible and largest entries one."""
    if not N.size:
        return N
    _, _, order = scipy.linalg.qr(N, mode="economic", pivoting=True)
    basis = np.linalg.solve(N[:, order[: len(N)]], N)
    basis /= np.abs(basis).max(axis=1, keepdims=True)
    basis[np.abs(basis) < _ZERO_COEFFICIENT] = 0.0
    return np.asarray(basis)


Mask = NDArray[np.bool_]
JointMarkers = tuple[Array, Array, Array, Array]
"""x_I (3,) over the model size, axes R_I (3, 3), x_J and R_J of the two markers of a joint."""


@dataclass(frozen=True)
class WeightedJacobian:
    """The Jacobian of all rows of a system at one pose, weighted.

    A (nc, columns); `columns` are their indices in v: coordinates that can move, without states.
    """

    compiled: Compiled
    A: Array
    columns: NDArray[np.int64]

    @classmethod
    def of(cls, compiled: Compiled, Cq: Array) -> WeightedJacobian:
        """Weighted Jacobian of Cq (nc, nv)."""
        scales = column_scales(compiled)
        columns = np.flatnonzero(scales > 0)
        A = compiled.system.row_weights[:, None] * Cq[:, columns] * scales[columns]
        return cls(compiled, A, columns)

    @cached_property
    def owners(self) -> tuple[str, ...]:
        """Scene path of the reaction of each row."""
        groups = self.compiled.system.groups["n"]
        return tuple(np.repeat(np.array(self.compiled.layout.reactions, object), groups))

    @cached_property
    def driven(self) -> Mask:
        """Flags of the rows of drivers."""
        return ~joint_rows(self.compiled)

    @cached_property
    def modal(self) -> Mask:
        """Flags of the columns of modal coordinates."""
        modal = np.zeros(self.compiled.layout.nv, bool)
        for body in self.compiled.layout.bodies:
            modal[body.iv + 6 : body.iv + 6 + body.m] = True
        return modal[self.columns]

    @cached_property
    def scalar(self) -> Mask:
        """Flags of the columns of scalar coordinates, which belong to no body."""
        layout = self.compiled.layout
        scalar: Mask = self.columns >= layout.nv - len(layout.coordinates)
        return scalar

    @cached_property
    def norm(self) -> float:
        """Largest singular value of A."""
        return float(np.linalg.norm(self.A, 2)) if self.A.size else 1.0

    @cached_property
    def decomposition(self) -> Decomposition:
        """Singular values and vectors of all rows."""
        return Decomposition.of(self.A)

    @cached_property
    def joint_decomposition(self) -> Decomposition:
        """Decomposition of all rows except those of drivers."""
        return Decomposition.of(self.A[~self.driven]) if any(self.driven) else self.decomposition

    @cached_property
    def joint_circuits(self) -> Array:
        """(n, nc) circuits of the rows of joints, zero for those of drivers."""
        row_dependencies = self.joint_decomposition.row_dependencies
        padded = np.zeros((len(row_dependencies), len(self.A)))
        padded[:, ~self.driven] = row_dependencies
        return padded

    def without_modes(self) -> WeightedJacobian:
        """The Jacobian of the same bodies without deformation."""
        rigid = ~self.modal
        if np.all(rigid):
            return self
        return WeightedJacobian(self.compiled, self.A[:, rigid], self.columns[rigid])

    def velocities(self, motions: Array) -> Array:
        """(nv, k) velocity coordinates of motions (columns, k) that multiply A."""
        v = np.zeros((self.compiled.layout.nv, motions.shape[1]))
        v[self.columns] = motions / self.compiled.system.weights[self.columns, None]
        return v

    def rows_of(self, owner: str) -> Mask:
        """Flags of the rows that belong to a scene path."""
        return self._rows_by_owner[owner]

    @cached_property
    def _rows_by_owner(self) -> dict[str, Mask]:
        owners = np.array(self.owners)
        return {name: owners == name for name in dict.fromkeys(self.owners)}


@dataclass(frozen=True)
class ConstraintPose:
    """Positions q (nq,) of a system with all its rows there.

    Values C (nc,), Jacobian Cq (nc, nv), and all markers: positions x (n, 3) and axes R (n, 3, 3)
    in global axes.
    """

    compiled: Compiled
    q: Array
    C: Array
    Cq: Array
    x: Array
    R: Array

    @cached_property
    def jacobian(self) -> WeightedJacobian:
        """The weighted Jacobian."""
        return WeightedJacobian.of(self.compiled, self.Cq)

    @cached_property
    def g(self) -> Array:
        """Gradients (nc, 12) for the motions (δx_I, δφ_I, δx_J, δφ_J) of both markers."""
        g = np.zeros((len(self.C), 12))
        for k, row in enumerate(self.compiled.system.rows):
            i, j = row["I"], row["J"]
            g[k] = row_gradient(_axes(row), self.x[i], self.R[i], self.x[j], self.R[j])
        return g

    @cached_property
    def weighted_g(self) -> Array:
        """Gradients (nc, 12) of the weighted rows, lengths over the model size."""
        arm = np.tile(np.repeat([self.compiled.length, 1.0], 3), 2)
        weights = self.compiled.system.row_weights[:, None]
        return np.asarray(weights * self.g * arm)

    def markers_of(self, owner: str) -> JointMarkers:
        """Positions and axes of the two markers of a joint or driver, I and J."""
        group = self.compiled.system.groups[self.compiled.layout.reactions.index(owner)]
        row = self.compiled.system.rows[group["row"]]
        i, j = (int(row[side]) for side in ("JI" if group["reversed"] else "IJ"))
        size = self.compiled.length
        return self.x[i] / size, self.R[i], self.x[j] / size, self.R[j]

    def gradients_at_J(self, owner: str) -> Array:
        """Weighted gradients (n, 6) of the rows of a joint for motions of its marker J."""
        group = self.compiled.system.groups[self.compiled.layout.reactions.index(owner)]
        side = slice(0, 6) if group["reversed"] else slice(6, 12)
        return self.weighted_g[self.jacobian.rows_of(owner), side]


class ConstraintRows:
    """The rows of a system, pose by pose.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    """

    def __init__(self, compiled: Compiled) -> None:
        self.compiled = compiled
        channels = len(compiled.layout.channels)
        self._state = new_state(compiled.system, channels)
        self.work = new_work(compiled.system, channels)
        self._put_rows = row_evaluator(compiled.system, self._state, self.work)
        self._dense = DenseJacobian(compiled)

    def evaluate(self, q: Array, t: float = 0.0) -> ConstraintPose:
        """The rows at the positions q (nq,) and the time t [s]."""
        self._state.t[0] = t
        self._state.q[:] = q
        self._put_rows()
        markers = self.work.now.marker
        return ConstraintPose(
            self.compiled,
            q.copy(),
            self.work.con.C.copy(),
            self._dense.of(self.work),
            markers["x"].copy(),
            markers["R"].copy(),
        )

    def move(self, q: Array, d: Array) -> Array:
        """q ∘ exp(d) for a change d (nv,) of the velocity coordinates."""
        out = q.copy()
        call_without_compiling(move, self.compiled.system.parts, q, d, out)
        return out


def row_gradient(axes: tuple[int, int, int], xi: Array, Ri: Array, xj: Array, Rj: Array) -> Array:
    """Gradient (12,) of a row (kind, a, b) for (δx_I, δφ_I, δx_J, δφ_J) in global axes.

    Not finite where the row has none, such as a distance of zero.
    """
    (kind, a, b), at = axes, rows_between(xi, Ri, xj, Rj)
    with np.errstate(all="ignore"):
        ROW_KINDS[kind].gradient(at, a, b, 0, 1)
    return np.asarray(at.g)


def _axes(row: np.void) -> tuple[int, int, int]:
    return int(row["kind"]), int(row["a"]), int(row["b"])


class DenseJacobian:
    """Cq (nc, nv) of a system; where its entries are, is found once."""

    def __init__(self, compiled: Compiled) -> None:
        self._compiled, self._entries = compiled, []
        system, parts = compiled.system, compiled.system.parts
        rows = system.rows
        for side in "IJ":
            places = rows[f"jac_{side}"]
            on_body = np.flatnonzero(places >= 0)
            bodies = parts.bodies[parts.markers["body"][rows[side][on_body]]]
            for m in np.unique(bodies["m"]):
                mine, count = bodies["m"] == m, np.arange(6 + m)
                k = on_body[mine, None]
                columns = bodies["iv"][mine, None] + count
                self._entries.append((k, columns, places[k] + count))

    def of(self, work: Work) -> Array:
        """From the rows on bodies (Dense.jac) and the markers, as units left them."""
        system, layout, parts = (
            self._compiled.system,
            self._compiled.layout,
            self._compiled.system.parts,
        )
        rows, jac, Cq = system.rows, work.dense.jac, np.zeros((layout.nc, layout.nv))
        for k, columns, places in self._entries:
            Cq[k, columns] += jac[places]
        for coupled in system.coupled:
            Cq[coupled["row"], parts.coordinates[coupled["coordinate"]]["iv"]] -= coupled["factor"]
        markers = work.now.marker
        for curve, now in zip(parts.curve_markers, work.now.curve_marker, strict=True):
            # rows on curve markers change with the places of these along their curves
            group, first = system.groups[curve["group"]], 6 * curve["side"]
            column = parts.coordinates[curve["coordinate"]]["iv"]
            for row in range(group["row"], group["row"] + group["n"]):
                mi, mj = markers[rows[row]["I"]], markers[rows[row]["J"]]
                g = row_gradient(_axes(rows[row]), mi["x"], mi["R"], mj["x"], mj["R"])
                Cq[row, column] = g[first : first + 6] @ now["J"]
        return Cq


@one_blas_thread()
def constraint_rank(compiled: Compiled, work: Work) -> int | None:
    """Independent constraint equations at the state that a scratch was evaluated at.

    As many as velocity coordinates: the constraints alone fix the motion. Fewer than equations:
    some are redundant, and reactions are not unique. None for a model of more than
    `MAX_COORDINATES`.
    """
    if n_free(compiled) > MAX_COORDINATES:
        return None
    A = WeightedJacobian.of(compiled, DenseJacobian(compiled).of(work)).A
    return numerical_rank(np.asarray(np.linalg.svd(A, compute_uv=False)))


@one_blas_thread()
def with_driven_coordinates(compiled: Compiled, q: Array) -> Compiled:
    """The model with flags of coordinates that its rows fix, if some follow functions of time.

    They are fixed at the closed positions q (nq,), and beside them along the free motions: the
    height of a pendulum at the bottom is not. None of a model of more than `MAX_COORDINATES`.
    """
    if not (compiled.system.rows["fun"] >= 0).any() or n_free(compiled) > MAX_COORDINATES:
        return compiled
    rows = ConstraintRows(compiled)
    jacobian = rows.evaluate(q).jacobian
    free = null_space(jacobian.A)
    aside = _ASIDE * free @ np.cos(np.arange(free.shape[1]))[:, None]  # not along one motion alone
    beside = rows.evaluate(rows.move(q, jacobian.velocities(aside)[:, 0])).jacobian
    moves = np.abs(np.hstack([free, null_space(beside.A)])).max(axis=1, initial=0.0)
    driven = np.zeros(compiled.layout.nv, np.int64)
    driven[jacobian.columns[moves < RANK_TOLERANCE]] = 1
    return replace(compiled, system=compiled.system._replace(driven=driven))


def n_free(compiled: Compiled) -> int:
    """Velocity coordinates that may move: all, or those in the plane."""
    return int(np.sum(compiled.system.kkt.column >= 0))


def column_scales(compiled: Compiled) -> Array:
    """(nv,) how far one unit of each velocity coordinate moves: 0 for those left out of a plane."""
    scales: Array = np.where(compiled.system.kkt.column >= 0, 1.0 / compiled.system.weights, 0.0)
    scales[[start.iv for start in compiled.starts]] = 0.0  # states are no motion
    return scales


def joint_rows(compiled: Compiled) -> Mask:
    """(nc,) rows that are not drivers'."""
    driven = [path.startswith("drivers.") for path in compiled.layout.reactions]
    joints: Mask = ~np.repeat(driven, compiled.system.groups["n"]).astype(bool)
    return joints


def element(path: str) -> str:
    """The section and name of what a path is of: couplers have a reaction for each joint."""
    return ".".join(path.split(".")[:2])


def plain_name(path: str) -> str:
    """The name of a joint without its section, of anything else with it."""
    return path.removeprefix("joints.")


def row_tangent(
    axes: tuple[int, int, int], factor: float, xi: Array, Ri: Array, xj: Array, Rj: Array
) -> Array:  # fmt: skip
    """Derivative (12, 12) of the gradient of a row times a factor; zero where it has none."""
    (kind, a, b), at = axes, rows_between(xi, Ri, xj, Rj)
    tangent = ROW_KINDS[kind].tangent
    with np.errstate(all="ignore"):
        if tangent is not None:
            tangent(at, a, b, 0, 1, factor)
    return np.asarray(np.nan_to_num(at.H, nan=0.0, posinf=0.0, neginf=0.0))
