"""The same mechanisms in Exudyn, in its cheapest objects: three coordinates a body in a plane."""

from __future__ import annotations

import sys
import time

import numpy as np

sys.exudynFast = True  # its build without range checks
import exudyn as exu  # noqa: E402
import exudyn.itemInterface as item  # noqa: E402
from exudyn.rigidBodyUtilities import RigidBodyInertia  # noqa: E402

from tests.accuracyscenes import machines  # noqa: E402
from tests.peers.scenes import N_CHAIN, G  # noqa: E402

_SPARSE_FROM = 21  # coordinates, from which on it is faster than its dense solver
_POSITION = exu.OutputVariableType.Position


class Plane:
    """A system of planar bodies whose joints are pins."""

    def __init__(self, gravity=0.0):
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.gravity = gravity
        self.ground = self.mbs.AddObject(item.ObjectGround())
        self.bodies = {}

    def body(self, name, mass, inertia, center, angle, spin=0.0):
        """A body by its centre of mass (complex) and its angle."""
        node = self.mbs.AddNode(item.NodeRigidBody2D(
            referenceCoordinates=[center.real, center.imag, angle], initialVelocities=[0, 0, spin]
        ))  # fmt: skip
        made = item.ObjectRigidBody2D(physicsMass=mass, physicsInertia=inertia, nodeNumber=node)
        self.bodies[name] = (self.mbs.AddObject(made), node, center, angle)
        if self.gravity:
            marker = self.mbs.AddMarker(item.MarkerBodyMass(bodyNumber=self.bodies[name][0]))
            load = item.LoadMassProportional(markerNumber=marker, loadVector=[0, -self.gravity, 0])
            self.mbs.AddLoad(load)

    def local(self, name, point):
        """Coordinates on a body of a global point (complex) of the placed pose."""
        _, _, center, angle = self.bodies[name]
        z = (point - center) * np.exp(-1j * angle)
        return [z.real, z.imag, 0.0]

    def marker(self, name, point):
        at = [point.real, point.imag, 0.0] if name == "ground" else self.local(name, point)
        number = self.ground if name == "ground" else self.bodies[name][0]
        return self.mbs.AddMarker(item.MarkerBodyPosition(bodyNumber=number, localPosition=at))

    def pin(self, one, two, point):
        """A joint at a global point (complex)."""
        markers = [self.marker(one, point), self.marker(two, point)]
        self.mbs.AddObject(item.ObjectJointRevolute2D(markerNumbers=markers))

    def torque(self, name, value):
        marker = self.mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=self.bodies[name][0]))
        self.mbs.AddLoad(item.LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, value]))

    def on_x(self, name):
        """Hold y and the angle of a body at zero."""
        point = self.mbs.AddNode(item.NodePointGround())
        still = self.mbs.AddMarker(item.MarkerNodeCoordinate(nodeNumber=point, coordinate=0))
        for coordinate in (1, 2):
            moving = item.MarkerNodeCoordinate(
                nodeNumber=self.bodies[name][1], coordinate=coordinate
            )
            ends = [still, self.mbs.AddMarker(moving)]
            self.mbs.AddObject(item.CoordinateConstraint(markerNumbers=ends))

    def place(self, name, local):
        at = [local.real, local.imag, 0.0]
        return self.mbs.GetObjectOutputBody(self.bodies[name][0], _POSITION, localPosition=at)


def slider_crank():
    made, r, rod = Plane(G), machines.R, machines.L
    made.body("crank", 2, 0.01, r / 2 + 0j, 0.0)
    made.body("rod", 1, 0.02, r + rod / 2 + 0j, 0.0)
    made.body("slider", 0.5, 0.01, r + rod + 0j, 0.0)
    made.pin("ground", "crank", 0j)
    made.pin("crank", "rod", r + 0j)
    made.pin("rod", "slider", r + rod + 0j)
    made.on_x("slider")
    made.torque("crank", 5.0)

    def end():
        pin = made.place("crank", r / 2 + 0j)
        return np.array([made.place("slider", 0j)[0], pin[0], pin[1]])

    return made.mbs, end


def andrews():
    """Placed as the scene of flexmb is, body by body."""
    made, scene = Plane(), machines.andrews().to_scene_dict()
    model = machines.andrews()
    frames = {}
    for name, body in model.bodies.items():
        at, angle = complex(*body.position[:2]), _angle(body.orientation)
        center = at + complex(*body.center[:2]) * np.exp(1j * angle)
        made.body(name, body.mass, body.inertia[2][2], center, angle)
        frames[name] = (at, angle, {m: complex(*k.position[:2]) for m, k in body.markers.items()})
    frames["ground"] = (0j, 0.0, {
        m: complex(*k.position[:2]) for m, k in model.ground.markers.items()
    })  # fmt: skip

    def point(reference):
        name, _, marker = reference.partition(".")
        at, angle, markers = frames[name]
        return name, at + (markers[marker] if marker else 0j) * np.exp(1j * angle)

    for joint in scene["joints"].values():
        (one, at), (two, _) = (point(end) for end in joint["between"])
        made.pin(one, two, at)
    spring = model.forces["spring"]
    ends = [made.marker(*point(end)) for end in spring.between]
    made.mbs.AddObject(item.ObjectConnectorSpringDamper(
        markerNumbers=ends, stiffness=spring.stiffness, referenceLength=spring.free_length
    ))  # fmt: skip
    made.torque("K1", 0.033)
    _, _, center, angle = made.bodies["K2"]
    tip = (point("K2.E")[1] - center) * np.exp(-1j * angle)
    return made.mbs, lambda: made.place("K2", tip)[:2]


def _angle(orientation):
    e0, _, _, e3 = orientation
    return 2 * np.arctan2(e3, e0)


def chain():
    made = Plane(G)
    for k in range(N_CHAIN):
        made.body(f"b{k}", 1.0, 0.1, k + 0.5 + 0j, 0.0)
        made.pin(f"b{k - 1}" if k else "ground", f"b{k}", k + 0j)

    def end():
        return np.concatenate([made.place(f"b{k}", 0.5 + 0j)[:2] for k in range(N_CHAIN)])

    return made.mbs, end


def chain_tree():
    """The same in minimal coordinates (`ObjectKinematicTree`), for its explicit solvers."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    node = mbs.AddNode(item.NodeGenericODE2(
        referenceCoordinates=[0.0] * N_CHAIN, initialCoordinates=[0.0] * N_CHAIN,
        initialCoordinates_t=[0.0] * N_CHAIN, numberOfODE2Coordinates=N_CHAIN,
    ))  # fmt: skip
    inertias, coms, offsets = exu.Matrix3DList(), exu.Vector3DList(), exu.Vector3DList()
    turns = exu.Matrix3DList()
    for k in range(N_CHAIN):
        inertias.Append(np.diag([0.01, 0.1, 0.1]))
        coms.Append([0.5, 0, 0])
        offsets.Append([1.0 if k else 0.0, 0, 0])
        turns.Append(np.eye(3))
    tree = mbs.AddObject(item.ObjectKinematicTree(
        nodeNumber=node, jointTypes=[exu.JointType.RevoluteZ] * N_CHAIN,
        linkParents=[k - 1 for k in range(N_CHAIN)], jointTransformations=turns,
        jointOffsets=offsets, linkInertiasCOM=inertias, linkCOMs=coms,
        linkMasses=[1.0] * N_CHAIN, gravity=[0, -G, 0],
    ))  # fmt: skip

    def end():
        return np.concatenate([mbs.GetSensorValues(sensor)[:2] for sensor in sensors])

    sensors = [
        mbs.AddSensor(item.SensorKinematicTree(
            objectNumber=tree, linkNumber=k, localPosition=[1.0, 0, 0], writeToFile=False,
            outputVariableType=_POSITION,
        ))
        for k in range(N_CHAIN)
    ]  # fmt: skip
    return mbs, end


def spatial_slider_crank():
    """Bodies of Euler parameters, joints of one and three conditions each."""
    model = machines.spatial_crank()
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    gravity = [0, 0, -G]
    made = {}
    for name, body in model.bodies.items():
        spin = [6.0, 0, 0] if name == "crank" else [0.0, 0, 0]
        R = _cosines(body.orientation)
        made[name] = (body, R, spin)
    # velocities of rod and slider that fit the crank's
    pin, rate, x, x_rate, axes, rates = machines._spatial(0.0)
    rod_spin = 6.0 * 0.5 * np.cross(axes, rates).sum(axis=0)
    rod_speed = 6.0 * (rate + np.array([x_rate, 0, 0])) / 2
    speeds = {"crank": ([0, 0, 0], [6, 0, 0]), "rod": (rod_speed, rod_spin),
              "slider": ([6.0 * x_rate, 0, 0], [0, 0, 0])}  # fmt: skip
    ground = mbs.CreateGround()
    for name, (body, R, _) in made.items():
        speed, spin = speeds[name]
        inertia = RigidBodyInertia(mass=body.mass, inertiaTensor=np.array(body.inertia))
        made[name] = mbs.CreateRigidBody(
            inertia=inertia, referencePosition=list(body.position), referenceRotationMatrix=R,
            initialVelocity=list(speed), initialAngularVelocity=list(spin), gravity=gravity,
        )  # fmt: skip
    bearing = list(model.bodies["crank"].position)
    mbs.CreateRevoluteJoint(bodyNumbers=[ground, made["crank"]], position=bearing, axis=[1, 0, 0],
                            useGlobalFrame=True)  # fmt: skip
    mbs.CreateSphericalJoint(bodyNumbers=[made["crank"], made["rod"]], position=list(pin),
                             useGlobalFrame=True)  # fmt: skip
    mbs.CreatePrismaticJoint(bodyNumbers=[ground, made["slider"]], position=[x, 0, 0],
                             axis=[1, 0, 0], useGlobalFrame=True)  # fmt: skip
    # x of the first marker along y of the slider, y of the second along the rod's third axis
    first = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], float).T
    second = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float).T
    half = machines._ROD / 2
    markers = [
        mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=made["slider"], localPosition=[0, 0, 0])),
        mbs.AddMarker(item.MarkerBodyRigid(bodyNumber=made["rod"], localPosition=[half, 0, 0])),
    ]
    mbs.AddObject(item.ObjectJointGeneric(
        markerNumbers=markers, constrainedAxes=[1, 1, 1, 0, 0, 1], rotationMarker0=first,
        rotationMarker1=second,
    ))  # fmt: skip

    def end():
        arm = [0, machines._CRANK, 0]
        slider = mbs.GetObjectOutputBody(made["slider"], _POSITION, localPosition=[0, 0, 0])
        pin = mbs.GetObjectOutputBody(made["crank"], _POSITION, localPosition=arm)
        return np.array([slider[0], pin[1], pin[2]])

    return mbs, end


def _cosines(p):
    from tests.accuracyscenes.textbook import rotation

    return rotation(np.array(p, float))


MODELS = {
    "slider-crank": {"": slider_crank},
    "Andrews": {"": andrews},
    "spatial slider-crank": {"": spatial_slider_crank},
    "chain of 10": {"": chain, "minimal coordinates": chain_tree},
}
"""By scene of `tests.peers.scenes`: the ways to build it."""


def solvers(how):
    """Settings to try, by name: each the best for some model."""
    kinds = exu.DynamicSolverType
    if how:
        return {"DOPRI5": {"kind": kinds.DOPRI5}, "RK44": {"kind": kinds.RK44},
                "RK67": {"kind": kinds.RK67}}  # fmt: skip
    return {
        "generalized-α, index 2, fresh Jacobians, 1e-5": {"tolerance": 1e-5, "fresh": True},
        "generalized-α, index 2, fresh Jacobians": {"fresh": True},
        "generalized-α, index 2": {},
        "generalized-α, index 3": {"index2": False},
    }


def solve(mbs, end, duration, steps, kind=None, index2=True, fresh=False, tolerance=1e-8):
    """Places at the end, and processor time of the solver [s]."""
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = steps
    settings.timeIntegration.endTime = duration
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = 10 * duration
    settings.displayComputationTime = False
    newton = settings.timeIntegration.newton
    newton.useModifiedNewton = True
    newton.modifiedNewtonJacUpdatePerStep = fresh
    newton.relativeTolerance = tolerance
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.timeIntegration.generalizedAlpha.useIndex2Constraints = index2
    settings.timeIntegration.generalizedAlpha.useNewmark = index2
    if len(mbs.systemData.GetODE2Coordinates()) >= _SPARSE_FROM:
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    explicit = {}
    if kind is not None:
        settings.timeIntegration.automaticStepSize = False
        settings.timeIntegration.explicitIntegration.computeEndOfStepAccelerations = False
        explicit = {"solverType": kind}
    begin = time.process_time()
    done = mbs.SolveDynamic(settings, **explicit)
    cpu = time.process_time() - begin
    assert done or done is None
    return np.array(end(), float), cpu
