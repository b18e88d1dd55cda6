"""The rows of joints on curves, with their curve markers.

pin-in-slot, cam-knife   t·h = 0, n·h = 0             h from the curve marker to J
cam-roller               t·h = 0, n·h = ± radius
cam-flat                 m·h = 0, m·t = 0             m across the flat, h from J to the curve
cam-cam                  t·h = 0, n·h = 0, t·n₂ = 0   h from the first curve to the second
point-on-curve           h = 0                        in space, or in the plane of the model
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile.joints.curve_starts import (
    inside,
    nearest_pair,
    nearest_place,
    side_of_follower,
    tangent_place,
)
from flexmb.engine.compile.joints.curves import (
    Contact,
    Laid,
    Slider,
    Sliders,
    X,
    Y,
    Z,
    lay,
    placed_frame,
)
from flexmb.engine.compile.markers import Markers
from flexmb.engine.row_kinds import DOT1, DOT2, POINT
from flexmb.errors import Problem, SceneError
from flexmb.model import lookup
from flexmb.model.bodies.markers import PlacedMarker
from flexmb.model.joints.joint import JointSpec
from flexmb.model.model import Model
from flexmb.model.plane import plane_axes
from flexmb.model.values.names import GROUND

__all__ = ["OnCurve", "Site", "curve_joint"]

Array = NDArray[np.float64]


class OnCurve(NamedTuple):
    """Rows (kind, a, b, offset) between markers I and J; whether J of the joint is their I."""

    I: int  # noqa: E741
    J: int
    rows: tuple[tuple[int, int, int, float], ...]
    reversed: bool = False


@dataclass(frozen=True)
class Site:
    """Where a joint on curves is made: its markers I and J, and its group and first row."""

    model: Model
    name: str
    frames: tuple[PlacedMarker, PlacedMarker]
    markers: Markers
    sliders: Sliders
    group: int
    row: int

    @property
    def joint(self) -> JointSpec:
        """What the scene says of it."""
        return self.model.joints[self.name]

    def slide(self, laid: Laid, carrier: int, side: int, start: float, other: int = -1) -> int:
        """A curve marker of its own, on the side of the rows; carried by I or J (0, 1)."""
        pool, n = self.markers.pool, len(laid.pieces.coefficients)
        at = pool.add(laid.pieces.ends)
        pool.add(laid.pieces.coefficients)
        marker = self.markers.own(self.frames[carrier])
        shape = at, n, laid.closed, laid.turns
        self.sliders.found.append(Slider(self.name, marker, *shape, self.group, side, other, start))
        return marker

    def pushes(self, row: int, compressed: float) -> None:
        """It can only push, with this sign of the multiplier of one of its rows."""
        self.sliders.contacts.append(Contact(self.name, self.row + row, compressed))


def curve_joint(site: Site) -> OnCurve:
    """Rows of a joint on curves, with its curve markers.

    Raises
    ------
    SceneError
        A roller larger than the curve is hollow.
    """
    model, joint = site.model, site.joint
    assert joint.curve is not None  # joints on curves have one
    laid = lay(model, joint.curve, site.frames[0])
    if joint.second_curve is not None:
        return _cams(site, (laid, lay(model, joint.second_curve, site.frames[1])))
    x, R = placed_frame(model, site.frames[1])
    if joint.type == "cam-flat":
        return _flat(site, laid, x, R[:, Z])
    across = joint.type != "point-on-curve"
    s = nearest_place(laid, x, across) if joint.start is None else joint.start
    S, J = site.slide(laid, 0, 0, s), site.markers.add(site.frames[1])
    if not across:
        kept = (X, Y, Z) if model.plane is None else plane_axes(model.plane)[:2]
        return OnCurve(S, J, tuple((POINT, axis, axis, 0.0) for axis in kept))
    side, radius = _side(site, laid, s, x), joint.radius or 0.0
    if joint.type != "pin-in-slot":
        site.pushes(1, -side)
    if radius > 0.0:
        _refuse_hollow(model, site.name, laid, side, radius)
    return OnCurve(S, J, ((DOT2, X, X, 0.0), (DOT2, Y, Y, side * radius)))


def _flat(site: Site, laid: Laid, x: Array, normal: Array) -> OnCurve:
    """A flat through x: the curve's point in it, the curve along it."""
    s = site.joint.start
    s = tangent_place(laid, x, normal) if s is None else s
    S, J = site.slide(laid, 0, 1, s), site.markers.add(site.frames[1])
    _, _, n = laid.at(np.array([s]))
    site.pushes(0, _side(site, laid, s, x) * float(np.sign(n[0] @ normal)))
    return OnCurve(J, S, ((DOT2, Z, Z, 0.0), (DOT1, Z, X, 0.0)), True)


def _cams(site: Site, laid: tuple[Laid, Laid]) -> OnCurve:
    joint, k = site.joint, len(site.sliders.found)
    first, second = nearest_pair(*laid, joint.start)
    if joint.second_start is not None:
        second = joint.second_start
    S = site.slide(laid[0], 0, 0, first, k + 1)
    T = site.slide(laid[1], 1, 1, second, k)
    if laid[0].closed:
        within = inside(laid[0], laid[1].at(laid[1].samples[::8])[0]).mean() > 0.5
        side = -laid[0].outward if within else laid[0].outward
    else:
        side = side_of_follower(laid[0], first, _center(site.model, joint, laid[1].x))
    site.pushes(1, -side)
    return OnCurve(S, T, ((DOT2, X, X, 0.0), (DOT2, Y, Y, 0.0), (DOT1, X, Y, 0.0)))


def _side(site: Site, laid: Laid, s: float, x: Array) -> float:
    """Side of the curve that a follower acts on: 1 that of the normal."""
    joint = site.joint
    if joint.radius is not None:
        p, _, n = laid.at(np.array([s]))
        height = float(n[0] @ (x - p[0]))
        if abs(height) > 0.5 * joint.radius or not laid.closed:
            return 1.0 if height >= 0.0 else -1.0
    if laid.closed:
        return laid.outward
    return side_of_follower(laid, s, _center(site.model, joint, x))


def _center(model: Model, joint: JointSpec, marker: Array) -> Array:
    """Centre of mass of the follower; the mirror image of the cam's if the follower is ground."""
    I, J = (reference.partition(".")[0] for reference in joint.between)  # noqa: E741
    body = model.bodies[I if J == GROUND else J]
    if body.flexible:
        return marker
    found: Array = lookup.global_position(
        model, lookup.place_marker(model, f"{I if J == GROUND else J}.center")
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
