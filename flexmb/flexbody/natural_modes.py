"""Natural modes of a flexible body with some of its interfaces fixed, and modal damping.

The natural modes are those of the rigid motions of the frame and the modal coordinates together,
with the six motions of the fixed interfaces (by the rows of Phi there) at zero. They are those of
the reduced model, whose static part is exact.

Vibrations for modal damping: with stiffness K = L Lᵀ (m, m), a basis of the free motions with modal
coordinates N (m, d) and mass M (d, d) = R Rᵀ, the singular values of Lᵀ N R⁻ᵀ are the natural
frequencies and the left singular vectors u are the shapes Lᵀ η / ω. The damping matrix

    D = Σ 2 ζ_j / ω_j (L u_j) (L u_j)ᵀ

gives each mode exactly its ratio ζ_j and couples no modes. It acts on modal coordinates alone, so
that rigid motions do no work in it. With all modes and ζ = βω/2 it is β K. Shapes that the free
motions do not contain (because interfaces prevent them) are damped by the same law at the
frequencies of these shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space, solve_triangular

from flexmb.flexbody.arrays import RANK_TOLERANCE, FloatArray, skew
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.damping import DampingOptions

_PAIRS = ((1, 2), (2, 0), (0, 1))


@dataclass(frozen=True, eq=False)
class NaturalModes:
    """Natural modes of unit modal mass, ascending in frequency.

    Parameters
    ----------
    frequencies : (k,) float
        Hz.
    frame : (6, k) float
        Displacement of the origin of the body frame [m] and rotation of the frame [rad].
    eta : (m, k) float
        Modal coordinates.
    """

    frequencies: FloatArray
    frame: FloatArray
    eta: FloatArray

    def shapes(self, points: FloatArray, modes: FloatArray) -> FloatArray:
        """(n, 3, k) displacement of points (n, 3) that unit eta move by modes (n, 3, m) [m]."""
        turned = np.cross(self.frame[3:].T[None], points[:, None]).transpose(0, 2, 1)
        return np.asarray(self.frame[:3] + turned + modes @ self.eta)


def natural_modes(
    body: FlexBody, interfaces: Sequence[str] = (), rows: FloatArray | None = None
) -> NaturalModes:
    """Natural modes with these interfaces fixed.

    Parameters
    ----------
    body : FlexBody
        The body.
    interfaces : sequence of str
        Names; without any the body is free, and its rigid motions are left out.
    rows : (n, 6 + m) array, optional
        Linear constraints instead of whole interfaces: their coefficients for the translation of
        the body frame, its rotation (body axes) and eta. Rigid motions that they leave free have
        frequency zero.

    Raises
    ------
    ReductionError
        An unknown interface.
    """
    M, K = matrices_at_rest(body)
    if rows is None:
        free = free_motions(body, interfaces)
    else:
        free = _null_space(rows, np.sqrt(np.diag(M)))
    omega2, W = eigh(free.T @ K @ free, free.T @ M @ free)
    shapes = free @ W
    if body.m:
        largest = np.abs(shapes[6:]).argmax(axis=0)
        shapes = shapes * np.sign(shapes[6 + largest, np.arange(len(omega2))])
    frequencies = np.asarray(np.sqrt(np.maximum(omega2, 0.0)) / (2 * np.pi))
    return NaturalModes(frequencies, shapes[:6], shapes[6:])


def natural_frequencies(body: FlexBody, interfaces: Sequence[str] = ()) -> FloatArray:
    """(k,) natural frequencies [Hz] with these interfaces fixed; see :func:`natural_modes`."""
    return natural_modes(body, interfaces).frequencies


def free_motions(body: FlexBody, interfaces: Sequence[str]) -> FloatArray:
    """(6 + m, k) basis of the motions of frame and eta with these interfaces fixed, scaled by mass.

    Without interfaces the frame is fixed, so that rigid motions are left out.
    """
    if not interfaces:
        return np.eye(6 + body.m)[:, 6:]
    rows = []
    for name in interfaces:
        part = body.interface(name)
        arm = skew(part.position)
        rows.append(np.hstack([np.eye(3), -arm, part.Phi_t]))
        rows.append(np.hstack([np.zeros((3, 3)), np.eye(3), part.Phi_r]))
    return _null_space(np.vstack(rows), np.sqrt(np.diag(matrices_at_rest(body)[0])))


def _null_space(rows: FloatArray, size: FloatArray) -> FloatArray:
    """(n, k) null space of the rows; each row and column is first scaled to be of order one.

    A coordinate without inertia, as the rotation of points on a line about it, gets the largest
    scale.
    """
    size = np.where(size > 0.0, size, size.max())
    scaled = rows / size
    largest = np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.asarray(null_space(scaled / np.where(largest > 0.0, largest, 1.0)) / size[:, None])


def mean_motion(body: FlexBody) -> FloatArray:
    """(6, m) mean translation at the origin and mean rotation per unit of modal coordinates.

    Those of its mean axes: zero in a frame that is these axes.
    """
    P = body.P - body.center[:, None, None] * body.p
    moments = np.array([P[a, b] - P[b, a] for a, b in _PAIRS])
    turn = np.linalg.pinv(body.inertia_about_center) @ moments
    return np.vstack([body.p / body.mass + skew(body.center) @ turn, turn])


def mass_by_axes(body: FlexBody, *, with_fields: bool = False) -> FloatArray:
    """(3, 3, n, n) ∫ρ u_a u_b of translation, rotation about the origin and modes u, body axes; and
    of the fields that these leave out under geometric stiffness."""
    m, turn = body.m, -np.array([skew(axis) for axis in np.eye(3)])  # (θ × s)_a = θ·turn_a s
    M = np.zeros((3, 3, 6 + m, 6 + m))
    for a in range(3):
        for b in range(3):
            one = M[a, b]
            one[a, b], one[a, 3:6], one[a, 6:] = body.mass, turn[b] @ body.S1, body.p[b]
            one[3:6, b], one[6:, b] = turn[a] @ body.S1, body.p[a]
            one[3:6, 3:6], one[6:, 6:] = turn[a] @ body.S0 @ turn[b].T, body.Mab[a, b]
            one[3:6, 6:] = turn[a] @ body.P[:, b]
            one[6:, 3:6] = (turn[b] @ body.P[:, a]).T
    if not with_fields or body.omitted_stiffening is None:
        return M
    fields, n = body.omitted_stiffening.mass.copy(), 6 + m
    fields[..., 3:6] -= fields[..., :3] @ skew(body.center)
    fields[..., 6:n] += fields[..., :6] @ mean_motion(body)
    above = np.concatenate([M, fields[..., :n].transpose(1, 0, 3, 2)], axis=3)
    return np.concatenate([above, fields], axis=2)


def matrices_at_rest(body: FlexBody) -> tuple[FloatArray, FloatArray]:
    """Mass and stiffness (6 + m, 6 + m) at rest; order: translation, rotation about the origin,
    eta."""
    M = mass_at_rest(body.mass, body.S1, body.S0, body.p, body.P, body.M_eta)
    K = np.zeros_like(M)
    K[6:, 6:] = body.K
    return M, K


def mass_at_rest(
    mass: float, S1: FloatArray, S0: FloatArray, p: FloatArray, P: FloatArray, M_eta: FloatArray
) -> FloatArray:
    """Mass (6 + m, 6 + m) at rest in body axes, from the inertia integrals of a body."""
    M = np.zeros((6 + len(M_eta), 6 + len(M_eta)))
    M[:3, :3] = mass * np.eye(3)
    M[:3, 3:6] = -skew(S1)
    M[3:6, 3:6] = np.trace(S0) * np.eye(3) - S0
    M[:3, 6:] = p
    M[3:6, 6:] = [P[a, b] - P[b, a] for a, b in _PAIRS]
    M[6:, 6:] = M_eta
    lower = np.tril_indices(len(M), -1)
    M[lower] = M.T[lower]
    return M


_RIGID = 1e-9  # frequency over the highest below which a motion is rigid; round-off is about 1e-13
_COUPLED = 1e-6  # damping between modes, over that within them, below which it is round-off


@dataclass(frozen=True, eq=False)
class Vibrations:
    """Natural modes of unit modal mass with stiffness (no rigid motions), ascending in frequency.

    Parameters
    ----------
    omega : (k,) float
        rad/s.
    eta : (m, k) float
        Modal coordinates.
    stress : (r, r) float
        Orthonormal: the k shapes Lᵀ η / ω, then all others, which the modes do not contain.
    """

    omega: FloatArray
    eta: FloatArray
    stress: FloatArray

    @classmethod
    def of(cls, K: FloatArray, eta: FloatArray, mass: FloatArray) -> Vibrations:
        """From K (m, m), and the modal coordinates eta (m, d) and mass (d, d) of the free
        motions."""
        half = solve_triangular(np.linalg.cholesky(mass), eta.T, lower=True).T
        U, s, Vt = np.linalg.svd(stiffness_factor(K).T @ half)
        k = int(np.sum(s > _RIGID * s.max(initial=0.0)))
        U[:, :k], s = U[:, :k][:, ::-1], s[:k][::-1]
        return cls(s, half @ Vt[:k][::-1].T, U)


def stiffness_factor(K: FloatArray) -> FloatArray:
    """L (m, r) of the semidefinite K = L Lᵀ (m, m) of rank r."""
    scale = np.sqrt(np.where(np.diag(K) > 0.0, np.diag(K), 1.0))
    values, W = eigh(K / np.outer(scale, scale))
    stiff = values > RANK_TOLERANCE * values.max(initial=0.0)
    return np.asarray(scale[:, None] * W[:, stiff] * np.sqrt(values[stiff]))


def body_vibrations(body: FlexBody, interfaces: tuple[str, ...] = ()) -> Vibrations:
    """Vibrations of the body alone with these interfaces fixed; of the free body without any."""
    M, _ = matrices_at_rest(body)
    free = free_motions(body, interfaces) if interfaces else np.eye(6 + body.m)
    return Vibrations.of(body.K, free[6:], free.T @ M @ free)


def damping_matrix(
    body: FlexBody,
    damping: DampingOptions,
    joined: Vibrations,
    where: str = "damping",
    together: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """(m, m) damping in the modal coordinates of a body.

    Parameters
    ----------
    body, damping : FlexBody, DampingOptions
        The body and its ratios.
    joined : Vibrations
        Vibrations of the body as the scene joins it.
    where : str
        Place of the options, for messages.
    together : ((j,) array, (m, j) array), optional
        Natural frequencies [rad/s] of the scene with all its flexible bodies, and the modal
        coordinates of this body in these modes. They damp shapes of this body that its joints would
        prevent if the other bodies were rigid.

    Raises
    ------
    FlexmbError
        A mode that does not exist, or a cut-off frequency below all of them.
    """
    of, free = joined, body_vibrations(body)
    if damping.of == "free":
        of = free
    elif damping.of == "clamped":
        of = body_vibrations(body, tuple(part.name for part in body.interfaces))
    k, L = len(of.omega), stiffness_factor(body.K)
    z = damping.ratios_of_modes(of.omega / (2 * np.pi), where)
    half = L @ of.stress[:, :k] * np.sqrt(2 * z / of.omega)
    # the other shapes, as the free body vibrates in them: the singular values are 1/ω
    n, rest = len(free.omega), of.stress[:, k:]
    if not (rest.shape[1] and n):
        return np.asarray(half @ half.T)
    Y, periods, _ = np.linalg.svd(rest.T @ free.stress[:, :n] / free.omega)
    omega = 1.0 / periods
    z = damping.ratios(omega / (2 * np.pi))
    others = L @ rest @ Y * np.sqrt(2 * z / omega)
    D = half @ half.T + others @ others.T
    if together is not None and damping.of == "joined":
        omega, eta = together
        z = damping.ratios(omega / (2 * np.pi))
        others = L @ rest @ (rest.T @ L.T @ eta) * np.sqrt(2 * z / omega) / omega
        D += others @ others.T
    return np.asarray(D)


def damping_ratios(D: FloatArray, vibrations: Vibrations) -> FloatArray:
    """(k,) the damping ratio of each mode with the damping D (m, m).

    If D couples modes, it is −Re λ/|λ| of the eigenvalue λ of the damped mode in which the mode
    dominates, and at least 1 if that does not oscillate.
    """
    omega, C = vibrations.omega, vibrations.eta.T @ D @ vibrations.eta
    own = 0.5 * np.diag(C) / omega
    size, k = np.sqrt(np.outer(np.diag(C), np.diag(C)).clip(0.0)), len(omega)
    least = 1e-9 * size.max(initial=0.0)
    if not np.any(np.abs(C - np.diag(np.diag(C))) > _COUPLED * np.maximum(size, least)):
        return np.asarray(own)
    # states (ω x, ẋ), scaled so that the entries of the matrix are comparable
    A = np.block([[np.zeros((k, k)), np.diag(omega)], [-np.diag(omega), -C]])
    values, W = np.linalg.eig(A)
    oscillates = values.imag > 0.0
    values, shares = values[oscillates], np.abs(W[k:, oscillates])
    ratios = np.maximum(own, 1.0)
    from scipy.optimize import linear_sum_assignment  # importing takes 0.2 s and is seldom needed

    modes, pairs = linear_sum_assignment(-shares)
    ratios[modes] = -values[pairs].real / np.abs(values[pairs])
    return ratios
