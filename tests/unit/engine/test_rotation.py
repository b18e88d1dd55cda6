"""Coefficients of the rotation tangent at every size of angle, against their power series."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexmb.engine.algebra.vector import tangent_coefficients


def series(x):
    """Σ (−x)^k/(2k+2)!, Σ (−x)^k/(2k+3)! and their derivatives; x is an angle squared."""
    k = range(25)
    c1 = math.fsum((-x) ** i / math.factorial(2 * i + 2) for i in k)
    c2 = math.fsum((-x) ** i / math.factorial(2 * i + 3) for i in k)
    d1 = math.fsum(-i * (-x) ** (i - 1) / math.factorial(2 * i + 2) for i in k[1:])
    d2 = math.fsum(-i * (-x) ** (i - 1) / math.factorial(2 * i + 3) for i in k[1:])
    return c1, c2, d1, d2


@pytest.mark.parametrize("x", [0.0, 1e-12, 1e-4, 9.99e-3, 1.001e-2, 0.1, 1.0, 9.0])
def test_tangent_coefficients(x):
    found = tangent_coefficients(x)
    np.testing.assert_allclose(found[:2], series(x)[:2], rtol=1e-12)
    # Beside the switch to the series the derivatives lose digits; they are used times x.
    np.testing.assert_allclose(found[2:], series(x)[2:], rtol=1e-9)
