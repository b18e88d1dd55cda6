"""Load factors of a mechanism: its loads over those that buckle it.

The load factor μ is the largest number for which K + K_g/μ is singular, with K_g the geometric
stiffness of the forces and moments at markers and of the inertia loads, for those motions of the
whole mechanism that deform it. Fields that the modes leave out deform it too, as far as its bodies
tell (:class:`flexmb.flexbody.OmittedStiffening`). Without them natural frequencies under the loads
are too high: those that are left out follow the modes statically, with their mass (Guyan, AIAA J.
3 (1965) 380).

Moments are conjugate to rotation vectors (semitangential), and forces have constant directions. To
these the rows of joints add their own curvature: axes, lines and planes turn with bodies. A force
in the axes of a marker turns with it, and a torque is conjugate to the spin, which adds an
unsymmetric stiffness. Only real μ count then: a column under a force that follows its tip never
buckles, but flutters (Beck, Z. angew. Math. Phys. 3, 1952), which is a motion that the equations
describe.

Sources: Timoshenko & Gere, Theory of Elastic Stability, §2.2; Bolotin, Nonconservative Problems of
the Theory of Elastic Stability, 1963, ch. 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import ConstraintRows, numerical_rank, row_tangent
from flexmb.analysis.validity.pose_vibrations import frequency_changes
from flexmb.engine.algebra.forms import bend_of
from flexmb.engine.compile import Compiled
from flexmb.engine.joints import DOT1, ROW_KINDS
from flexmb.flexbody import FlexBody
from flexmb.flexbody.arrays import Array, IntArray, skew
from flexmb.flexbody.natural_modes import mass_by_axes, matrices_at_rest, mean_motion
from flexmb.flexbody.parts import Interface
from flexmb.flexbody.static_response import SYMMETRIC_PAIRS, OmittedStiffening

# Strain energy of a body in the motion that buckles, over the largest, with which it buckles too:
# equal columns of a frame have the same.
_MIN_ENERGY = 0.5
_RIGID_SHARE = 1e-9  # ω² over the largest one, below which a motion deforms nothing
# Imaginary part of a load factor over its real part, up to which it counts: equal buckling loads
# of a round or square column become a conjugate pair by a small torque.
_REAL = 0.2
# Load factor without fields that are left out over that with them, below which those are not
# counted beside loads that turn: where nothing buckles, eigenvalues are of any small size.
_SAME_FACTOR = 0.5


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads at n times of a run: q, v, vd; wrenches at markers (n, markers, 6) in global axes,
    their arms in body axes; the axes A (n, bodies, 3, 3) of all bodies; places and axes of markers;
    multipliers of the rows; those forces and torques (n, k, 3) that are not conservative."""

    q: Array
    v: Array
    vd: Array
    wrenches: Array
    s: Array
    A: Array
    x: Array
    R: Array
    lam: Array
    turning: Array


class LoadedMechanism:
    """Square root of the mass and stiffness (nv, nv) of all bodies, in body axes; constraints."""

    def __init__(self, compiled: Compiled, gravity: Array, turning: NDArray[np.void]) -> None:
        nv, self._compiled, self._gravity = compiled.layout.nv, compiled, gravity
        self._turning, self._omitted, first = turning, list[_OmittedFields](), nv
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
                mean = mean_motion(body)
            self._root[part, part] = _square_root(M)
            number = len(self._bodies)
            self._bodies.append((entry, part, body, mean))
            if body is not None and body.omitted_stiffening is not None:
                self._omitted.append(_OmittedFields.of_body(compiled, number, body, first))
                first = self._omitted[-1].rows.stop
        self._size = first
        self._owners = np.array([one.body for one in self._omitted], np.int64)
        self._starts = [one.rows.start - nv for one in self._omitted]
        fields = {one.body: one.rows for one in self._omitted}
        self._masses = [
            (part, fields.get(number, slice(0)), mass_by_axes(body, with_fields=number in fields))
            for number, (_, part, body, _) in enumerate(self._bodies if fields else ())
            if body is not None
        ]

    def load_factors(self, loads: Loads) -> tuple[Array, Array, Array]:
        """Load factors, and what fields that are left out do to natural frequencies under loads.

        Returns
        -------
        values : (n, bodies) array
            The load factors of the mechanism, each assigned to the bodies that buckle.
        omega : (n,) array
            The frequency that is most too high for want of modes [rad/s].
        shares : (n, bodies) array
            The part of it that would be lost with them, by the body that lacks most.
        """
        n, Kg = len(loads.q), self._geometric_stiffness(loads)
        self._add_curved_rows(loads, Kg)
        self._add_turning_loads(loads, Kg)
        poses = [self._rows.evaluate(q).jacobian for q in loads.q]
        _, S, Vt = np.linalg.svd(np.array([pose.A for pose in poses]))
        ranks = np.array([numerical_rank(one) for one in S])
        values, omega = np.zeros((n, len(self._bodies))), np.zeros(n)
        shares = np.zeros_like(values)
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
                loss, motions = self._loss(Kg[rows[some]], V)
                self._buckle(loss, motions, rows[some], values)
                if self._omitted:
                    mass, softening = self._inertia(loads, rows[some], motions)
                    of = np.sqrt(omega2[some, count:])
                    change = frequency_changes(loss + softening, mass, of)
                    omega[rows[some]], lost, moved = change
                    sizes = np.add.reduceat(moved**2, self._starts, axis=1)
                    shares[rows[some], self._owners[sizes.argmax(axis=1)]] = lost
        return values, omega, shares

    def _inertia(self, loads: Loads, rows: IntArray, motions: Array) -> tuple[Array, Array]:
        """Mass of flexible bodies in motions (n, nv + r, k + r), and stiffness that centrifugal
        loads take as they grow: (n, k + r, k + r) each."""
        taken = np.zeros((len(rows), *2 * motions.shape[2:]))
        mass = np.zeros_like(taken)
        for part, rest, by_axes in self._masses:
            w = loads.v[rows, part.start + 3 : part.start + 6]
            G = (w * w).sum(axis=1)[:, None, None] * np.eye(3) - w[:, :, None] * w[:, None]
            own = np.concatenate([motions[:, part], motions[:, rest]], axis=1)
            back = own.transpose(0, 2, 1)
            mass += back @ np.einsum("aaij->ij", by_axes) @ own
            taken += back @ np.tensordot(G, by_axes, 2) @ own
        return mass, taken

    def _loss(self, Kg: Array, V: Array) -> tuple[Array, Array]:
        """Stiffness that loads take from motions V (rows, nv, k) of unit strain energy, and from
        fields that modes leave out; these motions (rows, nv + r, k + r)."""
        n, nv, k = V.shape
        rest = self._size - nv
        motions = np.zeros((n, self._size, k + rest))
        motions[:, :nv, :k], motions[:, nv:, k:] = V, np.eye(rest)
        return -motions.transpose(0, 2, 1) @ Kg @ motions, motions

    def _buckle(self, loss: Array, V: Array, rows: IntArray, values: Array) -> None:
        """Set the load factors of `rows` by motions V (rows, nv + r, k + r) of unit strain energy,
        and the stiffness that they lose."""
        if len(self._turning):
            factors, shape = _largest_real(loss)
            k = loss.shape[1] - (self._size - len(self._K))
            alone, own = _largest_real(loss[:, :k, :k])
            apart = alone < _SAME_FACTOR * factors
            factors = np.where(apart, alone, factors)
            shape[apart[:, 0], :k], shape[apart[:, 0], k:] = own[apart[:, 0]], 0.0
        else:
            factors, shapes = np.linalg.eigh(0.5 * (loss + loss.transpose(0, 2, 1)))
            shape = shapes[:, :, -1]
        x = (V @ shape[..., None])[..., 0]
        parts = [part for _, part, *_ in self._bodies]
        energy = np.array(
            [((x[:, own] @ self._K[own, own]) * x[:, own]).sum(axis=1) for own in parts]
        ).T
        for one in self._omitted:
            energy[:, one.body] += (x[:, one.rows] ** 2).sum(axis=1)
        buckles = energy >= _MIN_ENERGY * energy.max(axis=1, keepdims=True)
        values[rows] = np.where(buckles, factors[:, -1:], 0.0)

    def _geometric_stiffness(self, loads: Loads) -> Array:
        """(n, nv, nv) second variation of the work of all loads by rotations and eta, body axes.

        The loads are forces at markers and inertia forces ρ (a + G s), all of constant direction,
        and semitangential moments at markers.
        """
        K = np.zeros((len(loads.q), self._size, self._size))
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
            arms = np.cross(parts.markers["arm"][markers], forces)
            about_nodes = np.concatenate([forces, turns + arms], axis=2)
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
                        w = about_nodes[:, k]
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
                for one in self._omitted:
                    if one.body == number:
                        one.add_to(K, part, mean[3:], G, about_nodes)
            Kb[:, 3:, :3] = Kb[:, :3, 3:].transpose(0, 2, 1)
        return K

    def _add_curved_rows(self, loads: Loads, K: Array) -> None:
        """Add to K (n, nv, nv) the curvature of loaded rows of joints, whose direction turns.

        It is that in the positions and rotation vectors of their markers: the symmetric part of the
        tangent, which is that in spins.
        """
        rows, markers = self._compiled.system.rows, self._compiled.system.parts.markers
        curved = np.array([kind.tangent is not None for kind in ROW_KINDS])[rows["kind"]]
        for k in np.flatnonzero(curved & (loads.lam != 0.0).any(axis=0)):
            row = rows[k]
            kind, ends = (int(row["kind"]), int(row["a"]), int(row["b"])), (row["I"], row["J"])
            if kind[0] == DOT1:  # all at once, since they are most
                H = np.zeros((len(loads.q), 12, 12))
                a, b = (loads.R[:, at, :, c] for at, c in zip(ends, kind[1:], strict=True))
                both = loads.lam[:, k, None, None] * a[:, :, None] * b[:, None]
                H[:, 3:6, 3:6] = H[:, 9:, 9:] = both
                H[:, 9:, 3:6], H[:, 3:6, 9:] = -both, -both.transpose(0, 2, 1)
            else:
                H = np.array([
                    row_tangent(kind, lam[k], *(y for at in ends for y in (x[at], R[at])))
                    for lam, x, R in zip(loads.lam, loads.x, loads.R, strict=True)
                ])  # fmt: skip
            H = 0.5 * (H + H.transpose(0, 2, 1))
            moved = [
                (6 * i, self._bodies[markers["body"][at]][1], self._motion(loads, at))
                for i, at in enumerate(ends)
                if markers["body"][at] >= 0
            ]
            for i, own, first in moved:
                for j, other, second in moved:
                    block = H[:, i : i + 6, j : j + 6]
                    K[:, own, other] += first.transpose(0, 2, 1) @ block @ second

    def _motion(self, loads: Loads, at: int) -> Array:
        """(n, 6, 6 + m) motion and rotation of a marker, global axes, per velocity of its body."""
        number = int(self._compiled.system.parts.markers["body"][at])
        A, modes = loads.A[:, number], self._modes(at)
        J = np.zeros((len(A), 6, 6 + modes.shape[1]))
        J[:, :3, :3] = J[:, 3:, 3:6] = np.eye(3)
        J[:, :3, 3:6], J[:, :, 6:] = -skew(loads.s[:, at]), modes
        return np.concatenate([A @ J[:, :3], A @ J[:, 3:]], axis=1)

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


@dataclass(frozen=True, eq=False)
class _OmittedFields:
    """Fields of unit strain energy that the modes of a body leave out: further coordinates.

    `rows` are theirs. `loads` has numbers of markers among those of the body, and the sizes (l, 6)
    of the loads of the fields by units of the wrench about their nodes.
    """

    body: int
    of: OmittedStiffening
    rows: slice
    loads: list[tuple[int, Array]]

    @classmethod
    def of_body(cls, compiled: Compiled, number: int, body: FlexBody, first: int) -> _OmittedFields:
        """With the number of the body, and that of the first coordinate."""
        of, parts, m = body.omitted_stiffening, compiled.system.parts, body.m
        assert of is not None
        points, one = list[tuple[Interface, Array]](), np.eye(len(of.own))
        own = 6 + 6 * len(body.interfaces)
        for k, end in enumerate(body.interfaces):
            points.append((end, one[:, 6 + 6 * k : 12 + 6 * k]))
        for k, load in enumerate(body.loads):
            forces = [point for point in load.points if point.wrench[:3].any()]
            for at in forces[:1]:  # it has the bend of the load (`bent_points`)
                axis = int(np.abs(at.wrench).argmax())
                points.append((at, np.outer(one[own + k], np.eye(6)[axis] / at.wrench[axis])))
        own += len(body.loads)
        for k, node in enumerate([] if body.nodes is None else body.nodes.points_with_bend()):
            points.append((node, one[:, own + 6 * k : own + 6 * k + 6]))
        loads = []
        for k, marker in enumerate(parts.markers[parts.markers["body"] == number]):
            if marker["modes"] < 0 or marker["bend"] < 0:
                continue
            Phi = parts.pool[marker["modes"] : marker["modes"] + 6 * m].reshape(6, m)
            bend, nearest, least = bend_of(marker, m, parts.pool), None, np.inf
            for point, sizes in points:
                same = np.array_equal(point.position, marker["rho"])
                if same and np.array_equal(np.vstack([point.Phi_t, point.Phi_r]), Phi):
                    assert point.bend is not None
                    forms = point.bend[: bend.shape[1]].transpose(1, 0, 2)
                    away = float(np.abs(forms - bend).max(initial=0.0))
                    if away < least:
                        nearest, least = sizes, away
            if nearest is not None:
                loads.append((k, nearest))
        return cls(number, of, slice(first, first + of.own.shape[1]), loads)

    def add_to(self, K: Array, part: slice, turn: Array, G: Array, wrenches: Array) -> None:
        """Add to K (n, c, c) what the loads of the body do, with its coordinates `part`.

        `turn` (3, m) is the mean rotation by modes, G (n, 3, 3) the acceleration per place, and
        `wrenches` (n, markers, 6) are those about nodes, all in body axes.
        """
        c = np.zeros((len(G), len(self.of.own)))
        for k, (a, b) in enumerate(SYMMETRIC_PAIRS):
            c[:, k] = -0.5 * (2 - (a == b)) * (G[:, a, b] + G[:, b, a])
        for k, sizes in self.loads:
            c += wrenches[:, k] @ sizes.T
        turns, modes = (np.tensordot(c, x, 1) for x in (self.of.turns, self.of.modes))
        beside = np.concatenate([turns, modes + turns @ turn], axis=2)
        both = slice(part.start + 3, part.stop)
        K[:, self.rows, both] += beside
        K[:, both, self.rows] += beside.transpose(0, 2, 1)
        K[:, self.rows, self.rows] += np.tensordot(c, self.of.own, 1)


def _largest_real(loss: Array) -> tuple[Array, Array]:
    """The largest real eigenvalue (n, 1) of matrices (n, k, k), zero if none, and its vector."""
    every, shapes = np.linalg.eig(loss)
    every = np.where(np.abs(every.imag) <= _REAL * every.real, every.real, 0.0)
    largest = every.argmax(axis=1)[:, None]
    vector = np.take_along_axis(shapes.real, largest[:, None], axis=2)[..., 0]
    return np.take_along_axis(every, largest, axis=1), vector


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


def _rigid_mass(entry: np.void) -> Array:
    """(6, 6) mass of a rigid body about its origin, body axes."""
    arm = skew(entry["S1"])
    J = np.trace(entry["S0"]) * np.eye(3) - entry["S0"]
    return np.block([[entry["mass"] * np.eye(3), -arm], [arm, J]])
