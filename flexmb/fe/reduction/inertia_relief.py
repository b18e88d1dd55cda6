"""Inertia relief, inertia loads and residual vectors.

A free body under a load f accelerates as a whole. It is deformed by the load minus the inertia
forces of that acceleration, P f with P = I - M R (R^T M R)^-1 R^T; its deformation about mean axes
is P^T u.

Inertia loads are the d'Alembert forces of a body that accelerates and rotates. Its points have the
acceleration a + (α̃ + ω̃²) s, with s from the centre of mass: twelve numbers, each the factor of
one load M r on the mesh. Six of the fields r are rigid motions, for a and α; six are the symmetric
(e_a s_b + e_b s_a)/2, for ω̃². Modes of low frequency represent the responses badly: the first mode
in which a disc expands is the 41st or the 80th. If the static responses with the interfaces fixed
are added to the modes as residual vectors, expansion and stress under acceleration and spin are
exact in the static limit, with any number of modes. Constraint modes represent what the motion of
the interfaces does. Source: Rose (1991), Using residual vectors in MSC/NASTRAN dynamic analysis
(inertia relief).

Residual vectors are the parts of static responses that the retained modes do not contain. They
complete the modes so that the static response to each load is exact. They have diagonal mass and
stiffness among themselves and are orthogonal to the retained modes. Sources: Rose (1991); Craig,
Chang (1977), AIAA/ASME 18th SDM conference (residual attachment modes).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, solve_triangular
from scipy.linalg.lapack import dpstrf
from scipy.sparse import csr_array

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern, condensed_load
from flexmb.fe.reduction.eigenmodes import Modes, SymmetryPlane
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.flexbody.arrays import FloatArray, is_nonzero
from flexmb.flexbody.static_response import SYMMETRIC_PAIRS


def centrifugal_fields(fe: FEMatrices) -> list[tuple[FloatArray, FloatArray]]:
    """The six centrifugal fields: loads (n,) of G (s - c) per mass, and [G, -G c] (3, 4).

    G are the six symmetric unit matrices (e_a e_b^T + e_b e_a^T)/2, c is the centre of mass.
    """
    fields = []
    for a, b in SYMMETRIC_PAIRS:
        G = np.zeros((3, 3))
        G[a, b] += 0.5
        G[b, a] += 0.5
        field = np.column_stack([G, -G @ fe.center])
        fields.append((condensed_load(fe, fe.load_per_mass(field)), field))
    return fields


def inertia_loads(
    fe: FEMatrices, mirror: SymmetryPlane | None = None, rigid: bool = True
) -> FloatArray:
    """(n, 12) loads per unit of a, α and the six centrifugal fields.

    The first six are zero unless ``rigid``. In a planar reduction, loads that leave the plane are
    zero. So are centrifugal loads that are round-off of places, as those across a straight line.
    """
    rigid_loads = np.asarray(fe.M @ fe.rigid) * float(rigid)
    fields = np.column_stack([f for f, _ in centrifugal_fields(fe)])
    sizes = np.sum(fields**2 / fe.K.diagonal()[:, None], axis=0)
    fields[:, sizes <= _FIELD_ROUND_OFF**2 * sizes.max()] = 0.0
    F = np.column_stack([rigid_loads, fields])
    if mirror is not None:
        F[:, ~_is_in_plane(mirror.normal)] = 0.0
    return F if mirror is None else 0.5 * (F + mirror.S.T @ F)


def _is_in_plane(normal: int) -> np.ndarray:
    """(12,) bool: which inertia fields are symmetric about the plane normal to an axis."""
    slides = [axis != normal for axis in range(3)]
    pairs = [(a == normal) == (b == normal) for a, b in SYMMETRIC_PAIRS]
    return np.array([*slides, *(not slide for slide in slides), *pairs])


def inertia_responses(
    fe: FEMatrices, responses: FloatArray, mirror: SymmetryPlane | None
) -> FloatArray:
    """(n, r) the responses among the twelve that deform the body."""
    return deforming_responses(fe, responses, inertia_loads(fe, mirror))


class InertiaRelief:
    """Inertia relief with mass M (n, n) and rigid motions R (n, r)."""

    def __init__(self, M: csr_array | FloatArray, R: FloatArray) -> None:
        self._R, self._MR = R, M @ R
        gram = R.T @ self._MR
        size = np.sqrt(np.diag(gram))
        scale = np.where(size > 0, 1.0 / np.where(size > 0, size, 1.0), 0.0)
        values, Q = eigh(scale[:, None] * gram * scale)
        massive = is_nonzero(values)  # a line of point masses has no inertia about itself
        inverse = np.where(massive, 1.0 / np.where(massive, values, 1.0), 0.0)
        self._inverse = scale[:, None] * (Q * inverse) @ Q.T * scale

    def acceleration(self, f: FloatArray) -> FloatArray:
        """(r, ...) rigid acceleration under loads f (n, ...)."""
        return self._solve(self._R.T @ f)

    def inertia(self, f: FloatArray) -> FloatArray:
        """(n, ...) M R a: the inertia loads of the rigid acceleration under f, which relief
        subtracts."""
        return self._MR @ self.acceleration(f)

    def loads(self, f: FloatArray) -> FloatArray:
        """P f: loads (n, ...) in equilibrium with the inertia of the acceleration they cause."""
        return f - self.inertia(f)

    def fields(self, u: FloatArray) -> FloatArray:
        """P^T u: fields (n, ...) without their rigid motion, removed mass-orthogonally."""
        return u - self._R @ self._solve(self._MR.T @ u)

    def _solve(self, b: FloatArray) -> FloatArray:
        return self._inverse @ b


_REPRESENTED_ENERGY = (
    # share of a response's energy below which the rest is round-off: the modes contain the response
    1e-10
)
_FIELD_ROUND_OFF = 1e-10  # size of a centrifugal load over that of the largest, that is round-off
_RESPONSE_ROUND_OFF = (
    1e-14  # a response with less than this fraction of the energy F^2/K_ii of its load is round-off
)


def residual_vectors(fe: FEMatrices, responses: FloatArray, V: FloatArray) -> Modes:
    """Residual vectors: the parts of ``responses`` (n, r) outside of orthonormal modes V (n, m).

    Returns
    -------
    omega2 : (k,) float
        Stiffness over mass of each new vector, ascending; k <= r.
    U : (n, k) float
        The vectors, of unit modal mass.
    """
    if not responses.shape[1]:
        return np.zeros(0), responses
    X = responses - V @ (V.T @ (fe.M @ responses))
    X = X - V @ (V.T @ (fe.M @ X))
    X = X / np.sqrt(np.sum(responses * (fe.K @ responses), axis=0))
    energy = X.T @ (fe.K @ X)
    L, pivots, rank, _ = dpstrf(0.5 * (energy + energy.T), tol=_REPRESENTED_ENERGY, lower=1)
    independent = X[:, pivots[:rank] - 1]
    Y = solve_triangular(L[:rank, :rank], independent.T, lower=True).T if rank else independent
    mass = Y.T @ (fe.M @ Y)
    sigma, Q = eigh(0.5 * (mass + mass.T)) if rank else (np.zeros(0), np.zeros((0, 0)))
    sigma, Q = sigma[::-1], Q[:, ::-1]
    return 1.0 / sigma, Y @ (Q / np.sqrt(sigma))


def with_residual_vectors(fe: FEMatrices, modes: Modes, responses: FloatArray) -> Modes:
    """Modes, completed by the residual vectors of static responses."""
    stiff, U = residual_vectors(fe, responses, modes[1])
    return np.concatenate([modes[0], stiff]), np.concatenate([modes[1], U], axis=1)


def fixed_interface_responses(
    fixed: FixedInterfaceModel, relief: InertiaRelief, loads: tuple[LoadPattern, ...]
) -> FloatArray:
    """(n, r) responses to loads with the interfaces fixed, and to the inertia of the motion they
    cause."""
    F = load_columns(fixed.fe, loads)
    responses = fixed.solve(np.concatenate([F, relief.inertia(F)], axis=1))
    return deforming_responses(fixed.fe, responses, np.concatenate([F, F], axis=1))


def free_body_responses(
    fixed: FixedInterfaceModel, relief: InertiaRelief, F: FloatArray
) -> FloatArray:
    """(n, r) deformation of the free body under loads F (n, r), about mean axes."""
    return deforming_responses(fixed.fe, relief.fields(fixed.free(relief.loads(F))), F)


def deforming_responses(fe: FEMatrices, responses: FloatArray, F: FloatArray) -> FloatArray:
    """The responses (n, r) that are more than round-off of their loads F (n, r).

    Round-off alone are, for example, those to the weight of a free body or to the inertia of a load
    without resultant.
    """
    energy = np.sum(responses * (fe.K @ responses), axis=0)
    local = np.sum(F**2 / fe.K.diagonal()[:, None], axis=0)
    return responses[:, energy > _RESPONSE_ROUND_OFF * local]


def load_columns(fe: FEMatrices, loads: tuple[LoadPattern, ...]) -> FloatArray:
    """(n, r) the loads whose static responses the basis contains exactly."""
    columns = [load.f for load in loads if load.residual]
    return np.stack(columns, axis=1) if columns else np.zeros((fe.numbering.n, 0))


def residual_kind(loads: tuple[LoadPattern, ...], residual: str) -> str:
    """Kind of the residual vectors: to which loads they are static responses."""
    kinds = ("load",) * any(load.residual for load in loads) + ("inertia",) * (
        residual == "inertia"
    )
    return " and ".join(kinds)
