"""Load factors of a mechanism: its loads over those that buckle it.

The load factor μ is the largest number for which K + K_g/μ is singular, with K_g the geometric
stiffness of the forces and moments at markers and of the inertia loads, for those motions of the
whole mechanism that deform it.

Moments are conjugate to rotation vectors (semitangential), to which the rows of joints that keep
axes perpendicular add their own curvature. A force in the axes of a marker turns with it, and a
torque is conjugate to the spin, which adds an unsymmetric stiffness. Only real μ count then: a
column under a force that follows its tip never buckles, but flutters (Beck, Z. angew. Math. Phys.
3, 1952), which is a motion that the equations describe.

Sources: Timoshenko & Gere, Theory of Elastic Stability, §2.2; Bolotin, Nonconservative Problems of
the Theory of Elastic Stability, 1963, ch. 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import ConstraintRows, numerical_rank
from flexmb.engine.algebra.forms import bend_of
from flexmb.engine.compile import Compiled
from flexmb.engine.joints import DOT1
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray, skew
from flexmb.flexbody.natural_modes import matrices_at_rest

# Strain energy of a body in the motion that buckles, over the largest, with which it buckles too:
# equal columns of a frame have the same.
_MIN_ENERGY = 0.5
_RIGID_SHARE = 1e-9  # ω² over the largest one, below which a motion deforms nothing
# Imaginary part of a load factor over its real part, up to which it counts: equal buckling loads
# of a round or square column become a conjugate pair by a small torque.
_REAL = 0.2


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads at n times of a run: q, v, vd; wrenches at markers (n, markers, 6) in global axes,
    their arms in body axes; the axes A (n, bodies, 3, 3) of all bodies and R of all markers;
    multipliers of the rows; those forces and torques (n, k, 3) that are not conservative."""

    q: Array
    v: Array
    vd: Array
    wrenches: Array
    s: Array
    A: Array
    R: Array
    lam: Array
    turning: Array


class LoadedMechanism:
    """Square root of the mass and stiffness (nv, nv) of all bodies, in body axes; constraints."""

    def __init__(self, compiled: Compiled, gravity: Array, turning: NDArray[np.void]) -> None:
        nv, self._compiled, self._gravity = compiled.layout.nv, compiled, gravity
        self._turning = turning
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
        self._add_axes_of_joints(loads, Kg)
        self._add_turning_loads(loads, Kg)
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
        loss = -V.transpose(0, 2, 1) @ Kg[rows] @ V
        if len(self._turning):
            every, shapes = np.linalg.eig(loss)
            real = np.abs(every.imag) <= _REAL * every.real
            every = np.where(real, every.real, 0.0)
            largest = every.argmax(axis=1)[:, None]
            factors = np.take_along_axis(every, largest, axis=1)
            shapes = np.take_along_axis(shapes.real, largest[:, None], axis=2)
        else:
            factors, shapes = np.linalg.eigh(0.5 * (loss + loss.transpose(0, 2, 1)))
        x = (V @ shapes[:, :, -1:])[..., 0]
        parts = [part for _, part, *_ in self._bodies]
        energy = np.array(
            [((x[:, own] @ self._K[own, own]) * x[:, own]).sum(axis=1) for own in parts]
        ).T
        buckles = energy >= _MIN_ENERGY * energy.max(axis=1, keepdims=True)
        values[rows] = np.where(buckles, factors[:, -1:], 0.0)

    def _geometric_stiffness(self, loads: Loads) -> Array:
        """(n, nv, nv) second variation of the work of all loads by rotations and eta, body axes.

        The loads are forces at markers and inertia forces ρ (a + G s), all of constant direction,
        and semitangential moments at markers.
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
            forces, turns = loads.wrenches[:, markers, :3] @ A, loads.wrenches[:, markers, 3:] @ A
            Kb = K[:, iv + 3 : part.stop, iv + 3 : part.stop]
            moments = G @ entry["S0"] + a[:, :, None] * entry["S1"]
            moments = moments - forces.transpose(0, 2, 1) @ loads.s[:, markers]
            for k, marker in enumerate(parts.markers[markers]):
                if m and marker["modes"] >= 0:
                    f, turn, arm = forces[:, k], turns[:, k], marker["arm"]
                    Phi = self._modes(markers[k])
                    carried = np.cross(Phi[:3].T, f[:, None])
                    carried += 0.5 * np.cross(Phi[3:].T, turn[:, None])
                    Kb[:, :3, 3:] -= carried.transpose(0, 2, 1)
                    both = -0.5 * (arm[:, None] * f[:, None] + f[:, :, None] * arm)
                    both += (f @ arm)[:, None, None] * np.eye(3)
                    Kb[:, 3:, 3:] += Phi[3:].T @ both @ Phi[3:]
                    if marker["bend"] >= 0:
                        bend = bend_of(marker, m, parts.pool)
                        w = np.concatenate([f, turn + np.cross(arm, f)], axis=1)
                        Kb[:, 3:, 3:] += np.einsum("nd,idj->nij", w[:, : bend.shape[1]], bend)
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

    def _add_axes_of_joints(self, loads: Loads, K: Array) -> None:
        """Add to K (n, nv, nv) the curvature of the rows a·b of axes of two markers.

        With rotations α and β of the markers, its part of second order beside that of these
        rotations is (α·a)(α·b)/2 + (β·a)(β·b)/2 - (β·a)(α·b) where a·b = 0.
        """
        rows, markers = self._compiled.system.rows, self._compiled.system.parts.markers
        for k in np.flatnonzero((rows["kind"] == DOT1) & (loads.lam != 0.0).any(axis=0)):
            ends = [int(rows[k][side]) for side in "IJ"]
            a, b = (loads.R[:, at, :, rows[k][axis]] for at, axis in zip(ends, "ab", strict=True))
            bodies = [int(markers["body"][at]) for at in ends]
            H = [
                loads.A[:, body] @ self._rotation(at) if body >= 0 else None
                for body, at in zip(bodies, ends, strict=True)
            ]
            both = loads.lam[:, k, None, None] * a[:, :, None] * b[:, None]
            for i, j in ((0, 0), (1, 1), (0, 1), (1, 0)):
                first, second = H[i], H[j]
                if first is None or second is None:
                    continue
                part = 0.5 * (both + both.transpose(0, 2, 1)) if i == j else -both
                part = part.transpose(0, 2, 1) if (i, j) == (0, 1) else part
                own, other = self._bodies[bodies[i]][1], self._bodies[bodies[j]][1]
                K[:, own, other] += first.transpose(0, 2, 1) @ part @ second

    def _add_turning_loads(self, loads: Loads, K: Array) -> None:
        """Add to K (n, nv, nv) the stiffness of forces that turn with a marker, and of torques.

        A rotation δθ of the marker changes a force F by δθ × F: at a marker with the motion J v and
        the rotation H v, body axes, that is Jᵀ F̃ B H, B from the axes of the one body to the other.
        A torque does so too; and it does work on the spin δθ + θ × δθ/2 of its marker.
        """
        markers = self._compiled.system.parts.markers
        for k, load in enumerate(self._turning):
            turned, H = int(markers["body"][load["axes"]]), self._rotation(load["axes"])
            for at, sign in ((load["marker"], 1.0), (load["other"], -1.0)):
                number = int(markers["body"][at])
                if at < 0 or number < 0:
                    continue
                back = loads.A[:, number].transpose(0, 2, 1)
                F = sign * np.einsum("nij,nj->ni", back, loads.turning[:, k])
                rows = self._bodies[number][1]
                J = np.zeros((len(F), 3, rows.stop - rows.start))
                if load["torque"]:
                    J[:] = self._rotation(at)
                    K[:, rows, rows] -= 0.5 * J.transpose(0, 2, 1) @ skew(F) @ J
                else:
                    J[:, :, :3], J[:, :, 3:6] = np.eye(3), -skew(loads.s[:, at])
                    J[:, :, 6:] = self._modes(at)[:3]
                if load["axes"] >= 0 and turned >= 0:
                    columns = self._bodies[turned][1]
                    change = skew(F) @ back @ loads.A[:, turned] @ H
                    K[:, rows, columns] += J.transpose(0, 2, 1) @ change

    def _rotation(self, marker: int) -> Array:
        """(3, 6 + m) rotation of a marker per velocity of its body, undeformed, body axes."""
        modes = self._modes(marker)[3:]
        return np.hstack([np.zeros((3, 3)), np.eye(3), modes])

    def _modes(self, marker: int) -> Array:
        """(6, m) motion of a marker by the modes of its body, undeformed, body axes."""
        parts = self._compiled.system.parts
        one = parts.markers[marker]
        m = int(parts.bodies[one["body"]]["m"])
        if not m or one["modes"] < 0:
            return np.zeros((6, m))
        Phi = parts.pool[one["modes"] : one["modes"] + 6 * m].reshape(6, m)
        return np.vstack([Phi[:3] - skew(one["arm"]) @ Phi[3:], Phi[3:]])


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
