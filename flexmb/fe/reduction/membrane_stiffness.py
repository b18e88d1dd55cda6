"""Membrane stiffness of a reduced body, from its finite elements.

The shapes are the lowest modes with the interfaces at rest, and the lowest of the other modes,
which are orthogonal to these in stiffness. In its surface the body moves to where the energy is
least, by what its modes lack of that motion, while its interfaces move along arcs as they turn.
Strains of second order are means over the elements: elements whose strain is linear cannot follow
them from point to point, and would lock.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import eigh, null_space

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.assembly.interfaces import ModelInterface, RigidInterface
from flexmb.fe.reduction.reduced_basis import ReducedBasis, ReducedModes
from flexmb.flexbody.arrays import FloatArray, skew
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.membrane_stiffness import MembraneStiffness, shape_pairs
from flexmb.progress import Progress, silent

# Shapes of each sort. With six, a clamped square is within 1 % up to 1.5 times its thickness.
_MAX_SHAPES = 6
# Ratios of second moments of mass: of the second axis to the first one, up to which a body is a
# bar; of the third to the second, up to which solid elements are a plate.
_BAR, _PLATE = 0.3, 0.02
_MATRICES = 24  # (d, d) of an element, the memory that its strains of second order take


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
    F, V = _second_order_loads(fe, elastic.Phi @ shapes)
    # rigid interfaces move along arcs
    arcs = _arcs(fe, basis.interfaces, [end.Phi_r @ shapes for end in body.interfaces])
    arc_forces = np.asarray(fe.K @ arcs)
    V = V + arcs.T @ F + F.T @ arcs + arcs.T @ arc_forces
    F = F + arc_forces
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
    if fe.ties or not fe.blocks or any(not hasattr(b.family, "mean_strains") for b in fe.blocks):
        return False
    thin, wide, long = np.linalg.eigvalsh(body.S0 - np.outer(body.S1, body.S1) / body.mass)
    shells = any(block.family.dimension == 2 for block in fe.blocks)
    return bool(wide > _BAR * long and (shells or thin < _PLATE * wide))


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


def _arcs(
    fe: FEMatrices, interfaces: tuple[ModelInterface, ...], rotations: list[FloatArray]
) -> FloatArray:
    """(n, p) displacements of second order of the nodes of rigid interfaces, by pairs of shapes.

    Rotations of an interface (3, k) per shape turn an arm s by (a x (b x s) + b x (a x s))/2, of
    which pairs of a shape with itself have half.
    """
    first, second = shape_pairs(rotations[0].shape[1])
    moved = np.zeros((fe.numbering.n_all, len(first)))
    for interface, rotation in zip(interfaces, rotations, strict=True):
        if isinstance(interface, RigidInterface):
            arms = (fe.mesh.points[interface.nodes] - interface.position)[:, None]
            a, b = rotation.T[first], rotation.T[second]
            arcs = np.cross(a, np.cross(b, arms)) + np.cross(b, np.cross(a, arms))
            arcs[:, first == second] *= 0.5
            numbers, arcs = fe.numbering.table[interface.nodes, :3], arcs.transpose(0, 2, 1)
            moved[numbers[numbers >= 0]] = 0.5 * arcs[numbers >= 0]
    return moved[: fe.numbering.n]


def _second_order_loads(fe: FEMatrices, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, p) loads whose work is that of the stress of a displacement at the second-order strains
    of each pair of shapes, and (p, p) the energy of these strains, interior at rest."""
    first, second = shape_pairs(shapes.shape[1])
    both = np.where(first == second, 1.0, 2.0)
    everywhere = fe.expand(shapes)
    F, V = np.zeros((fe.numbering.n_all, len(first))), np.zeros((len(first),) * 2)
    for block in fe.blocks:
        width = 6 if block.family.rotations else 3
        for nodes in block.chunks(_MATRICES):
            dofs = fe.numbering.of(nodes, width)
            elements = (fe.mesh.points[nodes], block.section, everywhere[dofs])
            B, products, elasticity, measure = block.family.mean_strains(*elements)
            E = both * products[..., first, second]
            stress = measure[:, None, None] * (elasticity @ E)
            np.add.at(F, dofs, np.matmul(B.transpose(0, 2, 1), stress))
            V += E.reshape(-1, len(first)).T @ stress.reshape(-1, len(first))
    n = fe.numbering.n
    return (F if fe.follow is None else F[:n] + fe.follow.T @ F[n:]), V
