"""Couplers and screws as rows that follow shared scalar coordinates.

An equation Σ a x = c between n joint coordinates x is n rows and n − 1 coordinates s without mass:
x_i = s_i for all but the last, x_n = (c − Σ a_i s_i)/a_n. So it takes one freedom away, the angles
in it count turns, and the multiplier of each row is what the coupler does to that joint: the
torques (forces) on all its joints are in proportion to a. A screw couples its own angle and stroke.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from flexmb.flexbody import FlexBody
from flexmb.model.model import Model

Factors = tuple[tuple[str, float], ...]


class CoupledRow(NamedTuple):
    """One joint coordinate that follows scalar coordinates, these by name."""

    owner: str  # name of its reaction
    joint: str
    coordinate: str
    factors: Factors
    offset: float
    relative: bool  # counted from the initial pose


def coupled_scalars(model: Model) -> Iterator[tuple[str, bool]]:
    """Names of the scalar coordinates of couplers and screws, and whether they are angles."""
    for name, spec in model.couplers.items():
        owners = spec.reaction_names(name)
        for owner, (_, coordinate) in zip(owners[:-1], spec.coordinates, strict=False):
            yield f"couplers.{owner}", coordinate != "stroke"
    for name, joint_spec in model.joints.items():
        if joint_spec.type == "screw":
            yield f"joints.{name}", True


def coupled_rows(model: Model, flexbodies: Mapping[str, FlexBody]) -> Iterator[CoupledRow]:
    """The rows of all couplers."""
    for name in model.couplers:
        coupling = model.couplers[name].equation(model, flexbodies)
        keys = tuple((term.joint, term.coordinate) for term in coupling.terms)
        owners = [f"couplers.{owner}" for owner in model.couplers[name].reaction_names(name)]
        last = coupling.terms[-1].factor
        for owner, key in zip(owners[:-1], keys, strict=False):
            yield CoupledRow(owner, *key, ((owner, 1.0),), 0.0, coupling.relative)
        factors = tuple(
            (owner, -term.factor / last)
            for owner, term in zip(owners[:-1], coupling.terms, strict=False)
        )
        yield CoupledRow(
            owners[-1], *keys[-1], factors, coupling.constant / last, coupling.relative
        )


def screw_rows(model: Model, name: str) -> tuple[CoupledRow, ...]:
    """Angle and stroke of a screw, which move together; none for other joints."""
    pitch = model.joints[name].pitch
    if pitch is None:
        return ()
    owner = f"joints.{name}"
    along = ((owner, pitch / (2.0 * math.pi)),)
    return (
        CoupledRow(owner, name, "angle", ((owner, 1.0),), 0.0, True),
        CoupledRow(owner, name, "stroke", along, 0.0, True),
    )
