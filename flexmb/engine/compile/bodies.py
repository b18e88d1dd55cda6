"""Table of bodies: offsets, rigid inertia, modal integrals in the pool, initial placement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.tables import BODY, Pool
from flexmb.flexbody import FlexBody
from flexmb.model.bodies.body import BodySpec, RigidBodySpec
from flexmb.model.model import Model

Array = NDArray[np.float64]


def body_table(model: Model, flexbodies: Mapping[str, FlexBody], pool: Pool) -> NDArray[np.void]:
    """BODY rows in the order of the model; panels are filled in later."""
    table = np.zeros(len(model.bodies), BODY)
    flexible = {k: flexbodies[name] for k, name in enumerate(model.bodies) if name in flexbodies}
    rigid = [k for k in range(len(table)) if k not in flexible]
    specs = [spec for name, spec in model.bodies.items() if name not in flexbodies]
    table["mass"][rigid], table["S1"][rigid], table["S0"][rigid] = second_moments(specs)
    for k, body in flexible.items():
        row = table[k]
        row["m"], row["mass"], row["S1"], row["S0"] = body.m, body.mass, body.S1, body.S0
        row["flex"] = pool.add(modal_block(body))
        row["damped"] = int(body.D is not None and np.any(body.D))
    for name, n in (("iq", 7 + table["m"]), ("iv", 6 + table["m"]), ("z", 12 * table["m"])):
        table[name] = np.cumsum(n) - n
    return table


def second_moments(specs: Sequence[BodySpec]) -> tuple[Array, Array, Array]:
    """Mass (n,), first (n, 3) and second moment ∫ρ s sᵀ (n, 3, 3) of rigid bodies about their
    origins.

    A mass distribution with inertia J about its centre has the second moment ½ tr(J) I − J.
    """
    mass, c, J = mass_properties(specs)
    second = 0.5 * np.trace(J, axis1=1, axis2=2)[:, None, None] * np.eye(3) - J
    first = mass[:, None] * c
    return mass, first, second + mass[:, None, None] * (c[:, :, None] * c[:, None, :])


def mass_properties(specs: Sequence[BodySpec]) -> tuple[Array, Array, Array]:
    """Mass (n,), centre (n, 3) and inertia about it (n, 3, 3) of rigid bodies."""
    of = [spec.mass_properties for spec in specs if isinstance(spec, RigidBodySpec)]
    assert len(of) == len(specs)  # flexible bodies are known by their FlexBody
    center = np.array([each.center for each in of]).reshape(-1, 3)
    inertia = np.array([each.inertia for each in of]).reshape(-1, 3, 3)
    return np.array([each.mass for each in of]), center, inertia


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
    pose = [(*spec.position, *spec.orientation) for spec in model.bodies.values()]
    q[bodies["iq"][:, None] + np.arange(7)] = pose
    return q


def modal_reach(body: FlexBody) -> Array:
    """Largest displacement anywhere on the body per unit of each modal coordinate (m,)."""
    fields = [interface.Phi_t for interface in body.interfaces]
    if body.surface is not None:
        fields.extend(body.surface.modes)
    if not fields:
        return np.sqrt(np.diag(body.M_eta) / body.mass)
    return np.linalg.norm(np.stack(fields), axis=1).max(axis=0)
