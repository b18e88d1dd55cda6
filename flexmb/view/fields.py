"""The values that colour flexible bodies: displacement, stress, strain energy per volume.

Displacement is relative to the body's reference. Stress is at the mesh nodes of the surface, the
largest over layers and sections there: von Mises, or the principal stress of largest magnitude with
its sign. Strain energy per volume is computed from the stress for an isotropic material, ((1 + nu)
σ:σ - nu (tr σ)²) / (2 E) (Timoshenko and Goodier, Theory of Elasticity, section 90).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from flexmb.errors import ViewError
from flexmb.flexbody import FlexBody, PartResult, principal_stresses, von_mises
from flexmb.flexbody.arrays import Array
from flexmb.units import UnitSystem
from flexmb.view.content import Deformed, Scale
from flexmb.view.mechanism import Mechanism


@dataclass(frozen=True)
class Field:
    """A quantity that colours bodies: its name, SI unit, whether it has a sign, its function of
    stress."""

    quantity: str
    unit: str
    signed: bool = False
    of_stress: Callable[[FlexBody | PartResult, Array, Any], Array] | None = None


def _principal(body: FlexBody | PartResult, stress: Array, rows: Any) -> Array:
    values = principal_stresses(stress)
    return np.where(np.abs(values[:, 2]) > values[:, 0], values[:, 2], values[:, 0])


def _strain_energy(body: FlexBody | PartResult, stress: Array, rows: Any) -> Array:
    assert body.stress is not None
    materials = _materials(body)
    E, nu = (np.array([row[k] for row in materials])[body.stress.part[rows]] for k in (0, 1))
    trace, shear = stress[:, :3].sum(axis=1), 2 * (stress[:, 3:] ** 2).sum(axis=1)
    square = (stress[:, :3] ** 2).sum(axis=1) + shear
    return np.asarray(((1 + nu) * square - nu * trace**2) / (2 * E))


FIELDS: Final = {
    "displacement": Field("displacement", "m"),
    "von_mises": Field(
        "von Mises stress", "Pa", of_stress=lambda body, stress, rows: von_mises(stress)
    ),
    "principal": Field("principal stress", "Pa", True, _principal),
    "strain_energy": Field("strain energy density", "J/m^3", of_stress=_strain_energy),
}


def _materials(body: FlexBody | PartResult) -> list[tuple[float, float]]:
    """E [Pa] and nu of each part that has stress."""
    assert body.stress is not None
    common = json.loads(body.provenance.get("material") or "{}")
    sections = json.loads(body.provenance.get("sections") or "{}")
    rows = []
    for part in body.stress.parts:
        material = (sections.get(part) or {}).get("material") or common
        E, nu = (material.get(key) for key in ("E", "nu"))
        if not isinstance(E, float | int) or not isinstance(nu, float | int):
            what = (
                f'the material of "{part}" of the body {body.name} is not isotropic, or not known'
            )
            raise ViewError(f'{what}: color = "strain_energy" needs E and nu; "von_mises" does not')
        rows.append((float(E), float(nu)))
    return rows


def stress_values(mechanism: Mechanism, color: str, layer: str | None) -> dict[str, Array | None]:
    """Values (n,) at the surface points of each flexible body; None for bodies without stress.

    Raises
    ------
    ViewError
        No body has stress, or none in the layer.
    """
    stress = {
        name: field_at_points(body, mechanism.pose(name).eta, color, layer)
        for name, body in mechanism.flexbodies.items()
    }
    if all(values is None for values in stress.values()):
        layers = {name for body in mechanism.flexbodies.values() if body.stress is not None
                  for name in body.stress.layers}  # fmt: skip
        if layers and layer is not None:
            what = f'no flexible body has stress in a layer "{layer}"'
            raise ViewError.unknown(what, layer, sorted(layers))
        what = 'no flexible body of the run has stress; reduce the mesh with stress = "surface"'
        raise ViewError(what)
    return stress


def field_at_points(
    body: FlexBody | PartResult, eta: Array, color: str, layer: str | None
) -> Array | None:
    """Value of largest magnitude over layers and sections at each surface point; NaN without
    stress."""
    function = FIELDS[color].of_stress
    assert function is not None
    if body.stress is None or body.surface is None:
        return None
    rows = body.stress.rows(layer=layer)
    if not len(rows):
        return None
    values = function(body, body.stress.at(eta, rows), rows)
    ids, nodes = body.stress.ids[rows], body.surface.node_ids
    count = max(ids.max(), nodes.max()) + 1
    high, low = np.full(count, np.nan), np.full(count, np.nan)
    np.fmax.at(high, ids, values)
    np.fmin.at(low, ids, values)
    largest = np.where(np.abs(low) > np.abs(high), low, high)
    return largest[nodes] if np.isfinite(largest[nodes]).any() else None


def fitting_scale(
    moments: list[tuple[Deformed, ...]], color: str, units: UnitSystem
) -> Scale | None:
    """The scale for everything coloured at some moments; None if nothing is."""
    shown = [body.values for bodies in moments for body in bodies if body.values is not None]
    if not shown or color not in FIELDS:
        return None
    field = FIELDS[color]
    largest = max(float(np.nanmax(np.abs(values))) for values in shown)
    least = -largest if field.signed else 0.0
    return Scale.fitting(largest, units, field.unit, field.quantity, least)
