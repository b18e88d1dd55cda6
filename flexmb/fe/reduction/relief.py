"""Loads and fields of a free body without their rigid part.

In: mass and rigid motions. Out: :class:`Relief`. A free body under a load accelerates as a whole;
what deforms it is the load less the inertia of that acceleration, P f with P = I - M R (R^T M R)^-1
R^T (inertia relief), and its deformation is told about mean axes, P^T u.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array

from flexmb.flexbody.arrays import FloatArray

__all__ = ["Relief"]

_MASSLESS = 1e-12  # relative; a line of point masses has no inertia about itself


class Relief:
    """Inertia relief with mass M (n, n) and rigid motions R (n, r)."""

    def __init__(self, M: csr_array, R: FloatArray) -> None:
        self._R, self._MR = R, M @ R
        gram = R.T @ self._MR
        size = np.sqrt(np.diag(gram))
        scale = np.where(size > 0, 1.0 / np.where(size > 0, size, 1.0), 0.0)
        values, Q = eigh(scale[:, None] * gram * scale)
        inverse = np.where(values > _MASSLESS, 1.0 / np.where(values > 0, values, 1.0), 0.0)
        self._inverse = scale[:, None] * (Q * inverse) @ Q.T * scale

    def acceleration(self, f: FloatArray) -> FloatArray:
        """(r, ...) rigid acceleration under loads f (n, ...)."""
        return self._solve(self._R.T @ f)

    def inertia(self, f: FloatArray) -> FloatArray:
        """(n, ...) inertia loads M R a of the rigid acceleration under f: what relief takes off."""
        return self._MR @ self.acceleration(f)

    def loads(self, f: FloatArray) -> FloatArray:
        """P f: loads (n, ...) in equilibrium with the inertia of the acceleration they cause."""
        return f - self.inertia(f)

    def fields(self, u: FloatArray) -> FloatArray:
        """P^T u: fields (n, ...) without rigid motion, in the measure of the mass."""
        return u - self._R @ self._solve(self._MR.T @ u)

    def _solve(self, b: FloatArray) -> FloatArray:
        return self._inverse @ b
