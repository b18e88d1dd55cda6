"""Vibrations of a machine about one row of a run, with what its flexible bodies lack.

What a body lacks follows its accelerations x: as y = C x/ω², a static response, or as oscillators
where it is stored as modes (:class:`flexmb.flexbody.OmittedModes`). R = Σ CᵀC/ω² is twice the
strain energy of this. The frequency ω that the run has is that with K = ω² M; ΔM = K^½ M^-½ R M^-½
K^½ lowers it to ω/√(1 + ω² φᵀRφ) with φ its shape, which is Rayleigh's quotient of the shape with
its static response.

In the axes of a body that turns the same vibration has other frequencies. With gyroscopic forces
D ż and unit mass, z exp(λt) is too fast by aᴴRa/|zᴴ(2λ + D)z|, a its acceleration in space. Where
they differ from those in space, this replaces ΔM, and modes that are left out follow statically.

Geometric stiffening and inertia coupling that a body lacks change M, D and K of the equations
linearised about a state. Modes are followed as these changes grow from nothing to all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexmb.analysis.linear.linearization import Linearization, ModeSweep
from flexmb.analysis.linear.observer import body_axes
from flexmb.analysis.linear.state_equations import StateEquations, Tangents
from flexmb.analysis.validity.body_accelerations import OMITTED_DAMPING, Complex, LackingBody
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody.arrays import Array, IntArray, skew

RESOLVED = 2.0  # phase of a vibration between two rows [rad] up to which rows show it
LEAST_PHASE = 5e-3  # by which vibrations get out of phase within the run, that counts [rad]
LEAST_CYCLES = 0.5  # of a vibration in the run
_GROWTH = 0.02  # of a motion, over its frequency, from which it is unstable
# Difference of a frequency in body axes from that in space, and drift over the largest, that count.
_SAME_FREQUENCY, _SMALL_DRIFT = 0.05, 0.05
_SAME_MODE = 0.01  # difference of frequencies of modes that are left out that are one, over them
# Change of a frequency in a step from the terms of the run to all; numbers of steps.
_STEP, _MIN_STEPS, _MAX_STEPS = 0.05, 4, 20
# Stiffness by turning loads that is not symmetric, over all of them, from which on vibrations
# without it have no meaning.
_TURNING_SHARE = 1e-3
_LEAST_MASS = 1e-9  # of a vibration with fields, over that without them
# Share of a body in the change of a mode, over the largest, from which on it is its; that of one of
# its terms from which on it is a cause.
_OWN_SHARE, _SHARE_OF_CAUSE = 0.5, 0.1


def energies_of_vibrations(omega: Array, y: Array) -> Array:
    """(t, o) twice the energy of vibrations y (t, o), each with those of the same frequency."""
    same = np.abs(omega[:, None] - omega) < _SAME_MODE * omega
    return np.asarray((omega * y) ** 2 @ same)


def update_largest(largest: Array, values: Array, t: Array) -> None:
    """Replace largest values and their times (k, 2...) by larger ones among values (t, k)."""
    rows = values.argmax(axis=0)
    now = np.column_stack([values.max(axis=0), t[rows]])
    more = now[:, 0] > largest[: len(now), 0]
    largest[: len(now), :2][more] = now[more]


def most_of_vibrations(
    alone: Array, acting: Array, strain: float
) -> tuple[float, float, int, float]:
    """Energy, time and number of the mode that is left out and vibrates most; energy at sensors.

    Of each are known its largest energy and the time of it, without acting back on the body
    (o, 2), and with, since a time (o, 3). Acting back it changes the motion instead: at sensors
    that counts too, up to the energy without, or to the `strain` of the body.
    """
    acts = alone[:, 1] >= acting[:, 2]
    energy = np.where(acts, np.minimum(acting[:, 0], alone[:, 0]), alone[:, 0])
    most = np.where(acts, np.minimum(alone[:, 0], np.maximum(energy, strain)), alone[:, 0])
    j = int(energy.argmax())
    return float(energy[j]), float(alone[j, 1]), j, float(most[j])


def errors_at_nodes(
    made: Linearization, columns: BodyColumns, missing: Array, markers: IntArray, places: IntArray
) -> Array:
    """How much too high natural frequencies (k,) are, as nodes of a body give way too little.

    Joints and forces pull at nodes besides the interfaces, where the modes lack a part of the
    compliance. In a mode with the loads c there, cᵀ R c over twice its energy is the part that this
    adds to 1/ω².

    Parameters
    ----------
    made : Linearization
        Of a scene at rest.
    columns : BodyColumns
        The body.
    missing : (l, l) array
        R: twice the missing strain energy by loads at nodes.
    markers, places : (n,) int arrays
        Markers of the engine at these nodes, and the first of six columns of each.
    """
    compiled, at, X, s = made.compiled, made.tangents, made.shapes, made.eigenvalues
    lam = np.linalg.lstsq(at.Cq.T, at.M @ X * s**2 + at.D @ X * s + at.K @ X, rcond=None)[0]
    equations, rows = StateEquations(compiled, made.state), compiled.system.rows
    pulls = equations.wrench_changes(X, s)
    A = body_axes(compiled, made.state.q)[compiled.layout.bodies.index(columns)]
    c, own = np.zeros((len(missing), len(s)), complex), slice(columns.iv, columns.iv + 6)
    for marker, place in zip(markers, places, strict=True):
        mine = np.flatnonzero((rows["I"] == marker) | (rows["J"] == marker))
        J = equations.marker_motion(marker)[:, own]
        W = np.linalg.solve(J.T, at.Cq[mine][:, own].T @ lam[mine]) + pulls[marker]
        force, moment = A.T @ W[:3], A.T @ W[3:]
        arm = skew(compiled.system.parts.markers["arm"][marker])
        c[place : place + 6] += np.vstack([force, moment + arm @ force])
    energy = np.abs(s) ** 2 * _squares(at.M, X)
    share = np.divide(_squares(missing, c), energy, out=np.zeros(len(s)), where=energy > 0.0)
    return np.asarray(np.sqrt(1.0 + share) - 1.0)


def frequency_changes(loss: Array, mass: Array, omega: Array) -> tuple[Array, Array, Array]:
    """The natural frequency under loads (n,) that fields which are left out lower most, and the
    part of it (n,) that they take, 1 if all; and what they move by in its shape (n, r).

    `loss` (n, k + r, k + r) is the stiffness that loads take from motions of unit strain energy
    with frequencies omega (n, k), and from the fields, which follow them statically. In `mass` only
    that of the fields counts.
    """
    k, whole = omega.shape[1], np.eye(loss.shape[1]) - 0.5 * (loss + loss.transpose(0, 2, 1))
    own, across, rest = whole[:, :k, :k], whole[:, :k, k:], whole[:, k:, k:]
    follow = np.linalg.solve(rest, across.transpose(0, 2, 1))
    scale = omega[:, :, None] * omega[:, None]
    before, shapes = np.linalg.eigh(scale * own)
    carried = mass[:, :k, k:] @ follow
    moving = follow.transpose(0, 2, 1) @ mass[:, k:, k:] @ follow
    moving = np.eye(k) + scale * (moving - carried - carried.transpose(0, 2, 1))
    masses, axes = np.linalg.eigh(moving)
    axes /= np.sqrt(masses.clip(_LEAST_MASS))[:, None]
    stiffness = axes.transpose(0, 2, 1) @ (scale * (own - across @ follow)) @ axes
    after = np.linalg.eigvalsh(stiffness)
    buckled = np.linalg.eigvalsh(rest)[:, :1] <= 0.0
    left = np.where(buckled, 0.0, after.clip(0.0) / np.where(before > 0.0, before, 1.0))
    lost = np.where(before > 0.0, 1.0 - np.sqrt(left.clip(0.0, 1.0)), 0.0)
    skewed = np.abs(loss - loss.transpose(0, 2, 1)).max(axis=(1, 2))
    lost[skewed > _TURNING_SHARE * np.abs(loss).max(axis=(1, 2))] = 0.0
    most = lost.argmax(axis=1)[:, None]
    shape = omega * np.take_along_axis(shapes, most[:, None], axis=2)[..., 0]
    moved = (follow @ shape[..., None])[..., 0]
    return (
        np.sqrt(np.take_along_axis(before, most, axis=1)[:, 0].clip(0.0)),
        np.take_along_axis(lost, most, axis=1)[:, 0],
        moved,
    )


@dataclass(frozen=True, eq=False)
class OmittedTerms:
    """Terms of one body that the equations linearised about a state leave out.

    `M`, `D`, `K` are of the velocity coordinates `part` of the body.
    """

    name: str
    cause: str
    cure: str
    part: slice
    M: Array
    D: Array
    K: Array

    def added(self, to: Tangents, share: float) -> Tangents:
        """The matrices with a share of these terms."""
        M, D, K = to.M.copy(), to.D.copy(), to.K.copy()
        for whole, own in ((M, self.M), (D, self.D), (K, self.K)):
            whole[self.part, self.part] += share * own
        return to._replace(M=M, D=D, K=K)

    def change(self, made: Linearization) -> Array:
        """(k,) relative changes of λ, of first order."""
        x, rate, s = made.shapes[self.part], np.abs(made.eigenvalues), made.eigenvalues
        by = self.M @ x * s**2 + self.D @ x * s + self.K @ x
        by = np.abs((x.conj() * by).sum(axis=0))
        scale = 2.0 * rate**2 * _squares(made.M, made.shapes)
        return np.asarray(np.divide(by, scale, out=np.zeros(len(s)), where=scale > 0.0))


def errors_by_omission(
    made: Linearization, terms: Sequence[OmittedTerms], band: tuple[float, float], least: float,
    counts: Callable[[str, Complex], NDArray[np.bool_]],
) -> Iterator[tuple[float, int, list[OmittedTerms]]]:  # fmt: skip
    """Errors of natural frequencies in a band [Hz], over those with all terms.

    Of each body: the largest error of a mode that it changes, infinite if no such frequency is
    left; the number of the mode, from 0; the terms of the body that change it. `counts` are (k,)
    which shapes (nv, k) of a body do, without these terms or with them. Symmetric terms whose
    changes of first order are below `least` are not looked at.
    """
    followed = [made]
    every = np.array([one.change(made) for one in terms])
    names = np.array([one.name for one in terms])
    changes = {one: every[names == one].sum(axis=0) for one in dict.fromkeys(names.tolist())}
    largest = np.max(list(changes.values()), axis=0)
    symmetric, most = not any(one.D.any() for one in terms), every.sum(axis=0).max(initial=0.0)
    if symmetric and most < least:
        return
    fewest = _MIN_STEPS // 2 if symmetric and most < _STEP else _MIN_STEPS
    n = int(np.clip(largest.max(initial=0.0) / _STEP, fewest, _MAX_STEPS))
    for share in np.linspace(0.0, 1.0, n + 1)[1:]:
        tangents = made.tangents
        for one in terms:
            tangents = one.added(tangents, float(share))
        seen = made.seen.with_tangents(tangents)
        followed.append(replace(made, tangents=tangents, seen=seen))
    sweep = ModeSweep.of("", [0.0] * (n + 1), followed)
    hertz, last = sweep.frequencies[[0, -1]], followed[-1]
    apart = np.abs(sweep.eigenvalues[-1][:, None] - last.eigenvalues)
    ends = np.nan_to_num(apart, nan=np.inf).argmin(axis=1)
    before, after = np.nan_to_num(hertz)
    errors = np.divide(before - after, after, out=np.full(len(after), np.inf), where=after > 0.0)
    errors[(before == 0.0) & (after == 0.0) | np.isnan(hertz[1]) | (after > band[1])] = 0.0
    errors[np.maximum(before, after) < band[0]] = 0.0
    for name, change in changes.items() if len(errors) else ():
        k = min(len(change), len(errors))  # more where one without a vibration has two rates
        mine = counts(name, made.shapes)[:k] | counts(name, last.shapes[:, ends])[:k]
        own = np.where(mine & (change >= _OWN_SHARE * largest)[:k], errors[:k], 0.0)
        worst = int(np.abs(own).argmax())
        causes = every[:, worst] * (names == name)
        of = (causes >= _SHARE_OF_CAUSE * causes.max()) & (names == name)
        every_cause = [one for one, is_cause in zip(terms, of, strict=True) if is_cause]
        yield float(own[worst]), worst, every_cause


@dataclass(frozen=True, eq=False)
class FrequencyDrift:
    """The vibrations of the machine about one row, without what its bodies lack.

    Each is a pair z, λ z of amplitudes of the d modes of the run and their rates.
    """

    values: Complex  # (k,) λ, 1/s
    shapes: Complex  # (d, k) amplitudes
    inverse: Complex  # (k, 2 d) their sizes from amplitudes and rates
    frequency: Array  # (k,) in space, rad/s
    drift: Array  # (k,) by which it is too large, rad/s
    shares: Array  # (bodies, k) of each body in that

    @classmethod
    def of(
        cls, bodies: Sequence[LackingBody], X: Array, omega: Sequence[Array], D: Array, K: Array,
        unit: float,
    ) -> FrequencyDrift:  # fmt: skip
        """With shapes X (nv, d), D and K (d, d), bodies that turn with omega, in body axes.

        `unit` is a time [s] of their size.
        """
        d = len(K)
        values, vectors, inverse = _vibrations(D, K, unit)
        z = vectors[:d]
        speeds, sizes, missing = np.zeros(2 * d), np.zeros(2 * d), []
        for one, turns in zip(bodies, omega, strict=True):
            v, a = one.accelerations.of_motions(X[one.part] @ z, values, turns)
            speeds += _squares(one.accelerations.mass, v)
            sizes += _squares(one.accelerations.mass, a)
            missing.append(_squares(one.missing, a))
        damped = (z.conj() * (D @ z)).sum(axis=0)
        by = np.abs(2.0 * values * _squares(np.eye(d), z) + damped)
        shares = np.divide(missing, by, out=np.zeros((len(bodies), 2 * d)), where=by > 0.0)
        squares = np.divide(sizes, speeds, out=np.zeros(2 * d), where=speeds > 0.0)
        return cls(values, z, inverse, np.sqrt(squares), shares.sum(axis=0), shares)

    def is_turned(self, duration: float) -> bool:
        """Whether frequencies of vibrations differ from those in space, and their drift counts."""
        other = np.abs(np.abs(self.values) - self.frequency) > _SAME_FREQUENCY * self.frequency
        vibrate = self._vibrate(duration)
        counts = self.drift > _SMALL_DRIFT * self.drift[vibrate].max(initial=0.0)
        return bool(np.any(other & counts & vibrate))

    def get_out_of_phase(self, duration: float) -> NDArray[np.bool_]:
        """(k,) those that vibrate within a time [s] and get out of phase, even if at resonance."""
        phase = 2.0 * self.drift * duration
        return np.asarray(self._vibrate(duration) & (phase >= LEAST_PHASE))

    def _vibrate(self, duration: float) -> NDArray[np.bool_]:
        """(k,) whether they vibrate within a time [s]; others are free motions."""
        return np.asarray(np.abs(self.values) * duration > 2.0 * np.pi * LEAST_CYCLES)


@dataclass(frozen=True, eq=False)
class PoseVibrations:
    """The vibrations of the machine about one row, those that the rows resolve.

    States are amplitudes of the modes of the run, then of those that are left out, then the rates
    of both.
    """

    shapes: Array  # (nv, d) of the modes of the run, in body axes
    shape_rates: Array  # (nv, d) of these
    project: Array  # (d, nv) amplitudes of a motion in body axes
    own: FrequencyDrift
    values: Complex  # (k,) of the states
    vectors: Complex  # (2 (d + o), k)
    kick: Complex  # (k, forces) change by a change of the rate of S, and of y
    start: Complex  # (k, 2 (d + o)) from states
    seen: Array  # (2, n, d) change of channels and reactions by amplitudes, and by rates
    omega: Array  # (d,) frequencies of the modes of the run, rad/s

    @classmethod
    def of(
        cls, bodies: Sequence[LackingBody], motions: tuple[Array, Array, Array], omega: Array,
        matrices: tuple[Array, Array], seen: Array, turns: Sequence[Array],
        times: tuple[float, float],
    ) -> PoseVibrations:  # fmt: skip
        """Of the modes of the run, of unit mass.

        Parameters
        ----------
        bodies : sequence of LackingBody
            The bodies.
        motions : tuple of arrays
            `shapes`, `shape_rates` and `project`.
        omega : (d,) array
            Frequencies of these modes without damping and gyroscopic forces [rad/s].
        matrices : tuple of (d, d) arrays
            Damping, with gyroscopic forces, and stiffness.
        seen : (2, n, d) array
            Change of channels and reactions by amplitudes, and by rates.
        turns : sequence of (3,) arrays
            Angular velocity of each body, body axes [rad/s].
        times : tuple of float
            Interval between rows and duration of the run [s].
        """
        X, d, (unit, duration) = motions[0], len(omega), times
        own = FrequencyDrift.of(bodies, X, turns, *matrices, unit)
        # forces: S of each body (its velocity coordinates), then y of all modes that are left out
        loads = np.hstack([X[one.part].T for one in bodies])
        w = np.concatenate([one.omega for one in bodies])
        n = d + len(w)
        if own.is_turned(duration):
            values = own.values - 1j * np.sign(own.values.imag) * own.drift
            vectors, start = np.zeros((2 * n, 2 * d), complex), np.zeros((2 * d, 2 * n), complex)
            vectors[:d], vectors[n : n + d] = own.shapes, own.shapes * own.values
            start[:, :d], start[:, n : n + d] = np.hsplit(own.inverse, 2)
            kick = start[:, n:] @ block_diag(loads, np.zeros((len(w), len(w))))
        else:
            moved = [one.C @ X[one.part] for one in bodies]
            A = np.concatenate([one.force @ x for one, x in zip(bodies, moved, strict=True)])
            rest = sum(x.T @ one.rest @ x for one, x in zip(bodies, moved, strict=True))
            lowered = np.eye(d) + omega[:, None] * rest * omega
            inverse = np.linalg.inv(np.block([[lowered, -A.T], [-A, np.eye(len(w))]]))
            D = block_diag(matrices[0], np.diag(2.0 * OMITTED_DAMPING * w))
            K = block_diag(matrices[1], np.diag(w**2))
            values, vectors, start = _vibrations(inverse @ D, inverse @ K, unit)
            kick = start[:, n:] @ inverse @ block_diag(loads, -np.eye(len(w)))
        size = np.abs(values)
        there = (size * unit < RESOLVED) & (values.real < _GROWTH * size)
        there &= size * duration > 2.0 * np.pi * LEAST_CYCLES
        return cls(
            *motions, own, values[there], vectors[:, there], kick[there], start[there], seen, omega
        )

    def phase_limits(self, h: Array, motions: Array, state: Array) -> Array:
        """(t, k) what each vibration can differ by: its drift times time, twice its amplitude.

        Parameters
        ----------
        h : (t,) array
            Steps between rows [s].
        motions : (2, t, nv) array
            Velocities less those on the line between rows beside, and these, in body axes.
        state : (2, k) array
            Sum of amplitudes times drifts, and largest amplitude, less what damping takes; updated.
        """
        own, d = self.own, len(self.omega)
        both: Complex = motions @ self.project.T @ own.inverse[:, d:].T
        # Slow motions, vibrations in other poses, leave the line between rows by little of them.
        both[0] /= np.fmax(1.0 - np.cos(own.values.imag * h[:, None]), 1e-12)
        sizes: Array = 0.5 * np.pi * np.abs(both).min(axis=0)
        left = np.exp(np.outer(h, own.values.real.clip(max=0.0)))
        limits = np.empty_like(sizes)
        for k, now in enumerate(sizes):
            state[0] = left[k] * state[0] + own.drift * h[k] * now
            state[1] = np.maximum(left[k] * state[1], now)
            limits[k] = np.minimum(state[0], 2.0 * state[1])
        return limits

    def sizes_of(self, other: PoseVibrations, sizes: Array, duration: float) -> Array:
        """(…, k) sizes of its vibrations in those of another pose that get out of phase."""
        x = self.project @ other.shapes @ other.own.shapes
        both = np.abs(self.own.inverse @ np.vstack([x, x * other.own.values]))
        return np.asarray(sizes * other.own.get_out_of_phase(duration) @ both.T)

    def is_exact(self, duration: float) -> bool:
        """Whether no vibration gets out of phase within a time [s], not even at resonance."""
        return not self.own.get_out_of_phase(duration).any()


def _vibrations(D: Array, K: Array, unit: float) -> tuple[Complex, Complex, Complex]:
    """λ (2 d,) of z̈ + D ż + K z = 0, its states (z, ż) as columns, and their inverse.

    `unit` is a time [s] of the size of the vibrations.
    """
    d = len(K)
    first = np.block([[np.zeros((d, d)), np.eye(d)], [-K * unit**2, -D * unit]])
    values, vectors = np.linalg.eig(first.astype(complex))
    rates = np.repeat([1.0, unit], d)
    states, sizes = vectors / rates[:, None], np.linalg.inv(vectors) * rates
    return np.asarray(values / unit), np.asarray(states), np.asarray(sizes)


def _squares(form: Array, motions: NDArray[Any]) -> Array:
    """(k,) of motions (n, k) in a quadratic form (n, n)."""
    return np.asarray((motions.conj() * (form @ motions)).sum(axis=0).real)
