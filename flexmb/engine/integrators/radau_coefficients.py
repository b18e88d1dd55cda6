"""Coefficients of Radau IIA with three stages, and of its error estimate and dense output.

Hairer & Wanner, Solving Ordinary Differential Equations II, 1996, §IV.5 and §IV.8.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.jit import Matrix, Vector, kernel

STAGES = 3


class Radau(NamedTuple):
    """Coefficients: A, A⁻¹ = V diag(γ, μ, μ̄) V⁻¹, error estimate, dense output."""

    A: Matrix  # (3, 3)
    inverse: Matrix  # (3, 3)
    c: Vector  # (3,)
    gamma: float
    filter: float  # 1/γ²
    mu_real: float
    mu_imag: float
    to: Matrix  # (3, 3) rows of V⁻¹: of γ; real and imaginary part of that of μ
    back: Matrix  # (3, 3) columns of V: of γ; twice the real, minus twice the imaginary part of μ
    error: Vector  # (3,) weights of the increments of the stages
    bend: Vector  # (2,) weights of the differences of inner stages from the cubic (dense output)
    works: Matrix  # (4, 4) coefficients of s ... s⁴ in the work, of the powers at 0, c₁, c₂, 1


def radau_coefficients() -> Radau:
    """Coefficients of the method of order 5."""
    s = 6.0**0.5
    A = np.array(
        [
            [(88 - 7 * s) / 360, (296 - 169 * s) / 1800, (-2 + 3 * s) / 225],
            [(296 + 169 * s) / 1800, (88 + 7 * s) / 360, (-2 - 3 * s) / 225],
            [(16 - s) / 36, (16 + s) / 36, 1 / 9],
        ]
    )
    inverse = np.linalg.inv(A)
    values, vectors = np.linalg.eig(inverse)
    order = [int(np.argmin(abs(values.imag))), int(np.argmax(values.imag))]
    rows = np.linalg.inv(vectors)
    gamma, mu = float(values[order[0]].real), complex(values[order[1]])
    # eigenvectors are defined up to a factor, which is complex for γ as well
    factor = 1.0 / rows[order[0], np.argmax(abs(rows[order[0]]))]
    first, of_first = (rows[order[0]] * factor).real, (vectors[:, order[0]] / factor).real
    second, of_second = rows[order[1]], vectors[:, order[1]]
    return Radau(
        A, inverse, A.sum(axis=1), gamma, 1.0 / gamma**2, mu.real, mu.imag,
        np.array([first, second.real, second.imag]),
        np.array([of_first, 2.0 * of_second.real, -2.0 * of_second.imag]),
        np.array([-13.0 - 7.0 * s, -13.0 + 7.0 * s, -1.0]) / (3.0 * gamma),
        _bend(A), np.linalg.inv(np.vander([0.0, *A.sum(axis=1)], increasing=True))
        / np.arange(1.0, 5.0)[:, None],
    )  # fmt: skip


def _bend(A: Matrix) -> Vector:
    """Weights of the differences of both inner stages from the cubic of the dense output.

    The motion differs from the cubic by c² (1 − c)²/24 h⁴ u⁗. The stages of smooth components also
    have an error of their own, (Σ aᵢⱼ cⱼ³/6 − cᵢ⁴/24) h⁴ u⁗; stages that constraints determine have
    none. With these weights the estimate of h⁴ u⁗ is right in both cases.
    """
    c = A.sum(axis=1)
    off = (c**2 * (1.0 - c) ** 2 / 24.0)[:2]
    own = (A @ c**3 / 6.0 - c**4 / 24.0)[:2]
    return np.linalg.solve([off, off + own], [1.0 / 24.0, 1.0 / 24.0])


@kernel
def put_stage_weights(radau, share, weights):
    """Weights of the stages in the parabola through them, at a fraction of their step."""
    for j in range(STAGES):
        w = 1.0
        for k in range(STAGES):
            if k != j:
                w *= (share - radau.c[k]) / (radau.c[j] - radau.c[k])
        weights[j] = w


@kernel
def stage_sum(weights, rows, k):
    """Weighted sum of three rows, column k."""
    return weights[0] * rows[0, k] + weights[1] * rows[1, k] + weights[2] * rows[2, k]
