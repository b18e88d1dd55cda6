"""Geometric stiffening: what stresses do to the stiffness of the modes.

A body stores the reduced geometric stiffness of the six centrifugal loads per mass (e_a s_b + e_b
s_a)/2, of a unit force along each axis and a unit moment about each at each interface and at given
nodes, and of its own loads. Moments are conjugate to the rotation vector (semitangential).
The stress is that of the free body under a load and the inertia forces of the rigid acceleration
that it causes.
Uniform and angular accelerations have no geometric stiffness of their own, since their inertia
forces balance the loads. All these together cover every inertia and interface load of a motion; the
centrifugal loads alone would be wrong. Sources: Wallrapp & Schwertassek, Representation of
geometric stiffening in multibody system simulation, Int. J. Numer. Meth. Engng 32 (1991) 1833;
Wallrapp, Standardization of flexible body modeling in multibody system codes, Mech. Struct. & Mach.
22 (1994) 283.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag, eigh

from flexmb.errors import Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices, geometric_forms, geometric_stiffness
from flexmb.fe.assembly.interfaces import ModelInterface, interface_stiffness
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.eigenmodes import SymmetryPlane
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.fe.reduction.inertia_relief import InertiaRelief, centrifugal_fields
from flexmb.fe.reduction.missing_response import node_loads
from flexmb.flexbody.arrays import FloatArray, skew
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.effects import bent_points
from flexmb.flexbody.parts import Interface
from flexmb.flexbody.static_response import SYMMETRIC_PAIRS, OmittedStiffening
from flexmb.progress import Progress, silent

_ALL = tuple(range(6))  # all six motions of a body, and of an interface
# Rotation of its point (rad) and root mean square of strain up to which moments count.
_LARGEST_TURN, _LARGEST_STRAIN = 1.0, 0.05
# Of fields that the modes leave out: random combinations of loads, two fields of each; the most
# that are stored; their least energy, the change of a stiffness by loads that take all of one.
_COMBINATIONS, _MOST_FIELDS, _LEAST_ENERGY = 12, 16, 1e-4


def with_geometric_stiffening(
    body: FlexBody,
    fe: FEMatrices,
    Phi: FloatArray,
    interfaces: tuple[ModelInterface, ...],
    patterns: tuple[LoadPattern, ...] = (),
    nodes: Sequence[int] = (),
    progress: Progress = silent,
    mirror: SymmetryPlane | None = None,
    is_complete: bool = True,
) -> FlexBody:
    """The body with the geometric stiffness of its loads; without modes it has none.

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
    patterns : tuple of LoadPattern
        The loads of the body, in their order.
    nodes : sequence of int
        Nodes at which loads act or sensors measure.
    progress : Progress
        Called with the phase ``"stiffening"``.
    mirror : SymmetryPlane, optional
        Of a planar reduction.
    is_complete : bool
        Whether the modes have all static responses to loads at interfaces.
    """
    if body.m == 0:
        return body
    fixed, relief = FixedInterfaceModel(fe, interfaces, _ALL), InertiaRelief(fe.M, fe.rigid)
    fields = centrifugal_fields(fe)
    counts = {node: 6 if fe.numbering.table[node, 3] >= 0 else 3 for node in nodes}
    loads = [f for f, _ in fields]
    loads += list(fixed.loads().T)
    units = slice(len(fields), len(loads))  # unit forces and moments at interfaces
    loads += [pattern.f for pattern in patterns]
    own = slice(units.stop, len(loads))
    for node, count in counts.items():  # without moments on nodes of solids
        loads += list(node_loads(fe, node, ()).T * (np.arange(6) < count)[:, None])
    F = np.column_stack(loads)
    relieved = relief.loads(F)
    U = fixed.free(relieved)
    per_mass = np.array([-_acceleration(fe, one) for one in relief.acceleration(F).T])
    per_mass[: len(fields)] += [g for _, g in fields]
    forms = geometric_forms(fe, Phi, U, per_mass, partial(progress, "stiffening"))
    # forces on interface nodes, which a unit load reaches only through the interface
    links = np.asarray(fe.K @ U) - relieved
    links[:, units] += F[:, units]
    for k, link in enumerate(links.T):
        for part, interface in zip(body.interfaces, interfaces, strict=True):
            forms[k] += part.Phi_r.T @ interface_stiffness(fe, interface, link) @ part.Phi_r
    forms = 0.5 * (forms + forms.transpose(0, 2, 1))
    table, energy = body.nodes, _stretching_energy(fe)
    bends = forms[own.stop :].reshape(-1, 6, *forms.shape[1:])
    if table is not None and counts:
        table = replace(table, bend_nodes=np.array(list(counts)), bend=bends)
    points = [
        replace(part, bend=bend)
        for part, bend in zip(
            body.interfaces, forms[units].reshape(-1, 6, *forms.shape[1:]), strict=True
        )
    ]
    points += [] if table is None else table.points_with_bend()
    rows = [*range(units.start, units.stop, 6), *range(own.stop, len(forms), 6)]
    for first, point in zip(rows, points, strict=True):
        six = slice(first, first + 6)
        axes = _relevant_axes(body.K, energy, point)
        forms[six], per_mass[six] = (np.tensordot(axes, x[six], 1) for x in (forms, per_mass))
        U[:, six], relieved[:, six] = U[:, six] @ axes, relieved[:, six] @ axes
    if table is not None and counts:
        table = replace(table, bend=forms[own.stop :].reshape(bends.shape))
    centrifugal = np.zeros((3, 3, body.m, body.m))
    for (a, b), form in zip(SYMMETRIC_PAIRS, forms, strict=False):
        centrifugal[a, b] = centrifugal[b, a] = form
    omitted = None
    if is_complete:
        strains = np.sqrt((relieved * U).sum(axis=0).clip(0.0) / energy)
        omitted = _omitted_stiffening(fixed, Phi, body.K, (forms, strains), U, per_mass, mirror)
    return replace(
        body,
        centrifugal_stiffness=centrifugal,
        interfaces=tuple(
            replace(part, bend=forms[first : first + 6])
            for part, first in zip(body.interfaces, rows, strict=False)
        ),
        loads=tuple(
            replace(load, points=bent_points(load.points, form))
            for load, form in zip(body.loads, forms[own], strict=True)
        ),
        nodes=table,
        omitted_stiffening=omitted,
    )


def _relevant_axes(K: FloatArray, energy: float, point: Interface) -> FloatArray:
    """(6, 6) projection of loads at a point: without moments that would take the stiffness of a
    shape only as the point has turned too far for linear theory, or as no material is elastic.

    Moments are those about the principal axes of the flexibility of the point. `energy` is twice
    that of a unit strain all over the body.
    """
    assert point.bend is not None
    flexibilities, axes = np.linalg.eigh(point.Phi_r @ np.linalg.solve(K, point.Phi_r.T))
    forms = np.tensordot(axes.T, point.bend[3:], 1)
    matters = np.ones(3)
    for k, (form, flexibility) in enumerate(zip(forms, flexibilities.clip(0.0), strict=True)):
        stiffness = np.abs(eigh(form, K, eigvals_only=True)).max(initial=0.0)
        strain = np.sqrt(flexibility / energy)
        matters[k] = stiffness >= max(flexibility / _LARGEST_TURN, strain / _LARGEST_STRAIN)
    return block_diag(np.eye(3), (axes * matters) @ axes.T)


def _omitted_stiffening(
    fixed: FixedInterfaceModel,
    Phi: FloatArray,
    K: FloatArray,
    loads: tuple[FloatArray, FloatArray],
    U: FloatArray,
    per_mass: FloatArray,
    mirror: SymmetryPlane | None,
) -> OmittedStiffening | None:
    """What the geometric stiffness of loads does to fields that the modes leave out; None: nothing.

    The fields are static responses, with the interfaces at rest, to the forces by which geometric
    stiffness pulls at the modes, less what these have of it. Each load counts with the size that
    takes all stiffness from some shape, if the material is elastic then. Of so many responses the
    largest parts are found by random combinations (Halko, Martinsson & Tropp, SIAM Review 53
    (2011) 217).

    `loads` are their forms and the strains by loads of size one.
    """
    fe, (forms, strains) = fixed.fe, loads
    omega2 = np.diag(K)
    shapes, m = Phi / np.sqrt(omega2), len(K)
    scaled = forms / np.sqrt(np.outer(omega2, omega2))
    sizes = np.abs(np.linalg.eigvalsh(scaled)).max(axis=1)
    some = np.flatnonzero(sizes * _LARGEST_STRAIN > strains)
    if not len(some):
        return None
    random, parts = np.random.default_rng(0), []
    for _ in range(_COMBINATIONS):
        c = random.standard_normal(len(some)) / sizes[some]
        stiffness = geometric_stiffness(fe, U[:, some] @ c, np.tensordot(c, per_mass[some], 1))
        parts.append(stiffness @ (shapes @ random.standard_normal((m, 2))))
    pulls = np.hstack(parts)
    if mirror is not None:
        pulls = 0.5 * (pulls + mirror.S.T @ pulls)
    Y = fixed.solve(pulls)
    for _ in range(2):  # twice for round-off
        Y = Y - shapes @ (shapes.T @ (fe.K @ Y))
    end = fixed.interfaces[0]
    Y = Y - fe.rigid @ np.linalg.lstsq(end.motion(fe.rigid), end.motion(Y), rcond=None)[0]
    energies, Q = np.linalg.eigh(Y.T @ (fe.K @ Y) / Y.shape[1])
    Q, energies = Q[:, ::-1][:, :_MOST_FIELDS], energies[::-1][:_MOST_FIELDS]
    there = energies > _LEAST_ENERGY
    Y = Y @ (Q[:, there] / np.sqrt(energies[there] * Y.shape[1]))
    if not Y.shape[1]:
        return None
    every = np.hstack([fe.rigid[:, 3:], Phi, Y])
    table = np.zeros((len(forms), Y.shape[1], every.shape[1]))
    table[some] = geometric_forms(fe, every, U[:, some], per_mass[some])[:, 3 + m :]
    mass = fe.reduced_mass(np.hstack([fe.rigid, Phi, Y]))[:, :, 6 + m :]
    return OmittedStiffening(*np.split(table, [3, 3 + m], axis=2), mass)


def _stretching_energy(fe: FEMatrices) -> float:
    """Twice the strain energy of a body that grows by a unit strain in all directions."""
    table, u = fe.numbering.table[:, :3], np.zeros(fe.numbering.n_all)
    u[table[table >= 0]] = (fe.mesh.points - fe.center)[table >= 0]
    u = u[: fe.numbering.n]
    return float(u @ (fe.K @ u))


def require_stresses(
    fe: FEMatrices, interfaces: tuple[ModelInterface, ...], has_material: bool = True
) -> None:
    """Refuse a model whose geometric stiffness is not known.

    Raises
    ------
    ReductionError
        There is no interface, no element, or no material.
    """
    what = ""
    if not interfaces:
        what = "needs at least one interface, where the forces act that stiffen the body"
    elif not fe.blocks:
        what = "needs the stress in the elements, of which given matrices tell nothing"
    elif not has_material:
        what = "needs the stress in the elements: give the material of the matrices too"
    if what:
        raise ReductionError.from_problems([Problem("geometric_stiffening", what)])


def _acceleration(fe: FEMatrices, rigid: FloatArray) -> FloatArray:
    """(3, 4) [A, b] of the acceleration A s + b at s that belongs to a rigid acceleration (6,)."""
    A = skew(rigid[3:])
    return np.column_stack([A, rigid[:3] - A @ fe.center])
