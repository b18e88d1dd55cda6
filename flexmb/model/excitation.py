"""What excites the flexible bodies of a scene: how fast it is driven, and at which nodes.

In: drivers, loads that are functions of time, initial spins; joints and forces. Out: a frequency,
up to which bodies answer with inertia. A motion f(t) has the frequencies |ḟ|/2π of an angle that
turns round, and √(max |f̈| / max |f − mean|)/2π. Also where something acts beside the interfaces:
modes answer a load at an interface exactly, in the static limit, and at other nodes as well as the
vibration modes do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexmb.model.body import BodySpec
from flexmb.model.functions.expression import Expression
from flexmb.model.functions.function import Function
from flexmb.model.lookup import ModelData

BAND_FACTOR = 25.0
"""Cutoff over the fastest frequency: a mode answers statically to 1 % below a tenth of its
frequency, and between pins a bar vibrates at 0.44 of its frequency when free."""
_SAMPLES = 400
_MANY_CYCLES = 3.0


def cutoff_frequency(model: ModelData) -> float:
    """Frequency [Hz] from which on modes are quasi-static with ``deformation = "automatic"``.

    Infinite where nothing drives the scene.
    """
    fastest = max((value for _, value in driving_frequencies(model)), default=0.0)
    return BAND_FACTOR * fastest if fastest > 0.0 else math.inf


def slowest_oscillation(model: ModelData) -> float:
    """Frequency [Hz] of the slowest driver or load: of those over many cycles; else 0."""
    return min((hertz for _, hertz in oscillations(model)), default=0.0)


def oscillations(model: ModelData) -> Iterator[tuple[str, float]]:
    """Path and mean frequency [Hz] of drivers and loads; 0 of those that make few cycles."""
    end = getattr(model.dynamics or model.kinematics, "duration", 0.0)
    for _, path, function in _driving_functions(model):
        if function.constant is None:
            hertz = _mean_frequency(function, end)
            yield path, hertz if hertz * end > _MANY_CYCLES else 0.0


def driving_frequencies(model: ModelData) -> Iterator[tuple[str, float]]:
    """Path and frequency [Hz] of what drives the scene."""
    end = getattr(model.dynamics or model.kinematics, "duration", 0.0)
    for section, path, function in _driving_functions(model):
        yield path, _frequency(function, end, section == "angles")
    for name, spec in model.bodies.items():
        for start in spec.initial_velocities.values():
            if start.angular_velocity is not None:
                spin = float(np.linalg.norm(start.angular_velocity))
                yield f"bodies.{name}", spin / (2.0 * math.pi)


def _driving_functions(model: ModelData) -> Iterator[tuple[str, str, Function]]:
    """Functions of time that drive the scene, with their path, of angles marked as such."""
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
def _samples(expression: Expression, end: float) -> NDArray[np.float64]:
    """(times, 3) value, first and second derivative."""
    return np.array([expression.value(t) for t in np.linspace(0.0, end, _SAMPLES)])


def _mean_frequency(function: Function, end: float) -> float:
    """That of a harmonic with the same ratio of second derivative and value, in the mean."""
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
    """Path of each joint, driver or force, the body that it acts on at a node, and the marker."""
    for path, owner, marker in loads_on_bodies(model):
        if is_beside_interfaces(model.bodies[owner], marker.partition(".")[2]):
            yield path, owner, marker


def loads_on_bodies(model: ModelData) -> Iterator[tuple[str, str, str]]:
    """Path of each joint, driver or force, the flexible body that it acts on, and the marker."""
    flexible = {name for name, body in model.bodies.items() if body.flexible}
    for section in ("joints", "drivers", "forces") if flexible else ():
        for name, spec in getattr(model, section).items():
            for field in ("between", "marker", "at"):
                ends = getattr(spec, field, None) or ()
                for marker in (ends,) if isinstance(ends, str) else ends:
                    owner = marker.partition(".")[0]
                    if owner in flexible:
                        yield f"{section}.{name}", owner, marker


def is_beside_interfaces(body: BodySpec, place: str) -> bool:
    """Whether a marker of a flexible body, or its origin, is carried by no interface."""
    return bool(place) and marker_interface(body, place) is None


def marker_interface(body: BodySpec, place: str) -> str | None:
    """The interface that a marker of a body is, or that carries it."""
    marker = body.markers.get(place)
    return place if marker is None else marker.interface


def load_points(model: ModelData, name: str) -> list[int | tuple[float, ...]]:
    """Nodes of a body at which something acts, or positions [m] whose nearest nodes are meant."""
    points: list[int | tuple[float, ...]] = []
    for _, owner, reference in loads_beside_interfaces(model):
        if owner == name:
            marker = model.bodies[owner].markers[reference.partition(".")[2]]
            point = tuple(marker.position or ()) if marker.node is None else marker.node
            if point != () and point not in points:
                points.append(point)
    return points
