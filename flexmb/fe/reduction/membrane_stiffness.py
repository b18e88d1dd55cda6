"""Membrane stiffness of a reduced body, from its finite elements.

The shapes are the lowest modes with the interfaces at rest, and the lowest of the other modes,
which are orthogonal to these in stiffness. In its surface the body moves to where the energy is
least, by what its modes lack of that motion, while its interfaces move along arcs as they turn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import eigh, null_space

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.second_order_strains import has_second_order_strains, second_order_loads
from flexmb.fe.reduction.reduced_basis import ReducedBasis, ReducedModes
from flexmb.flexbody.arrays import FloatArray, skew
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.membrane_stiffness import MembraneStiffness
from flexmb.progress import Progress, silent

# Shapes of each sort. With six, a clamped square is within 1 % up to 1.5 times its thickness.
_MAX_SHAPES = 6
_BAR = 0.01  # ratio of second moments of mass across and along, up to which a body is a bar


def with_membrane_stiffness(
    body: FlexBody,
    fe: FEMatrices,
    basis: ReducedBasis,
    elastic: ReducedModes,
    progress: Progress = silent,
) -> FlexBody:
    """The body with its membrane stiffness, if it is a plate or shell with interfaces.

    Parameters
    ----------
    body : FlexBody
        The reduced body.
    fe : FEMatrices
        Its model.
    basis, elastic : ReducedBasis, ReducedModes
        Its basis and its modes.
    progress : Progress
        Called with the phase ``"membrane"``.
    """
    if basis.fixed_response is None or not body.m or not _is_plate(body, fe):
        return body
    progress("membrane", 0.0)
    at_rest = _modes_at_rest(body)
    shapes = np.hstack([_lowest(body, at_rest), _lowest(body, _other_modes(body, at_rest))])
    turns = [end.Phi_r @ shapes for end in body.interfaces]
    F, V = second_order_loads(fe, elastic.Phi @ shapes, basis.interfaces, turns)
    C = elastic.Phi.T @ F
    own = at_rest.T @ C  # the modes move by themselves, not with the loads
    V = V - F.T @ basis.fixed_response(F)
    V = V + own.T @ np.linalg.solve(at_rest.T @ body.K @ at_rest, own)
    progress("membrane", 1.0)
    coordinates = np.linalg.solve(shapes.T @ body.K @ shapes, shapes.T @ body.K)
    stiffness = MembraneStiffness(coordinates, C, 0.5 * (V + V.T))
    return replace(body, membrane_stiffness=stiffness)


def _is_plate(body: FlexBody, fe: FEMatrices) -> bool:
    """Whether elements have second-order strains, and the body is neither a bar nor compact."""
    _, wide, long = np.linalg.eigvalsh(body.S0 - np.outer(body.S1, body.S1) / body.mass)
    return bool(wide > _BAR * long) and has_second_order_strains(fe)


def _modes_at_rest(body: FlexBody) -> FloatArray:
    """(m, j) combinations of modes that with a rigid motion leave all interfaces at rest."""
    length, rows = body.characteristic_length, []
    for end in body.interfaces:  # rotations as displacements at that length
        arm = (end.position - body.center) / length
        rows.append(np.hstack([end.Phi_t, np.eye(3), -skew(arm)]))
        rows.append(np.hstack([length * end.Phi_r, np.zeros((3, 3)), np.eye(3)]))
    A, scale = np.vstack(rows), np.ones(body.m + 6)
    scale[: body.m] = np.abs(A[:, : body.m]).max() or 1.0
    return np.asarray((null_space(A / scale) / scale[:, None])[: body.m])


def _other_modes(body: FlexBody, at_rest: FloatArray) -> FloatArray:
    """(m, l) combinations of modes that are orthogonal in stiffness to those at rest (m, j)."""
    size = np.sqrt(np.diag(body.K))
    return np.asarray(null_space((body.K @ at_rest / size[:, None]).T) / size[:, None])


def _lowest(body: FlexBody, space: FloatArray) -> FloatArray:
    """(m, k) lowest modes among the combinations `space` (m, j)."""
    if not space.shape[1]:
        return space
    values = eigh(space.T @ body.K @ space, space.T @ body.M_eta @ space)
    return np.asarray(space @ values[1][:, :_MAX_SHAPES])
