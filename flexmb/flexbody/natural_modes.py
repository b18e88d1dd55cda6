"""Natural modes of a flexible body with some of its interfaces held.

In: a body and names of interfaces. Out: frequencies [Hz] and shapes. The rigid motions of the frame
and the modal coordinates together, with the interfaces' six motions (as the rows of Phi say) at
zero; so the answer is that of the reduced model, exact in its static part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space

from flexmb.flexbody.arrays import FloatArray, skew
from flexmb.flexbody.body import FlexBody

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
    """Natural modes with these interfaces held.

    Parameters
    ----------
    body : FlexBody
        The body.
    interfaces : sequence of str
        Names; without any the body is free and its rigid motions are left out.
    rows : (n, 6 + m) array, optional
        Linear constraints in place of whole interfaces: their coefficients for the translation of
        the body frame, its rotation (body axes) and eta. Motions that they leave free have
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
    """(k,) natural frequencies [Hz] with these interfaces held; see :func:`natural_modes`."""
    return natural_modes(body, interfaces).frequencies


def free_motions(body: FlexBody, interfaces: Sequence[str]) -> FloatArray:
    """(6 + m, k) motions of the frame and eta with these interfaces held, of order one by mass.

    Without any the frame is held, so that rigid motions are left out.
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
    """(n, k) what rows leave free; each row and column is scaled to be of order one."""
    scaled = rows / size
    largest = np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.asarray(null_space(scaled / np.where(largest > 0.0, largest, 1.0)) / size[:, None])


def matrices_at_rest(body: FlexBody) -> tuple[FloatArray, FloatArray]:
    """Mass and stiffness (6 + m, 6 + m) at rest: translation, rotation about the origin, modes."""
    M = mass_at_rest(body.mass, body.S1, body.S0, body.p, body.P, body.M_eta)
    K = np.zeros_like(M)
    K[6:, 6:] = body.K
    return M, K


def mass_at_rest(
    mass: float, S1: FloatArray, S0: FloatArray, p: FloatArray, P: FloatArray, M_eta: FloatArray
) -> FloatArray:
    """Mass (6 + m, 6 + m) at rest in body axes from the integrals of a body."""
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
