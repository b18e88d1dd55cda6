"""The registry of what stages walk over, in their order: all kinds that a model may hold."""

from __future__ import annotations

from flexmb.engine.bodies.flexible_body import FLEXIBLE_BODIES
from flexmb.engine.bodies.marker import FLEXIBLE_MARKERS, POINT_MARKERS, RIGID_MARKERS
from flexmb.engine.bodies.rigid_body import PLANAR_BODIES, RIGID_BODIES
from flexmb.engine.forces.bushing import SIX_COMPONENT_FORCES
from flexmb.engine.forces.contact import CONTACTS
from flexmb.engine.forces.force_characteristic import FORCE_CHARACTERISTICS
from flexmb.engine.forces.joint_friction import JOINT_FRICTIONS
from flexmb.engine.forces.load import ACTION_REACTION_LOADS, LOADS
from flexmb.engine.forces.spring_damper import SPRINGS
from flexmb.engine.functions.function import TIME_FUNCTIONS
from flexmb.engine.joints.constraint import CONSTRAINT_ROWS, JOINTS
from flexmb.engine.joints.coordinate import COORDINATES
from flexmb.engine.joints.curve_marker import CURVE_MARKERS
from flexmb.engine.joints.point_joint import POINT_JOINTS
from flexmb.engine.kind import Kind
from flexmb.engine.sensors.feedback import FEEDBACK
from flexmb.engine.sensors.joint_coordinate import JOINT_ANGLES
from flexmb.engine.sensors.orientation_angles import TURNING_ANGLES

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
    SPRINGS,
    LOADS,
    ACTION_REACTION_LOADS,
    SIX_COMPONENT_FORCES,
    FORCE_CHARACTERISTICS,
    CONTACTS,
    JOINT_FRICTIONS,
    JOINT_ANGLES,
    TURNING_ANGLES,
    FEEDBACK,
)
