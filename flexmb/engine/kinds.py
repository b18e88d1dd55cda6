"""The registry of what stages walk over, in their order: all kinds that a model may hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from flexmb.engine.bodies.flexible_body import FLEXIBLE_BODIES
from flexmb.engine.bodies.marker import FLEXIBLE_MARKERS, POINT_MARKERS, RIGID_MARKERS
from flexmb.engine.bodies.rigid_body import PLANAR_BODIES, RIGID_BODIES
from flexmb.engine.compile.forces.action_reaction_load import lower_action_reaction_loads
from flexmb.engine.compile.forces.contact import lower_contacts
from flexmb.engine.compile.forces.force_characteristic import lower_force_characteristics
from flexmb.engine.compile.forces.joint_friction import (
    lower_joint_frictions,
    place_joint_frictions,
)
from flexmb.engine.compile.forces.load import lower_loads
from flexmb.engine.compile.forces.six_component_force import lower_six_component_forces
from flexmb.engine.compile.forces.spring_damper import lower_springs
from flexmb.engine.joints.constraint import CONSTRAINT_ROWS, JOINTS
from flexmb.engine.joints.coordinate import COORDINATES
from flexmb.engine.joints.curve_marker import CURVE_MARKERS
from flexmb.engine.joints.point_joint import POINT_JOINTS
from flexmb.engine.kernels.forces.action_reaction_load import ACTION_REACTION_LOADS
from flexmb.engine.kernels.forces.contact import CONTACTS
from flexmb.engine.kernels.forces.force_characteristic import FORCE_CHARACTERISTICS
from flexmb.engine.kernels.forces.joint_friction import JOINT_FRICTIONS
from flexmb.engine.kernels.forces.load import LOADS
from flexmb.engine.kernels.forces.six_component_force import SIX_COMPONENT_FORCES
from flexmb.engine.kernels.forces.spring_damper import SPRINGS
from flexmb.engine.kernels.functions.time_function import TIME_FUNCTIONS
from flexmb.engine.kernels.sensors.feedback import FEEDBACK
from flexmb.engine.kernels.sensors.row_measure import JOINT_ANGLES
from flexmb.engine.kernels.sensors.turning import TURNING_ANGLES
from flexmb.engine.kind import Kind

__all__ = ["KINDS"]


def _lowered(kind: Kind, lower: Callable[..., Any]) -> Kind:
    """A kind with what makes its tables."""
    return replace(kind, lower=lower)


KINDS: tuple[Kind, ...] = (
    TIME_FUNCTIONS,
    COORDINATES,
    RIGID_BODIES,
    PLANAR_BODIES,
    FLEXIBLE_BODIES,
    POINT_MARKERS,
    RIGID_MARKERS,
    FLEXIBLE_MARKERS,
    CURVE_MARKERS,
    JOINTS,
    CONSTRAINT_ROWS,
    POINT_JOINTS,
    _lowered(SPRINGS, lower_springs),
    _lowered(LOADS, lower_loads),
    _lowered(ACTION_REACTION_LOADS, lower_action_reaction_loads),
    _lowered(SIX_COMPONENT_FORCES, lower_six_component_forces),
    _lowered(FORCE_CHARACTERISTICS, lower_force_characteristics),
    _lowered(CONTACTS, lower_contacts),
    replace(JOINT_FRICTIONS, lower=lower_joint_frictions, place=place_joint_frictions),
    JOINT_ANGLES,
    TURNING_ANGLES,
    FEEDBACK,
)
