"""Membrane stiffness: the strain energy of a plate or shell that stretches as it bends.

A displacement u has the Green-Lagrange strain E = ε(u) + (∇uᵀ ∇u)/2. With the coordinates a = A η
of a few shapes and the products y of these by pairs, the strain energy of the body is

    U = ηᵀ K η/2 + ηᵀ C y + yᵀ V y/2.

C is the work of the stress of each mode at the second-order strains, and V the energy of these
strains after the points of the body have moved in its surface to where it is least, the interfaces
moving along arcs as they turn, and the modes at rest. It does not depend on the body frame.
Sources: Timoshenko & Woinowsky-Krieger, Theory of Plates and Shells, §101-103; Mignolet et al., A
review of indirect/non-intrusive reduced order modeling of nonlinear geometric structures, J. Sound
Vib. 332 (2013) 2437.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from flexmb.flexbody.arrays import Checker, FloatArray, IntArray

_STEPS, _ITERATIONS = 8, 30  # of the load; of Newton's method in each of them, at most
_CONVERGED = 1e-9  # change of the coordinates over these
_MAIN_SHARE = 0.03  # strain energy of a main shape over the largest, from which on it is one


def shape_pairs(count: int) -> tuple[IntArray, IntArray]:
    """Both numbers i <= j of each product of two of so many shapes."""
    first, second = np.triu_indices(count)
    return first, second


def small_load(excess: Callable[[float], float], end: float) -> float:
    """The load up to `end` from which on an excess is positive that falls with smaller loads.

    It may be many powers of ten below `end`: a foil is as stiff as linear theory says only while it
    deflects by less than its thickness.
    """
    if excess(end) < 0.0:
        return end
    while excess(0.1 * end) > 0.0:
        end *= 0.1
    return float(brentq(excess, 0.1 * end, end, xtol=1e-4 * end, rtol=1e-3))


@dataclass(frozen=True, eq=False)
class MembraneStiffness:
    """Strain energy of second-order strains, by products of pairs of the coordinates of k shapes.

    Parameters
    ----------
    shapes : (k, m) float
        Coordinates of the shapes per unit eta, A.
    linear : (m, k (k + 1)/2) float
        Its part that is linear in eta, C [J]; of a pair of two shapes that of both orders together.
    quadratic : (k (k + 1)/2, k (k + 1)/2) float
        Its part of products alone, V [J].

    Raises
    ------
    ReductionError
        Shapes that disagree or are more than the modes, numbers that are not finite, or a negative
        energy.
    """

    shapes: FloatArray
    linear: FloatArray
    quadratic: FloatArray

    def __post_init__(self) -> None:
        check = Checker("membrane stiffness")
        k, m = np.shape(self.shapes) if np.ndim(self.shapes) == 2 else (0, 0)
        pairs = k * (k + 1) // 2
        shapes = {"shapes": (k, m), "linear": (m, pairs), "quadratic": (pairs, pairs)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, check.floats(name, getattr(self, name), shape))
        if k > m:
            check.add("shapes", f"are {k}, more than the {m} modes of the body")
        check.raise_problems()
        V = self.quadratic
        if not np.allclose(V, V.T, rtol=0.0, atol=1e-8 * np.abs(V).max(initial=0.0)):
            check.add("quadratic", "is not symmetric")
        elif pairs and np.linalg.eigvalsh(V)[0] < -1e-6 * np.abs(V).max():
            check.add("quadratic", "has a negative eigenvalue: stretching takes energy")
        check.raise_problems()

    def beside_geometric_stiffness(self, K: FloatArray) -> MembraneStiffness:
        """What is left if geometric stiffening has the loads at interfaces and of inertia.

        With these the modes, of stiffness K (m, m), move by −K⁻¹ C y to where the energy is least.
        """
        left = self.quadratic - self.linear.T @ np.linalg.solve(K, self.linear)
        values, vectors = np.linalg.eigh(left)
        left = (vectors * values.clip(0.0)) @ vectors.T
        return MembraneStiffness(self.shapes, np.zeros_like(self.linear), left)

    def main_shapes(self, eta: FloatArray, K: FloatArray) -> MembraneStiffness:
        """That of the shapes with most of the strain energy in a deformation eta (m,).

        K (m, m) is the stiffness of the modes.
        """
        energy = np.diag(self._stiffness(K)) * (self.shapes @ eta) ** 2
        keep = np.flatnonzero(energy >= _MAIN_SHARE * energy.max())
        pairs = np.flatnonzero(np.isin(shape_pairs(len(energy)), keep).all(axis=0))
        return MembraneStiffness(
            self.shapes[keep], self.linear[:, pairs], self.quadratic[np.ix_(pairs, pairs)]
        )

    def deformations(self, K: FloatArray) -> FloatArray:
        """(m, k) deformations of the shapes, whose coordinates are one."""
        return np.asarray(np.linalg.solve(K, self.shapes.T @ self._stiffness(K)))

    def _stiffness(self, K: FloatArray) -> FloatArray:
        """(k, k) of the shapes, from that of the modes (m, m)."""
        return np.linalg.pinv(self.shapes @ np.linalg.solve(K, self.shapes.T), hermitian=True)

    def in_coordinates(self, Z: FloatArray) -> MembraneStiffness:
        """The same for modal coordinates Z (m, k); then these are the shapes, if they are fewer."""
        shapes, linear = self.shapes @ Z, Z.T @ self.linear
        count = Z.shape[1]
        if count >= len(shapes):
            return MembraneStiffness(shapes, linear, self.quadratic)
        first, second = shape_pairs(count)
        i, j = shape_pairs(len(shapes))
        both = shapes[i][:, first] * shapes[j][:, second]
        both += np.where(first == second, 0.0, shapes[i][:, second] * shapes[j][:, first])
        return MembraneStiffness(np.eye(count), linear @ both, both.T @ self.quadratic @ both)

    def products(self, eta: FloatArray) -> FloatArray:
        """(..., k (k + 1)/2) products of the coordinates of shapes, by eta (..., m)."""
        a = eta @ self.shapes.T
        first, second = shape_pairs(len(self.shapes))
        return np.asarray(a[..., first] * a[..., second])

    def energy(self, eta: FloatArray) -> FloatArray:
        """(...) part of the strain energy, by eta (..., m) [J]."""
        y = self.products(eta)
        linear = np.einsum("...i,ij,...j->...", eta, self.linear, y)
        return np.asarray(linear + 0.5 * np.einsum("...i,ij,...j->...", y, self.quadratic, y))

    def forces(self, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(m,) modal forces that oppose this deformation eta (m,), and their derivative (m, m)."""
        y, slopes = self.products(eta), self._slopes(eta)
        stress = self.linear.T @ eta + self.quadratic @ y
        forces = self.linear @ y + slopes.T @ stress
        both = self.linear @ slopes
        tangent = both + both.T + slopes.T @ self.quadratic @ slopes
        return forces, tangent + self.curvatures(stress)

    def curvatures(self, values: FloatArray) -> FloatArray:
        """(..., m, m) second derivatives by eta of the products times values (..., p)."""
        first, second = shape_pairs(len(self.shapes))
        forms = np.zeros((*values.shape[:-1], *(len(self.shapes),) * 2))
        forms[..., first, second] += values
        forms[..., second, first] += values
        return np.asarray(self.shapes.T @ forms @ self.shapes)

    def equilibrium(self, eta: FloatArray, compliance: FloatArray) -> FloatArray | None:
        """(m,) deformation under the load that without membrane stiffness causes eta (m,).

        Parameters
        ----------
        eta : (m,) float
            The deformation by K alone.
        compliance : (m, m) float
            Deformation per modal force, of the body as it is held.

        Returns
        -------
        (m,) float or None
            None if the body snaps through before the whole load acts.
        """
        bent, one = np.zeros_like(eta), np.eye(len(eta))
        for load in np.arange(1, _STEPS + 1) / _STEPS:
            for _ in range(_ITERATIONS):
                forces, tangent = self.forces(bent)
                residual = bent + compliance @ forces - load * eta
                step = np.linalg.solve(one + compliance @ tangent, residual)
                bent = bent - step
                if np.linalg.norm(step) <= _CONVERGED * np.linalg.norm(bent):
                    break
            else:
                return None
        return bent

    def _slopes(self, eta: FloatArray) -> FloatArray:
        """(k (k + 1)/2, m) derivatives of the products."""
        first, second = shape_pairs(len(self.shapes))
        a = self.shapes @ eta
        return np.asarray(
            a[first, None] * self.shapes[second] + a[second, None] * self.shapes[first]
        )
