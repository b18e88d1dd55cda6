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
# Energy of the static response to a load that the lowest shapes lack, over the whole, from which on
# it is a shape too.
_LEAST_ENERGY = 1e-6
_BENDING = (
    25.0  # square of a rate over that of the fastest of the lowest shapes, up to which it bends
)
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
    own = _with_responses(body, at_rest, _lowest(body, at_rest))
    shapes = np.hstack([own, _lowest(body, _other_modes(body, at_rest))])
    turns = [end.Phi_r @ shapes for end in body.interfaces]
    F, V = second_order_loads(fe, elastic.Phi @ shapes, basis.interfaces, turns)
    C = elastic.Phi.T @ F
    moved = at_rest.T @ C  # the modes move by themselves, not with the loads
    V = V - F.T @ basis.fixed_response(F)
    V = V + moved.T @ np.linalg.solve(at_rest.T @ body.K @ at_rest, moved)
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


def _with_responses(body: FlexBody, space: FloatArray, shapes: FloatArray) -> FloatArray:
    """(m, l) shapes (m, k) in `space` (m, j), and what they lack of its responses to loads.

    These are the static responses to the loads of the body and to its uniform acceleration, if
    they bend it: their rate is not much above those of the shapes.
    """
    if not space.shape[1]:
        return shapes
    stiffness, inertia = space.T @ body.K @ space, body.M_eta
    fastest = max(x @ body.K @ x / (x @ inertia @ x) for x in shapes.T)
    for loads in [one.modal[None] for one in body.loads] + [body.p]:
        responses = space @ np.linalg.solve(stiffness, space.T @ loads.T)
        least = _LEAST_ENERGY * np.einsum("ik,ij,jk->k", responses, body.K, responses).max()
        for response in responses.T:
            rest = response.copy()
            for _ in range(2):  # without the shapes, twice for round-off
                inside = shapes.T @ body.K @ rest
                rest -= shapes @ np.linalg.solve(shapes.T @ body.K @ shapes, inside)
            energy, mass = (rest @ matrix @ rest for matrix in (body.K, inertia))
            if energy > least and energy < _BENDING * fastest * mass:
                shapes = np.column_stack([shapes, rest / np.sqrt(mass)])
    return shapes


def _lowest(body: FlexBody, space: FloatArray) -> FloatArray:
    """(m, k) lowest modes among the combinations `space` (m, j)."""
    if not space.shape[1]:
        return space
    values = eigh(space.T @ body.K @ space, space.T @ body.M_eta @ space)
    return np.asarray(space @ values[1][:, :_MAX_SHAPES])
