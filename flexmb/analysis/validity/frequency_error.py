"""Errors of natural frequencies by modes that flexible bodies do not have, in the motion of a run.

The modes that a body has are static responses and some vibrations. Those of the joined machine are
combinations of them, and too fast: what the body lacks would move with them, and has mass. Near a
resonance a small error of a frequency is a large one of the motion.

What a body lacks follows its accelerations x as y = C x/ω² (a static response), or as oscillators
where it is stored as modes (:class:`flexmb.flexbody.OmittedModes`), and acts on the body by −Cᵀ ÿ.
So the difference δ of the motion from that of the full model satisfies, in the mechanism and
linearised about a row of the run,

    (M + ΔM) δ̈ + D δ̇ + K δ = d²S/dt²,   S = R x,   R = Σ CᵀC/ω²,

with R the strain energy that is missing under accelerations. Where the modes begin at rest those
that are left out do too, so that the rate of S jumps from zero there. A frequency ω that the run
has is that with K = ω² M; ΔM = K^½ M^-½ R M^-½ K^½ lowers it to ω/√(1 + ω² φᵀRφ) with φ its shape,
which is Rayleigh's quotient of the shape with its static response. S is taken as linear between
rows, which is solved exactly; vibrations that the rows do not resolve are left out. Matrices are
those of the row, with the springs, forces and damping there; they are computed again where the pose
or the speed of rotation differs, and used for all rows near it.

An undamped vibration is δ = ∫ cos ω(t − s) dS(s), so that the total variation of S, in norms of the
mass matrices of the bodies, is a bound of δ whatever the frequencies, poses and joints. While it is
too small to matter at any marker, nothing else is computed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh

from flexmb.analysis.assembly.jacobian import MAX_COORDINATES, one_blas_thread
from flexmb.analysis.assembly.mechanism_modes import mobilities
from flexmb.analysis.linear.observer import MinimalEquations, RowsAlongMotion, body_axes
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.analysis.monitors import Indicator
from flexmb.analysis.validity.linear_elasticity import flexible_columns, in_body_axes
from flexmb.engine.allocation import new_state
from flexmb.engine.bodies.static_modes import static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody import FlexBody, InertiaResponse
from flexmb.flexbody.arrays import Array, skew
from flexmb.model.model import Model
from flexmb.model.reading import GROUND
from flexmb.results.output_block import OutputBlock
from flexmb.units import percent

#: Change of a position sensor over its range from which a run says so.
LARGEST_CHANGE = 0.01
_ANGLES = ("angle", "second_angle")
_KINDS = ("position", "distance", "stroke", *_ANGLES)  # sensors that are judged
_RESOLVED = 2.0  # phase of a vibration between two rows [rad] up to which rows show it
_NEAR = 0.4  # rotation between two bodies [rad], or speed over frequency, of another pose
_MOST_POSES = 24
_EXACT_POSES = 3  # with exact frequencies, after which no others are computed
_LEAST_PHASE = 5e-3  # by which vibrations get out of phase within the run, that counts [rad]
_LEAST_CYCLES = 0.5  # of a vibration in the run
_GROWTH = 0.02  # of a motion, over its frequency, from which it is unstable
_OMITTED_DAMPING = 0.01  # damping ratio of modes that are left out
_SMALL_CHANGE = 0.5 * LARGEST_CHANGE  # below which the bound of a change needs no further look
_STEP = 1e-4  # of a motion for differences of sensors, over the size of the model
_LEAST_RANGE = 1e-7  # range of a sensor, over the size of the model, that is a motion


@dataclass(frozen=True, eq=False)
class _Body:
    """A flexible body, with what it lacks under its accelerations.

    These are 12 + m numbers: those of `InertiaResponse`, and of the modal coordinates. Those of its
    velocity coordinates, in body axes, are C (12 + m, 6 + m) times their rates.
    """

    columns: BodyColumns
    body: FlexBody
    omega: Array  # (o,) of the modes that are left out, rad/s
    force: Array  # (o, 12 + m) on them
    rest: Array  # (12 + m, 12 + m) missing energy besides these
    C: Array

    @classmethod
    def of(cls, columns: BodyColumns, body: FlexBody) -> _Body | None:
        """Of a flexible body; None if its file does not tell."""
        omitted, m = body.omitted_modes, columns.m
        if omitted is None:
            return None
        C = np.zeros((12 + m, 6 + m))
        C[:3, :3], C[3:6, 3:6], C[12:, 6:] = np.eye(3), np.eye(3), np.eye(m)
        C[:3, 3:6] = -skew(body.center)
        rest = np.zeros((12 + m,) * 2) if omitted.rest is None else omitted.rest
        force = np.hstack([omitted.inertia, omitted.modes])
        return cls(columns, body, 2.0 * np.pi * omitted.frequency, force, rest, C)

    @property
    def part(self) -> slice:
        """Its velocity coordinates."""
        return slice(self.columns.iv, self.columns.iv + 6 + self.columns.m)

    def accelerations(self, rows: OutputBlock, gravity: Array) -> Array:
        """(t, 12 + m) of the rows."""
        iq, iv, center = self.columns.iq, self.columns.iv, self.body.center
        omega, alpha = rows.v[:, iv + 3 : iv + 6], rows.vd[:, iv + 3 : iv + 6]
        a = in_body_axes(rows.q[:, iq + 3 : iq + 7], rows.vd[:, iv : iv + 3] - gravity)
        a = a + np.cross(alpha, center) + np.cross(omega, np.cross(omega, center))
        eta = rows.vd[:, self.part][:, 6:]
        return np.hstack([InertiaResponse.factors(a, alpha, omega), eta])


@dataclass(frozen=True, eq=False)
class _Pose:
    """The vibrations of the machine about one row, those that the rows resolve.

    States are amplitudes of the modes of the run, then of those that are left out, then the rates
    of both.
    """

    shapes: Array  # (nv, d) of the modes of the run, in body axes
    shape_rates: Array  # (nv, d) of these
    project: Array  # (d, nv) amplitudes of a motion in body axes
    omega: Array  # (d,) rad/s
    shift: Array  # (d,) share of ω² by which it is too large
    shares: Array  # (bodies, d) of each body in it
    values: NDArray[np.complex128]  # (k,) of the states
    vectors: NDArray[np.complex128]  # (2 (d + o), k)
    kick: NDArray[np.complex128]  # (k, forces) change by a change of the rate of S, and of y
    start: NDArray[np.complex128]  # (k, 2 (d + o)) from states
    seen: Array  # (channels, d) change of the sensors

    def is_exact(self, duration: float) -> bool:
        """Whether no vibration gets out of phase within a time [s], not even at resonance."""
        return float((self.shift * self.omega).max(initial=0.0)) * duration < _LEAST_PHASE


class FrequencyErrorMonitor:
    """Estimates what errors of natural frequencies change at the position sensors of a run.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    """

    def __init__(self, compiled: Compiled, model: Model) -> None:
        self._compiled, self._model, self._units = compiled, model, model.units
        self._gravity = np.array(model.gravity or (0.0, 0.0, 0.0))
        still = len(static_coordinates(compiled.system)) > 0
        small = compiled.layout.nv <= MAX_COORDINATES
        pairs = flexible_columns(compiled) if small and not still else ()
        self._bodies = [one for pair in pairs if (one := _Body.of(*pair)) is not None]
        self._numbers = [compiled.layout.bodies.index(one.columns) for one in self._bodies]
        channels = compiled.layout.channels
        self._sensors = {
            name: [k for k, one in enumerate(channels) if one.partition(".")[0] == name]
            for name, spec in model.sensors.items()
            if spec.type in _KINDS and not getattr(spec, "derivative", 0)
        }
        self._poses: list[tuple[Array, _Pose]] = []
        self._equations: StateEquations | None = None
        self._reach: tuple[Array, list[Array]] | None = None
        self._variation, self._counts = np.zeros(1), np.zeros(1, bool)
        self._joined = _relative_rotations(compiled, model)
        n_o, nv = sum(len(one.omega) for one in self._bodies), compiled.layout.nv
        self._duration = model.dynamics.duration if model.dynamics else 0.0
        self._interval = np.zeros(1)  # between rows, s
        self._row = np.zeros((0, 1))  # time and forces of the last row, and their last rate
        self._state = np.zeros(2 * (nv + n_o))  # difference of the motion, body axes; of y; rates
        self._least, self._most = np.array(np.inf), np.array(-np.inf)  # range of all channels
        self._largest = np.zeros((4, len(self._sensors)))  # change; time; mode: frequency, shift
        self._body = np.zeros(len(self._sensors), np.int64)  # that has the largest share in it

    @one_blas_thread()
    def add(self, rows: OutputBlock) -> None:
        """Add the next rows."""
        if not self._bodies or not self._sensors or not len(rows.t):
            return
        self._least = np.minimum(self._least, rows.sensors.min(axis=0))
        self._most = np.maximum(self._most, rows.sensors.max(axis=0))
        table = np.column_stack([rows.t, self._forces(rows)])
        if not len(self._row):  # modes that are left out begin at rest if the others do
            at_rest = all(not rows.v[0, one.part][6:].any() for one in self._bodies)
            rates = np.full(table.shape[1], 0.0 if at_rest else np.nan)
            self._row = np.vstack([table[0], rates])
        if not self._interval[0]:
            steps = np.diff(np.append(self._row[0, 0], rows.t))
            if not steps.any():
                return
            self._interval = np.array([np.median(steps[steps > 0.0])])
        self._counts |= self._may_count(table)
        if not self._counts[0]:
            self._rest(table)
            return
        near = self._near(rows)
        for part in np.split(np.arange(len(near)), np.flatnonzero(np.diff(near)) + 1):
            self._integrate(self._poses[near[part[0]]][1], table[part])

    def _forces(self, rows: OutputBlock) -> Array:
        """(t, forces) of the rows: S of each body, in body axes, then y = C x/ω² of its modes."""
        parts, modes = [], []
        for one in self._bodies:
            x = one.accelerations(rows, self._gravity)
            modes.append(x @ (one.force / one.omega[:, None] ** 2).T)
            parts.append(x @ one.rest @ one.C)
        return np.hstack([*parts, *modes])

    def _may_count(self, table: Array) -> bool:
        """Whether the variation of the forces so far may change a sensor by what counts."""
        self._reach = reach, roots = self._reach or mobilities(self._compiled)
        steps = np.diff(np.vstack([self._row[0], table])[:, 1:], axis=0)
        first, squares = sum(len(one.C[0]) for one in self._bodies), np.zeros(len(steps))
        for one, number in zip(self._bodies, self._numbers, strict=True):
            own, left_out = len(one.C[0]), len(one.omega)
            force = steps[:, :own] + steps[:, first : first + left_out] @ (one.force @ one.C)
            squares += ((force @ roots[number]) ** 2).sum(axis=1)
            steps, first = steps[:, own:], first - own + left_out
        self._variation += np.sqrt(squares).sum()
        turns = [int(self._model.sensors[name].type in _ANGLES) for name in self._sensors]
        changes = 2.0 * self._variation[0] * reach[turns]  # of both ends
        return not bool(np.all(changes <= _SMALL_CHANGE * np.array(self._ranges())))

    def _ranges(self) -> list[float]:
        """Range of each sensor so far; infinite for one that does not move."""
        ranges = self._most - self._least
        sizes = [float(ranges[at].max()) for at in self._sensors.values()]
        return [x if x > _LEAST_RANGE * self._compiled.length else np.inf for x in sizes]

    def _near(self, rows: OutputBlock) -> NDArray[np.int64]:
        """(t,) number of the pose whose vibrations count for each row; new ones are computed."""
        marks, near = self._marks(rows), np.zeros(len(rows.t), np.int64)
        if not self._poses:
            self._poses.append((marks[0], self._pose(rows, 0)))
        away = [np.linalg.norm(marks - mark, axis=1) for mark, _ in self._poses]
        first = 0
        while first < len(marks):
            most = _MOST_POSES
            if all(pose.is_exact(self._duration) for _, pose in self._poses):
                most = _EXACT_POSES
            to_pose = np.array(away)[:, first:]
            far = np.flatnonzero(to_pose.min(axis=0) > _NEAR)
            last = first + int(far[0]) if len(far) and len(away) < most else len(marks)
            near[first:last] = to_pose[:, : last - first].argmin(axis=0)
            if last < len(marks):
                self._poses.append((marks[last], self._pose(rows, last)))
                near[last] = len(away)
                away.append(np.linalg.norm(marks - marks[last], axis=1))
            first = last + 1
        return near

    def _marks(self, rows: OutputBlock) -> Array:
        """(t, n) rotations between bodies, and speeds of flexible ones over a frequency."""
        A = {-1: np.broadcast_to(np.eye(3), (len(rows.t), 3, 3))}
        for k, body in enumerate(self._compiled.layout.bodies):
            A[k] = _rotations(rows.q[:, body.iq + 3 : body.iq + 7])
        parts = [
            np.einsum("tij,tik->tjk", A[i], A[j]).reshape(len(rows.t), 9) / np.sqrt(2.0)
            for i, j in self._joined
        ]
        for one in self._bodies:
            mass = max(np.linalg.eigvalsh(one.body.M_eta)[-1], 1e-300)  # the largest modal one
            lowest = np.sqrt(np.linalg.eigvalsh(one.body.K)[0] / mass)
            iv = one.columns.iv
            parts.append(rows.v[:, iv + 3 : iv + 6] / lowest)
        return np.hstack(parts)

    def _pose(self, rows: OutputBlock, k: int) -> _Pose:
        """The vibrations about row k."""
        compiled = self._compiled
        if self._equations is None:
            state = new_state(compiled.system, len(compiled.layout.channels))
            self._equations = StateEquations(compiled, state)
        equations, state = self._equations, self._equations.state
        state.t[0], state.angles[:] = rows.t[k], 0.0
        for name in ("q", "v", "vd", "lam"):
            getattr(state, name)[:] = getattr(rows, name)[k]
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
        seen = omega * self._interval[0] < _RESOLVED
        omega, T = omega[seen], T[:, seen]
        S = of.change.S  # from the axes of the observer to those of the engine
        axes = np.eye(len(S))  # from those to body axes
        for body, A in zip(compiled.layout.bodies, body_axes(compiled, state.q), strict=True):
            axes[body.iv : body.iv + 3, body.iv : body.iv + 3] = A.T
        X, Xd = axes @ S @ N @ T, axes @ S @ Nd @ T
        project = T.T @ N.T @ of.at.M @ np.linalg.inv(axes @ S)
        moved = self._seen(equations, S @ N @ T)
        return self._vibrations((X, Xd, project), omega, (T.T @ D @ T, T.T @ K @ T), moved)

    def _seen(self, equations: StateEquations, X: Array) -> Array:
        """(channels, d) change of the sensors by motions X (nv, d)."""
        state, q = equations.state, equations.state.q.copy()
        size, made = self._compiled.length, np.zeros((len(state.angles), X.shape[1]))
        for j, x in enumerate(X.T):
            h = _STEP * size / max(np.abs(x * self._compiled.system.weights).max() * size, 1e-300)
            values = []
            for sign in (1.0, -1.0):
                state.q[:] = equations.moved(q, sign * h * x)
                values.append(equations.channels())
            made[:, j] = (values[0] - values[1]) / (2.0 * h)
        state.q[:] = q
        return made

    def _vibrations(
        self, motions: tuple[Array, Array, Array], omega: Array, matrices: tuple[Array, Array],
        seen: Array,
    ) -> _Pose:  # fmt: skip
        X, d, bodies, unit = motions[0], len(omega), self._bodies, self._interval[0]
        moved = [one.C @ X[one.part] for one in bodies]
        force = [one.force @ x for one, x in zip(bodies, moved, strict=True)]  # on modes left out
        rests = [x.T @ one.rest @ x for one, x in zip(bodies, moved, strict=True)]
        w = np.concatenate([one.omega for one in bodies])
        A, rest, n = np.concatenate(force), np.sum(rests, axis=0), d + len(w)
        M = np.block([[np.eye(d) + omega[:, None] * rest * omega, -A.T], [-A, np.eye(len(w))]])
        D = block_diag(matrices[0], np.diag(2.0 * _OMITTED_DAMPING * w))
        K = block_diag(matrices[1], np.diag(w**2))
        energies = [
            np.diag(own) + ((f / one.omega[:, None]) ** 2).sum(axis=0)
            for one, own, f in zip(bodies, rests, force, strict=True)
        ]
        shares = np.array(energies) * omega**2
        inverse = np.linalg.inv(M)
        first = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-inverse @ K * unit**2, -inverse @ D * unit]]
        )
        values, vectors = np.linalg.eig(first)
        start, size = np.linalg.inv(vectors), np.abs(values)
        there = (size < _RESOLVED) & (values.real < _GROWTH * size)
        there &= size * self._duration > 2.0 * np.pi * _LEAST_CYCLES * unit
        # forces: S of each body (its velocity coordinates), then y of all modes that are left out
        loads = np.hstack([X[one.part].T for one in bodies])
        none = np.zeros((len(w), loads.shape[1]))
        impulse = np.block([[loads, A.T], [none, -np.eye(len(w))]])
        kick = start[:, n:] @ (inverse @ impulse) * unit
        rates = np.repeat([1.0, unit], n)  # states have the interval as the unit of time
        return _Pose(
            *motions, omega, shares.sum(axis=0), shares, values[there] / unit,
            vectors[:, there] / rates[:, None], kick[there], start[there] * rates, seen,
        )  # fmt: skip

    def _integrate(self, pose: _Pose, table: Array) -> None:
        """Integrate over the next rows: times and forces."""
        nv, d = self._compiled.layout.nv, len(pose.omega)
        if pose.is_exact(self._duration) or not len(pose.values):
            self._rest(table)
            return
        half = len(self._state) // 2
        now = pose.project @ self._state[:nv]
        rates = pose.project @ (self._state[half : half + nv] - pose.shape_rates @ now)
        parts = now, self._state[nv:half], rates, self._state[half + nv :]
        z = pose.start @ np.concatenate(parts)
        every = np.vstack([self._row[0], table])
        h = np.diff(every[:, 0])
        slopes = np.diff(every[:, 1:], axis=0) / np.maximum(h, 1e-300)[:, None]
        before = None if np.isnan(self._row[1, 1]) else self._row[1, 1:]
        amplitudes = np.zeros((len(every), len(pose.values)), complex)
        amplitudes[0] = z
        for k in range(len(h)):
            if before is not None and h[k] > 0.0:
                z = z + pose.kick @ (slopes[k] - before)
            before = slopes[k] if h[k] > 0.0 else before
            z = np.exp(pose.values * h[k]) * z
            amplitudes[k + 1] = z
        rate = np.full(table.shape[1] - 1, np.nan) if before is None else before
        self._row = np.vstack([every[-1], np.append(0.0, rate)])
        states = (amplitudes @ pose.vectors.T).real
        n = states.shape[1] // 2
        self._update(pose, every[:, 0], states[:, :d])
        last = states[-1]
        rates = pose.shapes @ last[n : n + d] + pose.shape_rates @ last[:d]
        parts = pose.shapes @ last[:d], last[d:n], rates, last[n + d :]
        self._state = np.concatenate(parts)

    def _rest(self, table: Array) -> None:
        """Go to the last of the next rows without a difference of the motion."""
        self._row = np.vstack([table[-1], np.full_like(table[-1], np.nan)])
        self._state = np.zeros_like(self._state)

    def _update(self, pose: _Pose, t: Array, amplitudes: Array) -> None:
        """Keep the largest change of each sensor."""
        change = amplitudes @ pose.seen.T
        largest, number = self._largest.copy(), self._body.copy()
        for k, columns in enumerate(self._sensors.values()):
            sizes = np.linalg.norm(change[:, columns], axis=1)
            row = int(sizes.argmax())
            if sizes[row] > largest[0, k]:
                parts = np.linalg.norm(pose.seen[columns], axis=0) * np.abs(amplitudes).max(axis=0)
                j = int(np.argmax(parts))
                shift = pose.shift[j]
                hertz = pose.omega[j] / np.sqrt(1.0 + shift) / (2.0 * np.pi)
                largest[:, k] = sizes[row], t[row], hertz, np.sqrt(1.0 + shift) - 1.0
                number[k] = int(pose.shares[:, j].argmax())
        self._largest, self._body = largest, number

    def indicators(self) -> Iterator[Indicator]:
        """The largest change of a position sensor over its range, by the body that is its cause."""
        if not self._bodies or not self._most.ndim:
            return
        shares = [float(x) for x in self._largest[0] / self._ranges()]
        k = int(np.argmax(shares))
        _, t, hertz, shift = self._largest[:, k]
        body, sensor = self._bodies[self._body[k]].columns.name, list(self._sensors)[k]
        text = partial(self._sentence, body, sensor, shares[k], t, hertz, shift)
        yield Indicator(body, "frequency", shares[k], t, LARGEST_CHANGE, text)

    def _sentence(
        self, body: str, sensor: str, share: float, t: float, hertz: float, shift: float
    ) -> str:
        say = self._units.say
        return (
            f"bodies.{body}: for want of modes a natural frequency of the scene, "
            f"{say(hertz, 'Hz', 3)}, is too high by {percent(shift)}, and the motion comes near "
            f"it: sensors.{sensor} is off by about {percent(share)} of its range (t = "
            f"{say(t, 's', 4)}); reduce the body with more modes"
        )


def _relative_rotations(compiled: Compiled, model: Model) -> list[tuple[int, int]]:
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


def _rotations(p: Array) -> Array:
    """(t, 3, 3) direction cosines of Euler parameters (t, 4)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(np.roll(p, -1, axis=1)).as_matrix())
