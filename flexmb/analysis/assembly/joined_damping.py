"""Flexible bodies as the scene joins them: their damping, and which of their modes may be static.

In: a compiled model and its first pose. Out: the model with the damping matrices of its bodies, and
the ratio that each mode has. The modes of a body as joined are those of the scene in that pose with
this body flexible and all others rigid: joints, couplers and drivers hold, the others move with
their mass, springs and other forces are left out. Quasi-static modes have no mass, and those of
kinetostatic bodies no vibrations. A bar that is driven at its hub is clamped there; one on a free
hub vibrates against its mass. In scenes of more than `MAX_COORDINATES` coordinates the others are
at rest.

Bodies stay kinetostatic (`engine.bodies.static_modes`) only if the joints do not need their
compliance: with their modes fixed, the Jacobian must have the same rank. Else drivers could lock
the mechanism, and reactions that elasticity decides would be arbitrary. They do not if other modes
exist as well, which closing a joint would strain, nor if attached springs or bushings are not much
softer than they are: loads and deformation would not converge.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, qr

from flexmb.analysis.assembly.jacobian import (
    MAX_COORDINATES,
    Decomposition,
    WeightedJacobian,
    column_scales,
    dense_jacobian,
    n_free,
    null_space,
    numerical_rank,
    one_blas_thread,
)
from flexmb.engine.bodies.flexible_body import put_flags
from flexmb.engine.bodies.static_modes import (
    STATIC_MODES,
    free_static_modes,
    static_bodies,
    static_coordinates,
)
from flexmb.engine.compile import Compiled
from flexmb.engine.entries import row_evaluator
from flexmb.engine.state import Work
from flexmb.engine.tables import BodyColumns, System, aligned
from flexmb.engine.work import new_state, new_work
from flexmb.errors import AssemblyError, FlexmbError, Problem, SceneError
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.flexbody.damping import DampingOptions, read_damping
from flexmb.flexbody.natural_modes import Vibrations, damping_matrix, damping_ratios, mass_at_rest
from flexmb.model.markers import rotation_matrix
from flexmb.model.model import Model
from flexmb.results import BodyDamping

_NO_MASS = 1e-11  # of the largest
_SETTLES = 0.5  # of the last change of deformation, that the loads which follow it may make


def selected_damping(model: Model, name: str, body: FlexBody) -> DampingOptions | None:
    """The damping of a flexible body: that of the scene, or else of the body itself."""
    words = read_damping(getattr(model.bodies[name], "damping", None))
    return body.damping if words is None else words


@one_blas_thread()
def add_damping(compiled: Compiled, model: Model, q: Array) -> tuple[Compiled, list[BodyDamping]]:
    """The model with the damping of its flexible bodies, and the ratios of their modes.

    Of several flexible bodies also those of the modes that all have together, under no name.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model, which is returned as it is if it has its damping already.
    q : (nq,) array
        First positions, closed.

    Raises
    ------
    SceneError
        Modes that do not exist, cut-off frequencies below all modes.
    """
    if compiled.is_damped:
        return compiled, []
    parts = compiled.system.parts
    pool, bodies = aligned(parts.pool), parts.bodies.copy()
    flexbodies = dict(compiled.flexbodies)
    problems: list[Problem] = []
    dampings: list[BodyDamping] = []
    every, (static, kinetostatic) = list(range(len(bodies))), static_bodies(compiled.system)
    scene, others = None, ""
    for k, (row, columns) in enumerate(zip(bodies, compiled.layout.bodies, strict=True)):
        body = compiled.flexbodies.get(columns.name)
        if body is None or row["m"] == 0:
            continue
        name, m = columns.name, int(row["m"])
        if k in kinetostatic:
            dampings.append(BodyDamping(name, "none: all modes are quasi-static"))
            continue
        D = np.asarray(body.D)
        words = selected_damping(model, name, body)
        if words is None and not np.any(D):
            dampings.append(BodyDamping(name, "none"))
            continue
        if compiled.layout.nv > MAX_COORDINATES:
            scene, others = MechanismModes(compiled, q, [k]), ", all other bodies at rest"
        joined = (scene := scene or MechanismModes(compiled, q, every)).vibrations(k)
        text = "by the matrix of the body"
        if words is not None:
            text = words.sentence()
            try:
                D = damping_matrix(
                    body, words, joined, f"bodies.{name}.damping",
                    None if others else scene.part_of_modes(k),
                )  # fmt: skip
            except FlexmbError as error:
                problems += error.problems
                continue
        at = int(row["flex"]) + 12 * m + 2 * m * m
        pool[at : at + m * m] = D.ravel()
        flexbodies[name] = replace(body, D=D)
        put_flags(row, flexbodies[name], k in static)
        dampings.append(_ratios(name, text + others, D, joined))
    if problems:
        raise SceneError.from_problems(problems)
    if scene is None:
        return compiled, dampings
    if len(scene.flexible) > 1 and not others:
        names = [compiled.layout.bodies[k].name for k in scene.flexible]
        D = block_diag(*(flexbodies[name].D for name in names))
        dampings.append(_ratios("", "all flexible bodies", D, scene.together))
    system = compiled.system._replace(parts=parts._replace(pool=pool, bodies=bodies))
    return replace(compiled, system=system, flexbodies=flexbodies, is_damped=True), dampings


def _ratios(body: str, words: str, D: Array, joined: Vibrations) -> BodyDamping:
    frequencies, ratios = joined.omega / (2 * np.pi), damping_ratios(D, joined)
    return BodyDamping(body, words, tuple(frequencies.tolist()), tuple(ratios.tolist()))


class MechanismModes:
    """The motions that joints and drivers leave to bodies as rigid ones, all others at rest.

    Parameters
    ----------
    compiled, q : Compiled, (nq,) array
        The model and its pose.
    bodies : list of int
        Which bodies may move; with all of them the scalar coordinates do as well.
    """

    def __init__(self, compiled: Compiled, q: Array, bodies: list[int]) -> None:
        layout, system = compiled.layout, compiled.system
        self._compiled, everything = compiled, len(bodies) == len(layout.bodies)
        state, work = new_state(system), new_work(system)
        state.q[:] = q
        row_evaluator(system, state, work)()
        scales = column_scales(compiled)
        places = np.concatenate([_columns(layout.bodies[k]) for k in bodies])
        if everything:
            places = np.arange(layout.nv)
            A = dense_jacobian(compiled, work)
        else:
            A = _rows_of_body(compiled, work, *bodies)
        order = np.full(layout.nv, -1)
        order[places] = np.arange(len(places))
        mass, self._scales, self._order = np.zeros((len(places),) * 2), scales[places], order
        modal = np.zeros(len(places), bool)
        for k in bodies:
            columns = layout.bodies[k]
            at = order[_columns(columns)]
            block = _mass(system, k, compiled.flexbodies.get(columns.name))
            turn = rotation_matrix(q[columns.iq + 3 : columns.iq + 7])
            block[:3] = turn @ block[:3]
            block[:, :3] = block[:, :3] @ turn.T
            mass[np.ix_(at, at)], modal[at[6:]] = block, True
        for row in system.parts.coordinates if everything else ():
            mass[row["iv"], row["iv"]] = row["m"]
        self._mass = mass * np.outer(self._scales, self._scales)
        self._A = system.row_weights[:, None] * A * self._scales if everything else A * self._scales
        self._rigid = np.flatnonzero((self._scales > 0.0) & ~modal)
        self._rows = Decomposition.of(self._A[:, self._rigid])

    @cached_property
    def flexible(self) -> list[int]:
        """Numbers of the flexible bodies, that are not kinetostatic."""
        _, kinetostatic = static_bodies(self._compiled.system)
        bodies = enumerate(self._compiled.layout.bodies)
        return [k for k, one in bodies if one.m and k not in kinetostatic]

    @cached_property
    def together(self) -> Vibrations:
        """Vibrations of all flexible bodies."""
        return self.vibrations(*self.flexible)

    def part_of_modes(self, k: int) -> tuple[Array, Array] | None:
        """Frequencies of all flexible bodies together [rad/s], and body k in their modes."""
        if len(self.flexible) < 2:
            return None
        sizes = [self._compiled.layout.bodies[one].m for one in self.flexible]
        n = self.flexible.index(k)
        at = sum(sizes[:n])
        return self.together.omega, self.together.eta[at : at + sizes[n]]

    def vibrations(self, *bodies: int, still: IntArray | None = None) -> Vibrations:
        """Vibrations of a body, or of several together, as joined, all others rigid.

        `still` (k,) are places in v of modes that do not move.
        """
        several = [self._compiled.layout.bodies[k] for k in bodies]
        places = np.concatenate([_columns(one)[6:] for one in several])
        moving = ~np.isin(places, [] if still is None else still)
        modal = self._order[places[moving]]
        rows, A = self._rows, self._A[:, modal]
        # motions (x, y) with A_r x + A y = 0: y that redundant rows allow, and the x that follows
        r = rows.rank
        y = null_space(rows.U[:, r:].T @ A, rows.S.max(initial=1.0))
        x = -(rows.V[:, :r] / rows.S[:r]) @ (rows.U[:, :r].T @ A @ y)
        n, free = len(self._rigid), rows.free
        motions = np.block([[free, x], [np.zeros((len(modal), free.shape[1])), y]])
        both = np.append(self._rigid, modal)
        mass = motions.T @ self._mass[np.ix_(both, both)] @ motions
        try:
            K = block_diag(*(self._compiled.flexbodies[one.name].K for one in several))
            K = K[np.ix_(moving, moving)]
            eta = self._scales[modal, None] * motions[n:]
            if any(k in static_bodies(self._compiled.system)[0] for k in bodies):
                T = condensation(mass, eta.T @ K @ eta)[0]
                eta, mass = eta @ T, T.T @ mass @ T
            return Vibrations.of(K, eta, mass)
        except np.linalg.LinAlgError:
            what = "has no meaning: a motion of the scene that joints leave free has no inertia"
            problem = Problem(f"bodies.{several[0].name}.damping", what)
            raise AssemblyError.from_problems([problem]) from None


def _columns(columns: BodyColumns) -> NDArray[np.int64]:
    """(6 + m,) velocity coordinates of a body."""
    return columns.iv + np.arange(6 + columns.m)


def _rows_of_body(compiled: Compiled, work: Work, k: int) -> Array:
    """(n, 6 + m) weighted rows of the joints of body k for its own motion."""
    system = compiled.system
    owner, rows, size = system.parts.markers["body"], system.rows, 6 + compiled.layout.bodies[k].m
    A = np.zeros((len(rows), size))
    for side in "IJ":
        on = np.flatnonzero((rows[f"jac_{side}"] >= 0) & (owner[rows[side]] == k))
        A[on] += work.dense.jac[rows[f"jac_{side}"][on, None] + np.arange(size)]
    touched = A.any(axis=1)
    return np.asarray(system.row_weights[touched, None] * A[touched])


def _mass(system: System, k: int, body: FlexBody | None) -> Array:
    """(6 + m, 6 + m) of a body at rest, in body axes; quasi-static modes have none."""
    row = system.parts.bodies[k]
    if body is not None and row["m"] > 0:
        at, m = int(row["flex"]) + 12 * body.m, body.m
        M_eta = system.parts.pool[at : at + m * m].reshape(m, m)
        return mass_at_rest(body.mass, body.S1, body.S0, body.p, body.P, M_eta)
    no = np.zeros
    return mass_at_rest(row["mass"], row["S1"], row["S0"], no((3, 0)), no((3, 3, 0)), no((0, 0)))


def is_determinate(compiled: Compiled, rank: int | None) -> bool:
    """Whether constraints of this rank fix the motion, but for modes that follow the loads."""
    return rank == n_free(compiled) - len(static_coordinates(compiled.system, kinetostatic=True))


@one_blas_thread()
def choose_static_modes(compiled: Compiled, q: Array) -> Compiled:
    """The model with kinetostatic bodies only if joints and forces allow them, at q (nq,)."""
    modes = static_coordinates(compiled.system, kinetostatic=True)
    if not len(modes):
        return compiled
    if n_free(compiled) > MAX_COORDINATES:
        return _with_windows(compiled, q)
    if sum(body.m for body in compiled.layout.bodies) > len(modes):
        return replace(compiled, system=free_static_modes(compiled.system))
    state, work = new_state(compiled.system), new_work(compiled.system)
    state.q[:] = q
    row_evaluator(compiled.system, state, work)()
    rows = WeightedJacobian.of(compiled, dense_jacobian(compiled, work))
    ranks = [
        numerical_rank(np.asarray(np.linalg.svd(A, compute_uv=False)), 1.0)
        for A in (rows.A, rows.A[:, ~np.isin(rows.columns, modes)])
    ]
    if ranks[0] == ranks[1] and _loop_gain(compiled, q, modes) < _SETTLES:
        return _with_windows(compiled, q)
    return replace(compiled, system=free_static_modes(compiled.system))


# Least interval of the past of such modes times ω, of the slowest vibration of what hangs on them:
# second differences of the tolerance of the loads are 1e-8 of k times the size of the part at most,
# and what a cubic leaves of motion at Ω is (Ω/ω)⁴/500 of the forces, less than vibrations left out.
_WINDOW = 0.05


def _with_windows(compiled: Compiled, q: Array) -> Compiled:
    """The model with rates of kinetostatic bodies over a share of their slowest vibrations."""
    rows, kinetostatic = static_bodies(compiled.system)
    everything, one_by_one = range(len(compiled.layout.bodies)), n_free(compiled) > MAX_COORDINATES
    scene, periods = None, np.zeros(len(rows))
    for n, k in enumerate(rows):
        if k in kinetostatic:
            if scene is None or one_by_one:
                scene = MechanismModes(compiled, q, [k] if one_by_one else list(everything))
            with suppress(AssemblyError):  # there is no motion without inertia, and none is slow
                periods[n] = 1.0 / scene.vibrations(k).omega.min(initial=math.inf)
    kinds = compiled.system.kinds
    static = kinds[STATIC_MODES.name]._replace(window=_WINDOW * periods)
    return replace(
        compiled, system=compiled.system._replace(kinds={**kinds, STATIC_MODES.name: static})
    )


def _loop_gain(compiled: Compiled, q: Array, modes: IntArray) -> float:
    """How much of a deformation by these modes the loads that follow it add to it.

    It moves what closes joints, by the least kinetic energy: what has mass stays where it can. By
    that forces change, and accelerations and reactions by them.
    """
    from flexmb.analysis.linear.state_equations import StateEquations  # it needs machine code

    state, nv = new_state(compiled.system, len(compiled.layout.channels)), compiled.layout.nv
    state.q[:] = q
    M, _, K, Cq, _ = StateEquations(compiled, state).tangents()
    own, others = np.zeros((nv, nv)), np.setdiff1d(np.arange(nv), modes)
    for body in compiled.layout.bodies:
        at = slice(body.iv + 6, body.iv + 6 + body.m)
        own[at, at] = compiled.flexbodies[body.name].K if body.m else 0.0
    moved = np.zeros((nv, len(modes)))
    moved[modes] = np.eye(len(modes))
    rows, none = Cq[:, others], np.zeros((len(others), len(modes)))
    both = np.block([[M[np.ix_(others, others)], rows.T], [rows, np.zeros((len(Cq),) * 2)]])
    closed = np.linalg.lstsq(both, np.concatenate([none, -Cq[:, modes]]), rcond=None)[0]
    moved[others] = closed[: len(others)]
    force = (K - own) @ moved
    pushed = np.concatenate([-force[others], np.zeros((len(Cq), len(modes)))])
    accelerated = np.linalg.lstsq(both, pushed, rcond=None)[0]
    force = force[modes] + np.hstack([M[np.ix_(modes, others)], Cq[:, modes].T]) @ accelerated
    follows = np.linalg.solve(own[np.ix_(modes, modes)], force)
    return float(np.abs(np.linalg.eigvals(follows)).max(initial=0.0))


def condensation(M: Array, K: Array) -> tuple[Array, Array, IntArray]:
    """Static equilibrium of motions without mass (Guyan).

    M (n, n) is symmetric, K (n, n) need not be. Returns T and L (n, k) with the condensed matrices
    Lᵀ M T and Lᵀ K T, and the places (k,) of the coordinates that remain.
    """
    n = len(M)
    values, vectors = np.linalg.eigh(0.5 * (M + M.T))
    free = vectors[:, values <= _NO_MASS * values.max(initial=0.0)]
    if not free.size:
        return np.eye(n), np.eye(n), np.arange(n)
    _, _, order = qr(free.T, pivoting=True, mode="economic")
    remaining = np.sort(order[free.shape[1] :])
    keep = np.eye(n)[:, remaining]
    stiffness = free.T @ K @ free
    T = keep - free @ np.linalg.solve(stiffness, free.T @ K @ keep)
    L = keep - free @ np.linalg.solve(stiffness.T, free.T @ K.T @ keep)
    return T, L, remaining
