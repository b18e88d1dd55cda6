"""What a scene with a known solution is, and the same scene elsewhere, of another size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexmb.model import Model

from .textbook import found_once

AWAY = (1000.0, -500.0, 800.0)
"""m, where a scene is moved to."""


@dataclass(frozen=True)
class Scene:
    """A model, how long it is run, and the motion it must make.

    Attributes
    ----------
    make : callable
        `make(size)`: the model, all its lengths times `size`, masses and times as they are.
    duration : float
        s.
    truth : callable
        `truth(t)`: values (len(t),) by channel, at size 1, of all that is judged.
    sized : bool
        Whether it has lengths at all.
    stiff : bool
        Whether an explicit method would need very many steps.
    """

    make: Callable[[float], Model]
    duration: float
    truth: Callable[[np.ndarray], dict[str, np.ndarray]]
    sized: bool = True
    stiff: bool = False
    outputs: int = 100

    def __post_init__(self):
        object.__setattr__(self, "truth", found_once(self.truth))


def truth_of(scene, t, size=1.0, away=(0.0, 0.0, 0.0)):
    """Channels of a scene as it is at a size, moved."""
    model, found = scene.make(size), {}
    for channel, values in scene.truth(t).items():
        name, _, axis = channel.partition(".")
        sensor = model.sensors.get(name)
        kind = getattr(sensor, "type", "")
        long = kind in ("position", "distance", "stroke")
        origin = away["xyz".index(axis)] if kind == "position" and not sensor.relative_to else 0.0
        found[channel] = (size if long else 1.0) * np.asarray(values, float) + origin
    return found


def moved(model, away=AWAY):
    """The same scene about another point: its bodies, and all that stands on ground."""
    scene = model.to_scene_dict()
    for body in scene.get("bodies", {}).values():
        body["position"] = list(np.add(body.get("position", [0, 0, 0]), away))
    ground = scene.setdefault("ground", {}).setdefault("markers", {})
    for marker in ground.values():
        marker["position"] = list(np.add(marker.get("position", [0, 0, 0]), away))
    ground["away"] = {"position": list(away)}
    for group in ("joints", "forces", "sensors", "drivers"):
        for spec in scene.get(group, {}).values():
            for key in ("between", "relative_to", "of", "reaction"):
                if key in spec:
                    spec[key] = _shifted(spec[key])
    return Model.from_scene_dict(scene)


def far_apart(model, away=AWAY):
    """The same scene about another point, in a model that also has a body at the origin.

    It is so large that the coordinates of its equations have their origin there.
    """
    made = moved(model, away)
    made.add_body("mast", mass=1.0, inertia=[1, 1, 1])
    made.add_joint("foot", "fixed", between=["ground", "mast"])
    return made


def _shifted(names):
    if isinstance(names, str):
        return "ground.away" if names == "ground" else names
    return [_shifted(name) for name in names]


def beside_a_large_motion(model, size=1e3):
    """The same scene, and far from it a flywheel of 1 km that turns, with a sensor on its rim."""
    model.add_marker("ground.far", position=[0, 0, 10 * size])
    model.add_body("flywheel", mass=1.0, inertia=[size**2] * 3, position=[0, 0, 10 * size],
                   angular_velocity=[0, 0, 1.0])  # fmt: skip
    model.add_marker("flywheel.rim", position=[size, 0, 0])
    model.add_joint("flywheel", "revolute", between=["ground.far", "flywheel"], axis="z")
    model.add_sensor("far_rim", "position", of="flywheel.rim")
    return model
