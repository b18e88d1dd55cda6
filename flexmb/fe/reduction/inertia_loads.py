"""A body's own inertia loads: what a body that accelerates and turns does to itself.

Its points have the acceleration a + (α̃ + ω̃²) s, with s from the centre of mass: twelve numbers, of
which each is the factor of one load M r on the mesh. Six fields r are rigid motions, for a and α,
and six the symmetric (e_a s_b + e_b s_a)/2, for ω̃². Modes of low frequency answer them badly: the
first mode in which a disc grows is the 41st or the 80th. Their static responses with the interfaces
held, joined to the modes as residual vectors, make growth and stress under acceleration and spin
exact in the static limit, with any number of modes. Constraint modes answer what the interfaces do.
Source: Rose (1991), Using residual vectors in MSC/NASTRAN dynamic analysis (inertia relief).
"""

from __future__ import annotations

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.reduction.eigenmodes import SymmetryPlane
from flexmb.fe.reduction.inertia_relief import InertiaRelief, deforming_responses
from flexmb.fe.reduction.reduced_basis import ReducedBasis, ReducedModes
from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.parts import SYMMETRIC_PAIRS, InertiaResponse

Gradient = FloatArray


def centrifugal_fields(fe: FEMatrices) -> list[tuple[FloatArray, Gradient]]:
    """The fields G s of the six symmetric G: at the degrees of freedom (n,), and G (3, 3)."""
    arms, axes = fe.dof_points - fe.center, fe.rigid[:, :3]
    fields = []
    for a, b in SYMMETRIC_PAIRS:
        G = np.zeros((3, 3))
        G[a, b] += 0.5
        G[b, a] += 0.5
        fields.append((np.sum(axes * (arms @ G), axis=1), G))
    return fields


def inertia_loads(
    fe: FEMatrices, mirror: SymmetryPlane | None = None, rigid: bool = True
) -> FloatArray:
    """(n, 12) loads per unit of a, α and the six centrifugal fields; zero where not ``rigid``.

    Of a planar reduction those that leave the plane are zero too.
    """
    fields = np.column_stack([fe.rigid * float(rigid), *(w for w, _ in centrifugal_fields(fe))])
    if mirror is not None:
        fields[:, ~_is_in_plane(mirror.normal)] = 0.0
    F = np.asarray(fe.M @ fields)
    return F if mirror is None else 0.5 * (F + mirror.S.T @ F)


def _is_in_plane(normal: int) -> np.ndarray:
    """(12,) which fields are symmetric about a plane."""
    slides = [axis != normal for axis in range(3)]
    pairs = [(a == normal) == (b == normal) for a, b in SYMMETRIC_PAIRS]
    return np.array([*slides, *(not slide for slide in slides), *pairs])


def inertia_responses(
    fe: FEMatrices, responses: FloatArray, mirror: SymmetryPlane | None
) -> FloatArray:
    """(n, r) those of the twelve responses that deform the body."""
    return deforming_responses(fe, responses, inertia_loads(fe, mirror))


def inertia_response(
    fe: FEMatrices, basis: ReducedBasis, elastic: ReducedModes
) -> InertiaResponse | None:
    """Energies of the static responses to inertia loads, and what the modes lack of them."""
    X = basis.inertia
    if X is None:
        return None
    KX = fe.K @ X
    Y = X - elastic.Phi @ ((elastic.Phi.T @ KX) / elastic.omega2[:, None])
    moved = InertiaRelief(fe.M, fe.rigid).fields(Y)
    forms = (X.T @ KX, Y.T @ (fe.K @ Y), moved.T @ (fe.M @ moved))
    return InertiaResponse(*(0.5 * (form + form.T) for form in forms))
