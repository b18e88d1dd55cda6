"""Table of bodies: offsets, rigid inertia, modal integrals in the pool, initial placement."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.pool import Pool
from flexmb.engine.tables import BODY
from flexmb.flexbody import FlexBody
from flexmb.model.bodies.body import BodySpec, RigidBodySpec
from flexmb.model.model import Model

Array = NDArray[np.float64]


def body_table(model: Model, flexbodies: Mapping[str, FlexBody], pool: Pool) -> NDArray[np.void]:
    """BODY rows in the order of the model; panels are filled in later."""
    table = np.zeros(len(model.bodies), BODY)
    iq = iv = z = 0
    for row, (name, spec) in zip(table, model.bodies.items(), strict=True):
        flexbody = flexbodies.get(name)
        m = 0 if flexbody is None else flexbody.m
        row["iq"], row["iv"], row["m"], row["z"] = iq, iv, m, z
        if flexbody is None:
            row["mass"], row["S1"], row["S0"] = second_moments(spec)
        else:
            row["mass"], row["S1"], row["S0"] = flexbody.mass, flexbody.S1, flexbody.S0
            row["flex"] = pool.add(modal_block(flexbody))
            row["damped"] = int(flexbody.D is not None and np.any(flexbody.D))
        iq, iv, z = iq + 7 + m, iv + 6 + m, z + 12 * m
    return table


def second_moments(spec: BodySpec) -> tuple[float, Array, Array]:
    """Mass, first moment and second moment ∫ρ s sᵀ about the body origin of a rigid body.

    A mass distribution with inertia J about its centre has the second moment ½ tr(J) I − J.
    """
    assert isinstance(spec, RigidBodySpec)  # flexible bodies are known by their FlexBody
    of = spec.mass_properties
    second = 0.5 * np.trace(of.inertia) * np.eye(3) - of.inertia
    return of.mass, of.mass * of.center, second + of.mass * np.outer(of.center, of.center)


def modal_block(body: FlexBody) -> Array:
    """The numbers of `tables.FLEX_LAYOUT` in one row."""
    M = body.Mab
    turned = np.concatenate([M[b, a] for a in range(3) for b in range(3)])
    gyroscopic = np.concatenate([M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]])
    damping = np.zeros_like(body.K) if body.D is None else body.D
    parts = (body.p, body.P, turned, gyroscopic, body.M_eta, body.K, damping)
    return np.concatenate([np.ascontiguousarray(part).ravel() for part in parts])


def placed_positions(model: Model, bodies: NDArray[np.void]) -> Array:
    """q of the placed, undeformed pose."""
    q = np.zeros(int((7 + bodies["m"]).sum()))
    for row, spec in zip(bodies, model.bodies.values(), strict=True):
        q[row["iq"] : row["iq"] + 3] = spec.position
        q[row["iq"] + 3 : row["iq"] + 7] = spec.orientation
    return q


def modal_reach(body: FlexBody) -> Array:
    """Largest displacement anywhere on the body per unit of each modal coordinate (m,)."""
    fields = [interface.Phi_t for interface in body.interfaces]
    if body.surface is not None:
        fields.extend(body.surface.modes)
    if not fields:
        return np.sqrt(np.diag(body.M_eta) / body.mass)
    return np.linalg.norm(np.stack(fields), axis=1).max(axis=0)
