"""The shapes of gears and racks: toothed wheels of their pitch radii that mesh as they are placed.

A wheel that is in several pairs is drawn once. Wheels lie in the plane of the second one of their
pair; those of bevel gears taper towards the point in which their axes meet.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmb.model.joints.gear import GearSpec, RackSpec
from flexmb.model.reading import split_reference
from flexmb.view.joint_shapes import slide_range
from flexmb.view.mechanism import Mechanism, inverse
from flexmb.view.part import GROUND, Part, on_body
from flexmb.view.shapes import Triangles, axes_along, rack, toothed_wheel, unit

Array = NDArray[np.float64]
_Wheel = tuple[str, Array, Array]  # body, centre (3,) and axis (3,) at this time
_Phases = dict[tuple[str, int, int], float]

_TEETH = 28  # of the smaller wheel where no numbers are said
_WIDTH = 0.3  # of a wheel, as a share of the smaller radius
_PARALLEL = 1e-6  # sine of the angle between axes that count as parallel


def gear_parts(mechanism: Mechanism, colors: dict[str, str]) -> Iterator[Part]:
    """Toothed wheels and racks, in the axes of the bodies that carry them."""
    phases: _Phases = {}
    for spec in mechanism.model.couplers.values():
        if not isinstance(spec, GearSpec | RackSpec):
            continue
        ends = [_wheel(mechanism, joint, spec.joints) for joint in spec.joints]
        if ends[0] is None or ends[1] is None:
            continue
        if isinstance(spec, RackSpec):
            shapes = _rack(mechanism, spec, ends[0], ends[1])
        elif np.linalg.norm(np.cross(ends[0][2], ends[1][2])) < _PARALLEL:
            shapes = _spur_gears(spec, ends[0], ends[1], phases)
        else:
            shapes = _bevel_gears(spec, ends[0], ends[1])
        for body, shape in shapes:
            local = inverse(mechanism.frame(body))
            yield Part(
                body,
                shape.moved(local[:3, 3], local[:3, :3]),
                colors.get(body, GROUND),
                on_body(body),
                "body",
            )


def _wheel(mechanism: Mechanism, joint: str, joints: tuple[str, str]) -> _Wheel | None:
    """What a joint hangs on the common carrier."""
    model = mechanism.model
    bodies = [{split_reference(end)[0] for end in model.joints[name].between} for name in joints]
    for reference, axes in zip(
        model.joints[joint].between, mechanism.joint_axes[joint], strict=True
    ):
        body = split_reference(reference)[0]
        if body not in bodies[0] & bodies[1]:
            frame = mechanism.marker_frame(reference)
            return body, frame[:3, 3], frame[:3, :3] @ axes[:, 2]
    return None


def _spur_gears(
    spec: GearSpec, first: _Wheel, second: _Wheel, phases: _Phases
) -> Iterator[tuple[str, Triangles]]:
    (_, x, u), (_, y, v) = first, second
    h = (y - x) - ((y - x) @ u) * u
    distance = float(np.linalg.norm(h))
    inside = spec.internal or (spec.ratio is not None and spec.ratio * (u @ v) > 0)
    n = spec.teeth or (spec.radii if spec.radii is not None else (abs(spec.ratio or 1.0), 1.0))
    apart = abs(n[0] - n[1]) if inside else n[0] + n[1]
    if spec.radii is not None:
        radii = spec.radii
    elif distance > 0 and apart > 0:
        radii = n[0] * distance / apart, n[1] * distance / apart
    else:
        return
    teeth = [max(round(count), 8) for count in spec.teeth or _counts(radii)]
    axes = axes_along(u)
    towards = float(np.arctan2(h @ axes[:, 1], h @ axes[:, 0]))  # from the first to the second
    larger = int(radii[1] > radii[0])
    meets = [towards, towards + np.pi]
    if inside:
        meets = [towards + (np.pi if larger else 0.0)] * 2
    middle = float((y - x) @ u), 0.0  # both lie in the plane of the second
    share = None
    for k, (body, centre, _) in enumerate((first, second)):
        key = body, round(1e6 * radii[k]), round(1e6 * float(y @ u))
        pitch = 2 * np.pi / teeth[k]
        drawn = key in phases
        if not drawn:
            wanted = 0.0 if share is None else (share + 0.5 if inside else 0.5 - share)
            phases[key] = meets[k] - wanted * pitch
        share = (meets[k] - phases[key]) / pitch
        if drawn:
            continue
        c, s = np.cos(phases[key]), np.sin(phases[key])
        turn = axes @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        shape = toothed_wheel(radii[k], teeth[k], _WIDTH * min(radii), bool(inside) and k == larger)
        yield body, shape.moved(centre + middle[k] * u, turn)


def _counts(radii: tuple[float, float]) -> tuple[float, float]:
    return radii[0] * _TEETH / min(radii), radii[1] * _TEETH / min(radii)


def _bevel_gears(spec: GearSpec, first: _Wheel, second: _Wheel) -> Iterator[tuple[str, Triangles]]:
    """Wheels whose axes meet: they taper towards that point."""
    (_, x, u), (_, y, v) = first, second
    s, t = np.linalg.lstsq(np.column_stack([u, -v]), y - x, rcond=None)[0]
    apex = x + s * u
    outward = [-np.sign(s) * u if abs(s) > 0 else u, -np.sign(t) * v if abs(t) > 0 else v]
    n = spec.teeth or spec.radii or (abs(spec.ratio or 1.0), 1.0)
    angle = float(np.arccos(np.clip(outward[0] @ outward[1], -1, 1)))
    cone = float(np.arctan2(np.sin(angle), n[1] / n[0] + np.cos(angle)))
    if spec.radii is not None:
        radii = spec.radii
    else:
        radius = (
            abs(s) * np.tan(cone) if abs(s) > 0 else abs(t) * np.tan(angle - cone) * n[0] / n[1]
        )
        radii = float(radius), float(radius * n[1] / n[0])
    if min(radii) <= 0:
        return
    teeth = [max(round(count), 8) for count in spec.teeth or _counts(radii)]
    width = _WIDTH * min(radii)
    for k, (body, _, _) in enumerate((first, second)):
        height = radii[k] / np.tan(cone if k == 0 else angle - cone)
        axes = axes_along(outward[k])
        h = outward[1 - k] @ axes
        phase = float(np.arctan2(h[1], h[0])) + (np.pi / teeth[1] if k else 0.0)
        c, sine = np.cos(phase), np.sin(phase)
        shape = toothed_wheel(radii[k], teeth[k], width)
        taper = 1.0 + (shape.points[:, 2:] - width / 2) / height * [1.0, 1.0, 0.0]
        points = shape.points * np.where([True, True, False], taper, 1.0)
        shape = Triangles(points + [0, 0, -width / 2], shape.faces)
        turn = axes @ np.array([[c, -sine, 0], [sine, c, 0], [0, 0, 1.0]])
        yield body, shape.moved(apex + height * outward[k], turn)


def _rack(
    mechanism: Mechanism, spec: RackSpec, pinion: _Wheel, bar: _Wheel
) -> Iterator[tuple[str, Triangles]]:
    (body, x, u), (other, y, d) = pinion, bar
    module, width = 2 * spec.radius / _TEETH, 1.5 * _WIDTH * spec.radius
    h = y - x
    n = unit(h - (h @ u) * u - (h @ d) * d)
    joint = mechanism.model.joints[spec.joints[1]]
    low, high = slide_range(mechanism, spec.joints[1], joint)
    pitch = np.pi * module
    count = int((high - low + 2.5 * spec.radius) / pitch) | 1  # odd: a tooth is in the middle
    I, J = (mechanism.point(reference) for reference in joint.between)  # noqa: E741
    ahead = abs(float((J - I) @ d)) - 0.5 * (abs(low) + abs(high))
    contact = x + spec.radius * n + (h @ u) * u + pitch * round(ahead / pitch) * d
    shape = rack(count, module, width, 4 * module)
    yield other, shape.moved(contact, np.column_stack([d, -n, np.cross(d, -n)]))
    axes = np.column_stack([n, np.cross(u, n), u])
    c, s = np.cos(np.pi / _TEETH), np.sin(np.pi / _TEETH)  # a gap meets that tooth
    turn = axes @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    yield body, toothed_wheel(spec.radius, _TEETH, width).moved(x + (h @ u) * u, turn)
