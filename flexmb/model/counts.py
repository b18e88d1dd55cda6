"""What a model consists of, counted from its data: bodies, coordinates, equations, freedoms.

In: a model, and the flexible bodies as far as they are known. Out: :class:`Counts`. The mobility is
Grübler's number, coordinates less equations; it says nothing about redundant equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexmb.model import lookup
from flexmb.model.joints.joint import JOINT_TYPES, JointType

if TYPE_CHECKING:
    from flexmb.model.model import Model


@dataclass(frozen=True)
class JointCount:
    """Joints of one type and the equations they bring."""

    type: str
    joints: int
    equations: int


@dataclass(frozen=True)
class Counts:
    """Counts of a model, in space or in a plane."""

    rigid_bodies: int
    flexible_bodies: int
    joints: tuple[JointCount, ...]
    drivers: int
    """Equations of all drivers, one for each coordinate that they prescribe."""
    forces: int
    sensors: int
    planar: bool
    couplers: int
    modes: int | None
    """Modal coordinates of all flexible bodies; None while one of them is not reduced."""

    @property
    def rigid_coordinates(self) -> int:
        """Six for each body, three in a plane, modes apart."""
        return (3 if self.planar else 6) * (self.rigid_bodies + self.flexible_bodies)

    @property
    def equations(self) -> int:
        """Of the joints, and one of each coupler; without drivers."""
        return sum(row.equations for row in self.joints) + self.couplers

    @property
    def mobility(self) -> int:
        """Rigid coordinates less the equations of joints, couplers and drivers."""
        return self.rigid_coordinates - self.equations - self.drivers


def count(model: Model, flexbodies: lookup.Bodies | None = None) -> Counts:
    """Count what a model consists of."""
    flexbodies = flexbodies or {}
    flexible = [name for name, spec in model.bodies.items() if spec.flexible]
    flexbodies_of = [lookup.flexbody_of(model, name, flexbodies) for name in flexible]
    bodies = [body for body in flexbodies_of if body is not None]
    used = [spec.type for spec in model.joints.values()]
    joints = tuple(
        JointCount(
            name,
            used.count(name),
            used.count(name) * _equations(row, model.plane is not None),
        )
        for name, row in JOINT_TYPES.items()
        if name in used
    )
    return Counts(
        rigid_bodies=len(model.bodies) - len(flexible),
        flexible_bodies=len(flexible),
        joints=joints,
        drivers=sum(len(spec.motions(model.plane)) for spec in model.drivers.values()),
        forces=len(model.forces),
        sensors=len(model.sensors),
        planar=model.plane is not None,
        couplers=len(model.couplers),
        modes=sum(body.m for body in bodies) if len(bodies) == len(flexible) else None,
    )


def _equations(row: JointType, planar: bool) -> int:
    """Equations of a joint type; none where it has no meaning."""
    return (row.planar_equations or 0) if planar else row.equations
