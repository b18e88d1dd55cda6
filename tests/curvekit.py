"""Curves for joints that slide along one, and what each such joint type needs of them."""

from __future__ import annotations

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


def special_fields(model, kind, planar=False):
    """Fields of a joint type beside axes, in a model that gets the curves they name."""
    fields = {"pitch": 0.7} if kind == "screw" else dict(ON_CURVES.get(kind, {}))
    if planar and kind == "point-on-curve":
        fields["curve"] = "wave"
    for word in {"curve", "second_curve"} & set(fields):
        if fields[word] not in model.curves:
            model.add_curve(fields[word], **CURVES[fields[word]])
    return fields
