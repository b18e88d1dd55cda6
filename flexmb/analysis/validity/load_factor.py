"""Load factor of stiffened flexible bodies in a run: their loads over those that buckle them.

The load factor μ is the largest number for which K + K_g/μ is singular.
K_g is the geometric stiffness of the forces at markers and of the inertia loads at one time of the
run, for those motions of the whole mechanism that deform it. The mean over a vibration period
counts, since waves along a bar do not buckle it. Above μ = 1 linear theory is not valid. Bodies
without geometric stiffening are judged by :mod:`flexmb.analysis.validity.omitted_stiffening`.

Sources: Euler's columns, Timoshenko & Gere, Theory of Elastic Stability, §2.2; the relation of load
and frequency, f = f₀ √(1 − P/P_cr), Timoshenko, Vibration Problems in Engineering, §5.11.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from flexmb.analysis.assembly.jacobian import (
    MAX_COORDINATES,
    ConstraintRows,
    numerical_rank,
    one_blas_thread,
)
from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.linear_elasticity import flexible_columns, joined_modes
from flexmb.analysis.validity.period_mean import period_mean, slow_shares, stretch
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import stage_solver
from flexmb.engine.initial_conditions import RESIDUAL
from flexmb.engine.state import State, Work
from flexmb.engine.tables import bend_of
from flexmb.errors import AssemblyError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray, skew
from flexmb.flexbody.natural_modes import matrices_at_rest
from flexmb.model.forces.load import BodyLoadSpec
from flexmb.model.model import Model
from flexmb.results.output_block import OutputBlock

#: Load factor above which a run has a note.
NEAR_BUCKLING = 0.8
_EULER = 0.1  # Euler load of a pinned bar over ω₁² m L: 1/π²
_SLENDER = 0.05  # largest ratio of the second moments of mass across and along a slender bar
# Rows are examined if a simple upper bound of the load exceeds this share of the warning level.
_MIN_ESTIMATE = 0.3
_MAX_ENTRIES = 2_000_000  # matrix entries of all rows that are examined together
# Strain energy of a body in the motion that buckles, over the largest, with which it buckles too:
# equal columns of a frame have the same.
_MIN_ENERGY = 0.5
_RIGID_SHARE = 1e-9  # ω² over the largest one, below which a motion deforms nothing


class LoadFactorMonitor:
    """Computes the load factor of each slender body with geometric stiffening along a run.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    q : (nq,) array
        First positions.
    is_motion : bool
        Whether the rows are a motion, whose vibrations do not count; not separate equilibria.
    """

    def __init__(self, compiled: Compiled, model: Model, q: Array, is_motion: bool = True) -> None:
        self._compiled, self._units, self._is_motion = compiled, model.units, is_motion
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        self._bodies, periods = [], []
        if compiled.layout.nv <= MAX_COORDINATES:
            Cq = lowest = None
            for columns, body in flexible_columns(compiled):
                Cq = ConstraintRows(compiled).evaluate(q).Cq if Cq is None else Cq
                frequencies, _ = joined_modes(body, columns, q, Cq)
                _, length = slender_axis(body)
                stiffened = body.centrifugal_stiffness is not None
                if length == 0.0 or not len(frequencies) or not stiffened:
                    continue
                lowest = _lowest_frequency(compiled, q) if lowest is None else lowest
                euler = _EULER * min(frequencies[0], lowest) ** 2 * body.mass * length
                self._bodies.append((columns, body, euler))
                periods.append(2.0 * np.pi / frequencies[0])
        self._periods = np.array(periods)
        self._reactions = [
            [k for k, path in enumerate(compiled.layout.reactions) if _acts_on(model, path, name)]
            for name in (columns.name for columns, *_ in self._bodies)
        ]
        self._loaded = [
            sum(_is_on(spec, columns.name) for spec in model.forces.values()) > 1
            or any(
                isinstance(f, BodyLoadSpec) and f.body == columns.name
                for f in model.forces.values()
            )
            for columns, *_ in self._bodies
        ]
        self._largest = np.zeros((2, len(self._bodies)))
        self._mean = np.full((2, len(self._bodies)), np.nan)  # mean over a period, time of last row
        self._stretches = [stretch(body, slender_axis(body)[0]) for _, body, _ in self._bodies]
        self._last = np.full((len(self._bodies), 3), np.nan)  # as of `slow_shares`

    @cached_property
    def _scratch(self) -> tuple[State, Work, Callable[[int], float]]:
        system = self._compiled.system
        state, work = new_state(system), new_work(system)
        return state, work, stage_solver(system, state, work)

    @cached_property
    def _mechanism(self) -> _Mechanism:
        return _Mechanism(self._compiled, self._gravity)

    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._bodies:
            return
        worth = np.zeros(len(rows.t), bool)
        for k, (columns, body, euler) in enumerate(self._bodies):
            force = np.abs(rows.lam).sum(axis=1)  # used if reactions are not stored
            if rows.reactions.size:
                parts = rows.reactions.reshape(len(rows.t), -1, 12)[:, self._reactions[k], :3]
                force = np.linalg.norm(parts, axis=2).sum(axis=1)
            far = np.linalg.norm(rows.vd[:, columns.iv : columns.iv + 3] - self._gravity, axis=1)
            load = force + body.mass * far
            worth |= (load > _MIN_ESTIMATE * NEAR_BUCKLING * euler) | self._loaded[k]
        values = np.zeros((len(rows.t), len(self._bodies)))
        values[worth] = self._values(rows, np.flatnonzero(worth))
        slow = np.zeros_like(values)
        for k, ((columns, *_), along) in enumerate(zip(self._bodies, self._stretches, strict=True)):
            slow[:, k], self._last[k] = slow_shares(columns, along, rows, self._last[k])
        for row in range(len(rows.t)) if worth.any() or self._mean[0].any() else ():
            self._average(float(rows.t[row]), values[row], slow[row])

    def _average(self, t: float, values: Array, slow: Array) -> None:
        """Update the means over a vibration period by the values at time t."""
        passed = (t - self._mean[1]) / self._periods if self._is_motion else np.nan * values
        self._mean[0], mean = period_mean(self._mean[0], passed, values, slow)
        self._mean[1] = t
        larger = mean > self._largest[0]
        self._largest[:, larger] = mean[larger], np.full(larger.sum(), t)

    def add_last(self, rows: OutputBlock) -> None:
        """Add the last row of a run that failed, without averaging."""
        if self._bodies:
            values = self._values(rows, np.zeros(1, np.int64))[0]
            larger = values > self._largest[0]
            self._largest[:, larger] = values[larger], np.full(larger.sum(), rows.t[0])

    def diverging(self) -> str:
        """The sentence on the first body that its loads have buckled, or ""."""
        for one in self.indicators():
            if one.value > 1.0:
                return one.text()
        return ""

    def indicators(self) -> Iterator[Indicator]:
        """The load factor of each body."""
        for k, (columns, *_) in enumerate(self._bodies):
            value, t = self._largest[:, k]
            text = partial(self._sentence, columns.name, value, t)
            yield Indicator(columns.name, "load_factor", value, t, NEAR_BUCKLING, text)

    def _sentence(self, name: str, value: float, t: float) -> str:
        what = "linear theory ends at one; make it stiffer, or shorten it between its joints"
        return (
            f"bodies.{name}: at t = {self._units.say(t, 's', 4)} its loads are {value:.2g} of "
            f"those that buckle it: {what}"
        )

    @one_blas_thread()
    def _values(self, rows: OutputBlock, which: IntArray) -> Array:
        """(rows, bodies) load factors at the rows `which`, from the wrenches at all markers."""
        parts = self._compiled.system.parts
        values = np.zeros((len(which), len(self._bodies)))
        numbers = [int(np.flatnonzero(parts.bodies["iv"] == one[0].iv)[0]) for one in self._bodies]
        size = max(1, _MAX_ENTRIES // self._compiled.layout.nv**2)
        for first in range(0, len(which), size):
            part = slice(first, first + size)
            loads = self.loads(rows, which[part])
            values[part] = self._mechanism.load_factors(loads)[:, numbers]
        return values

    def loads(self, rows: OutputBlock, which: IntArray) -> Loads:
        """The forces at all markers at the rows `which`."""
        state, work, solve = self._scratch
        forces, arms, axes = [], [], []
        for row in which:
            state.t[0] = rows.t[row]
            for name in ("q", "v", "vd", "lam"):
                getattr(state, name)[:] = getattr(rows, name)[row]
            solve(RESIDUAL)
            forces.append(self._forces(work, state.lam))
            arms.append(work.now.marker["s"].copy())
            axes.append(work.now.body["A"].copy())
        q, v, vd = (getattr(rows, name)[which] for name in ("q", "v", "vd"))
        return Loads(q, v, vd, *(np.array(one) for one in (forces, arms, axes)))

    def _forces(self, work: Work, lam: Array) -> Array:
        """(markers, 3) forces, including those of point joints, which the engine does not store."""
        system = self._compiled.system
        W = work.now.marker["W"][:, :3].copy()
        W[system.parts.markers["point"] == 1] = 0.0
        joints = system.kinds.get("point_joints")
        for group in () if joints is None else system.groups[joints.groups]:
            for r in range(group["row"], group["row"] + group["n"]):
                row = system.rows[r]
                W[row["I"], row["a"]] += lam[r]
                W[row["J"], row["a"]] -= lam[r]
        return np.asarray(W)


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads at n times of a run: q, v, vd; forces at markers (n, markers, 3) in global axes, their
    arms in body axes; the axes A (n, bodies, 3, 3) of all bodies."""

    q: Array
    v: Array
    vd: Array
    forces: Array
    s: Array
    A: Array


class _Mechanism:
    """Square root of the mass and stiffness (nv, nv) of all bodies, in body axes; constraints."""

    def __init__(self, compiled: Compiled, gravity: Array) -> None:
        nv, self._compiled, self._gravity = compiled.layout.nv, compiled, gravity
        self._rows, self._root, self._K = ConstraintRows(compiled), np.eye(nv), np.zeros((nv, nv))
        self._bodies: list[tuple[np.void, slice, FlexBody | None, Array]] = []
        names = {columns.iv: columns.name for columns in compiled.layout.bodies}
        for entry in compiled.system.parts.bodies:
            iv, m = int(entry["iv"]), int(entry["m"])
            body, part = compiled.bodies.get(names[iv]), slice(iv, iv + 6 + m)
            mean = np.zeros((6, m))
            if body is None or not m:
                body, M = None, _rigid_mass(entry)
            else:
                M, self._K[part, part] = matrices_at_rest(body)
                mean = np.array([np.concatenate(_mean_motion(body, eta)) for eta in np.eye(m)]).T
            self._root[part, part] = _square_root(M)
            self._bodies.append((entry, part, body, mean))

    def load_factors(self, loads: Loads) -> Array:
        """(n, bodies) load factors of the mechanism, each assigned to the bodies that buckle."""
        n, Kg = len(loads.q), self._geometric_stiffness(loads)
        poses = [self._rows.evaluate(q).jacobian for q in loads.q]
        _, S, Vt = np.linalg.svd(np.array([pose.A for pose in poses]))
        ranks = np.array([numerical_rank(one) for one in S])
        values = np.zeros((n, len(self._bodies)))
        for rank in np.unique(ranks):
            rows = np.flatnonzero(ranks == rank)
            N = np.array([poses[k].velocities(Vt[k, rank:].T) for k in rows])
            for number, (_, part, _, _) in enumerate(self._bodies):
                own = slice(part.start, part.start + 3)
                N[:, own] = loads.A[rows, number].transpose(0, 2, 1) @ N[:, own]
            omega2, X = _natural_motions(self._K, self._root, N)
            rigid = (omega2 <= _RIGID_SHARE * omega2[:, -1:]).sum(axis=1)
            for count in np.unique(rigid[rigid < omega2.shape[1]]):
                some = rigid == count
                V = N[some] @ X[some][:, :, count:] / np.sqrt(omega2[some, None, count:])
                self._buckle(Kg, V, rows[some], values)
        return values

    def _buckle(self, Kg: Array, V: Array, rows: IntArray, values: Array) -> None:
        """Set the load factors of `rows` by motions V (rows, nv, k) of unit strain energy."""
        Vt = V.transpose(0, 2, 1)
        factors, shapes = np.linalg.eigh(-0.5 * Vt @ (Kg[rows] + Kg[rows].transpose(0, 2, 1)) @ V)
        x = (V @ shapes[:, :, -1:])[..., 0]
        parts = [part for _, part, *_ in self._bodies]
        energy = np.array(
            [((x[:, own] @ self._K[own, own]) * x[:, own]).sum(axis=1) for own in parts]
        ).T
        buckles = energy >= _MIN_ENERGY * energy.max(axis=1, keepdims=True)
        values[rows] = np.where(buckles, factors[:, -1:], 0.0)

    def _geometric_stiffness(self, loads: Loads) -> Array:
        """(n, nv, nv) second variation of the work of all loads by rotations and eta, body axes.

        The loads are forces at markers and inertia forces ρ (a + G s), all of constant direction.
        """
        K = np.zeros((len(loads.q), *self._K.shape))
        parts, v, vd = self._compiled.system.parts, loads.v, loads.vd
        for number, (entry, part, body, mean) in enumerate(self._bodies):
            A, m, iv = loads.A[:, number], int(entry["m"]), part.start
            eta = vd[:, iv + 6 : iv + 6 + m] @ mean.T  # acceleration of the mean axes
            a = ((vd[:, None, iv : iv + 3] - self._gravity) @ A)[:, 0] + eta[:, :3]
            w, alpha = v[:, iv + 3 : iv + 6], vd[:, iv + 3 : iv + 6] + eta[:, 3:]
            spin = w[:, :, None] * w[:, None]
            G = skew(alpha) + spin - (w * w).sum(axis=1)[:, None, None] * np.eye(3)
            markers = np.flatnonzero(parts.markers["body"] == number)
            forces, Kb = loads.forces[:, markers] @ A, K[:, iv + 3 : part.stop, iv + 3 : part.stop]
            moments = G @ entry["S0"] + a[:, :, None] * entry["S1"]
            moments = moments - forces.transpose(0, 2, 1) @ loads.s[:, markers]
            for k, marker in enumerate(parts.markers[markers]):
                f = forces[:, k]
                if m and marker["modes"] >= 0:
                    Phi = parts.pool[marker["modes"] : marker["modes"] + 3 * m].reshape(3, m)
                    Kb[:, :3, 3:] -= np.cross(Phi.T, f[:, None]).transpose(0, 2, 1)
                    if marker["bend"] >= 0:
                        bend = bend_of(marker, m, parts.pool)
                        Kb[:, 3:, 3:] += np.einsum("nd,idj->nij", f, bend)
            trace = np.trace(moments, axis1=1, axis2=2)[:, None, None]
            Kb[:, :3, :3] = 0.5 * (moments + moments.transpose(0, 2, 1)) - trace * np.eye(3)
            if body is not None:
                carried = np.einsum("nkl,ljc->nkjc", G, body.P)
                carried += np.einsum("nk,jc->nkjc", a, body.p)
                for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
                    Kb[:, i, 3:] += carried[:, k, j] - carried[:, j, k]
                if (centrifugal := body.centrifugal_stiffness) is not None:
                    G = 0.5 * (G + G.transpose(0, 2, 1))
                    Kb[:, 3:, 3:] -= np.tensordot(G, centrifugal, 2)
            Kb[:, 3:, :3] = Kb[:, :3, 3:].transpose(0, 2, 1)
        return K


def _lowest_frequency(compiled: Compiled, q: Array) -> float:
    """Of all flexible bodies in the mechanism [rad/s]: a body on top of a column moves with it."""
    every = list(range(len(compiled.layout.bodies)))
    flexible = [k for k in every if compiled.layout.bodies[k].m]
    try:
        return float(MechanismModes(compiled, q, every).vibrations(*flexible).omega[0])
    except AssemblyError:  # motions without inertia
        return 0.0


def _natural_motions(K: Array, root: Array, N: Array) -> tuple[Array, Array]:
    """Squared frequencies (n, d), ascending, and their motions y (n, d, d) with N y of unit mass.

    The square root of the mass is used, since in the mass itself the inertia of a thin bar about
    its axis would be lost by round-off next to that of a heavy body.
    """
    back = np.linalg.inv(np.linalg.qr(root @ N, mode="r"))
    inverse = back.transpose(0, 2, 1)
    omega2, Y = np.linalg.eigh(inverse @ (N.transpose(0, 2, 1) @ K @ N) @ back)
    return omega2, back @ Y


def _square_root(M: Array) -> Array:
    """A matrix R with RᵀR = M, for a mass matrix with entries of very different sizes."""
    size = np.sqrt(M.diagonal())
    values, X = np.linalg.eigh(M / np.outer(size, size))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * X.T * size)


def _mean_motion(body: FlexBody, eta: Array) -> tuple[Array, Array]:
    """Mean translation at the origin and mean rotation (3,) of modal coordinates eta (m,)."""
    P = body.P @ eta - np.outer(body.center, body.p @ eta)
    moment = np.array([P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]])
    turn = np.linalg.pinv(body.inertia_about_center) @ moment
    return body.p @ eta / body.mass - np.cross(turn, body.center), turn


def _rigid_mass(entry: np.void) -> Array:
    """(6, 6) mass of a rigid body about its origin, body axes."""
    arm = skew(entry["S1"])
    J = np.trace(entry["S0"]) * np.eye(3) - entry["S0"]
    return np.block([[entry["mass"] * np.eye(3), -arm], [arm, J]])


def slender_axis(body: FlexBody, ratio: float = _SLENDER) -> tuple[Array, float]:
    """Axis and length of a body; length 0 if second moments across and along it exceed a ratio."""
    S = body.S0 - np.outer(body.S1, body.S1) / body.mass
    values, axes = np.linalg.eigh(S)
    slender = values[1] < ratio * values[2]
    return axes[:, 2], float(np.sqrt(12.0 * values[2] / body.mass)) if slender else 0.0


def _acts_on(model: Model, path: str, body: str) -> bool:
    section, _, name = path.partition(".")
    return section == "joints" and _is_on(model.joints[name], body)


def _is_on(spec: object, body: str) -> bool:
    """Whether a joint or force acts at a marker of the body."""
    if isinstance(spec, BodyLoadSpec):
        return spec.body == body
    markers = getattr(spec, "between", None) or (getattr(spec, "at", None),)
    return any((marker or "").partition(".")[0] == body for marker in markers)


def masses_along(body: FlexBody, axis: Array, ends: Array) -> Array:
    """(2, s) masses of the divisions of a bar, and the parts of them beyond their middles.

    The divisions are between `ends` (s + 1,) from the centre of mass. Masses per length are linear
    along the axis; masses at both ends, or one at the middle, give the centre and the second moment
    of the body.
    """
    length, center = ends[-1] - ends[0], -0.5 * (ends[0] + ends[-1])  # of mass, from the middle
    x = 0.5 * (ends[:-1] + ends[1:]) + center
    S = body.S0 - np.outer(body.S1, body.S1) / body.mass
    second = float(axis @ S @ axis) / length**2 + body.mass * (center / length) ** 2
    at_ends = min(6.0 * second - 0.5 * body.mass, body.mass)
    lumps, more = np.zeros(len(x)), 0.0
    if at_ends > 0.0:
        more = float(np.clip(2.0 * body.mass * center / length, -at_ends, at_ends))
        lumps[[0, -1]] = 0.5 * (at_ends - more), 0.5 * (at_ends + more)
    else:
        lumps[len(x) // 2 - 1] = -2.0 * at_ends
    rest, first = body.mass - lumps.sum(), body.mass * center - 0.5 * more * length
    weights = np.maximum(rest + 12.0 * first * x / length**2, 0.0)
    spread = weights * (rest / max(weights.sum(), 1e-300))
    return np.array([lumps + spread, np.append(0.0, lumps[1:]) + 0.5 * spread])
