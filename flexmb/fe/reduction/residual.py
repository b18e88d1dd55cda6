"""Residual vectors: the static responses that the kept modes leave out.

In: static responses to loads, and the modes that are kept already. Out: vectors that complete them,
with diagonal mass and stiffness among themselves and orthogonal to the kept modes, so that the
static response to each load is exact. Responses the basis holds already give none. Source: Rose
(1991), Using residual vectors in MSC/NASTRAN dynamic analysis; Craig, Chang (1977), AIAA/ASME 18th
SDM conference (residual attachment modes).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, solve_triangular
from scipy.linalg.lapack import dpstrf

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.held import Held
from flexmb.fe.reduction.relief import Relief
from flexmb.flexbody.arrays import FloatArray

__all__ = [
    "deforming",
    "held_responses",
    "load_columns",
    "relieved_responses",
    "residual_vectors",
]

_HELD = 1e-10  # share of a response's energy below which the kept modes hold it but for rounding
_NOTHING = 1e-14  # of what a load would do to its own degrees of freedom, the rest held: rounding

Modes = tuple[FloatArray, FloatArray]


def residual_vectors(fe: FEMatrices, responses: FloatArray, V: FloatArray) -> Modes:
    """What ``responses`` (n, r) add to orthonormal modes V (n, m).

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
    L, pivots, rank, _ = dpstrf(0.5 * (energy + energy.T), tol=_HELD, lower=1)
    chosen = X[:, pivots[:rank] - 1]
    Y = solve_triangular(L[:rank, :rank], chosen.T, lower=True).T if rank else chosen
    mass = Y.T @ (fe.M @ Y)
    sigma, Q = eigh(0.5 * (mass + mass.T)) if rank else (np.zeros(0), np.zeros((0, 0)))
    sigma, Q = sigma[::-1], Q[:, ::-1]
    return 1.0 / sigma, Y @ (Q / np.sqrt(sigma))


def held_responses(held: Held, relief: Relief, loads: tuple[LoadPattern, ...]) -> FloatArray:
    """(n, r) responses of the held body to loads, and to the inertia of the motion they cause.

    With both, the response is exact whether reactions at the interfaces or the inertia of the
    free body balance the load.
    """
    F = load_columns(held.fe, loads)
    responses = held.solve(np.concatenate([F, relief.inertia(F)], axis=1))
    return deforming(held.fe, responses, np.concatenate([F, F], axis=1))


def relieved_responses(held: Held, relief: Relief, F: FloatArray) -> FloatArray:
    """(n, r) deformation of the free body under loads F (n, r), about mean axes."""
    return deforming(held.fe, relief.fields(held.free(relief.loads(F))), F)


def deforming(fe: FEMatrices, responses: FloatArray, F: FloatArray) -> FloatArray:
    """The responses (n, r) that are more than rounding of loads (n, r) leaves.

    Such are those to the weight of a free body, or to the inertia of a load without resultant.
    """
    energy = np.sum(responses * (fe.K @ responses), axis=0)
    local = np.sum(F**2 / fe.K.diagonal()[:, None], axis=0)
    return responses[:, energy > _NOTHING * local]


def load_columns(fe: FEMatrices, loads: tuple[LoadPattern, ...]) -> FloatArray:
    """(n, r) the loads whose static response the basis shall hold."""
    chosen = [load.f for load in loads if load.residual]
    return np.stack(chosen, axis=1) if chosen else np.zeros((fe.numbering.n, 0))
