"""The rows of joints on curves, with their curve markers.

pin-in-slot, cam-knife   t·h = 0, n·h = 0             h from the curve marker to J
cam-roller               t·h = 0, n·h = ± radius
cam-flat                 m·h = 0, m·t = 0             m across the flat, h from J to the curve
cam-cam                  t·h = 0, n·h = 0, t·n₂ = 0   h from the first curve to the second
point-on-curve           h = 0                        in space, or in the plane of the model
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.curve_starts import (
    inside,
    nearest_pair,
    nearest_place,
    side_of_follower,
    tangent_place,
)
from flexmb.engine.compile.curves import Contact, Laid, Sliders, X, Y, Z, lay, placed_frame
from flexmb.engine.compile.markers import Markers
from flexmb.engine.tables import DOT1, DOT2, POINT
from flexmb.errors import Problem, SceneError
from flexmb.model import lookup
from flexmb.model.joints import JointSpec
from flexmb.model.markers import PlacedMarker
from flexmb.model.model import Model
from flexmb.model.names import GROUND
from flexmb.model.plane import plane_axes

__all__ = ["OnCurve", "curve_joint"]

Array = NDArray[np.float64]


class OnCurve(NamedTuple):
    """Rows (kind, a, b, offset) between markers I and J; whether J of the joint is their I."""

    I: int  # noqa: E741
    J: int
    rows: tuple[tuple[int, int, int, float], ...]
    reversed: bool = False


def curve_joint(
    model: Model,
    name: str,
    frames: tuple[PlacedMarker, PlacedMarker],
    markers: Markers,
    sliders: Sliders,
    at: tuple[int, int],
) -> OnCurve:
    """Rows of a joint on curves; its curve markers go to `sliders`, `at` are its group and row.

    Raises
    ------
    SceneError
        A roller larger than the curve is hollow.
    """
    joint = model.joints[name]
    group, row = at
    assert joint.curve is not None  # joints on curves have one
    laid = lay(model, joint.curve, frames[0])
    x, R = placed_frame(model, frames[1])
    if joint.second_curve is not None:
        return _cams(model, name, (laid, lay(model, joint.second_curve, frames[1])), frames,
                     markers, sliders, at)  # fmt: skip
    flat = joint.type == "cam-flat"
    s = joint.start
    if s is None:
        across = joint.type != "point-on-curve"
        s = tangent_place(laid, x, R[:, Z]) if flat else nearest_place(laid, x, across)
    S = sliders.add(name, laid, frames[0], markers, group=group, side=int(flat), start=s)
    J = markers.add(frames[1])
    if joint.type == "point-on-curve":
        kept = (X, Y, Z) if model.plane is None else plane_axes(model.plane)[:2]
        return OnCurve(S, J, tuple((POINT, axis, axis, 0.0) for axis in kept))
    side = _side(model, name, laid, s, x)
    if flat:
        _, _, n = laid.at(np.array([s]))
        sliders.contacts.append(Contact(name, row, side * float(np.sign(n[0] @ R[:, Z]))))
        return OnCurve(J, S, ((DOT2, Z, Z, 0.0), (DOT1, Z, X, 0.0)), True)
    if joint.type != "pin-in-slot":
        sliders.contacts.append(Contact(name, row + 1, -side))
    radius = joint.radius or 0.0
    if radius > 0.0:
        _refuse_hollow(model, name, laid, side, radius)
    return OnCurve(S, J, ((DOT2, X, X, 0.0), (DOT2, Y, Y, side * radius)))


def _cams(
    model: Model,
    name: str,
    laid: tuple[Laid, Laid],
    frames: tuple[PlacedMarker, PlacedMarker],
    markers: Markers,
    sliders: Sliders,
    at: tuple[int, int],
) -> OnCurve:
    joint = model.joints[name]
    first, second = nearest_pair(*laid, joint.start)
    if joint.second_start is not None:
        second = joint.second_start
    k, group = len(sliders.found), at[0]
    S, T = (
        sliders.add(
            name, laid[n], frames[n], markers, group=group, side=n, start=s, other=k + 1 - n
        )
        for n, s in enumerate((first, second))
    )
    if laid[0].closed:
        within = inside(laid[0], laid[1].at(laid[1].samples[::8])[0]).mean() > 0.5
        side = -laid[0].outward if within else laid[0].outward
    else:
        side = side_of_follower(laid[0], first, _center(model, joint, laid[1].x))
    sliders.contacts.append(Contact(name, at[1] + 1, -side))
    return OnCurve(S, T, ((DOT2, X, X, 0.0), (DOT2, Y, Y, 0.0), (DOT1, X, Y, 0.0)))


def _side(model: Model, name: str, laid: Laid, s: float, x: Array) -> float:
    """Side of the curve that a follower acts on: 1 that of the normal."""
    joint = model.joints[name]
    if joint.radius is not None:
        p, _, n = laid.at(np.array([s]))
        height = float(n[0] @ (x - p[0]))
        if abs(height) > 0.5 * joint.radius or not laid.closed:
            return 1.0 if height >= 0.0 else -1.0
    if laid.closed:
        return laid.outward
    return side_of_follower(laid, s, _center(model, joint, x))


def _center(model: Model, joint: JointSpec, marker: Array) -> Array:
    """Centre of mass of the follower; the mirror image of the cam's if the follower is ground."""
    I, J = (reference.partition(".")[0] for reference in joint.between)  # noqa: E741
    body = model.bodies[I if J == GROUND else J]
    if body.flexible:
        return marker
    found: Array = lookup.global_position(
        model, lookup.placed(model, f"{I if J == GROUND else J}.center")
    )
    return 2.0 * marker - found if J == GROUND else found


def _refuse_hollow(model: Model, name: str, laid: Laid, side: float, radius: float) -> None:
    s = laid.samples
    c = laid.pieces.at(s)
    hollow = side * (c[:, 1, X] * c[:, 2, Y] - c[:, 1, Y] * c[:, 2, X])
    k = int(np.argmax(hollow))
    if hollow[k] * radius >= 1.0:
        say = model.units.say
        what = (
            f"the roller does not fit the curve, which is hollow {say(s[k], 'm')} along it with a "
            f"radius of {say(1.0 / hollow[k], 'm')}; take a smaller roller, or round the curve"
        )
        raise SceneError.from_problems([Problem(f"joints.{name}.radius", what)])
