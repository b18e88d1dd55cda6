"""How the motion of one model differs from that of a neighbouring one: a first-order perturbation.

In: the rows of a run, and the compiled model of the same scene with one effect more or less. Out:
the change of every sensor, row by row. What the run leaves out of balance in the other model, its
defect F and C, drives the small motions of that model about the computed motion,

    M δv̇ + D δv + K δq + Cqᵀ δλ = −F,   Cq δq = −C,   δv = δq̇ + Ω δq

(Ω the turning of body axes). With δq = Z y + g, the columns of Z the motions that the rows of Cq
leave free, this is an ordinary linear equation for y, whose coefficients are averaged over each
interval and whose solution there is exact (matrix exponential, forces linear in time): modes far
faster than the rows vibrate and resonate as they would. The place that such a mode vibrates about,
its equilibrium with the loads and the accelerations of the slow ones, moves with the coefficients;
averages make it jump, and the mode would ring. It is carried over to each next row (adiabatic
motion). Where these stiff modes begin the first accelerations tell. Where a bristle begins to stick
or to slide the equation is solved anew: it sticks where the small motion has slid to. Positions
have the motion that closes joints at full size, of the second order, by the least elastic energy.

Source of the idea: defect correction (Stetter, Numer. Math. 29 (1978) 425); of the estimate:
Padilla & von Flotow, J. Guidance 15 (1992) 149, who linearise about the motion as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from flexmb.analysis.assembly.jacobian import one_blas_thread
from flexmb.analysis.dynamics.bent_functions import rows_behind_jumps
from flexmb.analysis.effects.free_motions import (
    Coefficients,
    FreeMotions,
    equilibria,
    first_order,
    least_solution,
    small_motions,
    times,
)
from flexmb.analysis.effects.smooth_pieces import Jumps, SmoothPieces
from flexmb.analysis.effects.stored_motion import Bristles, Motion, equations_of
from flexmb.analysis.linear.state_equations import StateEquations
from flexmb.engine.bodies.static_modes import static_coordinates
from flexmb.engine.compile import Compiled
from flexmb.flexbody.arrays import Array, IntArray

_UNRESOLVED = 1.0  # rad of a vibration between two rows from which on they do not resolve it
_ENDS = 5  # rows at the end of splines, where rates of what follows turning bodies are rough
_CLOSINGS = 2  # of joints at full size
_CLOSED = 0.01  # of their gaps may be left
_ROUNDS = 2  # of what such vibrations do slowly
_WORSE = 30.0  # motion of dependent coordinates per independent one that asks for others
_LEAST_ROWS, _MOST_ROWS = 8, 64  # with one choice of them; of those that are solved together
_NO_TIME = 0.01  # of an interval, which modes without inertia take
_MOST_VIBRATIONS = 80  # the slowest of many; what the rows do not resolve beyond only follows loads
_SMALL = 1e-5  # of the size of the model: a change of the motion that is linear in all sensors
_UNBOUNDED = 1e12  # a small motion this many times the model is not followed any further


@dataclass(frozen=True, eq=False)
class Response:
    """Change of the channels (n, k) that another model makes, and the motions behind it (n, nv).

    From row `bounded` on the small motions are no longer small: the linear equations are unstable
    there, or the change is as large as the model. `motion` is that of the run with the change, if
    bounded.
    """

    channels: Array
    dq: Array
    bounded: int
    motion: Motion | None = None


@one_blas_thread()
def respond(
    compiled: Compiled, motion: Motion, balance: Array,
    start: tuple[Array, Array, Array] | None = None, *, quasi_static: bool = False,
    jumps: Jumps | None = None,
) -> Response:  # fmt: skip
    """Small motions of a model about a motion that is not its own.

    Parameters
    ----------
    compiled : Compiled
        The other model.
    motion : Motion
        A computed motion in its coordinates; channels are those of the run itself.
    balance : (n, nv) array
        What the rows leave out of balance in their own model: the noise of reported accelerations
        and reactions, which is no effect.
    start : three (nv,) arrays, optional
        First changes of positions, velocities and accelerations; none by default.
    quasi_static : bool
        Leave out the inertia of vibrations: deformations follow their loads.
    jumps : Jumps, optional
        Where the computed motion jumps, which the other model does not.
    """
    n, one = len(motion.t), small_motions(compiled, motion, balance)
    behind = np.array(rows_behind_jumps(compiled, motion.t), np.int64)
    behind = behind if jumps is None else np.union1d(behind, jumps.rows)
    pieces = SmoothPieces(motion.t, behind)
    stays = {} if jumps is None else {int(k): i for i, k in enumerate(jumps.rows)}
    frames = one.frames
    state: _Begin = *(np.zeros(len(one.weights)),) * 2, None
    if start is not None:
        dq, dv, dvd = (frames.inward(0, x) for x in start)
        state = dq, dv, dvd - frames.spin()[1][0] @ dv
    static = static_coordinates(compiled.system)
    elastic = frames.elastic()
    springs = elastic, frames.elastic(static) if len(static) else None
    parts = np.zeros((3, n, len(one.weights)))
    first, bounded = 0, n
    bristles, load = Bristles(compiled, motion), np.zeros((n, len(one.weights)))
    bends = {*bristles.bends.tolist()}
    while first < n - 1 and bounded == n:
        end = min((k + 1 for k in (*stays, *bends) if k > first), default=n)
        segment = _segment(one, first, end)
        rows = slice(first, first + len(segment.Z))
        begin = frames.outward(np.stack(state[:2]), slice(first, first + 1))
        added = bristles.load(range(n)[rows], *begin)
        load[rows] = frames.turned(added[:, None], rows)[:, 0]
        of = one.part(rows).between(load[rows], first in bends, rows.stop - 1 in bends)
        parts[:, rows], bounded = _solve(
            pieces.part(rows), of, segment, state, springs, quasi_static
        )
        bounded = n if bounded == len(segment.Z) else first + bounded
        first += len(segment.Z) - 1
        state = parts[0, first], parts[1, first], None if first in bends else parts[2, first]
        if jumps is not None and first in stays:
            both = (x[stays[first]] for x in (jumps.places, jumps.velocities))
            dq, dv = (frames.inward(first, x) for x in both)
            state = state[0] - dq, state[1] - dv, None
    if quasi_static and n > _ENDS**2:
        parts[1:, -_ENDS:] = parts[1:, [-_ENDS - 1]]
    change, equations = np.zeros_like(motion.channels), equations_of(compiled)
    force = one.F + load + sum(map(times, (one.M, one.D, one.K), parts[::-1]))
    follows = (np.diag(elastic) > 0.0) & quasi_static  # their equations have no inertia in the run
    multipliers = np.einsum("tr,trc->tc", one.shares(force, follows), one.rows)
    closed = _closure(motion, equations, one, parts[0], elastic) if bounded == n else None
    dq = frames.outward(parts[0])
    factors = np.ones((1, n))
    if closed is None:  # large turns may take away from what such joints add: the smaller counts
        sizes = np.abs(parts[0]).max(axis=1, initial=_SMALL)
        factors = np.stack([np.ones(n), _SMALL / sizes])
    else:
        closed_v = pieces.rate(closed) + times(one.Omega, closed)
        parts += [closed, closed_v, pieces.rate(closed_v)]
    now, moves = equations.state, [frames.outward(part) for part in parts]
    for k in range(bounded):
        changes = []
        for f in factors[:, k]:
            motion.put(k, equations)
            now.q[:] = equations.moved(motion.q[k], f * moves[0][k])
            now.v[:] += f * moves[1][k]
            now.vd[:] += f * moves[2][k]
            now.lam[:] -= f * multipliers[k]
            now.history[:] += f * bristles.changes[k]
            changes.append((equations.channels() - motion.channels[k]) / f)
        change[k] = np.where(np.abs(changes[0]) < np.abs(changes[-1]), changes[0], changes[-1])
    dq[bounded:] = 0.0
    change[bounded:] = np.inf
    if bounded < n:
        return Response(change, dq, bounded)
    q = np.array([equations.moved(*pair) for pair in zip(motion.q, moves[0], strict=True)])
    rates, lam = (motion.v + moves[1], motion.vd + moves[2]), motion.lam - multipliers
    past = None if motion.history is None else motion.history + bristles.changes
    moved = Motion(motion.t, q, *rates, lam, motion.channels + change, past)
    return Response(change, dq, bounded, moved)


_Begin: TypeAlias = tuple[Array, Array, Array | None]
"""First changes of q, v and dv/dt in weighted coordinates."""


@dataclass(frozen=True, eq=False)
class _Segment:
    """Motions (rows, nu, d) per unit of independent coordinates, and what closes the rows of Cq."""

    Z: Array
    g: Array
    free: IntArray  # (d,) the independent coordinates


def _segment(of: Coefficients, first: int, n: int) -> _Segment:
    """Rows from `first` to n along which one choice of independent coordinates serves.

    Modes and bodies that turn little are independent where they can be: nothing turns with motion.
    """
    from scipy.linalg import qr

    _, rank, nu = of.Cq.shape
    order = qr(of.Cq[first] * of.prefer, mode="r", pivoting=True)[1] if rank else np.arange(nu)
    dependent, free = order[:rank], np.sort(order[rank:])
    Z, g = np.zeros((n - first, nu, nu - rank)), np.zeros((n - first, nu))
    Z[:, free] = np.eye(nu - rank)
    limit, k, some = np.inf, first, _LEAST_ROWS
    while rank and k < n:
        own, some = slice(k, min(k + some, n)), min(2 * some, _MOST_ROWS)
        both = np.concatenate([of.Cq[own][:, :, free], of.C[own, :, None]], axis=2)
        solution = -np.linalg.solve(of.Cq[own][:, :, dependent], both)
        sizes = np.abs(solution[:, :, :-1]).max(axis=(1, 2), initial=1.0)
        limit = max(_WORSE * sizes[0], _WORSE) if k == first else limit
        large = np.flatnonzero(sizes > limit)
        large = large[large >= first + _LEAST_ROWS - k]
        end = k - first + (large[0] if large.size else len(solution))
        Z[k - first : end, dependent] = solution[: end - k + first, :, :-1]
        g[k - first : end, dependent] = solution[: end - k + first, :, -1]
        if large.size:
            return _Segment(Z[:end], g[:end], free)
        k = own.stop
    return _Segment(Z, g, free)


def _closure(
    motion: Motion, equations: StateEquations, of: Coefficients, dq: Array, elastic: Array
) -> Array | None:
    """What closes joints at full size after motions (n, nu); None if these are too large for it.

    Of bodies that bend it is by how much they come closer, of the second order in the deflection.
    """
    closed, gaps = np.zeros_like(dq), np.zeros((_CLOSINGS + 1, len(dq)))
    closing = of.closure((motion.t[-1] - motion.t[0]) ** 2 * elastic)
    for gap in gaps:
        whole = of.frames.outward(dq + closed)
        for k in range(len(dq)):
            motion.put(k, equations)
            equations.state.q[:] = equations.moved(motion.q[k], whole[k])
            equations.residual()
            step = closing[k] @ (of.rows[k] @ equations.work.con.C)
            gap[k] = np.abs(step).max(initial=0.0)
            closed[k] -= step
    most = max(_CLOSED * gaps[0].max(initial=0.0), _SMALL**2)
    return closed if np.all(gaps[-1] <= most) else None


def _solve(
    pieces: SmoothPieces, of: Coefficients, segment: _Segment, state: _Begin,
    springs: tuple[Array, Array | None], follow: bool,
) -> tuple[Array, int]:  # fmt: skip
    """δq, δv and δv̇ (3, n, nu) from the first on, and how many rows are bounded.

    `springs` are the stiffness of all modes and that of those without inertia. With `follow`
    vibrations whose stiffness is mostly that of bodies follow their loads.
    """
    from scipy.linalg import expm

    elastic, massless = springs
    t = pieces.t
    n, interval, least = len(t), np.median(np.diff(t)), 1.0 / (t[-1] - t[0])
    made = FreeMotions(pieces, of, segment.Z, segment.g)
    further = None if massless is None else (_NO_TIME * interval) ** 2 * massless
    omega, T = made.modes(least, further)
    # the least energy closes joints that were closed at full size: what is stiff does not share it
    W = of.M[0] + elastic * (t[-1] - t[0]) ** 2
    close = np.linalg.solve(made.Z[0].T @ W @ made.Z[0], made.Z[0].T @ W)
    y0 = close @ (state[0] - made.g[0])
    yd0 = close @ (state[1] - made.V1[0] @ y0 - made.a0[0])
    y0, yd0 = np.linalg.solve(T, np.stack([y0, yd0], axis=1)).T
    if follow:
        still = np.einsum("ij,ik,kj->j", T, made.mean(elastic), T) > 0.5 * omega**2
    else:
        still = omega * interval > _UNRESOLVED
        still &= np.argsort(np.argsort(omega)) >= _MOST_VIBRATIONS
    still |= (massless is not None) & (omega * interval * _NO_TIME > 0.5)
    if still.any():  # they follow the loads and all other motions
        y0, yd0 = y0[~still], yd0[~still]
        K, load = T.T @ made.K @ T, made.load @ T
        others = np.concatenate([K[:, still][:, :, ~still], -load[:, still, None]], axis=2)
        lead = -np.linalg.solve(K[:, still][:, :, still], others)
        Z = made.Z @ T
        g = made.g + times(Z[:, :, still], lead[:, :, -1])
        Z = Z[:, :, ~still] + Z[:, :, still] @ lead[:, :, :-1]
        made = FreeMotions(pieces, of, Z, g, calm=follow)
        omega, T = made.modes(least)
        y0, yd0 = np.linalg.solve(T, np.stack([y0, yd0], axis=1)).T
    u, w = len(omega), omega
    M, D, K = (T.T @ A @ T for A in (made.M, made.D, made.K))
    # what modes that the rows do not resolve do slowly is taken out of the forces first
    quick = w * interval > _UNRESOLVED
    rest, slow, inner = made.load @ T, np.zeros((3, n, u)), np.ix_(np.arange(n), quick, quick)
    for _ in range(_ROUNDS):
        y = np.zeros((n, u))
        y[:, quick] = least_solution(K[inner], rest[:, quick, None])[..., 0]
        motion = np.array([y, pieces.rate(y), pieces.rate(y, 2)])
        rest = rest - sum(map(times, (K, D, M), motion))
        slow += motion
    if state[2] is not None:  # where forces hold quick ones at first: places are not known so well
        y0[quick] = 0.0
        force = of.F[0] + of.M[0] @ state[2] + of.D[0] @ state[1]
        force = force + of.K[0] @ (made.Z[0] @ (T @ y0) + made.g[0])
        side = made.Z[0] @ T[:, quick]
        y0[quick] = -least_solution(side.T @ of.K[0] @ side, side.T @ force)
    x = np.zeros((n, 2 * u))
    x[0] = np.concatenate([y0 - slow[0, 0], (yd0 - slow[1, 0]) / w])
    Mm, Dm, Km = (0.5 * (C[1:] + C[:-1]) for C in (M, D, K))  # symmetric: they make no energy
    A, inverse = first_order(Mm, Dm, Km, w)
    both = ~np.tile(quick, 2)
    if both.any():
        resolved = np.ix_(np.arange(n - 1), both, both)
        A[resolved] += pieces.series(first_order(M, D, K, w, ~quick)[0])
    jumps = np.concatenate([pieces.jumps(slow[0], slow[1]), pieces.jumps(slow[1], slow[2]) / w], 1)
    # averages make what quick ones ring about jump: they are carried over to it
    rows = equilibria(M, D, K, rest[:, :, None], w, quick)
    moved = equilibria(Mm, Dm, Km, np.stack([rest[:-1], rest[1:]], axis=2), w, quick)
    leave, arrive = moved[:, :, :-1] - rows[:-1], rows[1:] - np.delete(moved, -2, axis=2)
    bounded, lead = n, np.append(both, True)
    for k in range(n - 1):
        h = t[k + 1] - t[k]
        step = np.zeros((2 * u + 2, 2 * u + 2))
        step[: 2 * u, : 2 * u] = h * A[k]
        step[u : 2 * u, 2 * u] = h * (inverse[k] @ rest[k]) / w
        step[u : 2 * u, 2 * u + 1] = h * (inverse[k] @ (rest[k + 1] - rest[k])) / w
        step[2 * u + 1, 2 * u] = 1.0
        now = np.append(x[k], (1.0, 0.0))
        now[:u][quick] += leave[k] @ now[:-1][lead]
        now = expm(step) @ now
        now[:u][quick] += arrive[k] @ now[:-1][lead]
        x[k + 1] = now[: 2 * u] - jumps[k + 1]
        if not np.abs(T @ x[k + 1, :u]).max(initial=0.0) < _UNBOUNDED:
            bounded = k + 1
            x[k + 1 :] = 0.0
            break
    y, yd = x[:, :u], x[:, u:] * w
    rest = rest - times(K, y) - times(D, yd)
    slow += np.array([y, yd, np.linalg.solve(M, rest[..., None])[..., 0]])
    return made.motion(*(z @ T.T for z in slow)), bounded
