"""Difference between the motions of two similar models: a first-order perturbation.

In: the rows of a run, and the compiled model of the same scene with one effect more or less. Out:
the change of every sensor, row by row. The defect of the run in the other model, i.e. the residuals
F and C of its equations, excites small motions of that model about the computed motion,

    M δv̇ + D δv + K δq + Cqᵀ δλ = −F,   Cq δq = −C,   δv = δq̇ + Ω δq

with Ω the rotation of body axes. With δq = Z y + g, where the columns of Z are a basis of the null
space of Cq, this is an ordinary linear differential equation for y, which `modal_equations`
integrates. The first values of modes much faster than the rows follow from the first accelerations.
When a bristle of friction begins to stick or to slide, the solution starts again: the bristle
sticks at the position to which the small motion has slid. Positions also include the second-order
motion that closes joints for the full displacements, with the least elastic energy.

Source of the idea: defect correction (Stetter, Numer. Math. 29 (1978) 425); of the estimate:
Padilla & von Flotow, J. Guidance 15 (1992) 149, who linearise about the motion as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flexmb.analysis.assembly.jacobian import ConstraintRows, one_blas_thread
from flexmb.analysis.effects.independent_coordinates import (
    CondensedMotions,
    IndependentCoordinates,
    IndependentMotions,
    choose_coordinates,
)
from flexmb.analysis.effects.modal_equations import (
    UNRESOLVED,
    ModalEquations,
    least_squares_solution,
)
from flexmb.analysis.effects.smooth_pieces import Jumps, SlowAxes, SmoothPieces
from flexmb.analysis.effects.stored_motion import (
    Bristles,
    Motion,
    WeightedCoordinates,
    equations_of,
)
from flexmb.analysis.effects.variational_equations import VariationalEquations, linearise, times
from flexmb.analysis.functions_of_time import rows_behind_jumps
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.engine.bodies.static_modes import static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import Layout
from flexmb.flexbody.arrays import Array

_ENDS = 5  # rows at the ends of splines, where rates on rotating bodies are inaccurate
_CLOSINGS = 2  # Newton steps to close joints for the full displacements
_CLOSED = 0.01  # gap that may remain over the gap before
_WELL_CLOSED = 1e-5  # the same, below which there is no further step
_NO_TIME = 0.01  # response time of modes without inertia over the interval of rows
_MOST_VIBRATIONS = 40  # largest number of vibrations; faster unresolved ones only follow loads
_SPAN = 0.5  # phase of the slowest omitted vibration over which rates of condensed modes are taken
_SERIES = 1e-2  # rotation below which the coefficients of a screw are series [rad]
_SMALL = 1e-5  # displacement over the size of the model in which all sensors are linear


@dataclass(frozen=True, eq=False)
class Response:
    """Change of the channels (n, k) by another model, and of the motion (n, nv).

    From row `bounded` on the changes are not small: the linear equations are unstable there, or the
    change is as large as the model. `motion` is the motion of the run plus the change, if bounded.
    """

    channels: Array
    dq: Array
    bounded: int
    motion: Motion | None = None


@one_blas_thread()
def respond(
    compiled: Compiled, motion: Motion, balance: Array,
    start: tuple[Array, Array, Array] | None = None, *, quasi_static: Sequence[str] = (),
    jumps: Jumps | None = None, idle: Sequence[Sequence[str]] = (),
) -> Response:  # fmt: skip
    """Small motions of a model about the motion of another model.

    Parameters
    ----------
    compiled : Compiled
        The other model.
    motion : Motion
        A computed motion in the coordinates of the other model; channels are those of the run.
    balance : (n, nv) array
        Residual of the rows in their own model: noise of the reported accelerations and reactions,
        which is subtracted.
    start : three (nv,) arrays, optional
        First changes of positions, velocities and accelerations; zero by default.
    quasi_static : sequence of str
        Bodies whose vibrations have no inertia: their deformations are in equilibrium with their
        loads.
    jumps : Jumps, optional
        Jumps of the computed motion that the other model does not have.
    idle : sequence of sequences of str
        Sets of bodies that do not move beside all others.
    """
    equations, state = linearise(compiled, motion, balance), equations_of(compiled)
    equations = equations.without_motions([equations.frames.rigid(names) for names in idle])
    small = _solve(compiled, motion, equations, start, quasi_static, jumps)
    parts, pieces, bounded = small.motions, small.pieces, small.bounded
    load = equations.F + small.load
    load = load + sum(map(times, (equations.M, equations.D, equations.K), parts[::-1]))
    elastic = equations.frames.elastic()
    without = equations.frames.stiffness_of(quasi_static)
    follows = np.diag(np.zeros_like(elastic) if without is None else without) > 0.0
    multipliers = np.einsum("tr,trc->tc", equations.shares(load, follows), equations.rows)
    n, closed, factors = len(motion.t), None, np.ones((1, len(motion.t)))
    q, v, vd = map(equations.frames.to_motions, parts)
    moved = _Moves(q, v, vd, -multipliers, small.history)
    motions = [moved.of(compiled, motion)]
    if bounded == n:
        closed = _closure(motions[0], state, equations, pieces, elastic)
    if closed is not None:
        motions = [closed.of(compiled, motions[0])]
    else:  # large turns may take away from what such joints add: the smaller counts
        factors = np.stack([np.ones(n), _SMALL / np.abs(parts[0]).max(axis=1, initial=_SMALL)])
        motions.append(moved.times(factors[1, :, None]).of(compiled, motion))
    dq, change = q, np.full_like(motion.channels, np.inf)
    for k in range(bounded):
        change[k] = _change_of_channels(motion, k, state, motions, factors[:, k])
    dq[bounded:] = 0.0
    if bounded < n:
        return Response(change, dq, bounded)
    return Response(change, dq, bounded, replace(motions[0], channels=motion.channels + change))


class _Moves(NamedTuple):
    """Changes (n, ...) of a motion; those of positions in velocity coordinates."""

    q: Array
    v: Array
    vd: Array
    lam: Array
    history: Array

    def times(self, factors: Array) -> _Moves:
        """The changes times factors (n, 1)."""
        return _Moves(*(factors * one for one in self))

    def of(self, compiled: Compiled, motion: Motion) -> Motion:
        """The motion with these changes; its channels are those without."""
        q, v, vd = displaced(compiled.layout, motion, self.q, self.v, self.vd)
        past = None if motion.history is None else motion.history + self.history
        return Motion(motion.t, q, v, vd, motion.lam + self.lam, motion.channels, past)


def _change_of_channels(
    motion: Motion, k: int, state: StateEquations, motions: list[Motion], factors: Array
) -> Array:
    """Change (channels,) of row k, the smallest of those in motions whose moves have factors."""
    changes = []
    for f, other in zip(factors, motions, strict=True):
        other.put(k, state)
        changes.append((state.channels() - motion.channels[k]) / f)
    smaller = np.abs(changes[0]) < np.abs(changes[-1])
    return np.asarray(np.where(smaller, changes[0], changes[-1]))


def _closure(
    motion: Motion, equations: StateEquations, of: VariationalEquations, pieces: SmoothPieces,
    elastic: Array,
) -> _Moves | None:  # fmt: skip
    """Moves that close the joints of a displaced motion; None if these are too large.

    For bodies in bending it is their shortening, of second order in the deflection.
    """
    compiled, none = equations.compiled, np.zeros_like(motion.v)
    frames, constraints = WeightedCoordinates(compiled, motion), ConstraintRows(compiled)
    Cq = frames.turned(np.array([constraints.evaluate(q).Cq.copy() for q in motion.q]))
    there = replace(of, frames=frames, Cq=of.rows @ Cq)
    try:
        closing = there.closure((motion.t[-1] - motion.t[0]) ** 2 * elastic)
    except np.linalg.LinAlgError:  # so far away rows of Cq are alike to round-off
        return None
    closed, gaps = np.zeros(Cq.shape[::2]), np.zeros((_CLOSINGS + 1, len(Cq)))
    for gap in gaps:
        q = displaced(compiled.layout, motion, frames.to_motions(closed), none, none)[0]
        for k in range(len(Cq)):
            motion.put(k, equations)
            equations.state.q[:] = q[k]
            equations.residual()
            step = closing[k] @ (of.rows[k] @ equations.work.con.C)
            gap[k] = np.abs(step).max(initial=0.0)
            closed[k] -= step
        if gap.max(initial=0.0) <= _WELL_CLOSED * gaps[0].max(initial=0.0):
            break
    most = max(_CLOSED * gaps[0].max(initial=0.0), _SMALL**2)
    if np.any(gaps[-1] > most):
        return None
    rate = pieces.rate(closed) + times(frames.spin()[0], closed)
    dq, dv, dvd = map(frames.to_motions, (closed, rate, pieces.rate(rate)))
    past = np.zeros((len(Cq), compiled.system.history))
    return _Moves(dq, dv, dvd, np.zeros_like(motion.lam), past)


class _Begin(NamedTuple):
    """First changes of q, v and, if known, dv/dt (nu,) in weighted coordinates."""

    q: Array
    v: Array
    vd: Array | None


class _Springs(NamedTuple):
    """Stiffness (nu, nu) of all modes, of those without inertia and of bodies that follow loads."""

    elastic: Array
    massless: Array | None
    quasi_static: Array | None


@dataclass(frozen=True, eq=False)
class _SmallMotions:
    """δq, δv, δv̇ (3, n, nu); loads (n, nu) and changes of history (n, h) of bristles; number of
    bounded rows."""

    pieces: SmoothPieces
    motions: Array
    load: Array
    history: Array
    bounded: int


def _solve(
    compiled: Compiled, motion: Motion, of: VariationalEquations,
    start: tuple[Array, Array, Array] | None, quasi_static: Sequence[str], jumps: Jumps | None,
) -> _SmallMotions:  # fmt: skip
    """Solve the variational equations; arguments as of `respond`.

    Piece by piece: between jumps, between rows at which a bristle begins to stick or slide, and as
    long as one selection of independent coordinates is suitable.
    """
    n, frames, nu = len(motion.t), of.frames, len(of.weights)
    behind = np.array(rows_behind_jumps(compiled, motion.t), np.int64)
    behind = behind if jumps is None else np.union1d(behind, jumps.rows)
    pieces = SmoothPieces(motion.t, behind)
    stays = {} if jumps is None else {int(k): i for i, k in enumerate(jumps.rows)}
    begin = _Begin(np.zeros(nu), np.zeros(nu), None)
    if start is not None:
        dq, dv, dvd = (frames.to_coordinates(0, x) for x in start)
        begin = _Begin(dq, dv, dvd - frames.spin()[1][0] @ dv)
    static = static_coordinates(compiled.system)
    massless = frames.elastic(static) if len(static) else None
    springs = _Springs(frames.elastic(), massless, frames.stiffness_of(quasi_static))
    parts, load = np.zeros((3, n, nu)), np.zeros((n, nu))
    first, bounded, bristles = 0, n, Bristles(compiled, motion)
    bends = {*bristles.bends.tolist()}
    while first < n - 1 and bounded == n:
        end = min((k + 1 for k in (*stays, *bends) if k > first), default=n)
        coordinates = choose_coordinates(of, first, end)
        rows = slice(first, first + len(coordinates.Z))
        places = frames.to_motions(np.stack(begin[:2]), slice(first, first + 1))
        added = bristles.load(range(n)[rows], *places)
        load[rows] = frames.turned(added[:, None], rows)[:, 0]
        own = of.part(rows).between(load[rows], first in bends, rows.stop - 1 in bends)
        parts[:, rows], bounded = _solve_piece(pieces.part(rows), own, coordinates, begin, springs)
        bounded = n if bounded == len(coordinates.Z) else first + bounded
        first = rows.stop - 1
        accelerations = None if first in bends else parts[2, first]
        begin = _Begin(parts[0, first], parts[1, first], accelerations)
        if jumps is not None and first in stays:
            both = (x[stays[first]] for x in (jumps.places, jumps.velocities))
            dq, dv = (frames.to_coordinates(first, x) for x in both)
            begin = _Begin(begin.q - dq, begin.v - dv, None)
    flexible = {body.name for body in compiled.layout.bodies if body.m}
    if flexible and flexible <= {*quasi_static} and n > _ENDS**2:
        parts[1:, -_ENDS:] = parts[1:, [-_ENDS - 1]]
    return _SmallMotions(pieces, parts, load, bristles.changes, bounded)


def _solve_piece(
    pieces: SmoothPieces, of: VariationalEquations, coordinates: IndependentCoordinates,
    begin: _Begin, springs: _Springs,
) -> tuple[Array, int]:  # fmt: skip
    """δq, δv and δv̇ (3, n, nu) from given first values; number of bounded rows.

    Vibrations whose stiffness is mostly that of bodies that follow are in equilibrium with their
    loads.
    """
    (elastic, massless, quasi_static), (q, v, vd) = springs, begin
    span, interval = pieces.t[-1] - pieces.t[0], np.median(np.diff(pieces.t))
    axes = SlowAxes.of(pieces, of, coordinates.Z)
    within, further = IndependentMotions(axes, of, coordinates), None
    if massless is not None:
        further = (_NO_TIME * interval) ** 2 * massless
    omega, T = within.modes(1.0 / span, further)
    # joints are closed with the least elastic energy, so that stiff modes do not contribute
    first = np.linalg.solve(T, np.stack(within.coordinates(q, v, elastic * span**2), axis=1))
    if quasi_static is not None:
        follow = np.einsum("ij,ik,kj->j", T, within.mean(quasi_static), T) > 0.5 * omega**2
    else:
        follow = omega * interval > UNRESOLVED
        follow &= np.argsort(np.argsort(omega)) >= _MOST_VIBRATIONS
    if massless is not None:
        follow |= omega * interval * _NO_TIME > 0.5
        follow[within.rank() :] = True
    made: IndependentMotions | CondensedMotions = within
    if follow.any():
        wide = _SPAN / omega[follow].min() if quasi_static is not None else 0.0
        made = CondensedMotions(within, T, follow, wide)
        omega, T = made.modes(1.0 / span)
        first = np.linalg.solve(T, first[~follow])
    (y, yd), modal = first.T, ModalEquations(pieces, made, omega, T)
    if vd is not None:  # where forces hold quick ones at first: places are not known so well
        y[modal.quick] = 0.0
        force = of.F[0] + of.M[0] @ vd + of.D[0] @ v
        force = force + of.K[0] @ (made.place(T @ y) + made.g[0])
        side = made.place(T[:, modal.quick])
        y[modal.quick] = -least_squares_solution(side.T @ of.K[0] @ side, side.T @ force)
    moved, bounded = modal.integrate(y, yd)
    return made.motion(*(eta @ T.T for eta in moved)), bounded


def displaced(
    layout: Layout, motion: Motion, dq: Array, dv: Array, dvd: Array
) -> tuple[Array, Array, Array]:
    """q (n, nq), v and v̇ (n, nv) of a motion with changes (n, nv) of positions and both rates.

    Each body moves by the screw exp(δr, δθ) in its axes, and its velocities and accelerations
    change in these axes, which turn with it: one motion, whatever point of the body its coordinates
    are about. A displacement of that point straight ahead beside a finite rotation would not be.

    Source: Murray, Li & Sastry, A Mathematical Introduction to Robotic Manipulation, chapter 2.
    """
    q, v, vd = motion.q.copy(), motion.v + dv, motion.vd + dvd
    for body in layout.bodies:
        at, line = slice(body.iq, body.iq + 3), slice(body.iv, body.iv + 3)
        e, turn = slice(body.iq + 3, body.iq + 7), slice(body.iv + 3, body.iv + 6)
        modes = slice(body.iq + 7, body.iq + 7 + body.m)
        q[:, modes] += dq[:, body.iv + 6 : body.iv + 6 + body.m]
        before, angle = motion.q[:, e], dq[:, turn]
        shift, half = screw(rotate_back(before, dq[:, line]), angle)
        q[:, at] += rotate(before, shift)
        q[:, e] = product(before, half)
        u, w, dw = rotate_back(before, motion.v[:, line]), motion.v[:, turn], dv[:, turn]
        a = rotate_back(before, motion.vd[:, line])
        du = rotate_back(before, dv[:, line]) - np.cross(angle, u)
        da = rotate_back(before, dvd[:, line]) - np.cross(angle, a)
        da -= np.cross(dw, u) + np.cross(w, du)
        rates = a - np.cross(w, u) + da + np.cross(w + dw, u + du)
        v[:, line], vd[:, line] = rotate(q[:, e], u + du), rotate(q[:, e], rates)
    if n := len(layout.coordinates):
        q[:, -n:] += dq[:, -n:]
    return q, v, vd


def screw(d: Array, angle: Array) -> tuple[Array, Array]:
    """Displacement (n, 3) and quaternion (n, 4) of exp(d, θ)."""
    size = np.linalg.norm(angle, axis=1)[:, None]
    small = size < _SERIES
    s = np.where(small, 1.0, size)
    first = np.where(small, 0.5 - size**2 / 24.0, (1.0 - np.cos(s)) / s**2)
    second = np.where(small, 1.0 / 6.0 - size**2 / 120.0, (s - np.sin(s)) / s**3)
    across = np.cross(angle, d)
    half = np.where(small, 0.5 - size**2 / 48.0, np.sin(0.5 * s) / s)
    turn = np.hstack([np.cos(0.5 * size), half * angle])
    return d + first * across + second * np.cross(angle, across), turn


def rotate(e: Array, x: Array) -> Array:
    """Vectors (n, 3) in body axes with quaternions (n, 4), in those of the ground."""
    y = 2.0 * np.cross(e[:, 1:], x)
    return np.asarray(x + e[:, :1] * y + np.cross(e[:, 1:], y))


def rotate_back(e: Array, x: Array) -> Array:
    """Vectors in axes of the ground, in those of the body."""
    return rotate(e * [1.0, -1.0, -1.0, -1.0], x)


def product(a: Array, b: Array) -> Array:
    """Products of quaternions."""
    first = a[:, :1] * b[:, :1] - (a[:, 1:] * b[:, 1:]).sum(axis=1, keepdims=True)
    rest = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.hstack([first, rest])
