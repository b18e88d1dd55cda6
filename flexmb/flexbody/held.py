"""Natural modes of a flexible body with some of its interfaces held.

In: a body, interfaces or single motions of them. Out: frequencies and shapes. With d and theta a
small displacement and rotation of the body frame, a point s moves by d + theta x s + Phi eta; its
mass matrix follows from the inertia integrals, its stiffness is that of eta, and each held motion
of an interface is one equation. Source: Shabana, Dynamics of Multibody Systems, ch. 5, at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody

__all__ = ["MOTIONS", "HeldModes", "held_modes"]

MOTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""Motions of an interface along and about the body axes."""
_RIGID = 1e-7  # of the highest frequency; what is lower is a motion without strain


@dataclass(frozen=True, eq=False)
class HeldModes:
    """Natural modes of a held body, ascending in frequency.

    Parameters
    ----------
    frequencies : (k,) float
        Hz.
    frame : (6, k) float
        Displacement [m] of the body frame and its small rotation [rad], unit modal mass.
    eta : (m, k) float
        Modal coordinates.
    """

    frequencies: FloatArray
    frame: FloatArray
    eta: FloatArray

    def shapes(self, points: FloatArray, modes: FloatArray) -> FloatArray:
        """(n, 3, k) displacement of points (n, 3) that the body's modes (n, 3, m) move."""
        turned = np.cross(self.frame[3:].T[None], points[:, None]).transpose(0, 2, 1)
        return np.asarray(self.frame[:3] + turned + modes @ self.eta)


def held_modes(body: FlexBody, held: Sequence[str] = ()) -> HeldModes:
    """Natural modes with motions of interfaces held; motions without strain are left out.

    Parameters
    ----------
    body : FlexBody
        The body.
    held : sequence of str
        Interfaces such as ``"root"``, all six of its motions, or ``"root.x"``, ``"root.rz"``.

    Raises
    ------
    ReductionError
        No such interface or motion, or a body without modes.
    """
    if body.m == 0:
        what = "has no modes"
        raise ReductionError.from_problems([Problem(f"body {body.name}", what)])
    rows = [_rows(body, text) for text in held]
    K = np.zeros((6 + body.m,) * 2)
    K[6:, 6:] = body.K
    Z = null_space(np.concatenate(rows), rcond=1e-10) if rows else np.eye(len(K))
    M = Z.T @ _mass(body) @ Z
    values, W = eigh(Z.T @ K @ Z, 0.5 * (M + M.T))
    omega = np.sqrt(np.maximum(values, 0.0))
    elastic = omega > _RIGID * omega[-1]
    shapes = Z @ W[:, elastic]
    largest = np.abs(shapes[6:]).argmax(axis=0)
    shapes = shapes * np.sign(shapes[6 + largest, np.arange(len(largest))])
    return HeldModes(omega[elastic] / (2 * np.pi), shapes[:6], shapes[6:])


def _mass(body: FlexBody) -> FloatArray:
    """(6 + m, 6 + m) mass matrix at rest, rotations about the origin of the body frame."""
    M = np.zeros((6 + body.m,) * 2)
    M[:3, :3] = body.mass * np.eye(3)
    M[3:6, 3:6] = np.trace(body.S0) * np.eye(3) - body.S0
    M[:3, 3:6] = -_skew(body.S1)
    M[:3, 6:] = body.p
    M[3:6, 6:] = [body.P[a, b] - body.P[b, a] for a, b in ((1, 2), (2, 0), (0, 1))]
    M[6:, 6:] = body.M_eta
    return np.asarray(np.triu(M) + np.triu(M, 1).T)


def _rows(body: FlexBody, text: str) -> FloatArray:
    """(1 or 6, 6 + m) the motions of the interface, or one of them."""
    name, dot, motion = text.partition(".")
    part = body.interface(name)
    if dot and motion not in MOTIONS:
        what, near = f'"{motion}" is no motion of an interface', nearest(motion, MOTIONS)
        raise ReductionError.from_problems([Problem(f"held {text}", what, MOTIONS, near)])
    rows = np.zeros((6, 6 + body.m))
    rows[:3, :3] = rows[3:, 3:6] = np.eye(3)
    rows[:3, 3:6] = -_skew(part.position)
    rows[:3, 6:], rows[3:, 6:] = part.Phi_t, part.Phi_r
    return rows[[MOTIONS.index(motion)]] if dot else rows


def _skew(s: FloatArray) -> FloatArray:
    x, y, z = s
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
