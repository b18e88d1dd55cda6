"""How initial angular velocities and drivers accelerate a body, before anything is run.

In: a scene and its reduced bodies. Out: the accelerations of a body's points as the twelve numbers
of :class:`flexmb.flexbody.InertiaResponse`, over the run. They say whether the modes of the body
answer its own inertia loads, or need the static responses to them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import FlexmbError
from flexmb.flexbody.static_response import InertiaResponse
from flexmb.model import lookup
from flexmb.model.markers import rotation_matrix

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model
    from flexmb.model.joints.driver import DriverSpec

Array = NDArray[np.float64]
_SAMPLES = 201  # times at which a driver is looked at


def needs_inertia_residuals(model: Model, name: str, bodies: Mapping[str, FlexBody]) -> bool:
    """Whether the modes of a body do not answer the inertia loads of its prescribed rotation.

    Parameters
    ----------
    model : Model
        The scene.
    name : str
        The body.
    bodies : mapping of str to FlexBody
        Reduced bodies, this one among them.
    """
    body = bodies[name]
    response = body.inertia_response
    return response is not None and any(
        response.needs_residuals(c, body.characteristic_length, body.mass)
        for c in _accelerations(model, name, bodies)
    )


def is_rotated(model: Model, name: str) -> bool:
    """Whether an initial angular velocity or a driver turns a body."""
    return next(_rotations(model, name), None) is not None


def _accelerations(model: Model, name: str, bodies: Mapping[str, FlexBody]) -> Iterator[Array]:
    """(t, 12) of each rotation that is prescribed."""
    spec, center = model.bodies[name], bodies[name].center
    A = rotation_matrix(spec.orientation)
    for driver, alpha, omega in _rotations(model, name):
        if driver is None:
            turns = [(np.zeros(3), alpha @ A, omega @ A)]
        else:
            turns = []
            for point, axis in _axes(model, driver, bodies):
                arm = center - A.T @ (point - np.array(spec.position))
                turns.append((arm, np.outer(alpha, axis @ A), np.outer(omega, axis @ A)))
        for arm, rate, w in turns:
            a = np.cross(rate, arm) + np.cross(w, np.cross(w, arm))
            yield InertiaResponse.factors(a, rate, w)


def _axes(
    model: Model, driver: DriverSpec, bodies: Mapping[str, FlexBody]
) -> Iterator[tuple[Array, Array]]:
    """A point and the direction of the axis that a driver turns about, global, as placed.

    Any axis where it is not known yet, on another body that is not reduced.
    """
    try:
        I, _ = lookup.joint_frames(model, driver.joint or "", bodies)  # noqa: E741
    except (FlexmbError, KeyError):
        name, body = next(iter(bodies.items()))
        spec = model.bodies[name]
        center = np.array(spec.position) + rotation_matrix(spec.orientation) @ body.center
        yield from ((center, axis) for axis in np.eye(3))
        return
    yield lookup.global_position(model, I), lookup.global_axes(model, I)[:, 2]


def _rotations(model: Model, name: str) -> Iterator[tuple[DriverSpec | None, Array, Array]]:
    """The driver, or None, with angular acceleration and velocity over the run.

    Of a driver about its axis (t,), of an initial one as a vector (t, 3), global.
    """
    run = model.dynamics or model.kinematics
    if run is None:
        return
    bodies = _welded(model, name)
    for body in bodies:
        for marker, initial in model.bodies[body].initial_velocities.items():
            if initial.angular_velocity is not None:
                spin = np.array(initial.angular_velocity)
                if initial.axes == "body" and marker in model.bodies[body].markers:
                    spin = rotation_matrix(model.bodies[body].markers[marker].orientation) @ spin
                if initial.axes == "body":
                    spin = rotation_matrix(model.bodies[body].orientation) @ spin
                if spin.any():
                    yield None, np.zeros((1, 3)), spin[None]
    times = np.linspace(0.0, run.duration, _SAMPLES)
    for driver in model.drivers.values():
        ends = model.joints[driver.joint].between if driver.joint in model.joints else driver.ends
        of = {end.partition(".")[0] for end in ends}
        if "ground" not in of or not of & bodies:
            continue
        for coordinate, function in driver.motions(model.plane):
            if "angle" in coordinate and not function.expression.channels:
                jets = np.array([tuple(function.value(t)) for t in times])
                if driver.order == 2:
                    omega, alpha = np.cumsum(jets[:, 0]) * (times[1] - times[0]), jets[:, 0]
                else:
                    omega, alpha = jets[:, 1 - driver.order], jets[:, 2 - driver.order]
                finite = np.isfinite(omega) & np.isfinite(alpha)
                if np.any(omega[finite]) or np.any(alpha[finite]):
                    yield driver, alpha[finite], omega[finite]


def _welded(model: Model, name: str) -> set[str]:
    """A body and those that fixed joints connect with it."""
    welds = [
        {end.partition(".")[0] for end in joint.between}
        for joint in model.joints.values()
        if joint.type == "fixed"
    ]
    bodies, size = {name}, 0
    while len(bodies) > size:
        size = len(bodies)
        bodies = bodies.union(*(weld for weld in welds if weld & bodies)) - {"ground"}
    return bodies
