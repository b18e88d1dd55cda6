"""The motion of a run for a web page: meshes, their poses in each frame, their deformation.

In: a result. Out: packed numbers for ``page.js``. Rigid parts need twelve numbers per frame;
deformable parts need two bytes per coordinate relative to a rigid motion, so that the reader can
exaggerate the deformation. Surfaces with many triangles are simplified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexmb.flexbody.arrays import Array, IntArray
from flexmb.progress import Progress, silent
from flexmb.results import Result
from flexmb.view.content import Content, Deformed, Solid
from flexmb.view.drawing import Drawing
from flexmb.view.html_page import Html, packed, tag
from flexmb.view.mechanism import Mechanism, applied

_RIGID = 1e-6  # largest deviation from a rigid motion, over the size of a rigid part
_FIT_POINTS = 64  # points from which the rigid motion is estimated
_FRAMES = 91
_PER_TURN = 24  # least number of frames per revolution of the fastest body
_MAX_FRAMES = 151
_SECONDS = 7.0  # duration of the motion on the screen
_BUDGET = 4e6  # bytes of deformation and colours, before packing
_MAX_FACES = 12_000  # largest number of triangles of one body
_LEAST_FACES = 500
_DEPTH = 32767  # the largest number of two bytes
_SAMPLES = 30  # frames to which the view is fitted
_RESIDUAL = 2e-3  # largest error of the shared shapes, over the largest deformation
_FACTORS = (0.0, 1.0)  # factors on deformation that can always be selected


@dataclass
class _Part:
    """One shape over all frames."""

    faces: IntArray  # (t, 3), or lines (l, 2)
    color: str
    opacity: float = 1.0
    is_flexible: bool = False
    points: list[Array] = field(default_factory=list)  # (n, 3) drawn points, by frame
    matrices: list[Array] = field(default_factory=list)  # (4, 4) for rigid parts
    undeformed: list[Array] = field(default_factory=list)  # for deformable parts
    values: list[Array] = field(default_factory=list)  # (n,) fractions of the colour scale

    @property
    def group(self) -> tuple[bool, bool, float, str]:
        """Parts with the same key form one mesh."""
        is_line = self.faces.shape[1] == 2
        return bool(self.values), is_line, self.opacity, self.color if is_line else ""


@dataclass(frozen=True)
class MovingScene:
    """Numbers for ``page.js``, and a sentence about them."""

    data: dict[str, Any]
    factor: float  # initial factor on the deformation
    sentence: str

    def player(self) -> Html:
        """The page's element in which the scene moves, with its controls."""
        last = self.data["frames"] - 1
        choices = sorted({*_FACTORS, self.factor, 10.0 * self.factor} - {0.0} | {0.0})
        options = [_option(f, f == self.factor) for f in choices] if self.data["flexible"] else []
        return tag(
            "div",
            tag("div", id="stage", class_="stage", role="img", aria_label="The machine in motion"),
            tag(
                "div",
                tag("button", "▶ Play", id="play", type="button", aria_pressed="false"),
                tag("input", type="range", id="frame", min=0, max=last, value=0, aria_label="time"),
                tag("output", id="clock"),
                tag("label", "deformation ", tag("select", *options, id="factor"))
                if options
                else Html(""),
                tag("button", "Home view", id="home", type="button", class_="quiet"),
                class_="controls",
            ),
            tag("p", self.sentence, class_="lead"),
        )


def _option(factor: float, selected: bool) -> Html:
    words = "none" if factor == 0.0 else "true" if factor == 1.0 else f"{factor:g} times"
    more = {"selected": "selected"} if selected else {}
    return tag("option", words, value=f"{factor:g}", **more)


def moving_scene(result: Result, progress: Progress = silent) -> MovingScene:
    """The machine of a run at equally spaced times.

    Raises
    ------
    ViewError
        The result has no rows.
    FlexmbError
        The run did not store the poses, or a file of a flexible body is missing.
    """
    times, note = frame_times(result)
    contents, factor = _contents(result, times, progress)
    parts = _parts(contents)
    scale = contents[0].scale
    limits = (0.0, 1.0) if scale is None else scale.limits
    every = max(1, len(times) // _SAMPLES)
    drawn = np.vstack([points for part in parts for points in _places(part, every)])
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    pad = 0.02 * float((high - low).max()) or 1.0
    axes = contents[0].camera.axes
    colored = any(part.values for part in parts)  # something deforms
    seen = drawn @ axes.T
    center = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) @ axes
    data = {
        "id": "stage",
        "frames": len(times),
        "times": packed(times, "f8"),
        "unit": result.units.label("s"),
        "rate": len(times) / _SECONDS,
        "first": _first_frame(parts),
        "meshes": _meshes(parts, factor),
        "flexible": colored,
        "scale": "" if scale is None else scale.label,
        "bar": scale is not None and colored,
        "limits": [float(limit) for limit in limits],
        "box": [(low - pad).tolist(), (high + pad).tolist()],
        "center": center.tolist(),
        "seen": np.ptp(seen, axis=0)[:2].tolist(),
        "eye": axes[2].tolist(),
        "up": axes[1].tolist(),
        # plotly rotates the light with the camera
        "light": (1e3 * (np.array([-0.4, 0.7, -1.0]) @ axes)).tolist(),
    }
    return MovingScene(data, factor, _sentence(result, times, note))


def _contents(result: Result, times: Array, progress: Progress) -> tuple[list[Content], float]:
    """Contents of pictures at these times, and their common exaggeration."""
    drawing = Drawing(Mechanism(result), times=times.tolist())
    contents = []
    for k, time in enumerate(times):
        progress("motion", k / len(times))
        contents.append(drawing.content(float(time)))
    progress("motion", 1.0)
    return contents, drawing.factor


def _sentence(result: Result, times: Array, note: str) -> str:
    seconds = float(times[-1] - times[0]) * result.units.scale("s")
    speed = seconds / _SECONDS
    how = f"slowed {1 / speed:.3g} times" if speed < 1 else f"{speed:.3g} times as fast as real"
    if 0.9 < speed < 1.1:
        how = "in real time"
    return f"{len(times)} moments, played {how}{note}. Drag to turn, scroll or pinch to zoom."


def _places(part: _Part, every: int) -> list[Array]:
    """Points (n, 3) of a part in every `every`-th frame."""
    if part.matrices:
        return [applied(M, part.points[0]) for M in part.matrices[::every]]
    return part.points[::every]


def _first_frame(parts: Sequence[_Part]) -> int:
    """The frame with the largest deformation; without deformation one in between."""
    colored = [part for part in parts if part.values]
    if not colored:
        return 0
    frames = len(colored[0].values)
    return int(
        np.argmax([max(p.values[k].max(initial=0.0) for p in colored) for k in range(frames)])
    )


def frame_times(result: Result) -> tuple[Array, str]:
    """Times of the frames in the scene's units, and a note if they do not cover the whole run.

    If a body rotates more often than the frames can show, the last revolutions are shown.
    """
    t = result.time
    if len(t) < 2:
        return t, ""
    turns = np.zeros(len(t))
    seconds = t * result.units.scale("s")
    for body in result.layout.bodies:
        if result.has_columns("v", slice(body.iv + 3, body.iv + 6)):
            speed = np.linalg.norm(result.part("v", slice(body.iv + 3, body.iv + 6)), axis=1)
            step = 0.5 * (speed[1:] + speed[:-1]) * np.diff(seconds) / (2 * np.pi)
            turned = np.concatenate([[0.0], np.cumsum(step)])
            turns = turned if turned[-1] > turns[-1] else turns
    count, first, note = _FRAMES, float(t[0]), ""
    if turns[-1] * _PER_TURN > _FRAMES:
        count = _MAX_FRAMES
        left = turns[-1] - _MAX_FRAMES / _PER_TURN
        if left > 0:
            first = float(np.interp(left, turns, t))
            unit = result.units.label("s")
            note = f"; the last {t[-1] - first:.3g} of {t[-1] - t[0]:.3g} {unit}"
    return np.linspace(first, float(t[-1]), count), note


def _parts(contents: Sequence[Content]) -> list[_Part]:
    """Shapes that exist in all frames, simplified if they have too many triangles."""
    share = 2 * _BUDGET / (7 * len(contents) * max(1, len(contents[0].deformed)))
    most = max(_LEAST_FACES, min(_MAX_FACES, int(share)))  # there are about two triangles per point
    parts = []
    for k, solid in enumerate(contents[0].solids):
        frames = [content.solids[k] for content in contents if len(content.solids) > k]
        if len(frames) == len(contents) and all(_is_same(solid, one) for one in frames):
            parts.append(_rigid_part(frames))
    for k in range(len(contents[0].deformed)):
        bodies = [content.deformed[k] for content in contents]
        parts.append(_flexible_part(bodies, contents, most))
    return [part for part in parts if len(part.faces)]


def _is_same(first: Solid, other: Solid) -> bool:
    return len(first.triangles.points) == len(other.triangles.points) and np.array_equal(
        first.triangles.faces, other.triangles.faces
    )


def _rigid_part(frames: Sequence[Solid]) -> _Part:
    """A rigid shape; springs, which are stretched, are returned as deformable ones."""
    first = frames[0]
    rows, faces = _thinned(first.triangles.points, first.triangles.faces, _MAX_FACES)
    part = _Part(faces, first.color, round(first.opacity, 3))
    if all(one.triangles is first.triangles for one in frames):
        part.matrices = [one.matrix for one in frames]
        part.points = [first.triangles.points[rows]]
    else:
        part.points = [one.points[rows] for one in frames]
    return part


def _flexible_part(bodies: Sequence[Deformed], contents: Sequence[Content], most: int) -> _Part:
    first = bodies[0]
    faces = first.faces if len(first.faces) else first.lines
    rows, faces = _thinned(first.undeformed, faces, most)
    part = _Part(faces, first.color, round(first.opacity, 3), is_flexible=True)
    part.points = [body.points[rows] for body in bodies]
    part.undeformed = [body.undeformed[rows] for body in bodies]
    scale = contents[0].scale
    moved = any(body.displacement.any() for body in bodies)
    if scale is not None and moved and any(body.values is not None for body in bodies):
        zero = np.zeros(len(first.points))  # values of bodies at rest
        values = [zero if body.values is None else body.values for body in bodies]
        part.values = [np.nan_to_num(scale.shares(one[rows])) for one in values]
    return part


def _thinned(points: Array, faces: IntArray, most: int) -> tuple[IntArray, IntArray]:
    """Indices of the remaining points of a simplified surface, and its triangles."""
    if faces.shape[1] == 2 or len(faces) <= most:
        used = np.unique(faces)
        new = np.zeros(len(points), dtype=int)
        new[used] = np.arange(len(used))
        return used, new[faces]
    import pyvista

    mesh = pyvista.PolyData(points, np.column_stack([np.full(len(faces), 3), faces]).ravel())
    mesh.point_data["row"] = np.arange(len(points))
    mesh = mesh.decimate_pro(1.0 - most / len(faces), preserve_topology=False)
    return np.asarray(mesh.point_data["row"], dtype=int), np.asarray(mesh.faces).reshape(-1, 4)[
        :, 1:
    ]


def _meshes(parts: Sequence[_Part], factor: float) -> list[dict[str, Any]]:
    """One mesh for all parts that can be drawn together."""
    groups: dict[Any, list[_Part]] = {}
    for part in parts:
        groups.setdefault(part.group, []).append(part)
    meshes = []
    for (colored, is_line, opacity, _), members in groups.items():
        starts = np.cumsum([0, *(len(part.points[0]) for part in members)])
        corners = np.vstack([part.faces + n for part, n in zip(members, starts, strict=False)])
        packed_parts = [_packed_part(part, factor) for part in members]
        meshes.append({
            "corners": packed(corners, "u4"),
            "lines": is_line,
            "colored": colored,
            "opacity": opacity,
            "color": members[0].color,
            "colors": [[part.color, len(part.faces)] for part in members],
            "moves": any(_moves(part) for part in members),
            "parts": packed_parts,
        })  # fmt: skip
    return meshes


def _moves(part: _Part) -> bool:
    if part.matrices:
        return any(not np.array_equal(part.matrices[0], M) for M in part.matrices)
    return any(not np.array_equal(part.points[0], x) for x in part.points)


def rigid_motion(before: Array, after: Array) -> Array | None:
    """The matrix (4, 4) that moves points (n, 3) to new positions; None if they have deformed.

    The rotation fits in the least-squares sense (Kabsch, Acta Crystallographica A32, 1976).
    """
    if len(before) != len(after) or len(before) < 3:
        return None
    some = np.linspace(0, len(before) - 1, min(len(before), _FIT_POINTS)).astype(int)
    c, d = before[some].mean(axis=0), after[some].mean(axis=0)
    U, _, V = np.linalg.svd((after[some] - d).T @ (before[some] - c))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    size = float(np.ptp(before, axis=0).max())
    if np.abs((before - c) @ R.T + d - after).max() > _RIGID * size:
        return None
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = R, d - R @ c
    return motion


def _packed_part(part: _Part, factor: float) -> dict[str, Any]:
    """The undeformed shape, its rigid motion, and its deformation, packed."""
    whole = part.undeformed or part.points
    points, matrices, is_rigid = whole[0], part.matrices, not part.is_flexible
    if not matrices:
        moves = [rigid_motion(points, moved) for moved in whole]
        is_rigid = is_rigid and all(motion is not None for motion in moves)
        matrices = [np.eye(4) if motion is None else motion for motion in moves]
    numbers = np.array([np.concatenate([M[:3, :3].ravel(), M[:3, 3]]) for M in matrices])
    bend = np.zeros((0, *points.shape))
    if not is_rigid:
        drawn = zip(part.points, matrices, strict=True)
        bend = np.array([(x - M[:3, 3]) @ M[:3, :3] - points for x, M in drawn])
        bend = bend / factor if part.is_flexible and factor else bend
    depth = float(np.abs(bend).max(initial=0.0))
    shapes, amounts = _shared_shapes(bend.reshape(len(bend), points.size), depth)
    values = np.array(part.values)
    has_motion = part.matrices or float(np.ptp(numbers, axis=0).max()) > 0.0
    return {
        "points": packed(points),
        "motion": packed(numbers) if has_motion else None,
        "shapes": packed(shapes, "i2") if depth else None,
        "amounts": packed(amounts) if depth else None,
        "flexible": part.is_flexible,
        "values": packed(np.clip(np.round(255 * values), 0, 255), "u1") if part.values else None,
    }


def _shared_shapes(bend: Array, depth: float) -> tuple[Array, Array]:
    """A few shapes (k, 3 n) of two-byte numbers and amounts (frames, k), whose products sum to
    `bend`."""
    if not depth:
        return np.zeros((0, bend.shape[1])), np.zeros((len(bend), 0))
    values, vectors = np.linalg.eigh(bend @ bend.T)  # there are few frames and many points
    order = np.argsort(-values)
    left = bend
    for count in range(1, len(bend) + 1):
        amounts = vectors[:, order[:count]]
        shapes = amounts.T @ bend
        left = bend - amounts @ shapes
        if np.abs(left).max() <= _RESIDUAL * depth:
            break
    largest = np.abs(shapes).max(axis=1, keepdims=True)
    return np.round(shapes / largest * _DEPTH), amounts * largest.T / _DEPTH
