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
from scipy.linalg import eigh

from flexmb.errors import Problem, ReductionError
from flexmb.fe.assembly.assemble import FEMatrices, geometric_forms
from flexmb.fe.assembly.interfaces import ModelInterface, interface_stiffness
from flexmb.fe.assembly.loads import LoadPattern
from flexmb.fe.reduction.fixed_interface import FixedInterfaceModel
from flexmb.fe.reduction.inertia_relief import InertiaRelief, centrifugal_fields
from flexmb.fe.reduction.missing_response import node_loads
from flexmb.flexbody.arrays import FloatArray, skew
from flexmb.flexbody.body import FlexBody
from flexmb.flexbody.effects import bent_points
from flexmb.flexbody.parts import Interface
from flexmb.flexbody.static_response import SYMMETRIC_PAIRS
from flexmb.progress import Progress, silent

_ALL = tuple(range(6))  # all six motions of a body, and of an interface
# Rotation of its point (rad) and root mean square of strain up to which moments count.
_LARGEST_TURN, _LARGEST_STRAIN = 1.0, 0.05


def with_geometric_stiffening(
    body: FlexBody,
    fe: FEMatrices,
    Phi: FloatArray,
    interfaces: tuple[ModelInterface, ...],
    patterns: tuple[LoadPattern, ...] = (),
    nodes: Sequence[int] = (),
    progress: Progress = silent,
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
    """
    if body.m == 0:
        return body
    fixed, relief = FixedInterfaceModel(fe, interfaces, _ALL), InertiaRelief(fe.M, fe.rigid)
    fields = centrifugal_fields(fe)
    loads = [f for f, _ in fields]
    forces = fixed.loads()
    loads += list(forces.T)
    units = slice(len(fields), len(loads))  # unit forces and moments at interfaces
    counts = {node: 6 if fe.numbering.table[node, 3] >= 0 else 3 for node in nodes}
    at_nodes = {node: node_loads(fe, node, ())[:, :count] for node, count in counts.items()}
    loads += [pattern.f for pattern in patterns]
    loads += [one for F in at_nodes.values() for one in F.T]
    F = np.column_stack(loads)
    relieved = relief.loads(F)
    U = fixed.free(relieved)
    per_mass = [-_acceleration(fe, one) for one in relief.acceleration(F).T]
    per_mass[: len(fields)] = [a + g for a, (_, g) in zip(per_mass, fields, strict=False)]
    forms = geometric_forms(fe, Phi, U, per_mass, partial(progress, "stiffening"))
    # forces on interface nodes, which a unit load reaches only through the interface
    links = np.asarray(fe.K @ U) - relieved
    links[:, units] += F[:, units]
    for k, link in enumerate(links.T):
        for part, interface in zip(body.interfaces, interfaces, strict=True):
            forms[k] += part.Phi_r.T @ interface_stiffness(fe, interface, link) @ part.Phi_r
    forms = 0.5 * (forms + forms.transpose(0, 2, 1))
    centrifugal = np.zeros((3, 3, body.m, body.m))
    for (a, b), form in zip(SYMMETRIC_PAIRS, forms, strict=False):
        centrifugal[a, b] = centrifugal[b, a] = form
    relevant = partial(_relevant_forms, body.K, _stretching_energy(fe))
    bends = forms[units].reshape(len(interfaces), 6, body.m, body.m)
    own = slice(units.stop, units.stop + len(patterns))
    table = body.nodes
    if table is not None and at_nodes:
        bend = np.zeros((len(at_nodes), 6, body.m, body.m))
        every = [(k, d) for k, count in enumerate(counts.values()) for d in range(count)]
        bend[tuple(np.transpose(every))] = forms[own.stop :]
        table = replace(table, bend_nodes=np.array(list(at_nodes)), bend=bend)
        table = replace(table, bend=np.array([relevant(one) for one in table.points_with_bend()]))
    return replace(
        body,
        centrifugal_stiffness=centrifugal,
        interfaces=tuple(
            replace(part, bend=relevant(replace(part, bend=bend)))
            for part, bend in zip(body.interfaces, bends, strict=True)
        ),
        loads=tuple(
            replace(load, points=bent_points(load.points, form))
            for load, form in zip(body.loads, forms[own], strict=True)
        ),
        nodes=table,
    )


def _relevant_forms(K: FloatArray, energy: float, point: Interface) -> FloatArray:
    """(6, m, m) forms of a point: zero of moments that would take the stiffness of a shape only as
    the point has turned too far for linear theory, or as no material is elastic.

    Moments are those about the principal axes of the flexibility of the point. `energy` is twice
    that of a unit strain all over the body.
    """
    assert point.bend is not None
    flexibilities, axes = np.linalg.eigh(point.Phi_r @ np.linalg.solve(K, point.Phi_r.T))
    forms = np.tensordot(axes.T, point.bend[3:], 1)
    for form, flexibility in zip(forms, flexibilities.clip(0.0), strict=True):
        stiffness = np.abs(eigh(form, K, eigvals_only=True)).max(initial=0.0)
        strain = np.sqrt(flexibility / energy)
        if stiffness < max(flexibility / _LARGEST_TURN, strain / _LARGEST_STRAIN):
            form[:] = 0.0
    return np.concatenate([point.bend[:3], np.tensordot(axes, forms, 1)])


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
