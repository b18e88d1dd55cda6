"""Excitation of the flexible bodies of a scene: its frequencies, the loaded nodes, the rotations.

In: drivers, loads that are functions of time, initial spins; joints and forces. Out: the highest
frequency of excitation, by which quasi-static modes are told from dynamic ones. A function f(t)
counts with the frequency √(max |f̈| / max |f − mean|)/2π, a driven angle with max |ḟ|/2π if that is
higher.

Out: also the nodes besides the interfaces at which something acts, since modes contain the static
response to loads at interfaces exactly, but to loads at other nodes only as well as vibration modes
do. And the accelerations of a body by initial angular velocities and drivers, which show whether
its modes need the static responses to its own inertia loads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from flexmb.errors import FlexmbError
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.static_response import InertiaResponse
from flexmb.model.body import BodySpec
from flexmb.model.functions.expression import Expression
from flexmb.model.functions.function import Function
from flexmb.model.lookup import ModelData, global_axes, global_position, joint_frames
from flexmb.model.markers import rotation_matrix

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model.joints.driver import DriverSpec
    from flexmb.model.sensor import SensorSpec


BAND_FACTOR = 25.0
"""Cutoff frequency over the highest frequency of excitation. A mode responds statically to 1 % at a
tenth of its frequency, and between pins a bar vibrates at 0.44 of its free frequency."""
_SAMPLES = 400
_ROTATION_SAMPLES = 201  # times at which a driver is evaluated
_MIN_CYCLES = 3.0


def cutoff_frequency(model: ModelData) -> float:
    """Frequency [Hz] above which modes are quasi-static with ``deformation = "automatic"``.

    Infinite if nothing excites the scene.
    """
    fastest = max((value for _, value in driving_frequencies(model)), default=0.0)
    return BAND_FACTOR * fastest if fastest > 0.0 else math.inf


def slowest_oscillation(model: ModelData) -> float:
    """Frequency [Hz] of the slowest driver or load that makes several cycles in the run; 0 if
    none."""
    return min((hertz for _, hertz in oscillations(model)), default=0.0)


def oscillations(model: ModelData) -> Iterator[tuple[str, float]]:
    """Path and mean frequency [Hz] of drivers and loads; 0 for those with fewer than
    `_MIN_CYCLES`."""
    end = getattr(model.dynamics or model.kinematics, "duration", 0.0)
    for _, path, function in driving_functions(model):
        if function.constant is None:
            hertz = _mean_frequency(function, end)
            yield path, hertz if hertz * end > _MIN_CYCLES else 0.0


def driving_frequencies(model: ModelData) -> Iterator[tuple[str, float]]:
    """Path and highest frequency [Hz] of each driver and load."""
    end = getattr(model.dynamics or model.kinematics, "duration", 0.0)
    for section, path, function in driving_functions(model):
        yield path, _frequency(function, end, section == "angles")
    for name, spec in model.bodies.items():
        for start in spec.initial_velocities.values():
            if start.angular_velocity is not None:
                spin = float(np.linalg.norm(start.angular_velocity))
                yield f"bodies.{name}", spin / (2.0 * math.pi)


def driving_functions(model: ModelData) -> Iterator[tuple[str, str, Function]]:
    """Functions of time in drivers and loads: "angles" or the section, path, function."""
    end = getattr(model.dynamics or model.kinematics, "duration", 0.0)
    for section in ("drivers", "forces"):
        for name, spec in getattr(model, section).items():
            for field, value in spec:
                parts = value if isinstance(value, tuple) else (value,)
                for function in parts if end > 0.0 else ():
                    if isinstance(function, Function) and not function.expression.channels:
                        turns = section == "drivers" and field.endswith("angle")
                        yield "angles" if turns else section, f"{section}.{name}", function


@lru_cache(maxsize=64)
def _samples(expression: Expression, end: float) -> Array:
    """(times, 3) value, first and second derivative over the run."""
    return np.array([expression.value(t) for t in np.linspace(0.0, end, _SAMPLES)])


def _mean_frequency(function: Function, end: float) -> float:
    """Frequency of the harmonic with the same mean ratio of second derivative and value."""
    jets = _samples(function.expression, end)
    with np.errstate(all="ignore"):
        square = float(np.std(jets[:, 2]) / np.std(jets[:, 0]))
    return math.sqrt(square) / (2.0 * math.pi) if math.isfinite(square) else 0.0


def _frequency(function: Function, end: float, turns: bool) -> float:
    value, rate, second = _samples(function.expression, end).T
    size = float(np.abs(value - value.mean()).max())
    squares = [float(np.abs(second).max()) / size] if size > 0.0 else [0.0]
    if turns:
        squares.append(float(np.abs(rate).max()) ** 2)
    largest = max(square for square in squares if math.isfinite(square))
    return math.sqrt(largest) / (2.0 * math.pi)


def loads_beside_interfaces(model: ModelData) -> Iterator[tuple[str, str, str]]:
    """Path, body and marker of each joint, driver or force that acts on a node besides the
    interfaces."""
    for path, owner, marker in loads_on_bodies(model):
        if is_beside_interfaces(model.bodies[owner], marker.partition(".")[2]):
            yield path, owner, marker


def loads_on_bodies(model: ModelData) -> Iterator[tuple[str, str, str]]:
    """Path, body and marker of each joint, driver or force that acts on a flexible body."""
    flexible = {name for name, body in model.bodies.items() if body.flexible}
    for section in ("joints", "drivers", "forces") if flexible else ():
        for name, spec in getattr(model, section).items():
            for field in ("between", "marker", "relative_to", "at", "reaction"):
                ends = getattr(spec, field, None) or ()
                for marker in (ends,) if isinstance(ends, str) else ends:
                    owner = marker.partition(".")[0]
                    if owner in flexible:
                        yield f"{section}.{name}", owner, marker


def is_beside_interfaces(body: BodySpec, place: str) -> bool:
    """Whether a marker of a flexible body, or its origin, is not carried by an interface."""
    return bool(place) and marker_interface(body, place) is None


def marker_interface(body: BodySpec, place: str) -> str | None:
    """The interface that a marker is, or that carries it; None if a node carries it."""
    marker = body.markers.get(place)
    return place if marker is None else marker.interface


def load_points(model: ModelData, name: str) -> list[int | tuple[float, ...]]:
    """Nodes of a body at which something acts, or positions [m] whose nearest nodes are meant.

    With geometric stiffening also those at which sensors measure: the motion of an end that comes
    nearer as the body bends is that of a force there.
    """
    points: list[int | tuple[float, ...]] = []
    places = [marker for _, owner, marker in loads_beside_interfaces(model) if owner == name]
    if getattr(model.bodies[name], "geometric_stiffening", None) == "full":
        places += _sensors_beside_interfaces(model, name)
    for reference in places:
        marker = model.bodies[name].markers[reference.partition(".")[2]]
        point = tuple(marker.position or ()) if marker.node is None else marker.node
        if point != () and point not in points:
            points.append(point)
    return points


def _sensors_beside_interfaces(model: ModelData, name: str) -> list[str]:
    """Markers of sensors on nodes of a body besides its interfaces."""
    markers = (one for spec in model.sensors.values() for one in nodes_of_sensor(model, spec))
    return [marker for marker in markers if marker.partition(".")[0] == name]


def fastest_drives(model: ModelData) -> dict[str, tuple[str, float]]:
    """Path and frequency [Hz] of the fastest oscillation that acts on each body, by its name."""
    places = {(path, owner) for path, owner, _ in loads_on_bodies(model)}
    for name, driver in model.drivers.items():
        on = (owner for path, owner in places if path == f"joints.{driver.joint}")
        places |= {(f"drivers.{name}", owner) for owner in on}
    fastest: dict[str, tuple[str, float]] = {}
    for path, hertz in oscillations(model):
        for owner in (owner for place, owner in places if place == path):
            if hertz > fastest.get(owner, ("", 0.0))[1]:
                fastest[owner] = path, hertz
    return fastest


def nodes_of_sensor(model: ModelData, spec: SensorSpec) -> Iterator[str]:
    """Markers of a sensor on nodes of bodies besides their interfaces."""
    for field in ("of", "relative_to", "between"):
        ends = getattr(spec, field, None) or ()
        for marker in (ends,) if isinstance(ends, str) else ends:
            owner, _, place = marker.partition(".")
            if owner in model.bodies and is_beside_interfaces(model.bodies[owner], place):
                yield marker


def needs_inertia_residuals(model: ModelData, name: str, bodies: Mapping[str, FlexBody]) -> bool:
    """Whether the modes of a body need static responses to the inertia loads of prescribed
    rotations.

    Parameters
    ----------
    model : ModelData
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


def _accelerations(model: ModelData, name: str, bodies: Mapping[str, FlexBody]) -> Iterator[Array]:
    """(t, 12) numbers of `InertiaResponse` for each prescribed rotation."""
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
    model: ModelData, driver: DriverSpec, bodies: Mapping[str, FlexBody]
) -> Iterator[tuple[Array, Array]]:
    """A point and the direction of a driver's axis of rotation, global, in the placed pose.

    If it is not known because another body is not reduced yet: all three axes through the body's
    centre.
    """
    try:
        I, _ = joint_frames(model, driver.joint or "", bodies)  # noqa: E741
    except (FlexmbError, KeyError):
        name, body = next(iter(bodies.items()))
        spec = model.bodies[name]
        center = np.array(spec.position) + rotation_matrix(spec.orientation) @ body.center
        yield from ((center, axis) for axis in np.eye(3))
        return
    yield global_position(model, I), global_axes(model, I)[:, 2]


def _rotations(model: ModelData, name: str) -> Iterator[tuple[DriverSpec | None, Array, Array]]:
    """For each prescribed rotation the driver, or None, angular acceleration and angular velocity.

    For a driver (t,), about its axis and relative to the other body; for an initial velocity
    vectors (t, 3) in global axes.
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
    times = np.linspace(0.0, run.duration, _ROTATION_SAMPLES)
    for driver in model.drivers.values():
        ends = model.joints[driver.joint].between if driver.joint in model.joints else driver.ends
        of = {end.partition(".")[0] for end in ends}
        if not of & bodies or of <= bodies:
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


def _welded(model: ModelData, name: str) -> set[str]:
    """The bodies that fixed joints connect with a body, itself included."""
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
