"""Accelerations of a flexible body, which load it by its inertia.

A point s of a body is at r + A (s + Φ η). In body axes its acceleration is

    a + α × s + ω × (ω × s) + Φ η̈ + 2 ω × Φ η̇ + α × Φ η + ω × (ω × Φ η)

(Shabana, Dynamics of Multibody Systems, ch. 5). The last three terms are as large as the others
where a body turns as fast as it vibrates: those of a shaft that whirls slowly, seen in its axes,
nearly cancel. They are counted as the accelerations a, α and η̈ that are nearest in the norm of
the mass of the body.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexmb.analysis.assembly.mechanism_modes import MechanismModes
from flexmb.analysis.linear.observer import body_axes
from flexmb.analysis.linear.state_equations import StateEquations, sensor_amplitudes
from flexmb.analysis.validity.linear_elasticity import JoinedFrame, in_body_axes
from flexmb.engine.allocation import new_state
from flexmb.engine.compile import Compiled
from flexmb.engine.tables import BodyColumns, Layout
from flexmb.flexbody import FlexBody, InertiaResponse
from flexmb.flexbody.arrays import Array, skew
from flexmb.results.output_block import OutputBlock
from flexmb.units import UnitSystem

Complex = NDArray[np.complex128]

_ARMS = np.cross(np.eye(3)[:, None], np.eye(3))  # [i, c, a]: (e_i × s)_a = Σ_c [i, c, a] s_c
OMITTED_DAMPING = 0.01  # damping ratio of modes that are left out, which forget the start of a run
MAX_PHASE_STEP = 1.0  # phase of a mode between two rows [rad] up to which rows show its excitation
_MAX_EXPONENT = 50.0  # largest exponent of e within one sum
_LAST_TERM = 1e-12  # of the series of a rotation
_MEMORY = 3.0  # rate at which a mean of tensions forgets, over the first frequency of a pinned bar
_NO_MASS = 1e-13  # of a motion, over those of unit mass, that is round-off


class BodyAccelerations:
    """Accelerations of the material of a body and of the frame of its joints, along a run.

    Motions of the body are its n = 6 + m velocity coordinates: translation and rotation of its
    frame in body axes, and modes.

    Parameters
    ----------
    columns : BodyColumns
        The columns of the body in rows of a run.
    body : FlexBody
        The body.
    gravity : (3,) array
        Acceleration of gravity, global [m/s²].

    Attributes
    ----------
    mass, inverse : (n, n) array
        Mass matrix at rest, and its inverse: zero for motions without mass.
    """

    def __init__(self, columns: BodyColumns, body: FlexBody, gravity: Array) -> None:
        self.columns, self.body, self._gravity = columns, body, gravity
        products = _products_of_motions(body)
        self.mass = np.einsum("aaij->ij", products)
        self.inverse = inverse = _inverse(self.mass)
        # [a, b]: motions nearest to axis a of what moves along axis b
        self._nearest = inverse @ products
        self._places = _products_with_places(body) @ inverse  # motions nearest to axis a by s_b
        self._turns = np.einsum("cab,abij->cij", _cross_product(np.eye(3)), self._nearest)

    def of_material(self, rows: OutputBlock) -> Array:
        """(t, 12 + m): the numbers of `InertiaResponse` in body axes, and those of the modes."""
        eta, rates, further = self._deformation(rows)
        a, alpha, omega = self._of_frame(rows)
        center, more = self.body.center, np.zeros((len(eta), len(self.mass)))
        modes = self._nearest[..., 6:]
        for W, x in ((_turning(alpha, omega), eta), (2.0 * _cross_product(omega), rates)):
            more += np.einsum("tab,tabi->ti", W, np.tensordot(x, modes, (1, 3)))
        a, alpha = a + more[:, :3], alpha + more[:, 3:6]
        a = a + np.cross(alpha, center) + np.cross(omega, np.cross(omega, center))
        return np.hstack([InertiaResponse.factors(a, alpha, omega), further + more[:, 6:]])

    def of_joints(self, rows: OutputBlock, frame: JoinedFrame) -> tuple[Array, Array]:
        """(t, 12) numbers of `InertiaResponse` in the axes of a frame, and its ω (t, 3) there."""
        eta, rates, further = self._deformation(rows)
        a, alpha, omega = self._of_frame(rows)
        at, turn = frame.at(self.body.center[None])[0], frame.turn
        place = self.body.center + eta @ at.T
        a = a + np.einsum("tab,tb->ta", _turning(alpha, omega), place)
        a = a + 2.0 * np.cross(omega, rates @ at.T) + further @ at.T
        alpha = alpha + np.cross(omega, rates @ turn.T) + further @ turn.T
        omega = omega + rates @ turn.T
        a, alpha, omega = (x - np.cross(eta @ turn.T, x) for x in (a, alpha, omega))
        return InertiaResponse.factors(a, alpha, omega), omega

    def omega(self, rows: OutputBlock) -> Array:
        """(t, 3) angular velocity of the body frame, in body axes."""
        return self._of_frame(rows)[2]

    def of_motions(self, motions: Complex, rates: Complex, omega: Array) -> tuple[Complex, Complex]:
        """Velocities and accelerations in space of small motions about a steady rotation.

        Parameters
        ----------
        motions, rates : (n, k), (k,) complex arrays
            Motions x ∝ exp(rate t).
        omega : (3,) array
            Angular velocity of the body frame, in body axes.

        Returns
        -------
        tuple of (n, k) arrays
            Changes in body axes, which turn with x: those of the rotation itself turn with them.
        """
        W, turn = _cross_product(omega[None])[0], np.tensordot(omega, self._turns, 1)
        v = motions * rates + turn @ motions
        a = v * rates + turn @ v
        of_axes = (
            np.einsum("cad,db,abi->ic", _cross_product(np.eye(3)), one, self._places)
            for one in (W, W @ W)
        )
        v, a = (x - part @ motions[3:6] for x, part in zip((v, a), of_axes, strict=True))
        return v, a

    def in_turned_axes(self, forces: Array, angle: Array) -> Array:
        """Forces (t, n) on the motions of the body, in axes that turn by angle (t, 3) [rad]."""
        term, whole, k = forces, forces, 0
        most = float(np.linalg.norm(angle, axis=1).max(initial=0.0))
        size = 1.0
        while size > _LAST_TERM and most > 0.0:
            k, size = k + 1, size * most / (k + 1)
            term = np.einsum("tc,tci->ti", angle, np.tensordot(term, self._turns, (1, 1))) / k
            whole = whole + term
        return whole

    def _deformation(self, rows: OutputBlock) -> tuple[Array, Array, Array]:
        """(t, m) modal coordinates, their rates and accelerations."""
        q, m = self.columns.iq + 7, self.columns.m
        modes = slice(self.columns.iv + 6, self.columns.iv + 6 + m)
        return rows.q[:, q : q + m], rows.v[:, modes], rows.vd[:, modes]

    def _of_frame(self, rows: OutputBlock) -> tuple[Array, Array, Array]:
        """(t, 3) acceleration of the origin less gravity, α and ω of the body frame, body axes."""
        iq, iv = self.columns.iq, self.columns.iv
        a = in_body_axes(rows.q[:, iq + 3 : iq + 7], rows.vd[:, iv : iv + 3] - self._gravity)
        return a, rows.vd[:, iv + 3 : iv + 6], rows.v[:, iv + 3 : iv + 6]


def in_axes_of_bodies(layout: Layout, rows: OutputBlock, v: Array) -> Array:
    """(t, nv) velocities or accelerations, translations of bodies in their axes as well."""
    v = v.copy()
    for one in layout.bodies:
        p = rows.q[:, one.iq + 3 : one.iq + 7]
        v[:, one.iv : one.iv + 3] = in_body_axes(p, v[:, one.iv : one.iv + 3])
    return v


def displacements_in_axes_of_bodies(layout: Layout, q: Array, change: Array) -> Array:
    """(t, nv) displacements by small changes of positions q (t, nq), in the axes of bodies."""
    n = len(layout.coordinates)  # scalar ones, behind those of bodies
    x = np.zeros((len(q), layout.nv))
    x[:, layout.nv - n :] = change[:, layout.nq - n :]
    for one in layout.bodies:
        p, dp = q[:, one.iq + 3 : one.iq + 7], change[:, one.iq + 3 : one.iq + 7]
        x[:, one.iv : one.iv + 3] = in_body_axes(p, change[:, one.iq : one.iq + 3])
        turn = p[:, :1] * dp[:, 1:] - dp[:, :1] * p[:, 1:] - np.cross(p[:, 1:], dp[:, 1:])
        x[:, one.iv + 3 : one.iv + 6] = 2.0 * turn
        modes = slice(one.iv + 6, one.iv + 6 + one.m)
        x[:, modes] = change[:, one.iq + 7 : one.iq + 7 + one.m]
    return x


def _products_of_motions(body: FlexBody) -> Array:
    """(3, 3, n, n) [a, b, i, j] = ∫ρ χ_ai χ_bj, with χ_i the field of motion i."""
    m = body.m
    X = np.zeros((3, 3, 6 + m, 6 + m))
    X[:, :, :3, :3] = body.mass * np.einsum("ai,bj->abij", np.eye(3), np.eye(3))
    X[:, :, :3, 3:6] = np.einsum("ai,jcb,c->abij", np.eye(3), _ARMS, body.S1)
    X[:, :, :3, 6:] = np.einsum("ai,bj->abij", np.eye(3), body.p)
    X[:, :, 3:6, 3:6] = np.einsum("ica,jdb,cd->abij", _ARMS, _ARMS, body.S0)
    X[:, :, 3:6, 6:] = np.einsum("ica,cbj->abij", _ARMS, body.P)
    X[:, :, 6:, 6:] = body.Mab
    for i, j in (
        (slice(3), slice(3, 6)),
        (slice(3), slice(6, None)),
        (slice(3, 6), slice(6, None)),
    ):
        X[:, :, j, i] = X[:, :, i, j].transpose(1, 0, 3, 2)
    return X


def _products_with_places(body: FlexBody) -> Array:
    """(3, 3, n) [a, b, i] = ∫ρ χ_ai s_b."""
    rotations = np.einsum("ica,cb->abi", _ARMS, body.S0)
    translations = np.einsum("ai,b->abi", np.eye(3), body.S1)
    return np.concatenate([translations, rotations, body.P.swapaxes(0, 1)], axis=2)


def _inverse(mass: Array) -> Array:
    """(n, n) inverse of a mass matrix; zero for motions without mass: a line turns about itself."""
    sizes = np.sqrt(mass.diagonal())
    scale = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    scale = np.outer(scale, scale)
    return np.asarray(scale * np.linalg.pinv(scale * mass, rcond=_NO_MASS, hermitian=True))


def _turning(alpha: Array, omega: Array) -> Array:
    """(t, 3, 3) W with W x = α × x + ω × (ω × x)."""
    square = _cross_product(omega)
    return np.asarray(_cross_product(alpha) + square @ square)


def _cross_product(vectors: Array) -> Array:
    """(t, 3, 3) matrices of the cross product with vectors (t, 3)."""
    return np.asarray(np.cross(vectors[:, None], -np.eye(3)))


@dataclass(frozen=True, eq=False)
class LackingBody:
    """A flexible body, with what it lacks under its accelerations.

    These are 12 + m numbers: those of `InertiaResponse`, and of the modal coordinates. Those of its
    velocity coordinates, in body axes, are C (12 + m, 6 + m) times their rates.
    """

    columns: BodyColumns
    body: FlexBody
    accelerations: BodyAccelerations
    omega: Array  # (o,) of the modes that are left out, rad/s
    force: Array  # (o, 12 + m) on them
    rest: Array  # (12 + m, 12 + m) missing energy besides these
    C: Array

    @classmethod
    def of(cls, columns: BodyColumns, body: FlexBody, gravity: Array) -> LackingBody | None:
        """Of a flexible body; None if its file does not tell."""
        omitted, m = body.omitted_modes, columns.m
        if omitted is None:
            return None
        C = np.zeros((12 + m, 6 + m))
        C[:3, :3], C[3:6, 3:6], C[12:, 6:] = np.eye(3), np.eye(3), np.eye(m)
        C[:3, 3:6] = -skew(body.center)
        rest = np.zeros((12 + m,) * 2) if omitted.rest is None else omitted.rest
        force = np.hstack([omitted.inertia, omitted.modes])
        accelerations = BodyAccelerations(columns, body, gravity)
        return cls(columns, body, accelerations, 2.0 * np.pi * omitted.frequency, force, rest, C)

    def load_forces(self, loads: Array) -> Array:
        """(t, o) forces on the modes that are left out by loads at nodes (t, 6 r)."""
        by = self.body.omitted_modes.loads if self.body.omitted_modes else np.zeros((0, 0))
        return loads @ by.T if by.shape[1] == loads.shape[1] else np.zeros((len(loads), len(by)))

    @cached_property
    def tightening(self) -> tuple[Array, float]:
        """(m,) c per unit of eta, zero without geometric stiffening, and the first frequency ω₁ of
        a pinned bar [rad/s].

        The tension N of a bar raises the squares ω² of its frequencies by N k²/μ = c ω, with
        c = N/√(EI μ): its waves have k⁴ = ω² μ/EI. Elongation and bending are those between the two
        interfaces that are farthest apart, EI is that of the stiffer plane. Waves along it do not
        stiffen it: means over a run count.
        """
        body, none = self.body, (np.zeros(self.body.m), 1.0)
        ends = max(
            combinations(body.interfaces, 2), default=None,
            key=lambda pair: float(np.linalg.norm(pair[1].position - pair[0].position)),
        )  # fmt: skip
        if body.centrifugal_stiffness is None or ends is None:
            return none
        begin, end = ends
        arm = end.position - begin.position
        length = float(np.linalg.norm(arm))
        moved = end.Phi_t - begin.Phi_t + skew(arm) @ begin.Phi_r
        compliance = moved @ np.linalg.solve(body.K, moved.T)
        along, across = arm / max(length, 1e-300), np.linalg.svd(arm[None])[2][1:]
        lateral = np.linalg.eigvalsh(across @ compliance @ across.T)[0]
        if length == 0.0 or min(lateral, along @ compliance @ along) <= 0.0:
            return none
        density, bending = body.mass / length, length**3 / (3.0 * lateral)
        tension = along @ moved / (along @ compliance @ along)
        first = np.pi**2 * np.sqrt(bending / density) / length**2
        return tension / np.sqrt(bending * density), float(first)

    def tension(self, rows: OutputBlock) -> Array:
        """(t,) c of `tightening` [rad/s]."""
        first = self.columns.iq + 7
        eta = rows.q[:, first : first + self.columns.m]
        return np.asarray((eta @ self.tightening[0]).clip(0.0))

    def mean_tension(self, rows: OutputBlock, state: Array) -> Array:
        """(t,) mean c up to each row, over the slowest vibration of a pinned bar.

        `state` (3,) is the time of the row before, NaN if there is none, and the sums of c and of
        its weights up to it; it is updated.
        """
        now, first = self.tension(rows), self.tightening[1]
        last, total, weights = state if np.isfinite(state[0]) else (rows.t[0], 0.0, 0.0)
        means = np.empty_like(now)
        for k, h in enumerate(np.diff(np.append(last, rows.t))):
            left = np.exp(-_MEMORY * first * h)
            total, weights = left * total + now[k], left * weights + 1.0
            means[k] = total / weights
        state[:] = rows.t[-1], total, weights
        return means

    def omega_squares(self, tension: Array) -> Array:
        """(t, o) squares of the frequencies of modes that are left out, with tension c (t,)."""
        return np.asarray(self.omega**2 + tension[:, None] * self.omega)

    @property
    def name(self) -> str:
        """Its name."""
        return self.columns.name

    def beyond(self, path: str, hertz: float, units: UnitSystem) -> str:
        """The sentence on a drive above the frequencies of the modes that are left out, or ""."""
        last = self.omega.max(initial=0.0) / (2.0 * np.pi)
        if hertz <= last:
            return ""
        return (
            f"bodies.{self.name}: {path} oscillates with {units.say(hertz, 'Hz', 4)}; what modes "
            f"that were left out do there is known up to {units.say(last, 'Hz', 4)} only: reduce "
            f"it with modes = {{ frequency = {1.5 * hertz:.2g} }}"
        )

    @property
    def part(self) -> slice:
        """Its velocity coordinates."""
        return slice(self.columns.iv, self.columns.iv + 6 + self.columns.m)

    @property
    def missing(self) -> Array:
        """(6 + m, 6 + m) R: twice the missing energy by accelerations of the coordinates."""
        scaled = self.force / self.omega[:, None]
        return np.asarray(self.C.T @ (self.rest + scaled.T @ scaled) @ self.C)

    def interface_forces(self, joined: Collection[str]) -> Array:
        """(o,) largest force at a `joined` interface per acceleration of each mode that is left
        out, with all of them at rest."""
        n, mass, size = 6 + self.body.m, self.accelerations.mass, self.body.characteristic_length
        sizes = np.where(mass.diagonal() > 0.0, mass.diagonal(), mass[0, 0])
        unit, none, places = np.eye(3), np.zeros((3, 3)), self.body.interfaces
        rows = [
            np.block(
                [[unit, -skew(one.position), one.Phi_t], [none, size * unit, size * one.Phi_r]]
            )
            for one in places
        ]
        B, scales = np.vstack([np.zeros((0, n)), *rows]), np.sqrt(mass[0, 0] / sizes)
        K = block_diag(np.zeros((6, 6)), self.body.K) * np.outer(scales, scales)
        A = np.block([[K / K.max(), (B * scales).T], [B * scales, np.zeros((len(B),) * 2)]])
        units = np.linalg.lstsq(A, np.eye(n + len(B))[:, n:], rcond=None)[0][:n]
        pulls = self.force @ self.C @ (scales[:, None] * units)
        pulls = np.linalg.norm(pulls.reshape(len(pulls), len(places), 6)[..., :3], axis=2)
        at_joints = [one.name in joined for one in places]
        return np.asarray(pulls.max(axis=1, initial=0.0, where=at_joints))

    def sensor_changes(self, compiled: Compiled, row: OutputBlock, mode: int) -> Array:
        """(channels,) amplitude at sensors, over that of a mode that is left out, as its inertia
        moves the scene about a row of a run, and its interfaces no farther than of a free body."""
        number, system = compiled.layout.bodies.index(self.columns), compiled.system
        scene = MechanismModes(compiled, row.q[0], list(range(len(compiled.layout.bodies))))
        force, motions = (self.force @ self.C)[mode], scene.unit_motions()
        A = block_diag(body_axes(compiled, row.q[0])[number], np.eye(3 + self.body.m))
        X = motions @ (motions[self.part].T @ (A @ force))[:, None]
        free, own = self.accelerations.inverse @ force, A.T @ X[self.part, 0]
        ways = [
            [np.linalg.norm(x[:3] + np.cross(x[3:6], one.position) + one.Phi_t @ x[6:])
             for one in self.body.interfaces]
            for x in (free, own)
        ]  # fmt: skip
        most, now = (max(one, default=0.0) for one in ways)
        X = X * min(1.0, most / now) if now > 0.0 else X
        equations = StateEquations(compiled, new_state(system, len(compiled.layout.channels)))
        equations.set_row(row, 0)
        none = np.zeros((compiled.layout.nc, 1))
        both = sensor_amplitudes(equations, self.omega[[mode]], X, none)[..., 0]
        return np.asarray(np.linalg.norm(both[:, : len(compiled.layout.channels)], axis=0))


class OmittedOscillators:
    """The omitted modes of a body as oscillators, ÿ + 2ζω ẏ + ω² y = force."""

    def __init__(self, body: FlexBody, drive: float) -> None:
        omitted = body.omitted_modes
        self.omega = np.zeros(0) if omitted is None else 2.0 * np.pi * omitted.frequency
        ratio = 2.0 * np.pi * drive / self.omega
        self._gain = ratio**2 / np.hypot(1.0 - ratio**2, 2.0 * OMITTED_DAMPING * ratio)

    def integrate(self, t: Array, force: Array, state: Array, tension: Array) -> Array:
        """(t, o) response beyond force/ω², exact for forces that are linear between rows.

        With x that response, z = ẋ + ζωx + iω_d x decays exponentially, and each kink of the force
        is an impulse on it. If rows are too far apart to show the excitation of a mode, the force
        is taken as an oscillation with the frequency of the drivers and loads of the scene.

        Parameters
        ----------
        t : (t,) array
            Times [s].
        force : (t, o) array
            Modal forces at these times.
        state : (o, 5) array
            z (two numbers), the slope of the static response, this and the time of the row before;
            updated. NaN: no row yet.
        tension : (t,) array
            c by which tension raises ω² to ω² + c ω (`LackingBody.tightening`) [rad/s].
        """
        beyond = np.zeros((len(t), len(self.omega)))
        for k, omega in enumerate(self.omega):
            begins = np.isnan(state[k, 4])
            rates = np.sqrt(omega**2 + tension * omega)
            follow = force[:, k] / rates**2
            time = t if begins else np.append(state[k, 4], t)
            follow = follow if begins else np.append(state[k, 3], follow)
            w, h = rates[1:] if begins else rates, np.diff(time)
            decay = w * complex(-OMITTED_DAMPING, np.sqrt(1.0 - OMITTED_DAMPING**2))
            slopes = np.diff(follow) / np.maximum(h, 1e-300)
            slopes = np.append(slopes[:1] if np.isnan(state[k, 2]) else state[k, 2], slopes)
            kicks = np.where(h > 0.0, -np.diff(slopes), 0.0)
            z = np.empty(len(time), complex)
            z[0] = 0.0 if begins else complex(*state[k, :2])
            turns = np.append(0.0, np.cumsum(decay * h))
            most = OMITTED_DAMPING * (w * h).max(initial=0.0)
            block = max(1, int(_MAX_EXPONENT / max(most, 1e-300)))
            for first in range(0, len(h), block):
                part = slice(first, first + block)
                since = turns[first : first + 1 + block] - turns[first]
                z[first + 1 : first + 1 + block] = np.exp(since[1:]) * (
                    z[first] + np.cumsum(kicks[part] * np.exp(-since[:-1]))
                )
            resolved = np.append(np.ones(int(begins)), w * h < MAX_PHASE_STEP) > 0.0
            swing = np.abs(follow - follow.mean())[-len(t) :] * self._gain[k]
            ends = z.imag[-len(t) :] / (rates * np.sqrt(1.0 - OMITTED_DAMPING**2))
            beyond[:, k] = np.where(resolved, ends, swing)
            slope = slopes[-1] if len(h) else np.nan
            state[k] = z[-1].real, z[-1].imag, slope, follow[-1], time[-1]
        return beyond
