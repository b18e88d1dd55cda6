"""Vibrations of a flexible body that damping belongs to, its damping matrix, and ratios.

In: stiffness K = L Lᵀ (m, m) and a basis of the motions that are free, modal coordinates N (m, d)
and mass M (d, d) = R Rᵀ. Out: the singular values of Lᵀ N R⁻ᵀ, which are the natural frequencies;
left singular vectors u are the shapes Lᵀ η / ω. The damping matrix

    D = Σ 2 ζ_j / ω_j (L u_j) (L u_j)ᵀ

gives each mode its ratio ζ_j exactly, couples none, and takes no work from rigid motion: it acts on
modal coordinates alone. With all modes and ζ = βω/2 it is β K. What the motions cannot do (shapes
that interfaces hold) is damped by the same law at the frequencies of these shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, solve_triangular
from scipy.optimize import linear_sum_assignment

from flexmb.flexbody.arrays import RANK_TOLERANCE, FloatArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.damping import DampingOptions
from flexmb.flexbody.natural_modes import free_motions, matrices_at_rest

_RIGID = 1e-9  # frequency over the highest below which a motion is rigid; round-off leaves 1e-13
_COUPLED = 1e-6  # damping between modes, over that within them, that is round-off


@dataclass(frozen=True, eq=False)
class Vibrations:
    """Natural modes with stiffness of unit modal mass, ascending.

    Parameters
    ----------
    omega : (k,) float
        rad/s.
    eta : (m, k) float
        Modal coordinates.
    stress : (r, r) float
        Orthonormal: the k shapes Lᵀ η / ω, then all others of which the modes have none.
    """

    omega: FloatArray
    eta: FloatArray
    stress: FloatArray

    @classmethod
    def of(cls, K: FloatArray, eta: FloatArray, mass: FloatArray) -> Vibrations:
        """From K (m, m) and the modal coordinates eta (m, d) and mass (d, d) of free motions."""
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
    """Those of the body alone with these interfaces held; free without any."""
    M, _ = matrices_at_rest(body)
    free = free_motions(body, interfaces) if interfaces else np.eye(6 + body.m)
    return Vibrations.of(body.K, free[6:], free.T @ M @ free)


def damping_matrix(
    body: FlexBody, damping: DampingOptions, joined: Vibrations, where: str = "damping"
) -> FloatArray:
    """(m, m) damping in the modal coordinates of a body.

    Parameters
    ----------
    body, damping : FlexBody, DampingOptions
        The body and its ratios.
    joined : Vibrations
        Of the body as the scene joins it.
    where : str
        Its place, for messages.

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
    # the other shapes, as the free body can vibrate in them: 1/ω are singular values
    n, rest = len(free.omega), of.stress[:, k:]
    if not (rest.shape[1] and n):
        return np.asarray(half @ half.T)
    Y, periods, _ = np.linalg.svd(rest.T @ free.stress[:, :n] / free.omega)
    omega = 1.0 / periods
    z = damping.ratios(omega / (2 * np.pi))
    others = L @ rest @ Y * np.sqrt(2 * z / omega)
    return np.asarray(half @ half.T + others @ others.T)


def damping_ratios(D: FloatArray, vibrations: Vibrations) -> FloatArray:
    """(k,) the ratio that each mode has with the damping D (m, m).

    Where D couples modes it is that of the damped mode in which the mode is largest: −Re λ/|λ| of
    an eigenvalue λ, and at least 1 where that does not oscillate.
    """
    omega, C = vibrations.omega, vibrations.eta.T @ D @ vibrations.eta
    own = 0.5 * np.diag(C) / omega
    size = np.sqrt(np.outer(np.diag(C), np.diag(C)).clip(0.0))
    k = len(omega)
    if not np.any(np.abs(C - np.diag(np.diag(C))) > _COUPLED * np.maximum(size, size.max() * 1e-9)):
        return np.asarray(own)
    # scaled states (ω x, ẋ): one matrix whose entries compare
    A = np.block([[np.zeros((k, k)), np.diag(omega)], [-np.diag(omega), -C]])
    values, W = np.linalg.eig(A)
    oscillates = values.imag > 0.0
    values, shares = values[oscillates], np.abs(W[k:, oscillates])
    ratios = np.maximum(own, 1.0)
    modes, pairs = linear_sum_assignment(-shares)
    ratios[modes] = -values[pairs].real / np.abs(values[pairs])
    return ratios
