"""Flexible bodies in a plane: modes symmetric about it, without motion out of it.

:func:`mirror_motion` reflects a motion known at points. If the mirror image of a point is not a
point of the body, the motion there is interpolated by a quadratic fit through the nearest points;
for symmetric meshes the reflection is exact.

:func:`planar_body` retains those combinations of a body's modes that are symmetric about the plane
through its centre of mass; in them points of the plane stay in it. How much of a mode is
antisymmetric is measured at the nodes, whose motion is compared with the mirrored one; for a body
without nodes it is the kinetic energy along the normal. Interfaces must lie in the plane.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, eigh

from flexmb.errors import Problem, ReductionError
from flexmb.flexbody.arrays import FloatArray, IntArray
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.parts import Interface, ModeInfo, NodeModes

_Point = TypeVar("_Point", bound=Interface)

PLANES: dict[str, tuple[float, float, float]] = {
    "xy": (0.0, 0.0, 1.0),
    "yz": (1.0, 0.0, 0.0),
    "zx": (0.0, 1.0, 0.0),
}
"""Coordinate planes of a frame and their normals."""


_MAX_POINTS = 2000  # points that are compared; more would give the same result
_NEIGHBOURS = 24  # points used for a quadratic fit of ten coefficients
_MAX_WEIGHTS = (
    # sum of the magnitudes of the weights above which a fit extrapolates; then the nearest point is
    # used
    3.0
)
_EQUAL_POINTS = 1e-6  # points closer than this fraction of the extent are equal


def mirror_motion(
    points: FloatArray, motion: FloatArray, normal: FloatArray, center: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Reflect a motion at the plane through a point.

    Parameters
    ----------
    points : (k, 3) float
        Where the motion is known.
    motion : (k, 3, m) float
        The motion of each point.
    normal, center : (3,) float
        Unit normal of the plane and a point of it.

    Returns
    -------
    rows : (r,) int
        Points that were compared, evenly spread over the list.
    reflected : (r, 3, m) float
        The reflected motion at them.
    """
    R = np.eye(3) - 2 * np.outer(normal, normal)
    rows = np.unique(np.linspace(0, len(points) - 1, min(len(points), _MAX_POINTS)).astype(int))
    images = center + (points[rows] - center) @ R
    return rows, np.einsum("ab,kbm->kam", R, _interpolate_motion(points, motion, images))


def _interpolate_motion(points: FloatArray, motion: FloatArray, at: FloatArray) -> FloatArray:
    """(r, 3, m) the motion at other places (r, 3)."""
    from scipy.spatial import cKDTree  # importing takes 0.05 s, so only where a body is mirrored

    count = min(_NEIGHBOURS, len(points))
    distance, near = cKDTree(points).query(at, count)
    distance, near = distance.reshape(len(at), count), near.reshape(len(at), count)
    weights = np.zeros((len(at), count))
    weights[:, 0] = 1.0
    apart = np.flatnonzero(distance[:, 0] > _EQUAL_POINTS * np.ptp(points, axis=0).max())
    if len(apart):
        fitted = fit_weights(points[near[apart]], at[apart])
        inside = np.abs(fitted).sum(axis=1) < _MAX_WEIGHTS
        weights[apart[inside]] = fitted[inside]
    return np.asarray(np.einsum("rk,rkam->ram", weights, motion[near]))


def fit_weights(near: FloatArray, at: FloatArray) -> FloatArray:
    """(r, k) weights of the neighbours (r, k, 3) in a quadratic fit, evaluated at places (r, 3)."""
    arms = near - at[:, None]
    size = np.linalg.norm(arms, axis=2).max(axis=1)
    x = arms / size[:, None, None]
    pairs = [x[..., a] * x[..., b] for a in range(3) for b in range(a, 3)]
    A = np.stack([np.ones(x.shape[:2]), *(x[..., a] for a in range(3)), *pairs], axis=2)
    # the constant term is the value at the place
    return np.asarray(np.linalg.pinv(A, rcond=1e-6)[:, 0])


# largest allowed out-of-plane share of the energy of a mode, or of the motion of an interface
LARGEST_SHARE = 0.01
_MAX_ANTISYMMETRIC = 0.5  # a mode with a smaller antisymmetric share is meant to be in the plane
# rotations are multiplied by this fraction of the body's length, to compare with displacements
_ROTATION_LENGTH = 0.05


def planar_body(body: FlexBody, normal: ArrayLike) -> FlexBody:
    """The body with its in-plane modes alone.

    Parameters
    ----------
    body : FlexBody
        Any flexible or rigid body.
    normal : (3,) float
        Normal of the plane in body axes, of any length.

    Returns
    -------
    FlexBody
        Modes of unit modal mass, or the given ones if all of them are in-plane already.

    Raises
    ------
    ReductionError
        Modes or interfaces that move out of the plane by more than 1 %, with the share.
    """
    n = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    if body.m == 0:
        return body
    odd, whole = _energies(body, n)
    share, shapes = eigh(odd, whole)
    if share[-1] <= LARGEST_SHARE:
        planar = body
    else:
        inside, dropped = (
            shapes[:, share < _MAX_ANTISYMMETRIC],
            shapes[:, share >= _MAX_ANTISYMMETRIC],
        )
        planar = _combine_modes(body, _with_plane_interfaces(body, inside, dropped, n), dropped, n)
    odd, whole = _energies(planar, n)
    shares = np.diag(odd) / np.diag(whole)
    check_shares(planar.name, shares, planar.frequencies, n)
    _check_interfaces(planar, n)
    return flatten_body(planar, n, float(shares.max(initial=0.0)))


def check_shares(name: str, shares: FloatArray, frequencies: FloatArray, normal: ArrayLike) -> None:
    """Refuse modes of which more than 1 % is out of the plane.

    Raises
    ------
    ReductionError
        With the share of the worst mode and the number of others.
    """
    wrong = np.flatnonzero(shares > LARGEST_SHARE)
    if not len(wrong):
        return
    k = int(np.argmax(shares))
    others = f" ({len(wrong) - 1} more modes have over 1 %)" if len(wrong) > 1 else ""
    what = (
        f"mode {k} ({frequencies[k]:.4g} Hz) has {_percent(shares[k])} of its energy out of the "
        f"plane {plane_name(normal)}{others}: keep the scene spatial, or make body and mesh "
        "symmetric about the plane"
    )
    raise ReductionError.from_problems([Problem(f"body {name}", what)])


def flatten_body(body: FlexBody, normal: ArrayLike, share: float) -> FlexBody:
    """The body without what is left of out-of-plane motion in its integrals and interfaces.

    Parameters
    ----------
    body : FlexBody
        A body whose modes are in-plane but for a small share.
    normal : (3,) float
        Unit normal of the plane, body axes.
    share : float
        The largest share, 0 to 1, for the record.
    """
    n = np.asarray(normal, dtype=float)
    R = np.eye(3) - 2 * np.outer(n, n)  # reflection at the plane through the origin
    p = body.p - np.outer(n, n @ body.p)
    # correction for the distance of the plane from the origin
    offset = np.einsum("a,bm->abm", n * (n @ body.center), p)
    P = body.P - offset
    P = 0.5 * (P + np.einsum("ac,cdm,db->abm", R, P, R)) + offset
    Mab = 0.5 * (body.Mab + np.einsum("ac,cdij,db->abij", R, body.Mab, R))
    ends = tuple(_in_plane(part, n) for part in body.interfaces)
    record = {"plane": plane_name(n), "out-of-plane share": f"{share:.2g}"}
    provenance = {**body.provenance, **record}
    nodes = body.nodes
    if nodes is not None and nodes.bend is not None:
        nodes = replace(nodes, bend=_bend_in_plane(nodes.bend, n))
    return replace(body, p=p, P=P, Mab=Mab, interfaces=ends, nodes=nodes, provenance=provenance)


def out_of_plane(motion: FloatArray, turning: FloatArray, normal: ArrayLike) -> FloatArray:
    """(..., m) magnitude of out-of-plane motion: displacement along the normal, rotation about axes
    in the plane.

    Parameters
    ----------
    motion, turning : (..., 3, m) float
        Displacement and rotation times a length.
    normal : (3,) float
        Unit normal.
    """
    n = np.asarray(normal, dtype=float)
    along = np.einsum("a,...am->...m", n, motion)
    about = turning - np.einsum("a,b,...bm->...am", n, n, turning)
    return np.asarray(np.sqrt(along**2 + (about**2).sum(axis=-2)))


def plane_name(normal: ArrayLike) -> str:
    """``"xy"`` and so on for coordinate planes of the body frame, else the normal as text."""
    n = np.asarray(normal, dtype=float)
    for name, axis in PLANES.items():
        if np.abs(np.abs(n) - axis).max() < 1e-9:
            return name
    return "with normal (" + ", ".join(f"{value:.3g}" for value in n) + ")"


def _energies(body: FlexBody, n: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(m, m) quadratic forms: of the antisymmetric part of a mode, and of the whole mode.

    They are mean squares over the nodes plus mean squares over the interfaces, which are few but
    are where joints and forces act.
    """
    part = body.nodes if body.nodes is not None else body.surface
    if part is None:
        return np.einsum("a,b,abij->ij", n, n, body.Mab), body.M_eta
    if isinstance(part, NodeModes):
        points, motion, turning = part.position, part.Phi_t, part.Phi_r
    else:
        points, motion, turning = part.points, part.modes, None
    rows, there = mirror_motion(points, motion, n, body.center)
    forms = [_products(motion[rows], there), *_interface_forms(body, n)]
    if turning is not None:
        _, there = mirror_motion(points, turning, n, body.center)
        length = _ROTATION_LENGTH * body.characteristic_length
        # rotations are axial vectors
        forms.append(_products(length * turning[rows], -length * there))
    odd, whole = (sum(form[k] for form in forms) for k in (0, 1))
    floor = 1e-12 * np.trace(whole) / body.m * np.eye(body.m)
    return np.asarray(odd), np.asarray(whole + floor)


def _products(here: FloatArray, there: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Forms of the antisymmetric part of a motion, and of the whole motion.

    `here` is the motion at points, `there` the reflected motion at these points.
    """
    m = here.shape[2]
    odd, even = (0.5 * (here + sign * there).reshape(-1, m) for sign in (-1, 1))
    lost = odd.T @ odd / len(here)
    return lost, lost + even.T @ even / len(here)


def _interface_forms(body: FlexBody, n: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """`_products` of the interfaces; each lies in the plane and is its own mirror image."""
    if not body.interfaces:
        return []
    R = np.eye(3) - 2 * np.outer(n, n)
    motion = np.array([part.Phi_t for part in body.interfaces])
    turning = (
        _ROTATION_LENGTH * body.characteristic_length * np.array([p.Phi_r for p in body.interfaces])
    )
    return [_products(motion, R @ motion), _products(turning, -R @ turning)]


def _with_plane_interfaces(
    body: FlexBody, inside: FloatArray, dropped: FloatArray, n: FloatArray
) -> FloatArray:
    """`inside` (m, k) plus a small amount of `dropped`, such that interfaces stay in the plane.

    For a symmetric body the amount is only what the mesh and the measure leave.
    """
    if not body.interfaces:
        return inside
    N = np.outer(n, n)
    length = body.characteristic_length
    leaving = np.concatenate([N @ part.Phi_t for part in body.interfaces])
    tilting = np.concatenate([part.Phi_r - N @ part.Phi_r for part in body.interfaces])
    F = np.concatenate([leaving, length * tilting])
    amount = np.linalg.lstsq(F @ dropped, -F @ inside, rcond=1e-9)[0]
    return np.asarray(inside + dropped @ amount)


def _combine_modes(
    body: FlexBody, inside: FloatArray, dropped: FloatArray, n: FloatArray
) -> FlexBody:
    """The body in the modes that `inside` (m, k) spans; `dropped` are listed as out of plane."""
    plane = plane_name(n)
    if not inside.shape[1]:
        what = f"has no modes in the plane {plane}"
        raise ReductionError.from_problems([Problem(f"body {body.name}", what)])
    omega2, W = _modes(body, inside)
    Z = inside @ W
    infos = [
        ModeInfo(k, "elastic", frequency, True, "", kinetic_share=tuple(along))
        for k, (frequency, along) in enumerate(
            zip(_hertz(omega2), np.einsum("bbij,ik,jk->kb", body.Mab, Z, Z), strict=True)
        )
    ]
    outside = [
        ModeInfo(-1, "elastic", frequency, False, f"out of the plane {plane}")
        for frequency in _hertz(_modes(body, dropped)[0])
    ]
    listed = (*(mode for mode in body.modes if mode.kind == "rigid"), *outside, *infos)
    made = replace(combine_modes(body, Z), modes=listed)
    omitted = made.omitted_stiffening
    return replace(made, omitted_stiffening=None if omitted is None else omitted.in_plane(n))


def combine_modes(body: FlexBody, Z: FloatArray) -> FlexBody:
    """The body in the modes Phi Z with Z (m, k); without a list of modes."""
    omitted, membrane = body.omitted_modes, body.membrane_stiffness
    stiffening = body.omitted_stiffening
    return replace(
        body,
        p=body.p @ Z,
        P=body.P @ Z,
        Mab=Z.T @ body.Mab @ Z,
        K=_symmetric(Z.T @ body.K @ Z),
        D=None if body.D is None else _symmetric(Z.T @ body.D @ Z),
        centrifugal_stiffness=_combined(body.centrifugal_stiffness, Z),
        interfaces=_combine_points(body.interfaces, Z),
        modes=(),
        loads=tuple(
            replace(load, modal=load.modal @ Z, points=_combine_points(load.points, Z))
            for load in body.loads
        ),
        membrane_stiffness=None if membrane is None else membrane.in_coordinates(Z),
        omitted_modes=None if omitted is None else omitted.in_coordinates(Z),
        omitted_stiffening=None if stiffening is None else stiffening.in_coordinates(Z),
        **_combine_recovery(body, Z),
    )


def _combine_points(points: tuple[_Point, ...], Z: FloatArray) -> tuple[_Point, ...]:
    """Interfaces, or points of a load, in the modes Phi Z."""
    return tuple(
        replace(one, Phi_t=one.Phi_t @ Z, Phi_r=one.Phi_r @ Z, bend=_combined(one.bend, Z))
        for one in points
    )


def _combined(forms: FloatArray | None, Z: FloatArray) -> FloatArray | None:
    """Zᵀ forms Z (..., k, k) of forms (..., m, m)."""
    return None if forms is None else _symmetric(Z.T @ forms @ Z)


def _combine_recovery(body: FlexBody, Z: FloatArray) -> dict[str, Any]:
    """Motion of nodes and surface, stress and section forces in the modes Phi Z."""
    nodes, surface = body.nodes, body.surface
    stress, forces, shells = body.stress, body.section_forces, body.shell_forces
    if nodes is not None:
        turning = None if nodes.Phi_r is None else nodes.Phi_r @ Z
        bend = _combined(nodes.bend, Z)
        nodes = replace(nodes, Phi_t=nodes.Phi_t @ Z, Phi_r=turning, bend=bend)
    return {
        "nodes": nodes,
        "surface": None if surface is None else replace(surface, modes=surface.modes @ Z),
        "stress": None if stress is None else stress.combined(Z),
        "section_forces": None if forces is None else forces.combined(Z),
        "shell_forces": None if shells is None else shells.combined(Z),
    }


def _modes(body: FlexBody, shapes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Squared frequencies and mass-normalised modes within a subspace (m, k)."""
    if not shapes.shape[1]:
        return np.zeros(0), np.zeros((0, 0))
    K, M = (_symmetric(shapes.T @ matrix @ shapes) for matrix in (body.K, body.M_eta))
    omega2, W = eigh(K, M)
    largest = np.abs(W).argmax(axis=0)
    return omega2, W * np.sign(W[largest, np.arange(len(largest))])


def _check_interfaces(body: FlexBody, n: FloatArray) -> None:
    """Refuse interfaces that leave the plane by more than 1 % of the mode's largest motion."""
    if not body.interfaces:
        return
    length = body.characteristic_length
    motion = np.array([part.Phi_t for part in body.interfaces])
    turning = length * np.array([part.Phi_r for part in body.interfaces])
    whole = np.sqrt((motion**2 + turning**2).sum(axis=1))
    share = out_of_plane(motion, turning, n) / np.maximum(whole.max(axis=0), 1e-300)
    share[:, whole.max(axis=0) < 1e-9 * whole.max()] = 0.0
    problems = [
        Problem(
            f"body {body.name}",
            f"mode {k} moves the interface {body.interfaces[i].name} out of the plane "
            f"{plane_name(n)} by {_percent(share[i, k])} of its largest motion: keep the scene "
            "spatial, or put the interface into the plane of symmetry",
        )
        for i, k in np.argwhere(share > LARGEST_SHARE)
    ]
    if problems:
        raise ReductionError.from_problems(problems)


def _in_plane(part: Interface, n: FloatArray) -> Interface:
    N = np.outer(n, n)
    bend = None if part.bend is None else _bend_in_plane(part.bend, n)
    return Interface(part.name, part.position, part.Phi_t - N @ part.Phi_t, N @ part.Phi_r, bend)


def _bend_in_plane(bend: FloatArray, n: FloatArray) -> FloatArray:
    """(..., 6, m, m) without the displacement along n and the rotation about axes in the plane."""
    N = np.outer(n, n)
    S = block_diag(np.eye(3) - N, N)
    return np.asarray(np.einsum("ab,...bij->...aij", S, bend))


def _symmetric(matrix: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (matrix + matrix.swapaxes(-1, -2)))


def _hertz(omega2: Iterable[float]) -> list[float]:
    return [float(np.sqrt(max(value, 0.0)) / (2 * np.pi)) for value in omega2]


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"
