"""What a joint needs beside markers and axes, in models of tests."""

from __future__ import annotations

from curvekit import CURVES, ON_CURVES


def special_fields(model, kind, planar=False):
    """Fields of a joint type beside axes, in a model that gets the curves they name."""
    fields = {"pitch": 0.7} if kind == "screw" else dict(ON_CURVES.get(kind, {}))
    if planar and kind == "point-on-curve":
        fields["curve"] = "wave"
    for word in {"curve", "second_curve"} & set(fields):
        if fields[word] not in model.curves:
            model.add_curve(fields[word], **CURVES[fields[word]])
    return fields
