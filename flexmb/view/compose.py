"""From a mechanism at a time to the content of a picture.

In: a :class:`Mechanism`, how much to exaggerate, what to colour, from where to look. Out: a
:class:`Content`. Bodies without a shape are drawn as links between the markers that joints hold on
to; ground is drawn as a pedestal under what turns on it and as a rail along what slides on it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import Problem, ViewError, nearest
from flexmb.model.joints.joint import JointSpec
from flexmb.model.values.names import GROUND
from flexmb.view.camera import camera_of
from flexmb.view.content import Content, Deformed, Scale, Solid
from flexmb.view.contours import contours, followed
from flexmb.view.geometry import Triangles, box, cylinder, joined, sphere, tube
from flexmb.view.ground import ground, is_ground
from flexmb.view.mechanism import Mechanism, size_of
from flexmb.view.style import BODIES
from flexmb.view.style import GROUND as GROUND_COLOR

__all__ = ["compose", "round_exaggeration"]

Array = NDArray[np.float64]

_VISIBLE = 0.05  # share of its size by which the most deformed body is to be seen deformed
_NOTHING = 1e-9  # share of its size below which a deformation is rounding, not to be blown up
_SEE_THROUGH = 0.55  # opacity of a shape with a joint inside
_LINK, _JOINT = 0.012, 0.018  # radii as shares of the mechanism's size


def compose(
    mechanism: Mechanism,
    *,
    exaggeration: float | str = "auto",
    color: str = "displacement",
    layer: str | None = None,
    direction: tuple[float, float, float] | None = None,
) -> Content:
    """Everything to draw; see :func:`flexmb.view.render` for the options."""
    factor = _factor(mechanism, exaggeration)
    colors = {
        name: _body_color(mechanism, name, i) for i, name in enumerate(mechanism.model.bodies)
    }
    deformed = tuple(_deformed(mechanism, factor, colors, _values(mechanism, color, layer)))
    drawn = {body.name for body in deformed}
    size = _size(mechanism, deformed)
    camera = camera_of(mechanism, direction)
    joints = _joint_points(mechanism)
    solids = [
        Solid(name, shape, colors[name], _opacity(shape, joints, mechanism.model.bodies[name]))
        for name in mechanism.model.bodies
        if name not in drawn and (shape := _rigid_shape(mechanism, name, size)) is not None
    ]
    solids += [Solid(GROUND, shape, GROUND_COLOR) for shape in ground(mechanism, size, camera)]
    scale = _scale(mechanism, color, deformed)
    return Content(
        title=mechanism.model.title,
        caption=_caption(mechanism, factor, deformed, scale),
        solids=tuple(solids),
        deformed=deformed,
        joints=joints,
        joint_radius=_JOINT * size,
        scale=scale,
        camera=camera,
    )


def round_exaggeration(ratio: float) -> float:
    """The largest of 1, 2, 5 times a power of ten by which a deformation stays within view.

    Parameters
    ----------
    ratio : float
        Largest displacement of a body over its size.

    >>> round_exaggeration(3e-5)
    1000.0
    """
    if ratio < _NOTHING or ratio >= _VISIBLE:
        return 1.0
    wanted = _VISIBLE / ratio
    power = 10.0 ** math.floor(math.log10(wanted) + 1e-9)
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1 + 1e-9))


def _factor(mechanism: Mechanism, exaggeration: float | str) -> float:
    if exaggeration != "auto":
        return float(exaggeration)
    ratios = [0.0]
    for name in mechanism.flexbodies:
        found = mechanism.surface(name, 0.0)
        if found is not None:
            _, undeformed, displacement = found
            ratios.append(float(displacement.max()) / max(size_of(undeformed), 1e-300))
    return round_exaggeration(max(ratios))


def _values(mechanism: Mechanism, color: str, layer: str | None) -> dict[str, Array | None]:
    """What colours the flexible bodies, by name; None for the displacement itself.

    Raises
    ------
    ViewError
        Stress is to be shown, and there is none of that layer.
    """
    if color != "von_mises":
        return dict.fromkeys(mechanism.flexbodies)
    found = {name: mechanism.von_mises(name, layer) for name in mechanism.flexbodies}
    if all(values is None for values in found.values()):
        known = {name for body in mechanism.flexbodies.values() if body.stress is not None
                 for name in body.stress.layers}  # fmt: skip
        if known and layer is not None:
            what = f'no flexible body has stress in a layer "{layer}"'
            raise ViewError.from_problems([Problem("", what, sorted(known), nearest(layer, known))])
        what = 'no flexible body of the run has stress; reduce the mesh with stress = "surface"'
        raise ViewError(what)
    return found


def _scale(mechanism: Mechanism, color: str, deformed: tuple[Deformed, ...]) -> Scale | None:
    units = mechanism.result.units
    if color == "displacement" and deformed:
        return Scale.fitting(max(float(body.displacement.max()) for body in deformed), units)
    shown = [float(np.nanmax(body.values)) for body in deformed if body.values is not None]
    if color == "von_mises" and shown:
        return Scale.fitting(max(shown), units, "Pa", "von Mises stress")
    return None


def _deformed(
    mechanism: Mechanism,
    factor: float,
    colors: dict[str, str],
    values: dict[str, Array | None],
) -> list[Deformed]:
    by_stress = any(given is not None for given in values.values())
    bodies = []
    for name, body in mechanism.flexbodies.items():
        found = mechanism.surface(name, factor)
        if found is not None and body.surface is not None:
            points, undeformed, displacement = found
            faces, lines = body.surface.faces, body.surface.lines
            shown = values[name]
            if shown is None and not by_stress:
                shown = displacement
            bodies.append(
                Deformed(name, points, undeformed, faces, lines, displacement, colors[name], shown)
            )
    return bodies


def _size(mechanism: Mechanism, deformed: tuple[Deformed, ...]) -> float:
    """Diagonal of all there is, at this time [m]; 1 for a single point."""
    points = [mechanism.pose(name).r[None, :] for name in mechanism.model.bodies]
    points += [body.undeformed for body in deformed]
    points += [_joint_points(mechanism)]
    for name, spec in mechanism.model.bodies.items():
        points += [part.points for part in contours(mechanism, name, 0.0)]
        shape = _shape(getattr(spec, "shape", None))
        if shape is not None:
            points.append(_in_place(mechanism, name, shape).points)
    return size_of(np.vstack(points)) or 1.0


def _joint_points(mechanism: Mechanism) -> Array:
    points = [
        mechanism.point(reference)
        for spec in mechanism.model.joints.values()
        for reference in _shown(spec)
        if not (spec.type in ("prismatic", "cylindrical") and is_ground(reference))
    ]
    return np.array(points).reshape(-1, 3)


def _shown(spec: JointSpec) -> tuple[str, ...]:
    """The markers of a joint where a ball shows it."""
    if spec.curves:
        return followed(spec)
    return spec.between[: 1 if spec.type not in ("prismatic", "cylindrical") else 2]


def _rigid_shape(mechanism: Mechanism, name: str, size: float) -> Triangles | None:
    """The body's own shape, with links to joints beyond it; or links alone."""
    spec = mechanism.model.bodies[name]
    shape = _shape(getattr(spec, "shape", None))
    points = _distinct([mechanism.point(ref) for ref in mechanism.used_markers(name)], size)
    drawn = contours(mechanism, name, size)
    if drawn and (shape is not None or len(points) > 1):
        links = _links(points, mechanism.pose(name).A, size) if shape is None else None
        return joined([*drawn, links or _in_place(mechanism, name, shape or box(np.zeros(3)))])
    if drawn:
        return joined(drawn)
    if shape is None:
        if len(points) < 2 and not spec.flexible:
            points = _distinct([*points, mechanism.point(f"{name}.center")], size)
        return _links(points, mechanism.pose(name).A, size)
    body = _in_place(mechanism, name, shape)
    middle = mechanism.point(f"{name}.center")
    reach = float(np.linalg.norm(shape.points, axis=1).max())
    far = [point for point in points if np.linalg.norm(point - middle) > reach]
    return joined([body, *(tube(middle, point, _LINK * size) for point in far)])


def _links(points: list[Array], A: Array, size: float) -> Triangles | None:
    if not points:
        return None
    if len(points) == 1:
        return box(np.full(3, 6 * _LINK * size)).moved(points[0], A)
    pairs = [(i, i + 1) for i in range(len(points) - 1)]
    if len(points) <= 4:
        pairs = [(i, j) for i in range(len(points)) for j in range(i + 1, len(points))]
    ends = [sphere(_LINK * size, point) for point in points]
    return joined([*(tube(points[i], points[j], _LINK * size) for i, j in pairs), *ends])


def _shape(spec: object) -> Triangles | None:
    """Triangles of a shape of the scene, about its own centre in body axes."""
    kind = getattr(spec, "type", None)
    if kind == "box":
        return box(spec.size)
    if kind == "cylinder":
        return cylinder(spec.radius, spec.length, np.eye(3)["xyz".index(spec.axis)])
    return sphere(spec.radius) if kind == "sphere" else None


def _in_place(mechanism: Mechanism, name: str, shape: Triangles) -> Triangles:
    return shape.moved(mechanism.point(f"{name}.center"), mechanism.pose(name).A)


def _opacity(shape: Triangles, joints: Array, spec: object) -> float:
    """Full, but for a shape of the scene that would hide the joints inside it."""
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    inside = ((joints > low) & (joints < high)).all(axis=1)
    hides = getattr(spec, "shape", None) is not None and inside.any()
    return _SEE_THROUGH if hides else 1.0


def _body_color(mechanism: Mechanism, name: str, index: int) -> str:
    return mechanism.model.bodies[name].color or BODIES[index % len(BODIES)]


def _caption(
    mechanism: Mechanism, factor: float, deformed: tuple[Deformed, ...], scale: Scale | None
) -> str:
    units = mechanism.result.units
    parts = [f"t = {mechanism.time:.6g} {units.label('s')}"]
    if deformed:
        seen = "to scale" if factor == 1.0 else f"exaggerated {factor:g} times"
        parts.append(f"deformation {seen}")
        most = max(deformed, key=lambda body: float(body.displacement.max()))
        moved = Scale.fitting(float(most.displacement.max()), units)
        parts.append(f"largest displacement {moved.top:.3g} {moved.unit} ({most.name})")
    if scale is not None and scale.quantity != "displacement":
        at = next(
            body.name
            for body in deformed
            if body.values is not None and np.nanmax(body.values) == scale.largest
        )
        parts.append(f"largest {scale.quantity} {scale.top:.3g} {scale.unit} ({at})")
    return ", ".join(parts)


def _distinct(points: list[Array], size: float) -> list[Array]:
    kept: list[Array] = []
    for point in points:
        if all(np.linalg.norm(point - other) > 1e-6 * size for other in kept):
            kept.append(point)
    return kept
