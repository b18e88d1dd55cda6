"""Stiffness of Hertz' contact of two elastic bodies: F = K d^(3/2).

With A ≤ B half the principal curvatures of the gap, e the eccentricity of the ellipse of contact
and K(e), E(e) the complete elliptic integrals,

    K = (2π E*/3) K(e)^(−3/2) ((K(e) − E(e))/(e² A))^(1/2),   B/A = (E/(1 − e²) − K)/(K − E),

which for round contact is (4/3) E* √R. Source: Johnson, Contact Mechanics (1985), ch. 4.
"""

from __future__ import annotations

import math

__all__ = ["hertz_stiffness", "plane_modulus"]

_ROUND = 1e-6  # relative difference of curvatures below which the ellipse is a circle


def plane_modulus(first: tuple[float, float], second: tuple[float, float]) -> float:
    """E* [Pa] of two materials (E [Pa], nu): 1/E* = (1 − ν₁²)/E₁ + (1 − ν₂²)/E₂."""
    return 1.0 / sum((1.0 - nu * nu) / E for E, nu in (first, second))


def hertz_stiffness(modulus: float, curvatures: tuple[float, float]) -> float:
    """K [N/m^1.5] of E* and the two principal relative curvatures [1/m], both positive.

    >>> round(hertz_stiffness(3.0, (1.0, 1.0)), 9)
    4.0
    """
    A, B = sorted(0.5 * c for c in curvatures)
    if B - A <= _ROUND * B:
        return 4.0 / 3.0 * modulus / math.sqrt(A + B)
    low, high = 0.0, 1.0  # of e², by bisection: B/A grows with it from 1 without bound
    for _ in range(100):
        m = 0.5 * (low + high)
        K, E = _elliptic(m)
        low, high = (m, high) if (E / (1.0 - m) - K) / (K - E) < B / A else (low, m)
    K, E = _elliptic(m)
    return 2.0 * math.pi * modulus / 3.0 * K**-1.5 * math.sqrt((K - E) / (m * A))


def _elliptic(m: float) -> tuple[float, float]:
    """Complete elliptic integrals K, E of the parameter m = e², by the arithmetic mean."""
    a, b, total, power = 1.0, math.sqrt(1.0 - m), 0.5 * m, 0.5
    while abs(a - b) > 1e-15 * a:
        c = 0.5 * (a - b)
        a, b = 0.5 * (a + b), math.sqrt(a * b)
        power *= 2.0
        total += power * c * c
    K = 0.5 * math.pi / a
    return K, K * (1.0 - total)
