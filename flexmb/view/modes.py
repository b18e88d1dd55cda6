"""Mode shapes of a flexible body, one or several in a grid; Campbell diagrams, root loci.

In: a :class:`FlexBody` or its file, numbers of modes, interfaces that are fixed. Out: a PNG file
with each mode drawn deformed over the undeformed body, with its number and frequency above,
coloured by its displacement over the largest. The modes are the natural modes of the reduced body,
numbered from 1 as in the checks of a scene; those of the free body are its modal coordinates,
starting with eta.0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexmb.errors import ViewError
from flexmb.flexbody import FlexBody, PartResult, load
from flexmb.flexbody.arrays import Array
from flexmb.flexbody.natural_modes import natural_modes
from flexmb.progress import Progress, silent
from flexmb.view.body_shapes import plates_of
from flexmb.view.camera import Camera, body_camera
from flexmb.view.content import PIN, Content, Deformed, Scale, Solid
from flexmb.view.drawing import size_of
from flexmb.view.encoder import check_output, real_rate
from flexmb.view.film import RATE, check_processes, check_rate, make_film
from flexmb.view.mechanism import transform
from flexmb.view.picture import check_exaggeration, check_size, columns_of, draw_panels
from flexmb.view.plot import BODIES, INK, LINES, new_figure, style_axes, writable_file
from flexmb.view.shapes import sharp_edges, sphere

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from flexmb.analysis.linear.linearization import ModeSweep
    from flexmb.analysis.static_sweep import StaticSweep


_DEFAULT_MODES = 6  # number of modes drawn if none are named
_AMPLITUDE = 0.10  # largest displacement of a mode over the body's size
_INTERFACE_RADIUS = 0.012  # radius of the ball at an interface over the body's size
_PERIOD = 2.0  # seconds of one vibration in a film
_CELL = (640, 420)  # pixels of a panel if no size is given
_SINGLE = (1280, 720)
_ORDERS = (1, 2, 3)  # multiples of the speed that are drawn
_MAX_CURVES = 12  # largest number of modes in a Campbell diagram or root locus
_LEAST_DAMPING = 1e-6  # of a root locus: half the width of the plot over its height, at least


def render_modes(
    body: FlexBody | str | Path,
    modes: int | Sequence[int] | None = None,
    *,
    held: Sequence[str] = (),
    exaggeration: float | str = "auto",
    direction: tuple[float, float, float] | None = None,
    size: tuple[int, int] | None = None,
    output: str | Path = "modes.png",
) -> Path:
    """Draw mode shapes of a flexible body.

    Parameters
    ----------
    body : FlexBody or path
        The body, or its file.
    modes : int or sequence of int, optional
        Numbers of the modes, from 1; by default the first six.
    held : sequence of str, optional
        Interfaces that are fixed while the body vibrates, such as ``("root",)``; by default the
        body is free, and its rigid motions are not counted.
    exaggeration : float or "auto"
        Factor on modes of unit modal mass; ``"auto"``: the largest displacement is a tenth of the
        body's size.
    direction : three floats, optional
        Direction from the body towards the eye, body axes; by default across its longest extent.
    size : two ints, optional
        Width and height of the picture in pixels.
    output : path
        A file that ends in .png.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ViewError
        A mode that the body does not have, nothing to draw, or a wrong option.
    ReductionError
        An interface that the body does not have.
    BodyFileError
        The file is missing or damaged.
    """
    path = writable_file(output, (".png",))
    shot = _shot(body, modes, held, exaggeration, direction, size, 1)
    draw_panels(shot.panels(0), path, shot.size, shot.columns)
    return path


def film_modes(
    body: FlexBody | str | Path,
    modes: int | Sequence[int] | None = None,
    *,
    held: Sequence[str] = (),
    exaggeration: float | str = "auto",
    direction: tuple[float, float, float] | None = None,
    size: tuple[int, int] | None = None,
    fps: float = RATE,
    output: str | Path | None = None,
    processes: int | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Path:
    """Make a film of mode shapes: one period of each, all of the same duration, to be repeated.

    Parameters and errors are those of `render_modes` and of `film`; the output is by default
    ``<body>.modes.gif`` beside the body.

    Returns
    -------
    Path
        The file or folder.
    """
    if output is None:
        folder = Path() if isinstance(body, FlexBody) else Path(body).parent
        name = body.name if isinstance(body, FlexBody) else Path(body).name.partition(".")[0]
        output = folder / f"{name}.modes.gif"
    path = check_output(output, force)
    rate = real_rate(path, check_rate(fps))
    check_processes(processes)
    count = max(2, round(_PERIOD * rate))
    shot = _shot(body, modes, held, exaggeration, direction, size, count)
    make_film(shot, count, path, rate, processes, progress)
    return path


@dataclass(eq=False)
class ModeShot:
    """Mode shapes over one period of `count` frames; the first frame has the largest amplitude."""

    shapes: list[Content]  # at their largest amplitude
    places: Array  # (j, 3) of the joints at rest
    size: tuple[int, int]
    columns: int
    count: int

    def panels(self, number: int) -> Sequence[Content]:
        """A panel for each mode."""
        phase = np.cos(2.0 * np.pi * number / self.count)
        return [self._moved(shape, phase) for shape in self.shapes]

    def _moved(self, shape: Content, phase: float) -> Content:
        body, amount = shape.deformed[0], abs(phase) * shape.deformed[0].displacement
        points = body.undeformed + phase * (body.points - body.undeformed)
        moved = replace(body, points=points, displacement=amount, values=amount)
        solids = tuple(
            replace(solid, matrix=transform(np.eye(3), at + phase * (solid.matrix[:3, 3] - at)))
            for solid, at in zip(shape.solids, self.places, strict=True)
        )
        return replace(shape, deformed=(moved,), solids=solids)


def _shot(
    body: FlexBody | str | Path,
    modes: int | Sequence[int] | None,
    supports: Sequence[str],
    exaggeration: float | str,
    direction: tuple[float, float, float] | None,
    size: tuple[int, int] | None,
    count: int,
) -> ModeShot:
    where = f"the body {body.name}" if isinstance(body, FlexBody) else str(body)
    body = body if isinstance(body, FlexBody) else load(body)
    surface = body.surface
    if body.m == 0 or surface is None or not len(surface.points):
        raise ViewError(f"{where}: has no modes to draw, or no surface")
    frequencies, motion = _motions(body, supports)
    numbers = _numbers(body, modes, len(frequencies))
    check_exaggeration(exaggeration)
    pixels, columns = panel_grid(len(numbers), size)
    camera = body_camera(surface.points, direction)
    caption = f"{body.name}, {'held at ' + ', '.join(supports) if supports else 'free'}"
    shapes = [
        mode_panel(body, motion[:, :, k - 1], (title, caption), exaggeration, camera)
        for k in numbers
        if (title := f"mode {k}: {frequencies[k - 1]:.4g} Hz")
    ]
    places = np.array([part.position for part in body.interfaces]).reshape(-1, 3)
    return ModeShot(shapes, places, pixels, columns, count)


def panel_grid(count: int, size: tuple[int, int] | None = None) -> tuple[tuple[int, int], int]:
    """Size [pixels] of a picture of several panels, and its number of columns."""
    columns = columns_of(count)
    rows = -(-count // columns)
    pixels = size or (_SINGLE if count == 1 else (_CELL[0] * columns, _CELL[1] * rows))
    check_size((pixels[0] // columns, pixels[1] // rows))
    return pixels, columns


def _motions(body: FlexBody, supports: Sequence[str]) -> tuple[Array, Array]:
    """Frequencies (k,) [Hz], and motion (n + i, 3, k) of surface points, then of interfaces."""
    assert body.surface is not None
    places = np.array([part.position for part in body.interfaces]).reshape(-1, 3)
    moved = np.array([part.Phi_t for part in body.interfaces]).reshape(-1, 3, body.m)
    points = np.concatenate([body.surface.points, places])
    shapes = np.concatenate([body.surface.modes, moved])
    modes = natural_modes(body, supports)
    return modes.frequencies, modes.shapes(points, shapes)


def _numbers(body: FlexBody, modes: int | Sequence[int] | None, count: int) -> list[int]:
    if modes is None:
        return list(range(1, min(_DEFAULT_MODES, count) + 1))
    numbers = [modes] if isinstance(modes, int) else list(modes)
    wrong = [k for k in numbers if not 1 <= k <= count]
    if wrong or not numbers:
        what = ", ".join(str(k) for k in wrong) or "none"
        raise ViewError(f"the body {body.name} has the modes 1 to {count}, given {what}")
    return numbers


def balls(places: Array, size: float) -> tuple[Solid, ...]:
    """Balls at interfaces or supports (n, 3) of a body with the given size."""
    ball = sphere(_INTERFACE_RADIUS * size)
    return tuple(
        Solid("interface", ball, PIN, matrix=transform(np.eye(3), place), role="joint")
        for place in places
    )


def mode_panel(
    body: FlexBody | PartResult,
    motion: Array,
    texts: tuple[str, str],
    exaggeration: float | str,
    camera: Camera,
) -> Content:
    """One mode at its largest amplitude, seen along its vibration; the texts are title and
    caption."""
    assert body.surface is not None
    points, size = body.surface.points, size_of(body.surface.points) or 1.0
    u = motion[: len(points)]
    amount = np.linalg.norm(u, axis=1)
    largest = float(amount.max()) or 1.0
    factor = _AMPLITUDE * size / largest if isinstance(exaggeration, str) else float(exaggeration)
    faces, lines = body.surface.faces, body.surface.lines
    moved = points + factor * u
    drawn = Deformed(body.name, moved, points, faces, lines, amount, BODIES[0], amount)
    plates = plates_of(body) if isinstance(body, FlexBody) else None
    drawn = drawn if plates is None else plates.drawn(drawn)
    drawn = replace(drawn, sharp=sharp_edges(drawn.undeformed, drawn.faces))
    places = np.array([part.position for part in body.interfaces]).reshape(-1, 3)
    return Content(
        title=texts[0],
        caption=texts[1],
        solids=balls(places + factor * motion[len(points) :], size),
        deformed=(drawn,),
        scale=Scale(largest, 1.0 / largest, "", "displacement over the largest"),
        camera=camera,
        bar=False,
        extent=np.concatenate([points + factor * u, points - factor * u]),
    )


def campbell_figure(sweep: ModeSweep, modes: int = _MAX_CURVES) -> Figure:
    """Frequencies over the parameter, with multiples of the fastest rotation."""
    title = f"frequencies over {sweep.parameter}, seen from {' and '.join(sweep.frames)}"
    figure = new_figure(9.6, 6.0, title)
    axes = figure.subplots()
    frequencies = sweep.frequencies[:, :modes]
    for k in range(frequencies.shape[1]):
        color = LINES[k % len(LINES)]
        axes.plot(sweep.values, frequencies[:, k], color=color, lw=1.6, marker="o", ms=3)
    top = 1.1 * float(np.nanmax(frequencies, initial=0.0)) or 1.0
    if sweep.speeds.any():
        for n in _ORDERS:
            line = n * sweep.speeds / (2.0 * np.pi)
            axes.plot(sweep.values, line, color=INK, lw=0.8, ls=":")
            inside = np.flatnonzero(line <= 0.97 * top)
            if len(inside) and line[inside[-1]] > 0.0:
                at = sweep.values[inside[-1]], line[inside[-1]]
                axes.annotate(f"{n}x", at, color=INK, ha="right", va="bottom")
    axes.set_ylim(0.0, top)
    axes.set_xlabel(sweep.parameter, color=INK)
    axes.set_ylabel("frequency [Hz]", color=INK)
    style_axes(axes)
    return figure


def root_locus_figure(sweep: ModeSweep, modes: int = _MAX_CURVES) -> Figure:
    """Eigenvalues in the complex plane: a circle for the first value, a dot for the last."""
    figure = new_figure(9.6, 6.0, f"eigenvalues over {sweep.parameter}")
    axes = figure.subplots()
    for k in range(min(modes, sweep.eigenvalues.shape[1])):
        color, line = LINES[k % len(LINES)], sweep.eigenvalues[:, k]
        axes.plot(line.real, line.imag, color=color, lw=1.4, marker=".", ms=4)
        axes.plot(line.real[:1], line.imag[:1], color=color, marker="o", ms=8, mfc="none", ls="")
        axes.plot(line.real[-1:], line.imag[-1:], color=color, marker="o", ms=7, ls="")
    axes.axvline(0.0, color=INK, lw=0.8)
    shown = sweep.eigenvalues[:, :modes]
    least = _LEAST_DAMPING * float(np.nanmax(np.abs(shown), initial=0.0))
    if np.nanmax(np.abs(shown.real), initial=0.0) < least:
        axes.set_xlim(-least, least)
    axes.set_xlabel("Re λ [1/s]", color=INK)
    axes.set_ylabel("Im λ [1/s]", color=INK)
    style_axes(axes)
    return figure


def response_figure(frequencies: Sequence[float], response: Any, title: str) -> Figure:
    """Amplitude and phase over frequencies [Hz], on logarithmic scales."""
    figure = new_figure(9.6, 6.0, title)
    top, bottom = figure.subplots(2, 1, sharex=True)
    top.loglog(frequencies, np.abs(response), color=LINES[0], lw=1.6)
    phase = np.degrees(np.unwrap(np.angle(response)))
    bottom.semilogx(frequencies, phase, color=LINES[0], lw=1.6)
    top.set_ylabel("amplitude, SI", color=INK)
    bottom.set_ylabel("phase [deg]", color=INK)
    bottom.set_xlabel("frequency [Hz]", color=INK)
    for axes in (top, bottom):
        style_axes(axes)
    return figure


def equilibria_figure(sweep: StaticSweep, names: Sequence[str] = ()) -> Figure:
    """Channels of a static sweep over its parameter, one pair of axes for each unit.

    Unstable equilibria are drawn with open circles, events as dotted lines.
    """
    names = names or [n for n in sweep.names if np.ptp(sweep[n]) > 0.0] or sweep.names
    panels: dict[str, list[str]] = {}
    for name in names:
        panels.setdefault(sweep.units[sweep.names.index(name)], []).append(name)
    figure = new_figure(9.6, 1.2 + 2.5 * len(panels), f"equilibria over {sweep.parameter}")
    grid = figure.subplots(max(1, len(panels)), 1, sharex=True, squeeze=False)[:, 0]
    values, unstable = sweep.values, ~sweep.stable
    # limit points are ends of branches
    ends = [event.place for event in sweep.events if event.kind == "limit point"]
    for axes, (unit, members) in zip(grid, panels.items(), strict=False):
        for k, name in enumerate(members):
            color, line = LINES[k % len(LINES)], sweep[name]
            for i, (part, rest) in enumerate(
                zip(np.split(values, ends), np.split(line, ends), strict=True)
            ):
                label = None if i else name
                axes.plot(part, rest, color=color, lw=1.6, marker="o", ms=3, label=label)
            axes.plot(values[unstable], line[unstable], color=color, ls="", marker="o", ms=7,
                      mfc="white")  # fmt: skip
        for event in sweep.events:
            axes.axvline(event.low, color=INK, lw=0.8, ls=":")
            at = event.low, 1.0
            axes.annotate(event.kind, at, xycoords=("data", "axes fraction"), color=INK,
                          fontsize=8, rotation=90, ha="right", va="top")  # fmt: skip
        axes.set_ylabel(f"[{unit}]" if unit else "", color=INK)
        style_axes(axes)
        axes.legend(loc="upper left", bbox_to_anchor=(1.005, 1.02), frameon=False, labelcolor=INK)
    grid[-1].set_xlabel(sweep.parameter, color=INK)
    return figure
