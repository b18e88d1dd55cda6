"""Pictures of a part analysis: deformed with stress in colour, and its mode shapes.

In: a :class:`PartResult`. Out: PNG files: the static solution over the undeformed part with the
reference points of supports; vibration modes and buckling modes in a grid each.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexmb.errors import ViewError
from flexmb.flexbody import PartResult
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.part_result import STATIC
from flexmb.units import SI, UnitSystem
from flexmb.view.camera import Camera, body_camera
from flexmb.view.content import Content, Deformed, Scale
from flexmb.view.drawing import round_exaggeration, size_of
from flexmb.view.fields import FIELDS, field_at_points, fitting_scale
from flexmb.view.modes import balls, mode_panel, panel_grid
from flexmb.view.picture import check_exaggeration, check_size, draw_panels
from flexmb.view.plot import BODIES, writable_file
from flexmb.view.shapes import sharp_edges

_FIRST = 6  # number of modes drawn


def render_part(
    result: PartResult,
    *,
    units: UnitSystem = SI,
    color: str = "von_mises",
    layer: str | None = None,
    exaggeration: float | str = "auto",
    direction: tuple[float, float, float] | None = None,
    size: tuple[int, int] | None = None,
    output: str | Path = "part.png",
) -> tuple[Path, ...]:
    """Draw a part: its static solution, and its first six modes of vibration and of buckling.

    Parameters
    ----------
    result : PartResult
        The part.
    units : UnitSystem
        Unit system of the numbers in the pictures.
    color : str
        Colour of the static solution: ``"von_mises"``, ``"principal"``, ``"strain_energy"`` or
        ``"displacement"``.
    layer : str, optional
        The layer whose stress is shown; by default the largest of all layers.
    exaggeration : float or "auto"
        Factor on the static deformation; ``"auto"``: a round one that shows it.
    direction : three floats, optional
        Direction from the part towards the eye, axes of the mesh; by default across its longest
        extent.
    size : two ints, optional
        Width and height in pixels of the picture of the static solution; 1280 by 720 by default.
    output : path
        The file of the static solution; those of modes have ``.modes`` and ``.buckling`` in their
        names.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    ViewError
        A wrong option, or nothing to draw.
    """
    path = writable_file(output, (".png",))
    surface = result.surface
    if surface is None or not len(surface.points):
        raise ViewError(f"{result.name}: has no surface to draw")
    if color not in FIELDS:
        raise ViewError.unknown_name("color", color, FIELDS)
    check_exaggeration(exaggeration)
    check_size(size or (1280, 720))
    camera = body_camera(surface.points, direction)
    written: list[Path] = []
    if STATIC in result.fields:
        content = _static(result, units, color, layer, exaggeration, camera)
        draw_panels([content], path, size or (1280, 720))
        written.append(path)
    places = np.array([part.position for part in result.interfaces]).reshape(-1, 3)
    shape = (len(places), 3, len(result.fields))
    moved = np.array([part.Phi_t for part in result.interfaces]).reshape(shape)
    figures = dict(zip((f"mode {k}" for k in result.numbers), result.frequencies, strict=True))
    for kind, suffix in (("mode", "modes"), ("buckling", "buckling")):
        columns = [k for k, name in enumerate(result.fields) if name.startswith(kind)][:_FIRST]
        panels = []
        for k in columns:
            name = result.fields[k]
            motion = np.concatenate([surface.modes[:, :, k], moved[:, :, k]])
            if kind == "mode":
                text = f"{name}: {units.say(figures[name], 'Hz', 4)}"
            else:
                factor = result.load_factors[int(name.split()[1]) - 1]
                text = f"{name}: {factor:.4g} times the loads"
            texts = (text, result.name)
            panels.append(mode_panel(result, motion, texts, "auto", camera))
        if panels:
            file = path.with_name(f"{path.stem}.{suffix}.png")
            draw_panels(panels, file, *panel_grid(len(panels)))
            written.append(file)
    return tuple(written)


def _static(
    result: PartResult,
    units: UnitSystem,
    color: str,
    layer: str | None,
    exaggeration: float | str,
    camera: Camera,
) -> Content:
    """The static solution over the undeformed part, with its supports."""
    surface, e = result.surface, result.column()
    assert surface is not None
    points, extent = surface.points, size_of(surface.points) or 1.0
    u = surface.modes @ e
    amount = np.linalg.norm(u, axis=1)
    ratio = float(amount.max()) / extent
    factor = round_exaggeration(ratio) if isinstance(exaggeration, str) else float(exaggeration)
    values: Array | None = amount
    if color != "displacement":
        values = field_at_points(result, e, color, layer)
        if values is None:
            names = () if result.stress is None else result.stress.layers
            what = f'{result.name}: has no stress in a layer "{layer}"'
            raise ViewError.unknown(what, str(layer), names)
    drawn = Deformed(
        result.name, points + factor * u, points, surface.faces, surface.lines, amount, BODIES[0],
        values, sharp=sharp_edges(points, surface.faces),
    )  # fmt: skip
    scale = fitting_scale([(drawn,)], color, units)
    moved = Scale.fitting(float(amount.max()), units)
    caption = [
        f"deformation {'to scale' if factor == 1.0 else f'exaggerated {factor:g} times'}",
        f"largest displacement {moved.top:.3g} {moved.unit}",
    ]
    if color != "displacement" and scale is not None:
        caption.append(f"largest {scale.quantity} {scale.top:.3g} {scale.unit}")
    places = np.array([support.position for support in result.supports]).reshape(-1, 3)
    return Content(
        title=result.name,
        caption=", ".join(caption),
        solids=balls(places, extent),
        deformed=(drawn,),
        scale=scale,
        camera=camera,
    )
