"""Inertia relief, and what follows from it: residual vectors and geometric stiffening.

A free body under a load accelerates as a whole; it is deformed by the load less the inertia of that
acceleration, P f with P = I - M R (R^T M R)^-1 R^T, and its deformation about mean axes is P^T u.

Residual vectors are static responses that the kept modes leave out. They complete the modes so that
the static response to each load is exact; they have diagonal mass and stiffness among themselves
and are orthogonal to the kept modes. Sources: Rose (1991), Using residual vectors in MSC/NASTRAN
dynamic analysis; Craig, Chang (1977), AIAA/ASME 18th SDM conference (residual attachment modes).

Geometric stiffening is what stresses do to the stiffness of the modes: the reduced geometric
stiffness of the six centrifugal loads per mass (e_a s_b + e_b s_a)/2 and of a unit force at each
interface along each axis. The stress is that of the free body under a load and the inertia of the
acceleration that it causes. Uniform and angular accelerations leave no load at all. With all of
them every inertia and interface load of a motion is covered; the centrifugal loads alone would be
wrong. Sources: Wallrapp & Schwertassek, Representation of geometric stiffening in multibody system
simulation, Int. J. Numer. Meth. Engng 32 (1991) 1833; Wallrapp, Standardization of flexible body
modeling in multibody system codes, Mech. Struct. & Mach. 22 (1994) 283.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import eigh, solve_triangular
from scipy.linalg.lapack import dpstrf
from scipy.sparse import csr_array

from flexmb.errors import Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices, geometric_stiffness
from flexmb.fe.assembly.interfaces import ModelInterface
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.eigenmodes import Modes
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.flexbody.arrays import FloatArray, is_nonzero, skew
from flexmb.flexbody.body import FlexBody
from flexmb.progress import Progress, silent


class InertiaRelief:
    """Inertia relief with mass M (n, n) and rigid motions R (n, r)."""

    def __init__(self, M: csr_array, R: FloatArray) -> None:
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
        """(n, ...) inertia loads M R a of the rigid acceleration under f: what relief takes off."""
        return self._MR @ self.acceleration(f)

    def loads(self, f: FloatArray) -> FloatArray:
        """P f: loads (n, ...) in equilibrium with the inertia of the acceleration they cause."""
        return f - self.inertia(f)

    def fields(self, u: FloatArray) -> FloatArray:
        """P^T u: fields (n, ...) without rigid motion, in the measure of the mass."""
        return u - self._R @ self._solve(self._MR.T @ u)

    def _solve(self, b: FloatArray) -> FloatArray:
        return self._inverse @ b


_REPRESENTED = (
    1e-10  # share of a response's energy below which the kept modes hold it but for rounding
)
_NO_RESPONSE = (
    1e-14  # of what a load would do to its own degrees of freedom, the rest held: rounding
)


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
    L, pivots, rank, _ = dpstrf(0.5 * (energy + energy.T), tol=_REPRESENTED, lower=1)
    independent = X[:, pivots[:rank] - 1]
    Y = solve_triangular(L[:rank, :rank], independent.T, lower=True).T if rank else independent
    mass = Y.T @ (fe.M @ Y)
    sigma, Q = eigh(0.5 * (mass + mass.T)) if rank else (np.zeros(0), np.zeros((0, 0)))
    sigma, Q = sigma[::-1], Q[:, ::-1]
    return 1.0 / sigma, Y @ (Q / np.sqrt(sigma))


def fixed_interface_responses(
    fixed: FixedInterfaceModel, relief: InertiaRelief, loads: tuple[LoadPattern, ...]
) -> FloatArray:
    """(n, r) responses of the held body to loads, and to the inertia of the motion they cause.

    With both, the response is exact whether reactions at the interfaces or the inertia of the
    free body balance the load.
    """
    F = load_columns(fixed.fe, loads)
    responses = fixed.solve(np.concatenate([F, relief.inertia(F)], axis=1))
    return deforming_responses(fixed.fe, responses, np.concatenate([F, F], axis=1))


def free_body_responses(
    fixed: FixedInterfaceModel, relief: InertiaRelief, F: FloatArray
) -> FloatArray:
    """(n, r) deformation of the free body under loads F (n, r), about mean axes."""
    return deforming_responses(fixed.fe, relief.fields(fixed.free(relief.loads(F))), F)


def deforming_responses(fe: FEMatrices, responses: FloatArray, F: FloatArray) -> FloatArray:
    """The responses (n, r) that are more than rounding of loads (n, r) leaves.

    Such are those to the weight of a free body, or to the inertia of a load without resultant.
    """
    energy = np.sum(responses * (fe.K @ responses), axis=0)
    local = np.sum(F**2 / fe.K.diagonal()[:, None], axis=0)
    return responses[:, energy > _NO_RESPONSE * local]


def load_columns(fe: FEMatrices, loads: tuple[LoadPattern, ...]) -> FloatArray:
    """(n, r) the loads whose static response the basis shall hold."""
    columns = [load.f for load in loads if load.residual]
    return np.stack(columns, axis=1) if columns else np.zeros((fe.numbering.n, 0))


_ALL = tuple(range(6))  # motions of a body, and of an interface


def with_geometric_stiffening(
    body: FlexBody,
    fe: FEMatrices,
    Phi: FloatArray,
    interfaces: tuple[ModelInterface, ...],
    progress: Progress = silent,
) -> FlexBody:
    """The body with the geometric stiffness of its loads.

    Parameters
    ----------
    body : FlexBody
        The reduced body, with the interfaces in their order.
    fe : FEMatrices
        Its model.
    Phi : (n, m) float
        Its modes.
    interfaces : tuple of RigidInterface or WeightedInterface
        At least one.
    progress : Progress
        Told the phase ``"stiffening"``.
    """
    fixed, relief = FixedInterfaceModel(fe, interfaces, _ALL), InertiaRelief(fe.M, fe.rigid)
    fields = _centrifugal_fields(fe)
    loads = [np.asarray(fe.M @ w) for w, _ in fields]
    forces = fixed.loads()
    loads += [forces[:, 6 * k + d] for k in range(len(interfaces)) for d in range(3)]
    gradients = [G for _, G in fields] + [np.zeros((3, 3))] * (3 * len(interfaces))
    forms = np.zeros((len(loads), body.m, body.m))
    for number, (load, gradient) in enumerate(zip(loads, gradients, strict=True)):
        progress("stiffening", number / len(loads))
        u = fixed.free(relief.loads(load))
        per_mass = _force_per_mass(fe, gradient, relief.acceleration(load))
        form = Phi.T @ (geometric_stiffness(fe, u, per_mass) @ Phi)
        forms[number] = 0.5 * (form + form.T)
    progress("stiffening", 1.0)
    centrifugal = np.zeros((3, 3, body.m, body.m))
    for (a, b), form in zip(_PAIRS, forms, strict=False):
        centrifugal[a, b] = centrifugal[b, a] = form
    bends = forms[len(_PAIRS) :].reshape(len(interfaces), 3, body.m, body.m)
    return replace(
        body,
        centrifugal_stiffness=centrifugal,
        interfaces=tuple(
            replace(part, bend=bend) for part, bend in zip(body.interfaces, bends, strict=True)
        ),
    )


def require_stresses(fe: FEMatrices, interfaces: tuple[ModelInterface, ...]) -> None:
    """Refuse a model whose geometric stiffness is not known.

    Raises
    ------
    ReductionError
        There is no interface, or no element.
    """
    what = ""
    if not interfaces:
        what = "needs at least one interface, where the forces act that stiffen the body"
    elif not fe.blocks:
        what = "needs the stress in the elements, of which given matrices tell nothing"
    if what:
        raise ReductionError.from_problems([Problem("geometric_stiffening", what)])


_PAIRS = tuple((a, b) for a in range(3) for b in range(a, 3))


def _centrifugal_fields(fe: FEMatrices) -> list[tuple[FloatArray, FloatArray]]:
    """The fields G s of the six symmetric G: at the degrees of freedom (n,), and G (3, 3)."""
    arms, axes = fe.dof_points - fe.center, fe.rigid[:, :3]
    fields = []
    for a, b in _PAIRS:
        G = np.zeros((3, 3))
        G[a, b] += 0.5
        G[b, a] += 0.5
        fields.append((np.sum(axes * (arms @ G), axis=1), G))
    return fields


def _force_per_mass(fe: FEMatrices, G: FloatArray, acceleration: FloatArray) -> FloatArray:
    """[G, g] (3, 4) of a load per mass G (s - c) less the rigid acceleration that it causes."""
    G = G - skew(acceleration[3:])
    return np.column_stack([G, -acceleration[:3] - G @ fe.center])
