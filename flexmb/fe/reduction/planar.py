"""Modes that are symmetric about a coordinate plane, for bodies of planar scenes.

In: a finite-element model and the name of a plane of its frame. Out: :class:`Mirror`, which tells
in-plane motions of interfaces from others and picks the in-plane combinations of modes. The
symmetric subspace is found among all modes at once, so that pairs of equal or nearly equal
frequency, which an eigensolver mixes at will, fall apart into in-plane and out-of-plane ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array

from flexmb.errors import Problem, ReductionError, nearest
from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.reduction.reflection import antisymmetric, reflection
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.planes import PLANES

__all__ = ["Mirror", "make_mirror", "symmetric_modes"]

_SPARE = 2  # modes found beyond those asked: the last ones may want partners not yet computed
_HALF = 0.5  # share of energy from which on a mode counts as out of the plane

Modes = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class Mirror:
    """A plane of symmetry of a model, through its centre of mass.

    Parameters
    ----------
    plane : str
        ``"xy"``, ``"yz"`` or ``"zx"``.
    S : (n, n) sparse
        Reflection of displacement fields.
    """

    plane: str
    S: csr_array

    @property
    def normal(self) -> int:
        """Axis across the plane, 0 to 2."""
        return int(np.argmax(PLANES[self.plane]))

    @property
    def directions(self) -> tuple[int, ...]:
        """In-plane motions of an interface: two of Tx, Ty, Tz and one of Rx, Ry, Rz (0 to 5)."""
        slides = [axis for axis in range(3) if axis != self.normal]
        return (*slides, 3 + self.normal)

    def on(self, dofs: IntArray) -> csr_array:
        """The reflection of fields that live on some degrees of freedom."""
        return self.S[dofs][:, dofs]

    def shares(self, fe: FEMatrices, V: FloatArray) -> FloatArray:
        """(m,) share of each field's kinetic energy that is antisymmetric."""
        odd, whole = antisymmetric(fe.M, self.S, V)
        return np.diag(odd) / np.diag(whole)


def make_mirror(fe: FEMatrices, plane: str) -> Mirror:
    """The mirror of a plane.

    Raises
    ------
    ReductionError
        The plane is none of "xy", "yz", "zx".
    """
    if plane not in PLANES:
        names = tuple(PLANES)
        what = f'unknown plane "{plane}"'
        raise ReductionError.from_problems([Problem("plane", what, names, nearest(plane, names))])
    return Mirror(plane, reflection(fe, int(np.argmax(PLANES[plane]))))


def symmetric_modes(
    S: csr_array, M: csr_array, lowest: Callable[[int], Modes], modes: int, limit: int
) -> Modes:
    """The lowest modes of the symmetric subspace.

    Parameters
    ----------
    S, M : (n, n) sparse
        Reflection and mass.
    lowest : callable
        Squared frequencies and mass-normalised modes of the model, so many.
    modes : int
        How many symmetric ones are wanted; a few more are returned, or all there are.
    limit : int
        How many modes the model has in all.
    """
    if modes == 0:
        return lowest(0)
    count = min(int(2.5 * modes) + 2 * _SPARE, limit)
    while True:
        omega2, V = lowest(count)
        share, Q = eigh(*antisymmetric(M, S, V))
        even = Q[:, share < _HALF]
        if even.shape[1] >= modes + _SPARE or count == limit:
            break
        missing = (modes + _SPARE) / max(even.shape[1], 1)
        count = min(count + 2 * _SPARE + int(min(1.2 * missing - 1, 1.5) * count), limit)
    found, W = eigh(even.T @ (omega2[:, None] * even), even.T @ even)
    return found, V @ (even @ W)
