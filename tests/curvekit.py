"""Models with joints on curves for tests: two bodies, rigid or flexible, and one such joint."""

from __future__ import annotations

import numpy as np
from generators import cloud, interface, random_rotation

from flexmb.model import Model
from flexmb.model.joints.joint import JOINT_TYPES

CARRIERS = {"rigid-rigid": (0, 0), "rigid-flexible": (0, 3), "flexible-flexible": (3, 4)}
TYPES = tuple(name for name, row in JOINT_TYPES.items() if row.curves)
CURVES = {
    "oval": {"polar": "1 + 0.2*cos(t) + 0.1*sin(2*t)", "closed": True},
    "wave": {"x": "t", "y": "0.3*sin(t)", "range": [0, 4]},
    "helix": {"x": "cos(t)", "y": "sin(t)", "z": "0.3*t"},
}
ON_CURVES = {
    "pin-in-slot": {"curve": "wave"},
    "point-on-curve": {"curve": "helix"},
    "cam-knife": {"curve": "oval"},
    "cam-roller": {"curve": "oval", "radius": 0.1},
    "cam-flat": {"curve": "oval"},
    "cam-cam": {"curve": "oval", "second_curve": "wave"},
}


def on_curve(model, kind, planar=False):
    """The words of a joint of that type, its curves added to the model."""
    fields = dict(ON_CURVES.get(kind, {}))
    if planar and kind == "point-on-curve":
        fields["curve"] = "wave"
    for name in {"curve", "second_curve"} & set(fields):
        model.add_curve(fields[name], **CURVES[fields[name]])
    return fields


def pair(carriers, planar=False):
    """Two bodies with a marker `end` each, in a field of gravity."""
    rng = np.random.default_rng(11)
    model = Model("pair", plane="xy" if planar else None, gravity=[1, -9, 0 if planar else 3])
    for name, m in zip("ab", CARRIERS[carriers], strict=True):
        turn = np.eye(3) if planar else random_rotation(rng)
        place = {"position": [*rng.standard_normal(2), 0.0], "orientation": turn.tolist()}
        if m:
            ends = [interface(rng, "node", m)]
            model.add_body(name, cloud(rng, m).flexbody(name, ends), **place)
            model.add_marker(f"{name}.end", interface="node", position=[0.1, -0.2, 0.3])
        else:
            center = [0.1, 0.2, 0.0 if planar else 0.1]
            model.add_body(name, mass=1.5, center=center, inertia=[1.0, 2.0, 2.5], **place)
            z = 0.0 if planar else 0.3
            model.add_marker(f"{name}.end", position=[*rng.standard_normal(2), z])
    return model


def joined(kind, carriers, planar=False):
    """The two bodies with a joint of that type."""
    model = pair(carriers, planar)
    fields = on_curve(model, kind, planar)
    if kind == "cam-flat":
        fields["axis"] = [0.8, 0.6, 0.0]
    model.add_joint("joint", kind, between=["a.end", "b.end"], **fields)
    return model
