"""The equations of motion at one state, as arrays: residuals and their derivatives.

In: a compiled model and its state (t, q, v, v̇, λ). Out: F = M v̇ + … + Cqᵀ λ − Q and C, the
matrices M = ∂F/∂v̇, D = ∂F/∂v, K = ∂F/∂q, Cq = ∂C/∂q and ∂F/∂λ, and all channels. Derivatives with
respect to q are those with respect to the increment δ of q ∘ exp(δ), rotations in body axes. They
are taken from the engine's iteration matrix S = M + cv D + cp K, by suitable factors cv and cp.

Geometric stiffening takes ΔJ = tr(k) I − k, k = ηᵀK^{ab}η, from the inertia of the body frame in
these equations. What turns is the body in the mean: a frame at an interface turns with vibrations
too, whose mass is smaller, so that M would lose its sign by small deflections (0.8 % of the length
of a beam). In M here ΔJ belongs to the mean rotation, which is that of the frame in mean axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.allocation import new_run, new_work
from flexmb.engine.bodies.motion import move
from flexmb.engine.bodies.static_modes import free_static_modes, static_bodies
from flexmb.engine.bodies.wrench import marker_jacobian
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_units import bind, call, packed_record, prepare_units
from flexmb.engine.initial_conditions import evaluate_equations
from flexmb.engine.iteration_matrix import put_matrix, put_rows
from flexmb.engine.joints.constraint import read_reactions
from flexmb.engine.stage_tables import units_of
from flexmb.engine.state import State, Work
from flexmb.engine.state_rows import store_row_history
from flexmb.engine.tables import Kkt
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.natural_modes import mean_motion
from flexmb.model.model import Model
from flexmb.model.reading import GROUND
from flexmb.results.output_block import OutputBlock

Complex = NDArray[np.complex128]

_STEP = 1e-5  # of motions of unit size, for differences of wrenches
_SENSOR_STEP = 1e-4  # of a motion for differences of sensors, over the size of the model
_LEAST_REACTION, _LEAST_RANGE = 1e-3, 1e-6  # range over the largest that is judged; of sensors
_LEAST_MOTION = 1e-7  # range of a channel, by the size of the model and the run, that is a motion
_DERIVATIVES = {
    **dict.fromkeys(("position", "distance", "stroke", "angle", "second_angle"), 0),
    **dict.fromkeys(("velocity", "angular_velocity"), 1),
    **dict.fromkeys(("acceleration", "angular_acceleration", "reaction"), 2),
}
# Factors cv and cp that make one term of S = M + cv D + cp K dominate all others, or negligible.
# They are powers of two, so that nothing is rounded. Not zero, as feedback adds its terms only for
# cv > 0.
_DOMINANT, _NEGLIGIBLE = 2.0**60, 2.0**-120
_SLIDE = 0.25  # way that a joint slides, over the model, that is as a rotation of 1 rad


class Tangents(NamedTuple):
    """Derivatives of F with respect to v̇, v, q and λ, and of C to q, in the order of v and C."""

    M: Array  # (nv, nv)
    D: Array  # (nv, nv)
    K: Array  # (nv, nv)
    Cq: Array  # (nc, nv)
    L: Array  # (nv, nc) ∂F/∂λ: Cqᵀ and the forces that depend on reactions, as joint friction


class StateEquations:
    """The equations at a state, which they read but do not change.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.
    state : State
        The state; `q`, `v`, `vd`, `lam` and `t` may be changed in place between calls.
    """

    def __init__(self, compiled: Compiled, state: State) -> None:
        units = (evaluate_equations, put_matrix, put_rows, move, store_row_history, read_reactions)
        prepare_units([*units, *units_of(compiled.system)])
        compiled = replace(compiled, system=free_static_modes(compiled.system))
        self.compiled, self.state = compiled, state
        self.work: Work = new_work(compiled.system, len(state.angles))
        self._run = packed_record(new_run(compiled.system, state, self.work))
        self._at = packed_record(self._run.record.state_point)
        self._parts = packed_record(compiled.system.parts)
        self._channels = np.zeros(len(state.angles))
        self._put_channels = bind(evaluate_equations, self._run, self._channels)
        self._reactions = np.zeros(12 * len(compiled.layout.reactions))
        self._put_reactions = bind(read_reactions, self._run, self._at, self._reactions)
        self._put_matrices = [bind(one, self._run, self._at) for one in (put_matrix, put_rows)]
        self._motion = [np.zeros(n) for n in (len(state.q), compiled.layout.nv, len(state.q))]
        self._move = bind(move, self._parts, *self._motion)
        kinds = compiled.system.sensors.channels["what"]
        self._turns = self._run.record.sensors.turns[kinds] == 1
        self._places = _matrix_places(compiled.system.kkt)
        self._turning = list(_turning_bodies(compiled))

    def set_row(self, rows: OutputBlock, k: int) -> None:
        """Set the state to row k of a run."""
        self.state.t[0], self.state.angles[:] = rows.t[k], 0.0
        for name in ("q", "v", "vd", "lam"):
            getattr(self.state, name)[:] = getattr(rows, name)[k]

    def residual(self) -> Array:
        """F (nv,) at the state; C is in `work.con.C`."""
        self._evaluate()
        return np.array(self.work.trial.res)

    def update_history(self, *, is_first: bool) -> None:
        """Update the internal variables of all elements to the state; `is_first`: begin there."""
        self._evaluate()
        call(store_row_history, self._run, int(is_first))

    def _evaluate(self) -> None:
        state, work, n = self.state, self.work, len(self.state.angles)
        angles = state.angles.copy()
        work.feedback.near[:] = 0.0
        work.feedback.near[:n] = np.where(self._turns[:n], state.angles, 0.0)
        work.now.history[:] = state.history
        self._put_channels()
        state.angles[:] = angles

    def tangents(self) -> Tangents:
        """All derivatives at the state."""
        self._evaluate()
        self.work.factor.symmetric[0] = 0
        n = self.compiled.layout.nv
        mass = self._matrix(_NEGLIGIBLE, 0.0)
        M = mass[:n, :n]
        D = (self._matrix(_DOMINANT, 0.0)[:n, :n] - M) / _DOMINANT
        K = (self._matrix(_NEGLIGIBLE, _DOMINANT)[:n, :n] - M) / _DOMINANT
        for part, iq, stiffness, turn in self._turning:
            eta = self.state.q[iq + 7 : iq + 7 + turn.shape[1]]
            k = np.einsum("abij,i,j->ab", stiffness, eta, eta)
            change = k - np.trace(k) * np.eye(3)
            frame, mean = np.hstack([np.eye(3), 0.0 * turn]), np.hstack([np.eye(3), turn])
            M[part, part] += mean.T @ change @ mean - frame.T @ change @ frame
        return Tangents(M, D, K, mass[n:, :n], mass[:n, n:])

    def added_stiffness(self) -> dict[int, Array]:
        """Stiffness (m, m) that loads and deformation add to that of bodies, by their rows."""
        K, added = self.tangents().K, dict[int, Array]()
        for row, columns in enumerate(self.compiled.layout.bodies):
            own = slice(columns.iv + 6, columns.iv + 6 + columns.m)
            if columns.m:
                whole = 0.5 * (K[own, own] + K[own, own].T)
                added[row] = whole - self.compiled.bodies[columns.name].K
        return added

    def _matrix(self, cv: float, cp: float) -> Array:
        """S (nv + nc, nv + nc) of the engine, without its regularisation."""
        for put in self._put_matrices:
            put(cv, cp)
        factor, n = self.work.factor, len(self.compiled.system.kkt.place)
        S = np.zeros(n * n)
        for values, (sources, targets) in zip((factor.low, factor.up), self._places, strict=True):
            S[targets] = values[sources]
        return S.reshape(n, n)

    def channels(self) -> Array:
        """(channels,) values of all sensors at the state, SI."""
        self._evaluate()
        return self._channels.copy()

    def channels_and_reactions(self) -> Array:
        """(channels + 12 n,) the same, and reactions in the axes of their markers."""
        self._evaluate()
        self._put_reactions()
        return np.concatenate([self._channels, self._reactions])

    @property
    def markers(self) -> NDArray[np.void]:
        """All markers at the state that was evaluated last (`engine.state.MARKER_NOW`)."""
        return np.asarray(self.work.now.marker)

    def marker_motion(self, k: int) -> Array:
        """J (6, nv): velocity and angular velocity of marker k, global axes, per v."""
        parts, J = self.compiled.system.parts, np.zeros((6, self.compiled.layout.nv))
        body = int(parts.markers["body"][k])
        if body >= 0:
            at, m = int(parts.bodies["iv"][body]), int(parts.bodies["m"][body])
            out = np.zeros_like(self.work.dense.J[0])
            call(marker_jacobian, parts, self.work.now, k, out)
            J[:, at : at + 6 + m] = out[:, : 6 + m]
        return J

    def wrench_changes(self, X: Complex, rates: Complex) -> Complex:
        """(markers, 6, k) changes of the wrenches at markers, global axes, by vibrations X (nv, k)
        of unit size with λ (k,), the multipliers constant."""
        state, q, v = self.state, self.state.q.copy(), self.state.v.copy()
        changes = np.zeros((*self.work.now.marker["W"].shape, len(rates)), complex)
        for k, unit in product(range(len(rates)), (1.0, 1j)):
            x, xd = ((one / unit).real for one in (X[:, k], X[:, k] * rates[k]))
            for h in (_STEP, -_STEP) if x.any() or xd.any() else ():
                state.q[:], state.v[:] = self.moved(q, h * x), v + h * xd
                self._evaluate()
                changes[..., k] += unit * self.work.now.marker["W"] / (2.0 * h)
        state.q[:], state.v[:] = q, v
        self._evaluate()
        return changes

    def moved(self, q: Array, d: Array) -> Array:
        """q ∘ exp(d) for a motion d (nv,)."""
        self._motion[0][:], self._motion[1][:], self._motion[2][:] = q, d, q
        self._move()
        return self._motion[2].copy()


def sensor_amplitudes(equations: StateEquations, omega: Array, X: Array, lam: Array) -> Array:
    """(2, channels + 12 n, k) changes of sensors, and of reactions as in the table of a run, by
    vibrations: in phase with places, and with velocities.

    Parameters
    ----------
    equations : StateEquations
        At the state about which the scene vibrates.
    omega : (k,) array
        Frequencies [rad/s].
    X, lam : (nv, k), (nc, k) array
        Amplitudes of the motions and of the multipliers.
    """
    state, system = equations.state, equations.compiled.system
    base = [x.copy() for x in (state.q, state.v, state.vd, state.lam, state.angles)]
    layout = equations.compiled.layout
    change = np.zeros((2, len(layout.channels) + 12 * len(layout.reactions), len(omega)))
    for j, (w, x) in enumerate(zip(omega, X.T, strict=True)):
        h = _SENSOR_STEP / max(float(np.abs(x * system.weights).max()), 1e-300)
        for part, sign in product((0, 1), (1.0, -1.0)):
            if part:
                state.v[:] = base[1] + sign * h * w * x
            else:
                state.q[:] = equations.moved(base[0], sign * h * x)
                state.vd[:] = base[2] - sign * h * w**2 * x
                state.lam[:] = base[3] + sign * h * lam[:, j]
            change[part, :, j] += sign * equations.channels_and_reactions() / (2.0 * h)
            for name, value in zip(("q", "v", "vd", "lam", "angles"), base, strict=True):
                getattr(state, name)[:] = value
    return change


def multipliers_of(at: Tangents, forces: Array, massless: IntArray) -> Array:
    """(nc, k) λ with M a + Cqᵀ λ = F, Cq a = 0: what holds the scene under forces F (nv, k).

    What forces leave over accelerates it, so that light bodies get no more than their share. In M
    coordinates that are `massless` have what is left of negligible damping.
    """
    mass = at.M.diagonal().copy()
    mass[massless] = 0.0
    scale = 1.0 / np.sqrt(np.where(mass > 0.0, mass, max(mass.max(initial=0.0), 1e-300)))
    C = at.Cq * scale
    size = max(float(np.abs(C).max(initial=0.0)), 1e-300)
    A = np.block([[scale[:, None] * at.M * scale, C.T / size], [C / size, np.zeros((len(C),) * 2)]])
    right = np.vstack([scale[:, None] * forces, np.zeros((len(C), forces.shape[1]))])
    return np.asarray(np.linalg.lstsq(A, right, rcond=None)[0][len(mass) :] / size)


def amplitudes_of(equations: StateEquations, at: Tangents, X: Array, omega: Array) -> Array:
    """(2, channels + 12 n, k) changes of sensors and reactions by vibrations X (nv, k), and by
    their rates."""
    coordinates = equations.compiled.system.parts.coordinates
    massless = coordinates["iv"][coordinates["m"] == 0.0]
    lam = multipliers_of(at, at.M @ X * omega**2 - at.K @ X, massless)
    own = sensor_amplitudes(equations, omega, X, lam)
    own[1] /= omega
    return own


def relative_rotations(compiled: Compiled, model: Model) -> list[tuple[int, int]]:
    """Pairs of bodies (-1: the ground) whose relative rotation changes the equations."""
    numbers = {GROUND: -1, **{one.name: k for k, one in enumerate(compiled.layout.bodies)}}
    pairs, on_ground = set(), list[int]()
    for spec in (*model.joints.values(), *model.forces.values()):
        ends = getattr(spec, "between", None) or ()
        owners = [numbers.get(str(end).partition(".")[0], -1) for end in ends]
        if len(owners) == 2 and owners[0] != owners[1]:
            low, high = sorted(owners)
            if low >= 0:
                pairs.add((low, high))
            else:
                on_ground.append(high)
    pairs |= {(-1, k) for k in on_ground if on_ground.count(k) > 1}
    return sorted(pairs)


def relative_poses(compiled: Compiled, pairs: Sequence[tuple[int, int]], q: Array) -> list[Array]:
    """Rotations between bodies, and ways that joints between them slide, at positions q (t, nq).

    (t, 9) direction cosines, over √2, of each pair; (t, 3) the way between the markers of a joint,
    over a quarter of the model, or over itself where it is long.
    """
    from scipy.spatial.transform import Rotation

    A, r = {-1: np.broadcast_to(np.eye(3), (len(q), 3, 3))}, {-1: np.zeros((len(q), 3))}
    for k, body in enumerate(compiled.layout.bodies):
        p = np.roll(q[:, body.iq + 3 : body.iq + 7], -1, axis=1)
        A[k], r[k] = np.asarray(Rotation.from_quat(p).as_matrix()), q[:, body.iq : body.iq + 3]
    both = [np.einsum("tij,tik->tjk", A[i], A[j]) for i, j in pairs]
    parts = [one.reshape(len(q), 9) / np.sqrt(2.0) for one in both]
    rows, markers = compiled.system.rows, compiled.system.parts.markers
    places = markers["rho"] + markers["arm"]
    for ends in np.unique(np.column_stack([rows["I"], rows["J"]]), axis=0):
        i, j = (int(markers["body"][end]) for end in ends)
        if (min(i, j), max(i, j)) in pairs:
            far = r[j] + A[j] @ places[ends[1]] - r[i] - A[i] @ places[ends[0]]
            way = np.einsum("tij,ti->tj", A[i], far)
            size = np.hypot(np.linalg.norm(way, axis=1), _SLIDE * compiled.length)
            parts.append(way / size[:, None])
    return parts


class ChannelGroup(NamedTuple):
    """Columns of sensors, followed by reactions, that are one quantity."""

    name: str
    unit: str
    columns: list[int]
    derivatives: int  # of the motion that it measures: 2 for forces; -1: other quantities

    @property
    def is_sensor(self) -> bool:
        """Whether it is a sensor, not a reaction."""
        return self.name.startswith("sensors.")


def channel_groups(compiled: Compiled, model: Model, n: int) -> Iterator[ChannelGroup]:
    """Of each sensor, and of each reaction if the n columns have reactions."""
    channels, reactions = compiled.layout.channels, compiled.layout.reactions
    for name in model.sensors:
        own = [k for k, one in enumerate(channels) if one.partition(".")[0] == name]
        unit, spec = model.channel_unit(channels[own[0]]) or "", model.sensors[name]
        power = _DERIVATIVES.get(spec.type, -1)
        power += getattr(spec, "derivative", 0) if power >= 0 else 0
        yield ChannelGroup(f"sensors.{name}", unit, own, power)
    for k, name in enumerate(reactions if n > len(channels) else ()):
        for side, (what, unit) in product((0, 6), (("force", "N"), ("moment", "N m"))):
            at = len(channels) + 12 * k + side + 3 * (what == "moment")
            yield ChannelGroup(f"the {what} of {name}", unit, [at, at + 1, at + 2], 2)


def by_unit(
    groups: list[ChannelGroup], force: float, moment: float, turn: float, way: float
) -> Array:
    """(groups,) one of the values each."""
    values = {"N": force, "N m": moment}
    others = (turn if one.unit.startswith("rad") else way for one in groups)
    pairs = zip(groups, others, strict=True)
    return np.array([values.get(one.unit, other) for one, other in pairs])


def least_ranges(compiled: Compiled, groups: list[ChannelGroup], duration: float) -> Array:
    """(groups,) range below which each does not move, by the size of the model and of the run."""
    size, mass = compiled.length, float(compiled.system.parts.bodies["mass"].sum())
    sizes = by_unit(groups, mass * size, mass * size**2, 1.0, size)
    powers = np.array([max(one.derivatives, 0) for one in groups], np.int64)
    rate = 2.0 * np.pi / duration if duration else 0.0
    return np.asarray(_LEAST_MOTION * sizes * rate**powers)


def which_move(groups: list[ChannelGroup], ranges: Array) -> NDArray[np.bool_]:
    """Whether the range of each group is more than round-off beside others of its unit."""
    largest = dict[str, float]()
    for one, size in zip(groups, ranges, strict=True):
        largest[one.unit] = max(largest.get(one.unit, 0.0), float(size))
    least = [_LEAST_RANGE if one.is_sensor else _LEAST_REACTION for one in groups]
    return np.asarray(ranges > np.array(least) * [largest[one.unit] for one in groups])


def _turning_bodies(compiled: Compiled) -> Iterator[tuple[slice, int, Array, Array]]:
    """Of bodies with stiffening that vibrate: rotation and modes in v, first coordinate, K^{ab},
    and mean rotation (3, m) by modes."""
    still, _ = static_bodies(compiled.system)
    full = compiled.system.parts.bodies["coupling"] == 2
    for number, columns in enumerate(compiled.layout.bodies):
        body = compiled.bodies.get(columns.name)
        if body is None or not body.m or not full[number] or number in still:
            continue
        if body.centrifugal_stiffness is not None:
            part = slice(columns.iv + 3, columns.iv + 6 + columns.m)
            yield part, columns.iq, body.centrifugal_stiffness, mean_motion(body)[3:]


def _matrix_places(kkt: Kkt) -> tuple[tuple[IntArray, IntArray], tuple[IntArray, IntArray]]:
    """For the panels of L and of U: indices of the entries that are in S, and their index in S."""
    n, size = len(kkt.place), int(kkt.panels["nc"].sum()) + 1  # the last: unknowns not in S
    own = np.full(size, -1)
    own[kkt.place] = np.arange(n)
    own[-1] = -1
    entries: tuple[list[IntArray], list[IntArray]] = ([], [])
    for panel in kkt.panels:
        at, nc, nr, col = (int(panel[word]) for word in ("at", "nc", "nr", "col"))
        columns = np.arange(col, col + nc)
        rows = np.concatenate([columns, kkt.rows[panel["rows"] : panel["rows"] + nr]])
        i, j = np.indices((nc + nr, nc))
        lower = at + np.arange((nc + nr) * nc).reshape(nc + nr, nc)
        for upper, part in enumerate(entries):
            used = (i > j) if upper else (i >= j)
            r, c = own[rows[i[used]]], own[columns[j[used]]]
            place = c * n + r if upper else r * n + c
            place[(r < 0) | (c < 0)] = -1
            part.append(np.stack([lower[used], place]))
    low, up = (np.concatenate(part, axis=1) for part in entries)
    low, up = low[:, low[1] >= 0], up[:, up[1] >= 0]
    return (low[0], low[1]), (up[0], up[1])
