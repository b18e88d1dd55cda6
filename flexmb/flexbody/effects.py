"""The same flexible body with fewer effects, or in another body frame.

In: a body with its modes in mean axes. Out: the rigid body with the same interfaces, nodes and
surface; the body without the data of geometric stiffening; or the body in a frame fixed to one of
its interfaces, k. There u' = u − u_k − θ_k × (s − s_k), so the integrals of the new modes follow
exactly from those of the old ones and of rigid motion.

Geometric stiffening is due to displacements of second order. The rotation θ_k of the frame changes
them by −θ_k × N η + θ_k × (θ_k × (s − c))/2, rotations by −θ_k × θ/2 (Baker, Campbell, Hausdorff),
and both by a second-order rigid motion, such that they have no momentum and no angular momentum in
the new frame either: the interface is at rest in it to first order. Source: Shabana, Dynamics of
Multibody Systems, 4th ed., §5.6 on reference conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from flexmb.flexbody.arrays import FloatArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.natural_modes import mass_at_rest
from flexmb.flexbody.parts import Interface, LoadPoint
from flexmb.flexbody.planar_body import combine_modes

_Point = TypeVar("_Point", bound=Interface)
_Stiffening = tuple[FloatArray, Callable[[Interface], FloatArray]]
_EPS = np.zeros((3, 3, 3))  # permutation symbol
for _a, _b, _c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _EPS[_a, _b, _c], _EPS[_b, _a, _c] = 1.0, -1.0

_DIVIDED = "membrane stiffness"  # entry of the provenance
_NO_MASS = 1e-12  # a moment of inertia below this fraction of its bound is round-off


def about_point(body: FlexBody, point: FloatArray) -> FlexBody:
    """The body in a frame with the same axes and its origin at a point (3,).

    Places, and integrals with places, are changed. The geometric stiffness is not: uniform
    accelerations, by which the centrifugal loads differ, have none.
    """
    c, moved, surface = np.asarray(point, dtype=float), np.outer(body.S1, point), body.surface
    return replace(
        body,
        S1=body.S1 - body.mass * c,
        S0=body.S0 - moved - moved.T + body.mass * np.outer(c, c),
        P=body.P - c[:, None, None] * body.p,
        interfaces=tuple(_from_point(one, c) for one in body.interfaces),
        surface=None if surface is None else replace(surface, points=surface.points - c),
        nodes=None if body.nodes is None else _from_point(body.nodes, c),
        loads=tuple(
            replace(one, points=tuple(_from_point(each, c) for each in one.points))
            for one in body.loads
        ),
    )


def _from_point(places: Any, c: FloatArray) -> Any:
    return replace(places, position=places.position - c)


def rigid_twin(body: FlexBody) -> FlexBody:
    """The body without modes: its mass properties, interfaces, nodes and surface."""
    if body.m == 0:
        return body
    twin = combine_modes(without_stiffening(body), np.zeros((body.m, 0)))
    return replace(
        twin, D=None, inertia_response=None, load_response=None, omitted_modes=None,
        omitted_stress=None, membrane_stiffness=None,
    )  # fmt: skip


def without_stiffening(body: FlexBody) -> FlexBody:
    """The body without the data of geometric stiffening."""
    ends = tuple(replace(part, bend=None) for part in body.interfaces)
    loads = tuple(
        replace(load, points=tuple(replace(point, bend=None) for point in load.points))
        for load in body.loads
    )
    nodes = None if body.nodes is None else replace(body.nodes, bend_nodes=None, bend=None)
    return replace(
        body, centrifugal_stiffness=None, interfaces=ends, nodes=nodes, loads=loads,
        omitted_stiffening=None,
    )  # fmt: skip


def with_stretching(body: FlexBody) -> FlexBody:
    """The body with geometric stiffening and what is left of its membrane stiffness."""
    whole = body.membrane_stiffness
    if whole is None or body.centrifugal_stiffness is None or is_divided(body):
        return body
    return replace(
        body,
        membrane_stiffness=whole.beside_geometric_stiffness(body.K),
        provenance={**body.provenance, _DIVIDED: "beside geometric stiffening"},
    )


def is_divided(body: FlexBody) -> bool:
    """Whether geometric stiffening has a part of its membrane stiffness already."""
    return _DIVIDED in body.provenance


def bent_points(points: tuple[LoadPoint, ...], form: FloatArray) -> tuple[LoadPoint, ...]:
    """The points of a load, with more second-order motion of one of them, a force if there is any.

    It is such that this one does the work of the geometric stiffness `form` of the whole load.
    """
    bends = [np.zeros((6, *form.shape)) if one.bend is None else one.bend.copy() for one in points]
    first = min(range(len(points)), key=lambda k: not points[k].wrench[:3].any(), default=None)
    if first is not None:
        axis = int(np.abs(points[first].wrench).argmax())
        bends[first][axis] += form / points[first].wrench[axis]
    return tuple(replace(point, bend=bend) for point, bend in zip(points, bends, strict=True))


def without_modal_inertia(body: FlexBody, modes: Sequence[int]) -> FloatArray:
    """Mab if some modes deform the body without inertia: their rows and columns in mean axes are
    zero.

    Where the frame moves with a mode, the inertia of the rigid motion of the whole body relative to
    that frame remains. The first integrals p and P, by which inertia loads the modes, do not
    change.
    """
    M = mass_at_rest(body.mass, body.S1, body.S0, body.p, body.P, body.M_eta)[:6]
    size = np.sqrt(np.diag(M)) + np.finfo(float).tiny
    inverse = np.linalg.pinv(M[:, :6] / np.outer(size, size), rcond=_NO_MASS, hermitian=True)
    motion, dynamic = np.zeros((6, body.m)), np.ones(body.m)
    motion[:, modes] = (inverse / size[:, None] @ (M[:, 6:] / size[:, None]))[:, modes]
    dynamic[list(modes)] = 0.0
    Mab = body.Mab * np.outer(dynamic, dynamic)
    fields = _rigid_integrals(body, body.p * dynamic, body.P * dynamic, Mab, motion)
    return np.asarray(fields["Mab"])


def frame_at_interface(body: FlexBody, name: str) -> FlexBody:
    """The body in a frame fixed to an interface, which then neither translates nor rotates in it.

    Parameters
    ----------
    body : FlexBody
        In mean axes.
    name : str
        The interface.

    Raises
    ------
    ReductionError
        There is no such interface.
    """
    end = body.interface(name)
    if body.m == 0:
        return body
    # rigid motion that is added to each mode: translation of the origin and rotation
    turn = -end.Phi_r
    shift = -end.Phi_t - np.cross(turn.T, end.position).T
    fields = _rigid_integrals(body, body.p, body.P, body.Mab, np.vstack([shift, turn]))
    stiffening = None if body.centrifugal_stiffness is None else _stiffening(body, -turn)
    if stiffening is not None:
        fields["centrifugal_stiffness"] = stiffening[0]

    def in_frame(parts: tuple[_Point, ...]) -> tuple[_Point, ...]:
        return tuple(_moved(part, shift, turn, stiffening) for part in parts)

    nodes, surface = body.nodes, body.surface
    if nodes is not None:
        Phi_r = None if nodes.Phi_r is None else nodes.Phi_r + turn
        Phi_t = nodes.Phi_t + _rigid_displacement(nodes.position, shift, turn)
        bends = [one.bend for one in in_frame(tuple(nodes.points_with_bend()))]
        bend = nodes.bend if not bends else np.array(bends)
        nodes = replace(nodes, Phi_t=Phi_t, Phi_r=Phi_r, bend=bend)
    if surface is not None:
        moved = _rigid_displacement(surface.points, shift, turn)
        surface = replace(surface, modes=surface.modes + moved)
    loads = tuple(
        replace(
            load,
            modal=load.modal + load.force @ shift + load.moment @ turn,
            points=in_frame(load.points),
        )
        for load in body.loads
    )
    omitted = body.omitted_modes
    if omitted is not None:
        rigid = np.vstack([shift + np.cross(turn.T, body.center).T, turn])
        omitted = omitted.in_coordinates(np.eye(body.m), rigid)
    return replace(
        body, **fields, interfaces=in_frame(body.interfaces), nodes=nodes, surface=surface,
        loads=loads, omitted_modes=omitted,
    )  # fmt: skip


def _rigid_displacement(points: FloatArray, shift: FloatArray, turn: FloatArray) -> FloatArray:
    """(n, 3, m) displacement of points (n, 3) by the rigid motions shift, turn (3, m)."""
    return np.asarray(shift + np.einsum("acb,cm,nb->nam", _EPS, turn, points))


def _moved(
    part: _Point, shift: FloatArray, turn: FloatArray, stiffening: _Stiffening | None
) -> _Point:
    moved = _rigid_displacement(part.position[None], shift, turn)[0]
    bend = part.bend if stiffening is None else stiffening[1](part)
    return replace(part, Phi_t=part.Phi_t + moved, Phi_r=part.Phi_r + turn, bend=bend)


def _rigid_integrals(
    body: FlexBody, p: FloatArray, P: FloatArray, Mab: FloatArray, motion: FloatArray
) -> dict[str, Any]:
    """p, P and Mab of modes plus rigid motions d + G s with G_ab = ε_acb θ_c; motion (6, m) is d,
    θ."""
    shift, turn = motion[:3], motion[3:]
    G = np.einsum("acb,cm->abm", _EPS, turn)
    cross = np.einsum("ai,bj->abij", p, shift) + np.einsum("bcj,cai->abij", G, P)
    p = p + body.mass * shift + np.einsum("abm,b->am", G, body.S1)
    P = P + np.einsum("a,bm->abm", body.S1, shift) + np.einsum("bcm,ac->abm", G, body.S0)
    # int rho N_a (d + G s)_b, and the same of two rigid motions
    both = body.mass * np.einsum("ai,bj->abij", shift, shift)
    both += np.einsum("ai,bcj,c->abij", shift, G, body.S1)
    both += np.einsum("aci,c,bj->abij", G, body.S1, shift)
    both += np.einsum("aci,cd,bdj->abij", G, body.S0, G)
    Mab = Mab + cross + cross.transpose(1, 0, 3, 2) + both
    return {"p": p, "P": P, "Mab": Mab}


def _stiffening(body: FlexBody, turn: FloatArray) -> _Stiffening:
    """Centrifugal stiffness and function of bends, in a frame that rotates by `turn` (3, m) per
    eta.

    The second-order displacement in the new frame has the additional part v = −θ × N̄η + θ × (θ ×
    s̄)/2 − ψ × s̄, with N̄ and s̄ relative to the centre of mass and ψ such that ∫ρ s̄ × v = 0.
    """
    c, S = body.center, body.S0 - np.outer(body.S1, body.S1) / body.mass
    theta = np.einsum("bcd,cm->bdm", _EPS, turn)  # θ × x = theta x: (3, 3, m)
    twice = np.einsum("bcm,cdn->bdmn", theta, theta)
    P = body.P - np.einsum("a,dm->adm", c, body.p)
    A = -np.einsum("bdm,adn->abmn", theta, P) + 0.5 * np.einsum("bdmn,ad->abmn", twice, S)
    inertia = np.trace(S) * np.eye(3) - S
    psi = np.einsum("ci,iab,abmn->cmn", np.linalg.pinv(inertia), _EPS, A)
    A = A - np.einsum("bcd,cmn,ad->abmn", _EPS, psi, S)
    both = _symmetric(A + A.transpose(1, 0, 2, 3))
    assert body.centrifugal_stiffness is not None

    def bend(part: Interface) -> FloatArray:
        arm, moved = part.position - c, part.Phi_t - body.p / body.mass
        rotation = -0.5 * np.einsum("bdm,dn->bmn", theta, part.Phi_r) - psi
        v = -np.einsum("bdm,dn->bmn", theta, moved) + 0.5 * np.einsum("bdmn,d->bmn", twice, arm)
        v = v - np.einsum("bcd,cmn,d->bmn", _EPS, psi, arm)
        assert part.bend is not None
        return np.asarray(part.bend - 2.0 * _symmetric(np.concatenate([v, rotation])))

    return body.centrifugal_stiffness - both, bend


def _symmetric(forms: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (forms + np.swapaxes(forms, -1, -2)))
