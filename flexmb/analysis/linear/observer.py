"""Observers of a linearised motion, its independent coordinates and equations.

A small motion is written in the axes of an observer F, the ground or a body, which turns with ω_F:
δq = S x, S = diag(R_F, Aᵀ R_F, 1) for translation, rotation and modes of each body, so that

    δv = S (ẋ + W x),   δv̇ = S (ẍ + W ẋ + Ẇ x) + P (ẋ + W x),   P = Ṡ = S W − Ω S,

with W = diag(ω̃_F, ω̃_F, 0) in axes of F and Ω = diag(0, ω̃', 0), ω' of each body in its axes. A
machine that rotates as a whole, such as blades on a hub, has constant coefficients in rotating
axes; a rotor of revolution in those of its bearings. The joints allow x = N(t) y. The independent
coordinates y are selected among x by pivoting. Translations and rotations become dependent before
modes, so that soft and stiff directions are not mixed. If N changes with time, Ṅ and N̈ along the
motion enter the equations too: M ÿ + D ẏ + K y = Nᵀ f.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import ConstraintRows, column_scales, numerical_rank
from flexmb.analysis.linear.state_equations import Tangents
from flexmb.engine.algebra.vector import rotation_matrix
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.flexbody.arrays import Array, skew

_MODAL_SCALE = 1e-3  # weight of modes in pivoting: they become dependent only if nothing else can
_STEP = 0.02  # time step of differences along the motion, times its fastest rate
# Central differences of sixth order over seven points (Fornberg, Math. Comp. 51 (1988) 699).
_FIRST_DERIVATIVE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0
_SECOND_DERIVATIVE = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / 180.0
_MAX_OBSERVERS = 8  # largest number of observers that are compared
_EQUAL_ROTATIONS = 1e-9  # difference of angular velocities that is none, over the fastest rate


_AXES = ("x", "y", "z")


def body_axes(compiled: Compiled, q: Array) -> Array:
    """(bodies, 3, 3) direction cosines, body to global."""
    A = np.empty((len(compiled.layout.bodies), 3, 3))
    for k, body in enumerate(compiled.layout.bodies):
        rotation_matrix(q, body.iq + 3, A[k])
    return A


@dataclass(frozen=True)
class Observer:
    """Axes R (3, 3) of an observer, its angular velocity w and acceleration wd (3,) in them."""

    name: str
    R: Array
    w: Array
    wd: Array

    @classmethod
    def at(cls, compiled: Compiled, state: State, name: str) -> Observer:
        """The ground, or a body by its name."""
        if name == "ground":
            return cls(name, np.eye(3), np.zeros(3), np.zeros(3))
        body = next(body for body in compiled.layout.bodies if body.name == name)
        turn = slice(body.iv + 3, body.iv + 6)
        R = np.empty((3, 3))
        rotation_matrix(state.q, body.iq + 3, R)
        return cls(name, R, state.v[turn].copy(), state.vd[turn].copy())


def axes_of_motion(compiled: Compiled, A: Array, R: Array) -> Array:
    """S (nv, nv) for body axes A (bodies, 3, 3) and axes R of the observer."""
    S = np.eye(compiled.layout.nv)
    for body, own in zip(compiled.layout.bodies, A, strict=True):
        S[body.iv : body.iv + 3, body.iv : body.iv + 3] = R
        S[body.iv + 3 : body.iv + 6, body.iv + 3 : body.iv + 6] = own.T @ R
    return S


class Change(NamedTuple):
    """δq = S x, δv = S (ẋ + W x), δv̇ = S (ẍ + W ẋ + Ẇ x) + P (ẋ + W x): (nv, nv) each."""

    S: Array
    W: Array
    Wd: Array
    P: Array


def change_of_coordinates(observer: Observer, compiled: Compiled, state: State) -> Change:
    """The matrices from the motion x in the axes of an observer to δq, δv and δv̇."""
    nv = compiled.layout.nv
    S = axes_of_motion(compiled, body_axes(compiled, state.q), observer.R)
    W, Wd, turn = (np.zeros((nv, nv)) for _ in range(3))
    for body in compiled.layout.bodies:
        for at in (body.iv, body.iv + 3):
            W[at : at + 3, at : at + 3] = skew(observer.w)
            Wd[at : at + 3, at : at + 3] = skew(observer.wd)
        own = slice(body.iv + 3, body.iv + 6)
        turn[own, own] = skew(state.v[own])
    return Change(S, W, Wd, S @ W - turn @ S)


def in_axes_of(change: Change, of: Tangents) -> Tangents:
    """The matrices for x in place of δq, with F multiplied by Sᵀ."""
    S, W, Wd, P = change
    MS, DS = of.M @ S, of.D @ S
    return Tangents(
        S.T @ MS,
        S.T @ (MS @ W + of.M @ P + DS),
        S.T @ (MS @ Wd + of.M @ (P @ W) + DS @ W + of.K @ S),
        of.Cq @ S,
        S.T @ of.L,
    )


def fastest_rate(compiled: Compiled, state: State) -> float:
    """Rate at which the state changes, 1/s: largest weighted velocity, or root of acceleration."""
    bodies = [k for b in compiled.layout.bodies for k in range(b.iv, b.iv + 6)]
    weights = np.minimum(compiled.system.weights[bodies], 1e300)
    speed = float(np.abs(state.v[bodies] * weights).max())
    return max(speed, float(np.sqrt(np.abs(state.vd[bodies] * weights).max())))


class RowsAlongMotion:
    """The Jacobian and the axes of the bodies at a state, and before and after it.

    There are seven samples, a time h apart, along a motion with the velocity and acceleration of
    the state, which is in the middle. If nothing moves, there is only that of the state.
    """

    def __init__(self, compiled: Compiled, state: State) -> None:
        self.compiled, self.state = compiled, state
        rate = fastest_rate(compiled, state)
        moving = compiled.layout.nc > 0 and rate > 0.0 and bool(np.any(state.v))
        self.h = _STEP / rate if moving else 0.0
        rows = ConstraintRows(compiled)
        self.samples = []
        for k in range(-3, 4) if moving else (0,):
            s = k * self.h
            q = rows.move(state.q, s * state.v + 0.5 * s * s * state.vd)
            Cq = rows.evaluate(q, float(state.t[0])).Cq
            self.samples.append((Cq, body_axes(compiled, q)))


class Partition(NamedTuple):
    """Numbers of the dependent and of the independent velocity coordinates."""

    dependent: NDArray[np.int64]
    independent: NDArray[np.int64]


class Coordinates:
    """Independent coordinates y of the motions that the joints allow, seen by an observer.

    Parameters
    ----------
    along : RowsAlongMotion
        The rows at the state and near it.
    observer : Observer
        The observer in whose axes x is.
    partition : Partition, optional
        The selection of y; by default by pivoting.

    Attributes
    ----------
    N, Nd, Ndd : (nv, n) arrays
        x = N y, and its two derivatives in time.
    G, Gd, Gdd : (nv, nc) arrays
        x = G c changes the rows by c at constant independent coordinates; its two derivatives.
    index : (n,) array
        Numbers of the velocity coordinates that are selected as y.
    states : (n,) bool array
        Whether a coordinate is a state of a controller: only its ẏ has a meaning.
    """

    def __init__(
        self, along: RowsAlongMotion, observer: Observer, partition: Partition | None = None
    ) -> None:
        self._compiled = compiled = along.compiled
        scales = column_scales(compiled)
        starts = np.array([start.iv for start in compiled.starts], int)
        self._scales = np.where(scales > 0.0, scales, 1.0)
        self._left_out = np.flatnonzero(compiled.system.kkt.column < 0)
        names = ["ground", *(body.name for body in compiled.layout.bodies)]
        turning = names.index(observer.name) - 1
        weighted = [
            self._weighted(Cq, A, np.eye(3) if turning < 0 else A[turning])
            for Cq, A in along.samples
        ]
        A = weighted[len(weighted) // 2]
        self.partition = _partition(compiled, A, starts) if partition is None else partition
        self.index = self.partition.independent
        self.states = np.isin(self.index, starts)
        self.N, self.G = self._motions(A)
        self.Nd, self.Ndd = np.zeros_like(self.N), np.zeros_like(self.N)
        self.Gd, self.Gdd = np.zeros_like(self.G), np.zeros_like(self.G)
        if along.h > 0.0 and len(self.partition.dependent):
            for first, second, rows in zip(
                _FIRST_DERIVATIVE / along.h, _SECOND_DERIVATIVE / along.h**2, weighted, strict=True
            ):
                N, G = self._motions(rows)
                self.Nd += first * N
                self.Ndd += second * N
                self.Gd += first * G
                self.Gdd += second * G

    @property
    def n(self) -> int:
        """Number of independent coordinates."""
        return len(self.index)

    def _weighted(self, Cq: Array, A: Array, R: Array) -> Array:
        """(rows, nv) weighted rows of joints, and rows that fix coordinates normal to a plane."""
        S = axes_of_motion(self._compiled, A, R)
        weighted = self._compiled.system.row_weights[:, None] * (Cq @ S) * self._scales
        return np.vstack([weighted, S[self._left_out]])

    def _motions(self, A: Array) -> tuple[Array, Array]:
        """N and G of weighted rows A."""
        compiled, scales = self._compiled, self._scales
        dependent = self.partition.dependent
        N, G = np.zeros((compiled.layout.nv, self.n)), np.zeros((compiled.layout.nv, len(A)))
        N[self.index, np.arange(self.n)] = 1.0
        if len(dependent):
            Q, R = scipy.linalg.qr(A[:, dependent], mode="economic", check_finite=False)
            inverse = scipy.linalg.solve_triangular(R, Q.T, check_finite=False)
            own = scales[dependent, None]
            N[dependent] = -own * (inverse @ A[:, self.index]) / scales[self.index]
            G[dependent] = own * inverse
        nc = compiled.layout.nc
        return N, G[:, :nc] * compiled.system.row_weights


def _partition(compiled: Compiled, A: Array, starts: NDArray[np.int64]) -> Partition:
    """Dependent coordinates by pivoting of weighted rows A; modes are the last to depend."""
    rank = numerical_rank(np.asarray(np.linalg.svd(A, compute_uv=False))) if len(A) else 0
    order = np.arange(compiled.layout.nv)
    if rank:
        preference = np.ones(compiled.layout.nv)
        for body in compiled.layout.bodies:
            preference[body.iv + 6 : body.iv + 6 + body.m] = _MODAL_SCALE
        preference[starts] = 0.0
        order = scipy.linalg.qr(A * preference, mode="r", pivoting=True)[1]
    return Partition(order[:rank], np.sort(order[rank:]))


class MinimalEquations:
    """The equations M ÿ + D ẏ + K y = 0 of a state in the axes of an observer.

    `at` are the matrices for x; `left` (nv, n) is the left null space of the multipliers: leftᵀ L
    = 0.
    """

    def __init__(
        self,
        along: RowsAlongMotion,
        tangents: Tangents,
        name: str,
        partition: Partition | None = None,
    ) -> None:
        self.compiled, self.state = compiled, state = along.compiled, along.state
        self.observer = Observer.at(compiled, state, name)
        self.change = change_of_coordinates(self.observer, compiled, state)
        self.coordinates = Coordinates(along, self.observer, partition)
        self._set_matrices(tangents)

    def with_tangents(self, tangents: Tangents) -> MinimalEquations:
        """The equations of the same state in the same coordinates with other matrices."""
        other = copy(self)
        other._set_matrices(tangents)
        return other

    def _set_matrices(self, tangents: Tangents) -> None:
        self.at = at = in_axes_of(self.change, tangents)
        c = self.coordinates
        self.left = left = _left_null(at, c)
        self.mass = left.T @ at.M @ c.N
        self.damping = left.T @ (at.D @ c.N + 2.0 * at.M @ c.Nd)
        self.stiffness = left.T @ (at.K @ c.N + at.D @ c.Nd + at.M @ c.Ndd)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the independent coordinates."""
        names = _coordinate_names(self.compiled)
        return tuple(names[k] for k in self.coordinates.index)

    @property
    def depends_on_observer(self) -> bool:
        """Whether any independent coordinate is a translation or rotation, which has axes."""
        return any(".r." in name or ".rotation." in name for name in self.names)

    @property
    def slowest(self) -> float:
        """Lower bound of the rate of the slowest vibration, 1/s; 0 with rigid motions."""
        try:
            squared = np.trace(np.linalg.solve(self.stiffness, self.mass))
        except np.linalg.LinAlgError:
            return 0.0
        return float(1.0 / np.sqrt(abs(squared))) if np.isfinite(squared) and squared else 0.0

    def difference(self, later: MinimalEquations, rate: float) -> float:
        """Largest relative change of a coefficient; small ones over inertia at `rate`, 1/s."""
        mass, stiffness = (np.sqrt(np.abs(np.diag(M))) for M in (self.mass, self.stiffness))
        rates = np.maximum(stiffness, rate * mass)  # rate of each coordinate alone, times √mass
        changes = [0.0]
        for word, one_side in (("mass", (mass, mass)), ("damping", (rates, mass)),
                               ("stiffness", (rates, rates))):  # fmt: skip
            one, other = getattr(self, word), getattr(later, word)
            near = np.maximum(np.outer(*one_side), np.abs(one))
            gap = np.abs(other - one) / np.where(near > 0.0, near, 1.0)
            changes.append(float(gap.max(initial=0.0)))
        return max(changes)


def _left_null(at: Tangents, c: Coordinates) -> Array:
    """(nv, n) left null space of L; it is N unless friction depends on reactions."""
    extra = at.L - at.Cq.T
    if not extra.size or np.abs(extra).max() <= 1e-12 * np.abs(at.Cq).max(initial=0.0):
        return c.N
    dependent = np.setdiff1d(np.arange(len(c.N)), c.index)
    wanted = at.L.T @ c.N
    change = np.linalg.lstsq(at.L[dependent].T, -wanted, rcond=1e-10)[0]
    Y = c.N.copy()
    Y[dependent] += change
    return Y


def _coordinate_names(compiled: Compiled) -> list[str]:
    """Names of all velocity coordinates."""
    names = []
    for body in compiled.layout.bodies:
        names += [f"{body.name}.r.{a}" for a in _AXES] + [
            f"{body.name}.rotation.{a}" for a in _AXES
        ]
        names += [f"{body.name}.eta.{k}" for k in range(body.m)]
    return [*names, *compiled.layout.coordinates]


def carrier_of(seen: MinimalEquations, rate: float) -> str:
    """A rotating body if all bodies with independent modal coordinates rotate alike; else ""."""
    compiled, v = seen.compiled, seen.state.v
    names = {name.partition(".eta.")[0] for name in seen.names if ".eta." in name}
    bodies = zip(compiled.layout.bodies, body_axes(compiled, seen.state.q), strict=True)
    turns = {b.name: A @ v[b.iv + 3 : b.iv + 6] for b, A in bodies if b.name in names}
    first = next(iter(turns.values()), np.zeros(3))
    is_alike = all(np.linalg.norm(w - first) <= _EQUAL_ROTATIONS * rate for w in turns.values())
    return next(iter(turns)) if is_alike and np.linalg.norm(first) > _EQUAL_ROTATIONS * rate else ""


def observers(compiled: Compiled, state: State, rate: float) -> list[str]:
    """The ground, and bodies with different angular velocities, the fastest first."""
    names, seen = ["ground"], [np.zeros(3)]
    if rate == 0.0:
        return names
    A = body_axes(compiled, state.q)
    bodies = list(zip(compiled.layout.bodies, A, strict=True))
    turning = [(own @ state.v[b.iv + 3 : b.iv + 6], b.name) for b, own in bodies]
    for w, name in sorted(turning, key=lambda pair: -float(np.linalg.norm(pair[0]))):
        if all(np.linalg.norm(w - other) > _EQUAL_ROTATIONS * rate for other in seen):
            names.append(name)
            seen.append(w)
    return names[:_MAX_OBSERVERS]
