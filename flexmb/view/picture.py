"""What one picture of a mechanism shows, and its drawing.

In: a :class:`Mechanism`, how much to exaggerate deformations, what colours it. Out: a
:class:`Content` by `compose`, and a PNG file by `draw_panels`: drawn by VTK where it renders, else
by matplotlib, which then says so in the picture and names what to install.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ViewError
from flexmb.model.reading import GROUND
from flexmb.view import mpl_renderer, vtk_renderer
from flexmb.view.content import (
    Content,
    Deformed,
    Mechanism,
    Scale,
    Solid,
    Triangles,
    mechanism_camera,
    size_of,
)
from flexmb.view.framing import Framing
from flexmb.view.plot import BODIES, GHOST
from flexmb.view.plot import GROUND as GROUND_COLOR
from flexmb.view.shapes import (
    body_shape,
    curve_shapes,
    ground_shapes,
    joint_points,
    line_shapes,
    own_shape,
)

Array = NDArray[np.float64]

COLORS = ("displacement", "von_mises", "body")
_MIN_PIXELS = 64
_VISIBLE = 0.05  # share of its size by which the most deformed body is to be seen deformed
_ROUND_OFF = 1e-9  # share of its size below which a deformation is rounding, not exaggerated
_SEE_THROUGH = 0.55  # opacity of a shape with a joint inside
_JOINT = 0.018  # radius of a ball as a share of the mechanism's size


def compose(
    mechanism: Mechanism,
    *,
    exaggeration: float | str = "auto",
    color: str = "displacement",
    layer: str | None = None,
    direction: tuple[float, float, float] | None = None,
    framing: Framing | None = None,
) -> Content:
    """Everything to draw; see :func:`flexmb.view.render` for the options.

    With a `framing` it is one picture of a motion, which says size, exaggeration, camera and scale.
    """
    if framing is None:
        factor = exaggeration_factor([mechanism], exaggeration)
    else:
        factor = framing.exaggeration
    colors = {
        name: body.color or BODIES[i % len(BODIES)]
        for i, (name, body) in enumerate(mechanism.model.bodies.items())
    }
    colored = framing is not None and framing.scale is not None
    values = _values(mechanism, color, layer)
    deformed = tuple(_deformed(mechanism, factor, colors, values, colored))
    drawn = {body.name for body in deformed}
    size = _size(mechanism, deformed) if framing is None else framing.size
    camera = mechanism_camera(mechanism, direction) if framing is None else framing.camera
    joints = joint_points(mechanism)
    solids = [
        Solid(name, shape, colors[name], _opacity(shape, joints, mechanism.model.bodies[name]))
        for name in mechanism.model.bodies
        if name not in drawn and (shape := body_shape(mechanism, name, size)) is not None
    ]
    solids += [
        Solid(GROUND, shape, GROUND_COLOR) for shape in ground_shapes(mechanism, size, camera)
    ]
    solids += [Solid("", shape, GHOST) for shape in line_shapes(mechanism, size)]
    scale = _scale(mechanism, color, deformed)
    return Content(
        title=mechanism.model.title,
        caption=_caption(mechanism, factor, deformed, scale, framing.digits if framing else None),
        solids=tuple(solids),
        deformed=deformed,
        joints=joints,
        joint_radius=_JOINT * size,
        scale=framing.scale if framing is not None and framing.scale is not None else scale,
        camera=camera,
        size=size,
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
    if ratio < _ROUND_OFF or ratio >= _VISIBLE:
        return 1.0
    limit = _VISIBLE / ratio * (1 + 1e-9)
    power = 10.0 ** math.floor(math.log10(limit))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= limit)


def draw_panels(
    panels: Sequence[Content], path: Path, size: tuple[int, int], columns: int = 1
) -> None:
    """Draw panels, row by row, with VTK where it renders, else with matplotlib."""
    verdict = vtk_renderer.probe()
    if verdict.works:
        vtk_renderer.draw(panels, path, size, columns, verdict)
    else:
        mpl_renderer.draw(panels, path, size, f"{verdict.how}; {verdict.advice}", columns)


def check_exaggeration(exaggeration: float | str | None) -> None:
    """Refuse what is neither a number of at least 0 nor ``"auto"``."""
    if isinstance(exaggeration, str) and exaggeration != "auto":
        raise ViewError(f'exaggeration "{exaggeration}" is neither a number nor "auto"')
    if isinstance(exaggeration, int | float) and not 0 <= exaggeration < float("inf"):
        raise ViewError(f"exaggeration {exaggeration} must be a number of at least 0")


def check_size(size: tuple[int, int]) -> None:
    """Refuse fewer than 64 pixels either way."""
    if min(size) < _MIN_PIXELS:
        raise ViewError(f"a picture of {size[0]} x {size[1]} pixels is too small to show anything")


def check_look(
    color: str = "displacement",
    exaggeration: float | str | None = None,
    layer: str | None = None,
    direction: tuple[float, float, float] | None = None,
) -> None:
    """Refuse options of a picture that cannot be."""
    if color not in COLORS:
        raise ViewError.unknown_name("color", color, COLORS)
    if layer is not None and color != "von_mises":
        raise ViewError(f'the layer "{layer}" is of stress; give color "von_mises" with it')
    check_exaggeration(exaggeration)


def exaggeration_factor(mechanisms: Sequence[Mechanism], exaggeration: float | str) -> float:
    """The factor on deformations; ``"auto"``: a round one that shows the largest of these times."""
    if exaggeration != "auto":
        return float(exaggeration)
    ratios = [0.0]
    for mechanism in mechanisms:
        for name in mechanism.flexbodies:
            surface = mechanism.surface(name, 0.0)
            if surface is not None:
                _, undeformed, displacement = surface
                ratios.append(float(displacement.max()) / max(size_of(undeformed), 1e-300))
    return round_exaggeration(max(ratios))


def _values(mechanism: Mechanism, color: str, layer: str | None) -> dict[str, Array | None]:
    """What colours the flexible bodies, by name; None for the displacement itself."""
    if color != "von_mises":
        return dict.fromkeys(mechanism.flexbodies)
    stress = {name: mechanism.von_mises(name, layer) for name in mechanism.flexbodies}
    if all(values is None for values in stress.values()):
        layers = {name for body in mechanism.flexbodies.values() if body.stress is not None
                  for name in body.stress.layers}  # fmt: skip
        if layers and layer is not None:
            what = f'no flexible body has stress in a layer "{layer}"'
            raise ViewError.unknown(what, layer, sorted(layers))
        what = 'no flexible body of the run has stress; reduce the mesh with stress = "surface"'
        raise ViewError(what)
    return stress


def color_scale(
    mechanism: Mechanism,
    color: str = "displacement",
    layer: str | None = None,
    direction: tuple[float, float, float] | None = None,
) -> Scale | None:
    """The colour scale of a picture at this time alone."""
    colors = dict.fromkeys(mechanism.flexbodies, "")
    bodies = _deformed(mechanism, 1.0, colors, _values(mechanism, color, layer))
    return _scale(mechanism, color, tuple(bodies))


def _scale(mechanism: Mechanism, color: str, deformed: tuple[Deformed, ...]) -> Scale | None:
    units = mechanism.result.units
    bent = [body for body in deformed if mechanism.pose(body.name).eta.any()]
    if color == "displacement" and bent:
        return Scale.fitting(max(float(body.displacement.max()) for body in bent), units)
    shown = [float(np.nanmax(body.values)) for body in deformed if body.values is not None]
    if color == "von_mises" and shown:
        return Scale.fitting(max(shown), units, "Pa", "von Mises stress")
    return None


def _deformed(
    mechanism: Mechanism,
    factor: float,
    colors: dict[str, str],
    values: dict[str, Array | None],
    colored: bool = False,
) -> list[Deformed]:
    by_stress = any(stress is not None for stress in values.values())
    bodies = []
    for name, body in mechanism.flexbodies.items():
        surface = mechanism.surface(name, factor)
        if surface is not None and body.surface is not None:
            points, undeformed, displacement = surface
            faces, lines = body.surface.faces, body.surface.lines
            shown = values[name]
            if shown is None and not by_stress and (colored or mechanism.pose(name).eta.any()):
                shown = displacement
            bodies.append(
                Deformed(name, points, undeformed, faces, lines, displacement, colors[name], shown)
            )
    return bodies


def _size(mechanism: Mechanism, deformed: tuple[Deformed, ...]) -> float:
    """Diagonal of all there is, at this time [m]; 1 for a single point."""
    points = [mechanism.pose(name).r[None, :] for name in mechanism.model.bodies]
    points += [body.undeformed for body in deformed]
    points += [joint_points(mechanism)]
    for name in mechanism.model.bodies:
        shape = own_shape(mechanism, name)
        shapes = [*curve_shapes(mechanism, name, 0.0), *([] if shape is None else [shape])]
        points += [part.points for part in shapes]
    return size_of(np.vstack(points)) or 1.0


def _opacity(shape: Triangles, joints: Array, spec: object) -> float:
    """Full, but for a shape of the scene that would hide the joints inside it."""
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    inside = ((joints > low) & (joints < high)).all(axis=1)
    hides = getattr(spec, "shape", None) is not None and inside.any()
    return _SEE_THROUGH if hides else 1.0


def _caption(
    mechanism: Mechanism,
    factor: float,
    deformed: tuple[Deformed, ...],
    scale: Scale | None,
    digits: int | None,
) -> str:
    units = mechanism.result.units
    time = f"{mechanism.time:.6g}" if digits is None else f"{mechanism.time:.{digits}f}"
    parts = [f"t = {time} {units.label('s')}"]
    if any(body.values is not None or mechanism.pose(body.name).eta.any() for body in deformed):
        seen = "to scale" if factor == 1.0 else f"exaggerated {factor:g} times"
        parts.append(f"deformation {seen}")
        most = max(deformed, key=lambda body: float(body.displacement.max()))
        moved = Scale.fitting(float(most.displacement.max()), units)
        parts.append(f"largest displacement {moved.top:.3g} {moved.unit} ({most.name})")
    if scale is not None and scale.quantity != "displacement":
        where = next(
            body.name
            for body in deformed
            if body.values is not None and np.nanmax(body.values) == scale.largest
        )
        parts.append(f"largest {scale.quantity} {scale.top:.3g} {scale.unit} ({where})")
    return ", ".join(parts)
