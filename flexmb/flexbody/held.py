"""Natural frequencies of a flexible body with some of its interfaces held.

In: a body and names of interfaces. Out: frequencies [Hz]. The rigid motions of the frame and the
modal coordinates together, with the interfaces' six motions (as the rows of Phi say) at zero; so
the answer is that of the reduced model, exact in its static part.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import eigh, null_space

from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody

__all__ = ["held_frequencies"]

_PAIRS = ((1, 2), (2, 0), (0, 1))


def held_frequencies(body: FlexBody, interfaces: Sequence[str] = ()) -> FloatArray:
    """Frequencies with these interfaces held.

    Parameters
    ----------
    body : FlexBody
        The body.
    interfaces : sequence of str
        Names; without any the body is free and its rigid motions are left out.

    Returns
    -------
    (k,) float
        Ascending [Hz].

    Raises
    ------
    ReductionError
        An unknown interface.
    """
    if not interfaces:
        return body.frequencies
    M, K = _matrices(body)
    rows = []
    for name in interfaces:
        part = body.interface(name)
        arm = _cross(part.position)
        rows.append(np.hstack([np.eye(3), -arm, part.Phi_t]))
        rows.append(np.hstack([np.zeros((3, 3)), np.eye(3), part.Phi_r]))
    free = null_space(np.vstack(rows) / np.sqrt(np.diag(M))) / np.sqrt(np.diag(M))[:, None]
    omega2 = eigh(free.T @ K @ free, free.T @ M @ free, eigvals_only=True)
    return np.asarray(np.sqrt(np.maximum(omega2, 0.0)) / (2 * np.pi))


def _matrices(body: FlexBody) -> tuple[FloatArray, FloatArray]:
    """Mass and stiffness (6 + m, 6 + m) at rest: translation, rotation about the origin, modes."""
    n = 6 + body.m
    M, K = np.zeros((n, n)), np.zeros((n, n))
    M[:3, :3] = body.mass * np.eye(3)
    M[:3, 3:6] = -_cross(body.S1)
    M[3:6, 3:6] = np.trace(body.S0) * np.eye(3) - body.S0
    M[:3, 6:] = body.p
    M[3:6, 6:] = [body.P[a, b] - body.P[b, a] for a, b in _PAIRS]
    M[6:, 6:], K[6:, 6:] = body.M_eta, body.K
    lower = np.tril_indices(n, -1)
    M[lower] = M.T[lower]
    return M, K


def _cross(s: FloatArray) -> FloatArray:
    """(3, 3) with _cross(s) @ u = s x u."""
    x, y, z = s
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
