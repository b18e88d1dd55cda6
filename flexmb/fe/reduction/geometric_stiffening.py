"""Geometric stiffening: what stresses do to the stiffness of the modes.

A body stores the reduced geometric stiffness of the six centrifugal loads per mass (e_a s_b + e_b
s_a)/2, of a unit force along each axis at each interface and at given nodes, and of its own loads.
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
from flexmb.flexbody.static_response import SYMMETRIC_PAIRS
from flexmb.progress import Progress, silent

_ALL = tuple(range(6))  # all six motions of a body, and of an interface


def with_geometric_stiffening(
    body: FlexBody,
    fe: FEMatrices,
    Phi: FloatArray,
    interfaces: tuple[ModelInterface, ...],
    patterns: tuple[LoadPattern, ...] = (),
    nodes: Sequence[int] = (),
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
    patterns : tuple of LoadPattern
        The loads of the body, in their order.
    nodes : sequence of int
        Nodes at which loads act or sensors measure.
    progress : Progress
        Called with the phase ``"stiffening"``.
    """
    fixed, relief = FixedInterfaceModel(fe, interfaces, _ALL), InertiaRelief(fe.M, fe.rigid)
    fields = centrifugal_fields(fe)
    loads = [f for f, _ in fields]
    forces = fixed.loads()
    loads += [forces[:, 6 * k + d] for k in range(len(interfaces)) for d in range(3)]
    units = slice(len(fields), len(loads))  # the unit forces at interfaces
    at_nodes = {node: node_loads(fe, node, ())[:, :3] for node in nodes}
    loads += [pattern.f for pattern in patterns]
    loads += [F[:, d] for F in at_nodes.values() for d in range(3)]
    F = np.column_stack(loads)
    relieved = relief.loads(F)
    U = fixed.free(relieved)
    per_mass = [-_acceleration(fe, one) for one in relief.acceleration(F).T]
    per_mass[: len(fields)] = [a + g for a, (_, g) in zip(per_mass, fields, strict=False)]
    forms = geometric_forms(fe, Phi, U, per_mass, partial(progress, "stiffening"))
    # forces on interface nodes; a unit force reaches the nodes only through the interface
    links = np.asarray(fe.K @ U) - relieved
    links[:, units] += F[:, units]
    for k, link in enumerate(links.T):
        for part, interface in zip(body.interfaces, interfaces, strict=True):
            forms[k] += part.Phi_r.T @ interface_stiffness(fe, interface, link) @ part.Phi_r
    forms = 0.5 * (forms + forms.transpose(0, 2, 1))
    centrifugal = np.zeros((3, 3, body.m, body.m))
    for (a, b), form in zip(SYMMETRIC_PAIRS, forms, strict=False):
        centrifugal[a, b] = centrifugal[b, a] = form
    bends = forms[units].reshape(len(interfaces), 3, body.m, body.m)
    own = slice(units.stop, units.stop + len(patterns))
    table = body.nodes
    if table is not None and at_nodes:
        bend = forms[own.stop :].reshape(len(at_nodes), 3, body.m, body.m)
        table = replace(table, bend_nodes=np.array(list(at_nodes)), bend=bend)
    return replace(
        body,
        centrifugal_stiffness=centrifugal,
        interfaces=tuple(
            replace(part, bend=bend) for part, bend in zip(body.interfaces, bends, strict=True)
        ),
        loads=tuple(
            replace(load, points=bent_points(load.points, form))
            for load, form in zip(body.loads, forms[own], strict=True)
        ),
        nodes=table,
    )


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
