"""The registry of what stages run through, in their order: all kinds that a model may hold."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from flexmb.engine import forces
from flexmb.engine.bodies.flexible_body import FLEXIBLE_BODIES
from flexmb.engine.bodies.inertia_coupling import CONSTANT_BODIES, PARTIAL_BODIES
from flexmb.engine.bodies.marker import FLEXIBLE_MARKERS, POINT_MARKERS, RIGID_MARKERS
from flexmb.engine.bodies.membrane_forces import MEMBRANE_FORCES
from flexmb.engine.bodies.rigid_body import PLANAR_BODIES, RIGID_BODIES
from flexmb.engine.bodies.static_modes import STATIC_MODES
from flexmb.engine.function import TIME_FUNCTIONS
from flexmb.engine.joints.constraint import CONSTRAINT_ROWS, JOINTS
from flexmb.engine.joints.coordinate import COORDINATES
from flexmb.engine.joints.curve_marker import CURVE_MARKERS
from flexmb.engine.joints.point_joint import POINT_JOINTS
from flexmb.engine.kind import Kind
from flexmb.engine.sensors.feedback import FEEDBACK
from flexmb.engine.sensors.joint_coordinate import JOINT_ANGLES
from flexmb.engine.sensors.marker_motion import TURNING_ANGLES

FORCE_KINDS = [
    value
    for module in iter_modules(forces.__path__, f"{forces.__name__}.")
    for value in vars(import_module(module.name)).values()
    if isinstance(value, Kind)
]
"""All kinds of forces: those that the modules of `engine.forces` define."""
KINDS: tuple[Kind, ...] = (
    TIME_FUNCTIONS,
    COORDINATES,
    RIGID_BODIES,
    PLANAR_BODIES,
    FLEXIBLE_BODIES,
    PARTIAL_BODIES,
    CONSTANT_BODIES,
    STATIC_MODES,
    MEMBRANE_FORCES,
    POINT_MARKERS,
    RIGID_MARKERS,
    FLEXIBLE_MARKERS,
    CURVE_MARKERS,
    JOINTS,
    CONSTRAINT_ROWS,
    POINT_JOINTS,
    *FORCE_KINDS,
    JOINT_ANGLES,
    TURNING_ANGLES,
    FEEDBACK,
)
