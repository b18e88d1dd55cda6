"""Membrane stiffness of a reduced body, from its finite elements.

The shapes are modes with the interfaces at rest: the lowest, and those in the static responses to
loads, with what is left of these; and the lowest of the other modes, which are orthogonal to these
in stiffness. In its surface the body moves to where the energy is
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

# Lowest modes that are shapes: of those that leave interfaces at rest, and of the others. Of the
# former as many more as the second number that have a part in responses to loads.
_LOWEST, _LOWEST_OF_OTHERS, _OF_RESPONSES = 3, 6, 5
# Least strain energy of that part, and of what is left of a response, over the whole response.
_LEAST_ENERGY = 1e-6
_NO_WORK = 1e-12  # energy of a response over the largest that the load could have, of round-off
# Square of the rate of a response over that of the tenth mode, up to which it bends the body.
_BENDING, _TENTH = 10.0, 10
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
    at_rest, rigid = _modes_at_rest(body)
    others, _ = _modes_of(body, _other_modes(body, at_rest))
    shapes = np.hstack([_shapes_at_rest(body, at_rest, rigid), others[:, :_LOWEST_OF_OTHERS]])
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


def _modes_at_rest(body: FlexBody) -> tuple[FloatArray, FloatArray]:
    """(m, j) combinations of modes that with a rigid motion leave all interfaces at rest.

    And that motion (6, j): translation of the centre of mass [m], rotation [rad].
    """
    length, rows = body.characteristic_length, []
    for end in body.interfaces:  # rotations as displacements at that length
        arm = (end.position - body.center) / length
        rows.append(np.hstack([end.Phi_t, np.eye(3), -skew(arm)]))
        rows.append(np.hstack([length * end.Phi_r, np.zeros((3, 3)), np.eye(3)]))
    A, scale = np.vstack(rows), np.ones(body.m + 6)
    scale[: body.m] = np.abs(A[:, : body.m]).max() or 1.0
    motions = null_space(A / scale) / scale[:, None]
    motions[body.m + 3 :] /= length
    return motions[: body.m], motions[body.m :]


def _other_modes(body: FlexBody, at_rest: FloatArray) -> FloatArray:
    """(m, l) combinations of modes that are orthogonal in stiffness to those at rest (m, j)."""
    size = np.sqrt(np.diag(body.K))
    return np.asarray(null_space((body.K @ at_rest / size[:, None]).T) / size[:, None])


def _shapes_at_rest(body: FlexBody, space: FloatArray, rigid: FloatArray) -> FloatArray:
    """(m, k) shapes in `space` (m, j): lowest modes, those in responses to loads, and their rest.

    The responses are static ones to the loads of the body and to its uniform acceleration, if they
    bend it. `rigid` (6, j) is the motion of the body frame with which the interfaces are at rest;
    loads do work on it too.
    """
    modes, squares = _modes_of(body, space)
    if not len(squares):
        return modes
    moved = rigid @ np.linalg.lstsq(space, modes, rcond=None)[0]
    loads = [
        (one.modal, one.force, one.moment - np.cross(body.center, one.force)) for one in body.loads
    ]
    loads += [(p, body.mass * axis, np.zeros(3)) for p, axis in zip(body.p, np.eye(3), strict=True)]
    fastest, parts, responses = _BENDING * squares[:_TENTH][-1], np.zeros(len(squares)), []
    for f, F, M in loads:
        work = modes.T @ f + moved.T @ np.concatenate([F, M])
        most = np.abs(modes.T @ f) + np.linalg.norm(F) * np.linalg.norm(moved[:3], axis=0)
        most += np.linalg.norm(M) * np.linalg.norm(moved[3:], axis=0)
        energy, part = work**2 / squares, work / squares
        bends = energy.sum() < fastest * (part @ part)
        if bends and energy.sum() > _NO_WORK * (most**2 / squares).sum():
            parts = np.maximum(parts, energy / energy.sum())
            responses.append(modes @ part / np.sqrt(energy.sum()))
    parts[:_LOWEST] = np.inf
    order = np.argsort(-parts, kind="stable")[: _LOWEST + _OF_RESPONSES]
    shapes = modes[:, np.sort(order[parts[order] > _LEAST_ENERGY])]
    for response in responses:
        rest = response.copy()
        for _ in range(2):  # without the shapes, twice for round-off
            inside = shapes.T @ body.K @ rest
            rest -= shapes @ np.linalg.solve(shapes.T @ body.K @ shapes, inside)
        if rest @ body.K @ rest > _LEAST_ENERGY:
            shapes = np.column_stack([shapes, rest / np.sqrt(rest @ body.M_eta @ rest)])
    return shapes


def _modes_of(body: FlexBody, space: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(m, j) modes among the combinations `space` (m, j), and their squared rates (j,)."""
    if not space.shape[1]:
        return space, np.zeros(0)
    squares, shapes = eigh(space.T @ body.K @ space, space.T @ body.M_eta @ space)
    return np.asarray(space @ shapes), squares
