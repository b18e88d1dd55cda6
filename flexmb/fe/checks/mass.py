"""The mass of a body by its elements, against the assembled matrix.

In: blocks of elements; a finite-element model. Out: the sum of volumes (areas, lengths) times
density, without any mass matrix; a sentence where the two masses differ.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from flexmb.fe.assembly.assemble import FEMatrices
from flexmb.fe.elements.select import Block
from flexmb.flexbody.arrays import FloatArray

__all__ = ["mass_sentence", "nominal_mass", "point_mass"]

_DIFFERENCE = 1e-3  # relative; curved elements are measured by another quadrature than their mass
_SIMPSON = ((0.0, 1 / 6), (0.5, 2 / 3), (1.0, 1 / 6))  # exact for an area that varies as a square


def nominal_mass(blocks: Iterable[Block], points: FloatArray) -> float:
    """Volumes, areas or lengths of all elements times their density, and mass per area or length
    that adds no stiffness [kg]; the materials of all blocks are known."""
    total = 0.0
    for block in blocks:
        size = block.family.measure(points[block.nodes], block.section)
        total += float(np.sum(size * _density(block.section, block.family.dimension)))
    return total


def point_mass(masses: Mapping[str, Mapping[str, Any]] | None) -> float:
    """Sum of the masses at nodes and groups [kg]."""
    return float(sum(words["mass"] for words in (masses or {}).values()))


def mass_sentence(fe: FEMatrices, points: float = 0.0) -> str:
    """What is wrong with the assembled mass; empty if nothing is.

    Parameters
    ----------
    fe : FEMatrices
        The model.
    points : float
        Masses at nodes [kg].
    """
    expected = nominal_mass(fe.blocks, fe.mesh.points) + points
    R = fe.rigid[:, :3]
    found = np.einsum("ij,ij->j", R, fe.M @ R)
    worst = float(found[np.argmax(np.abs(found - expected))])
    if abs(worst - expected) <= _DIFFERENCE * expected:
        return ""
    return (
        f"the mass matrix holds {worst:.6g} kg, but volumes times density of the elements and the "
        f"masses at nodes are {expected:.6g} kg"
    )


def _density(section: Any, dimension: int) -> float | FloatArray:
    """Mass per volume, area or length."""
    if dimension == 3:
        return float(section.material.density)
    if dimension == 2:
        layers = sum(layer.thickness * layer.material.density for layer in section.layers)
        return float(layers + section.nonstructural)
    span = getattr(section, "span", None)
    if span is None:
        return float(section.material.density * section.A + section.nonstructural)
    return np.array([_mean(section.section, *ends) for ends in span])


def _mean(section: Any, start: float, end: float) -> float:
    """Mean mass per length of a section that varies, from one fraction of its chain to another."""
    parts = [(section.at(start + s * (end - start)), weight) for s, weight in _SIMPSON]
    return float(
        sum(w * (part.A * section.material.density + part.nonstructural) for part, w in parts)
    )
