"""How near the loads of a run bring a flexible body to buckling.

Where geometric stiffening is on, the load factor μ is the largest of the numbers with which K + K_g
/ μ has a motion without stiffness: K_g is the geometric stiffness of the forces at the markers and
of the inertia loads, at one moment of the run, in those motions of the whole mechanism that deform
it, in the mean over a period: waves along a bar do not buckle it. Above one linear theory has no
meaning. Where it is off, slender bodies are judged by the axial force beside Euler's load of a bar
between pins with their lowest frequency, 0.1 ω₁² m L, which is right within a factor of two for
other ends.

Sources: Euler's columns, Timoshenko & Gere, Theory of Elastic Stability, §2.2; the relation of load
and frequency, f = f₀ √(1 − P/P_cr), Timoshenko, Vibration Problems in Engineering, §5.11.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, ConstraintRows
from flexmb.analysis.dynamics.linear_elasticity import flexible_columns, in_body_axes, joined_modes
from flexmb.analysis.monitors import Indicator
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import stage_solver
from flexmb.engine.initial_conditions import RESIDUAL
from flexmb.engine.state import State, Work
from flexmb.engine.work import new_state, new_work
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, skew
from flexmb.flexbody.natural_modes import matrices_at_rest
from flexmb.model.forces.body_load import BodyLoadSpec
from flexmb.model.model import Model
from flexmb.results.writer import OutputBlock

#: Load factors from which on the user is told, with and without geometric stiffening.
NEAR_BUCKLING, LARGEST_AXIAL_LOAD = 0.8, 0.1
_EULER = 0.1  # load between pins over ω₁² m L: 1/π²
_SLENDER = 0.05  # second moment of mass across a bar over that along it
_LOOK = 0.3  # of the level of warning: what the least of all estimates must reach
_FASTEST = 0.125  # share of a mean that one row may replace
_RIGID = 1e-9  # of the highest squared frequency: motions that deform nothing


class LoadFactorMonitor:
    """The load factor of each flexible body that forces act on.

    Parameters
    ----------
    compiled, model : Compiled, Model
        What is run.
    q : (nq,) array
        First positions.
    """

    def __init__(self, compiled: Compiled, model: Model, q: Array) -> None:
        self._compiled, self._units = compiled, model.units
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        self._bodies, periods = [], []
        if compiled.layout.nv <= MAX_COORDINATES:
            Cq = None
            for columns, body in flexible_columns(compiled):
                Cq = ConstraintRows(compiled).evaluate(q).Cq if Cq is None else Cq
                frequencies, _ = joined_modes(body, columns, q, Cq)
                axis, length = _bar(body)
                if length == 0.0 or not len(frequencies):
                    continue
                euler = _EULER * frequencies[0] ** 2 * body.mass * length
                stiffened = body.centrifugal_stiffness is not None
                self._bodies.append((columns, body, axis, length, euler, stiffened))
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
        self._mean = np.full((2, len(self._bodies)), np.nan)  # over a period, and its last moment

    @cached_property
    def _scratch(self) -> tuple[State, Work, Callable[[int], float]]:
        system = self._compiled.system
        state, work = new_state(system), new_work(system)
        return state, work, stage_solver(system, state, work)

    def add(self, rows: OutputBlock) -> None:
        """Take the next rows."""
        if not self._bodies:
            return
        worth = np.zeros(len(rows.t), bool)
        for k, (columns, body, _, _, euler, stiffened) in enumerate(self._bodies):
            force = np.abs(rows.lam).sum(axis=1)  # where reactions are not stored
            if rows.reactions.size:
                parts = rows.reactions.reshape(len(rows.t), -1, 12)[:, self._reactions[k], :3]
                force = np.linalg.norm(parts, axis=2).sum(axis=1)
            far = np.linalg.norm(rows.vd[:, columns.iv : columns.iv + 3] - self._gravity, axis=1)
            load = force + body.mass * far
            level = NEAR_BUCKLING if stiffened else LARGEST_AXIAL_LOAD
            worth |= (load > _LOOK * level * euler) | self._loaded[k]
        none = np.zeros(len(self._bodies))
        for row in range(len(rows.t)) if worth.any() or self._mean[0].any() else ():
            self._average(float(rows.t[row]), self._values(rows, row) if worth[row] else none)

    def _average(self, t: float, values: Array) -> None:
        """Take values at a moment into the means, which forget as fast as the bodies vibrate."""
        mean, last = self._mean
        mean[:] = np.where(np.isnan(mean), values, mean)
        forgotten = np.minimum((t - np.where(np.isnan(last), t, last)) / self._periods, _FASTEST)
        mean += forgotten * (values - mean)
        last[:] = t
        larger = mean > self._largest[0]
        self._largest[:, larger] = mean[larger], np.full(larger.sum(), t)

    def add_last(self, rows: OutputBlock) -> None:
        """Take the row in which a run ends, by itself: there is no time for a mean."""
        if self._bodies:
            values = self._values(rows, 0)
            larger = values > self._largest[0]
            self._largest[:, larger] = values[larger], np.full(larger.sum(), rows.t[0])

    def diverging(self) -> str:
        """The sentence for the first body that its loads have buckled, or ""."""
        for one in self.indicators():
            if one.warning == NEAR_BUCKLING and one.value > 1.0:
                return one.text()
        return ""

    def indicators(self) -> Iterator[Indicator]:
        """The load factor of each body."""
        for k, (columns, _, _, _, _, stiffened) in enumerate(self._bodies):
            value, t = self._largest[:, k]
            level = NEAR_BUCKLING if stiffened else LARGEST_AXIAL_LOAD
            text = partial(self._sentence, columns.name, value, t, stiffened)
            yield Indicator(columns.name, "load_factor", value, t, level, text)

    def _sentence(self, name: str, value: float, t: float, stiffened: bool) -> str:
        at = self._units.say(t, "s", 4)
        if stiffened:
            what = "linear theory ends at one; make it stiffer, or shorten it between its joints"
            return (
                f"bodies.{name}: at t = {at} its loads are {value:.2g} of those that buckle it: "
                f"{what}"
            )
        return (
            f"bodies.{name}: at t = {at} it is compressed by about {value:.2g} of the load that "
            "buckles it, yet its forces do not soften it; reduce it with "
            'geometric_stiffening = "full"'
        )

    def _values(self, rows: OutputBlock, row: int) -> Array:
        """(bodies,) load factors at one row, from the wrenches at all markers."""
        state, work, solve = self._scratch
        state.t[0] = rows.t[row]
        for name in ("q", "v", "vd", "lam"):
            getattr(state, name)[:] = getattr(rows, name)[row]
        solve(RESIDUAL)
        now, table = work.now.marker, self._compiled.system.parts.markers
        values = np.zeros(len(self._bodies))
        whole: Array | None = None
        for k, (columns, body, axis, length, euler, stiffened) in enumerate(self._bodies):
            if stiffened:
                if whole is None:
                    whole = load_factors(self._compiled, state, now, self._gravity)
                values[k] = whole[self._number(columns.iv)]
                continue
            number = self._number(columns.iv)
            at = np.flatnonzero(table["body"] == number)
            forces = now["W"][at, :3] @ work.now.body[number]["A"]
            values[k] = -((forces @ axis) @ ((now["s"][at] - body.center) @ axis)) / length / euler
        return values

    def _number(self, iv: int) -> int:
        """Which body of the engine it is."""
        return int(np.flatnonzero(self._compiled.system.parts.bodies["iv"] == iv)[0])


def load_factors(compiled: Compiled, state: object, now: NDArray[np.void], gravity: Array) -> Array:
    """(bodies,) load factor of the mechanism at one moment, given to the body that buckles.

    Parameters
    ----------
    compiled : Compiled
        What is run.
    state : State
        Positions, velocities, accelerations.
    now : (markers,) MARKER_NOW
        Wrenches and places of the markers there.
    gravity : (3,) array
        Its acceleration.
    """
    q, v, vd = state.q, state.v, state.vd  # type: ignore[attr-defined]
    nv, table = compiled.layout.nv, compiled.system.parts.bodies
    M, K, Kg = np.eye(nv), np.zeros((nv, nv)), np.zeros((nv, nv))
    names = {columns.iv: columns.name for columns in compiled.layout.bodies}
    slices = []
    for number, entry in enumerate(table):
        iq, iv, m = int(entry["iq"]), int(entry["iv"]), int(entry["m"])
        body = compiled.flexbodies.get(names[iv])
        p = q[iq + 3 : iq + 7]
        A = in_body_axes(np.tile(p, (3, 1)), np.eye(3))
        loads = compiled.system.parts.markers["body"] == number
        if body is None or body.m != m:
            Mb, Kb = _rigid_mass(entry), np.zeros((6, 6))
        else:
            Mb, Kb = matrices_at_rest(body)
        turn = block_diag(A, np.eye(3 + m))
        part = slice(iv, iv + 6 + m)
        M[part, part], K[part, part] = turn @ Mb @ turn.T, Kb
        a = (vd[iv : iv + 3] - gravity) @ A
        w = v[iv + 3 : iv + 6]
        alpha = vd[iv + 3 : iv + 6]
        if body is not None and body.m == m:  # of mean axes, whatever the body frame is fixed at
            shift, turn = _mean_motion(body, vd[iv + 6 : iv + 6 + m])
            a, alpha = a + shift, alpha + turn
        G = skew(alpha) + np.outer(w, w) - w @ w * np.eye(3)
        forces = now["W"][loads, :3] @ A
        Kg[iv + 3 : iv + 6 + m, iv + 3 : iv + 6 + m] = _geometric_stiffness(
            compiled,
            entry,
            body if m else None,
            np.flatnonzero(loads),
            forces,
            now["s"][loads],
            a,
            G,
        )
        slices.append(part)
    jacobian = ConstraintRows(compiled).evaluate(q).jacobian
    N = jacobian.velocities(jacobian.decomposition.free)
    omega2, X = eigh(N.T @ K @ N, N.T @ M @ N)
    V = N @ X[:, omega2 > _RIGID * omega2[-1]] / np.sqrt(omega2[omega2 > _RIGID * omega2[-1]])
    values = np.zeros(len(table))
    if V.shape[1]:
        factors, shapes = eigh(-0.5 * V.T @ (Kg + Kg.T) @ V)
        x = V @ shapes[:, -1]
        energy = [x[part] @ K[part, part] @ x[part] for part in slices]
        values[int(np.argmax(energy))] = factors[-1]
    return values


def _mean_motion(body: FlexBody, eta: Array) -> tuple[Array, Array]:
    """Translation at the origin and rotation (3,) that modal coordinates (m,) have in the mean."""
    P = body.P @ eta - np.outer(body.center, body.p @ eta)
    moment = np.array([P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]])
    turn = np.linalg.pinv(body.inertia_about_center) @ moment
    return body.p @ eta / body.mass - np.cross(turn, body.center), turn


def _geometric_stiffness(
    compiled: Compiled,
    entry: np.void,
    body: FlexBody | None,
    markers: NDArray[np.int64],
    forces: Array,
    arms: Array,
    a: Array,
    G: Array,
) -> Array:
    """(3 + m, 3 + m) second variation of the work of all loads, over rotation and eta, body axes.

    Forces at markers, and inertia ρ (a + G s), each along a direction that does not turn.
    """
    m, pool = int(entry["m"]), compiled.system.parts.pool
    K = np.zeros((3 + m, 3 + m))
    moments = G @ entry["S0"] + np.outer(a, entry["S1"])
    for f, s, k in zip(forces, arms, markers, strict=True):
        moments = moments - np.outer(f, s)
        marker = compiled.system.parts.markers[k]
        if m and marker["modes"] >= 0:
            Phi = pool[marker["modes"] : marker["modes"] + 3 * m].reshape(3, m)
            K[:3, 3:] -= np.cross(Phi.T, f).T
            if marker["bend"] >= 0:
                bend = pool[marker["bend"] : marker["bend"] + 3 * m * m].reshape(m, 3, m)
                K[3:, 3:] += np.einsum("d,idj->ij", f, bend)
    K[:3, :3] = 0.5 * (moments + moments.T) - np.trace(moments) * np.eye(3)
    if body is not None:
        carried = np.einsum("kl,ljc->kjc", G, body.P) + np.einsum("k,jc->kjc", a, body.p)
        for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
            K[i, 3:] += carried[k, j] - carried[j, k]
        if body.centrifugal_stiffness is not None:
            K[3:, 3:] -= np.einsum("ab,abij->ij", 0.5 * (G + G.T), body.centrifugal_stiffness)
    K[3:, :3] = K[:3, 3:].T
    return K


def _rigid_mass(entry: np.void) -> Array:
    """(6, 6) mass of a rigid body about its origin, body axes."""
    arm = skew(entry["S1"])
    J = np.trace(entry["S0"]) * np.eye(3) - entry["S0"]
    return np.block([[entry["mass"] * np.eye(3), -arm], [arm, J]])


def _bar(body: FlexBody) -> tuple[Array, float]:
    """Axis and length of a slender body; length 0 where it is none."""
    S = body.S0 - np.outer(body.S1, body.S1) / body.mass
    values, axes = np.linalg.eigh(S)
    slender = values[1] < _SLENDER * values[2]
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
