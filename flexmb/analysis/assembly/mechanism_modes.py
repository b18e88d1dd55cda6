"""Vibration modes of flexible bodies as part of the mechanism, in its first pose.

In: a compiled model and its first pose. Out: natural frequencies and modal coordinates of one
flexible body, or of all together, with all other bodies rigid. Joints, couplers and drivers
constrain them; the other bodies move with their mass; springs and other forces are left out. A bar
that is driven at its hub is clamped there; one on a free hub vibrates against the hub's mass. In
models with more than `MAX_COORDINATES` coordinates the other bodies are at rest.

Quasi-static modes have no mass: they are eliminated by static condensation.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, qr

from flexmb.analysis.assembly.jacobian import (
    Decomposition,
    DenseJacobian,
    column_scales,
    null_space,
)
from flexmb.engine.allocation import new_state, new_work
from flexmb.engine.bodies.static_modes import static_bodies
from flexmb.engine.compile import Compiled
from flexmb.engine.compiled_calls import row_evaluator
from flexmb.engine.state import Work
from flexmb.engine.tables import BodyColumns, System
from flexmb.errors import AssemblyError, Problem
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray, skew
from flexmb.flexbody.natural_modes import Vibrations, mass_at_rest
from flexmb.model.markers import rotation_matrix

_NO_MASS = 1e-11  # eigenvalue of the mass matrix over the largest one that counts as zero
_NO_STIFFNESS = 1e-14  # square of a frequency over the largest one that counts as zero


class MechanismModes:
    """Motions of bodies that joints and drivers allow, and vibrations of flexible ones.

    Parameters
    ----------
    compiled, q : Compiled, (nq,) array
        The model and its pose.
    bodies : list of int
        Numbers of the bodies that may move; if these are all, scalar coordinates move as well.
    every_mass : bool
        Whether quasi-static modes have mass, as dynamic ones have.
    """

    def __init__(
        self, compiled: Compiled, q: Array, bodies: list[int], *, every_mass: bool = False
    ) -> None:
        layout, system = compiled.layout, compiled.system
        self._compiled, everything = compiled, len(bodies) == len(layout.bodies)
        state, work = new_state(system), new_work(system)
        state.q[:] = q
        row_evaluator(system, state, work)()
        scales = column_scales(compiled)
        places = np.concatenate([_columns(layout.bodies[k]) for k in bodies])
        if everything:
            places = np.arange(layout.nv)
            A = DenseJacobian(compiled).of(work)
        else:
            A = _rows_of_body(compiled, work, *bodies)
        order = np.full(layout.nv, -1)
        order[places] = np.arange(len(places))
        mass, self._scales, self._order = np.zeros((len(places),) * 2), scales[places], order
        modal = np.zeros(len(places), bool)
        for k in bodies:
            columns = layout.bodies[k]
            at = order[_columns(columns)]
            body = compiled.bodies.get(columns.name)
            block = _mass(system, k, body)
            if every_mass and body is not None and columns.m:
                block[6:, 6:] = body.M_eta
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

    def unit_motions(self) -> Array:
        """(n, k) motions of unit mass that the joints leave, in the coordinates of the bodies."""
        N = null_space(self._A, self._rows.S.max(initial=1.0))
        values, X = np.linalg.eigh(N.T @ self._mass @ N)
        massive = values > _NO_MASS * values.max(initial=0.0)
        return np.asarray(self._scales[:, None] * (N @ (X[:, massive] / np.sqrt(values[massive]))))

    def vibrations_with_reactions(self) -> tuple[Array, Array, Array]:
        """Of the whole scene, if all motions have mass: ω (k,) [rad/s], motions X (nv, k) of unit
        mass and the forces Cqᵀ λ (nv, k) that keep them."""
        K, nv = np.zeros_like(self._mass), len(self._scales)
        for columns in self._compiled.layout.bodies:
            own = slice(columns.iv + 6, columns.iv + 6 + columns.m)
            K[own, own] = self._compiled.flexbodies[columns.name].K if columns.m else 0.0
        U = self.unit_motions()
        squares, Q = np.linalg.eigh(U.T @ K @ U)
        stiff = squares > _NO_STIFFNESS * squares.max(initial=0.0)
        X, squares = U @ Q[:, stiff], squares[stiff]
        scales = np.divide(1.0, self._scales, out=np.zeros(nv), where=self._scales > 0.0)
        mass = self._mass * np.outer(scales, scales)
        return np.sqrt(squares), X, mass @ X * squares - K @ X

    @cached_property
    def flexible(self) -> list[int]:
        """Numbers of the flexible bodies that are not kinetostatic."""
        _, kinetostatic = static_bodies(self._compiled.system)
        bodies = enumerate(self._compiled.layout.bodies)
        return [k for k, one in bodies if one.m and k not in kinetostatic]

    @cached_property
    def together(self) -> Vibrations:
        """Vibrations of all flexible bodies together."""
        return self.vibrations(*self.flexible)

    def part_of_modes(self, k: int) -> tuple[Array, Array] | None:
        """Frequencies of all flexible bodies together [rad/s], and the part of body k in the modes.

        None if there is only one flexible body.
        """
        if len(self.flexible) < 2:
            return None
        sizes = [self._compiled.layout.bodies[one].m for one in self.flexible]
        n = self.flexible.index(k)
        at = sum(sizes[:n])
        return self.together.omega, self.together.eta[at : at + sizes[n]]

    def vibrations(self, *bodies: int, still: IntArray | None = None) -> Vibrations:
        """Vibrations of one or several bodies in the mechanism, with all other bodies rigid.

        `still` (k,) are indices in v of modes that are fixed.
        """
        several = [self._compiled.layout.bodies[k] for k in bodies]
        places = np.concatenate([_columns(one)[6:] for one in several])
        moving = ~np.isin(places, [] if still is None else still)
        modal = self._order[places[moving]]
        rows, A = self._rows, self._A[:, modal]
        # motions (x, y) with A_r x + A y = 0: y in the null space of redundant rows, x by the
        # others
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
    """(6 + m,) indices of the velocity coordinates of a body."""
    return columns.iv + np.arange(6 + columns.m)


def _rows_of_body(compiled: Compiled, work: Work, k: int) -> Array:
    """(n, 6 + m) weighted constraint rows of body k, in its own velocity coordinates."""
    system = compiled.system
    owner, rows, size = system.parts.markers["body"], system.rows, 6 + compiled.layout.bodies[k].m
    A = np.zeros((len(rows), size))
    for side in "IJ":
        on = np.flatnonzero((rows[f"jac_{side}"] >= 0) & (owner[rows[side]] == k))
        A[on] += work.dense.jac[rows[f"jac_{side}"][on, None] + np.arange(size)]
    touched = A.any(axis=1)
    return np.asarray(system.row_weights[touched, None] * A[touched])


def _mass(system: System, k: int, body: FlexBody | None) -> Array:
    """(6 + m, 6 + m) mass matrix of a body at rest, in body axes; zero for quasi-static modes."""
    row = system.parts.bodies[k]
    if body is not None and row["m"] > 0:
        at, m = int(row["flex"]) + 12 * body.m, body.m
        M_eta = system.parts.pool[at : at + m * m].reshape(m, m)
        return mass_at_rest(body.mass, body.S1, body.S0, body.p, body.P, M_eta)
    no = np.zeros
    return mass_at_rest(row["mass"], row["S1"], row["S0"], no((3, 0)), no((3, 3, 0)), no((0, 0)))


def mobilities(compiled: Compiled) -> tuple[Array, list[Array]]:
    """What impulses on bodies that are free can move, as a bound for those that are joined.

    Parameters
    ----------
    compiled : Compiled
        The compiled model.

    Returns
    -------
    largest : (2,) array
        Largest velocity [m/s] and angular velocity [rad/s] of any marker by a motion of its body
        with a kinetic energy of ½ J; infinite if a body has a motion without mass.
    roots : list of (6 + m, 6 + m) array
        L of each body, L Lᵀ its inverse mass matrix in body axes; NaN without mass.
    """
    system, largest, roots = compiled.system, np.zeros(2), list[Array]()
    parts, eye = system.parts, np.eye(3)
    for k, columns in enumerate(compiled.layout.bodies):
        M, m = _mass(system, k, compiled.bodies.get(columns.name)), columns.m
        values, Q = np.linalg.eigh(M)
        massive = values[0] > _NO_MASS * values[-1]
        roots.append(Q / np.sqrt(values) if massive else np.full_like(M, np.nan))
        for marker in parts.markers[parts.markers["body"] == k]:
            Phi_t, Phi_r, at = np.zeros((3, m)), np.zeros((3, m)), int(marker["modes"])
            if at >= 0:
                both = parts.pool[at : at + 6 * m].reshape(6, m)
                Phi_r, Phi_t = both[3:], both[:3] - skew(marker["arm"]) @ both[3:]
            arm = skew(marker["rho"] + marker["arm"])
            moved = np.hstack([eye, -arm, Phi_t]), np.hstack([0.0 * eye, eye, Phi_r])
            sizes = [float(np.linalg.norm(x @ roots[k], 2)) if massive else np.inf for x in moved]
            largest = np.maximum(largest, sizes)
    return largest, roots


def condensation(M: Array, K: Array) -> tuple[Array, Array, IntArray]:
    """Static condensation of motions without mass (Guyan).

    M (n, n) is symmetric, K (n, n) need not be. Returns T and L (n, k), with which the condensed
    matrices are Lᵀ M T and Lᵀ K T, and the indices (k,) of the coordinates that remain.
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
