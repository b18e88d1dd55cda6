"""A drawing of a run: its parts, made once, and what they show at any time.

In: a :class:`Mechanism` and the options of a ``[view]``. Out: :class:`Content` at a time; one for a
picture, many for a film, with the same scales, glyphs and framing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from flexmb.engine.geometry import reference_points
from flexmb.flexbody.arrays import Array, IntArray
from flexmb.model.reading import GROUND, split_reference
from flexmb.model.scenes.sections import ViewSpec
from flexmb.results.run_summary import MODE_SHAPE
from flexmb.view.arrows import arrow_scale, arrow_solids
from flexmb.view.body_shapes import body_parts, ground_grid, ground_parts, own_shape, plates_of
from flexmb.view.camera import Camera, common_axis, hiding_bodies, mechanism_camera
from flexmb.view.content import Content, Deformed, Label, Part, Scale, Solid, on_marker
from flexmb.view.fields import FIELDS, fitting_scale, stress_values
from flexmb.view.force_shapes import force_parts
from flexmb.view.joint_shapes import driver_parts, gear_parts, joint_parts
from flexmb.view.mechanism import MEAN_AXES, Display, Mechanism, applied
from flexmb.view.plot import BODIES, INK
from flexmb.view.shapes import arrow, sharp_edges, spread_points

_SHOWN_DEFORMATION = 0.05  # largest drawn deformation of the most deformed body, over its size
_ROUND_OFF = 1e-9  # deformation over size below which it is round-off and not exaggerated
_SEE_THROUGH = 0.55  # opacity of a shape with a joint inside, or that hides a body
_PIN = 0.016  # radius of a pin over the mechanism's size
_PIN_CLEARANCE = 0.2  # largest radius of a pin over the least distance of two joints
_LONGEST_PIN = 0.12  # largest half length of a pin over the mechanism's size
_FRAMING_TIMES = 24  # number of times of a run to which the view is fitted
_LOCAL_FRAME = 0.75  # share of the whole motion below which a picture is fitted to its moment
_COLOR_SAMPLES = 240  # number of times at which the largest value for the colours is searched
_OCCLUSION_POINTS = 250  # points per body by which a camera determines what hides what
_Shown = TypeVar("_Shown", Solid, Deformed)
_TRIAD = ("#c2410c", "#15803d", "#1d4ed8")  # x, y, z


def some_times(times: Sequence[float], count: int) -> list[float]:
    """`count` of the times, including the first and the last."""
    return [times[k] for k in np.linspace(0, len(times) - 1, min(count, len(times))).astype(int)]


def size_of(points: Array) -> float:
    """Diagonal of the box around points (n, 3) [m]."""
    return float(np.linalg.norm(np.ptp(np.asarray(points), axis=0))) if len(points) else 0.0


def round_exaggeration(ratio: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that exaggerates a deformation not too much.

    Parameters
    ----------
    ratio : float
        Largest displacement of a body over its size.

    >>> round_exaggeration(3e-5)
    1000.0
    """
    if ratio < _ROUND_OFF or ratio >= _SHOWN_DEFORMATION:
        return 1.0
    limit = _SHOWN_DEFORMATION / ratio * (1 + 1e-9)
    power = 10.0 ** math.floor(math.log10(limit))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= limit)


class Drawing:
    """The drawing of a run.

    Parameters
    ----------
    mechanism : Mechanism
        The run; its time is that of the picture.
    view : ViewSpec, optional
        What to show; by default the scene's ``[view]``.
    times : sequence of float, optional
        Times whose largest deformation and values set the scales, in the scene's units; that of the
        mechanism by default. A film gives those of its frames.
    scale : Scale, optional
        The colour scale, if it is known already.
    film : bool
        Whether several times are frames: then their distance determines the digits of the time, and
        the view is fitted to them only.

    Raises
    ------
    ViewError
        A colour by a quantity that the run does not have, or a direction without length.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        view: ViewSpec | None = None,
        times: Sequence[float] | None = None,
        scale: Scale | None = None,
        film: bool = True,
    ) -> None:
        self.mechanism = mechanism
        self.view = view = mechanism.model.view if view is None else view
        self.times = tuple(times) if times is not None else (mechanism.time,)
        self.colors = {
            name: body.color or BODIES[i % len(BODIES)]
            for i, (name, body) in enumerate(mechanism.model.bodies.items())
        }
        self._plates, self._sharp = {}, {}
        for name, body in mechanism.flexbodies.items():
            if body.surface is not None:
                points, faces = body.surface.points, body.surface.faces
                self._plates[name] = plates = plates_of(body)
                if plates is not None:
                    points, faces = plates.thick(points), plates.faces
                self._sharp[name] = sharp_edges(points, faces)
        self.factor = self._factor()
        self._bending = {*mechanism.flexbodies}  # as far as known
        start = Display(mechanism.at(float(mechanism.result.time[0])), 1.0, view.reference)
        self.size = self._size(start)
        self.pin = self._pin(start)
        self._arrows = None
        if view.forces != "none":
            self._arrows = arrow_scale(mechanism, view.forces, self.size)
        self.parts = list(self._body_parts())
        self.cameras = self._cameras()
        self.parts += self._acting_parts(self.cameras[0])
        some = [self._deformed(self.display(t)) for t in some_times(self.times, _COLOR_SAMPLES)]
        self._bending = {body.name for bodies in some for body in bodies if body.bends}
        if view.color == "displacement":
            some = [tuple(one for one in bodies if one.name in self._bending) for bodies in some]
        self.scale = scale or fitting_scale(some, view.color, mechanism.result.units)
        if self.scale is not None and self.is_mode_shape and self.scale.largest > 0.0:
            quantity = "relative displacement"
            self.scale = Scale(self.scale.largest, 1.0 / self.scale.largest, "", quantity)
        step = min(np.diff(self.times), default=0.0)
        self._digits = max(0, 1 - math.floor(math.log10(step))) if film and step > 0.0 else None
        self._moments: list[tuple[Array, Array]] | None = None
        self.parts += ground_parts(mechanism, self.size, self.pin, self.cameras[0])
        self.parts += self._grid(self.cameras[0])  # around everything, including brackets of ground
        moments = [self._surfaces(self.display(time)) for time in some_times(self.times, 3)]
        self._hiding = {camera: hiding_bodies(camera, moments) for camera in self.cameras}

    @property
    def is_mode_shape(self) -> bool:
        """Whether a vibration mode of the linearised machine, of arbitrary amplitude, is drawn."""
        return MODE_SHAPE in self.mechanism.result.statistics

    def display(self, time: float | None = None) -> Display:
        """The drawn poses of everything at a time of the run; by default that of the picture."""
        moment = self.mechanism if time is None else self.mechanism.at(time)
        return Display(moment, self.factor, self.view.reference)

    def content(self, time: float | None = None, camera: Camera | None = None) -> Content:
        """The content at a time, by default that of the picture, from a camera, by default the
        first."""
        display, view, camera = self.display(time), self.view, camera or self.cameras[0]
        deformed = tuple(self._cleared(body, camera) for body in self._deformed(display))
        solids = [self._cleared(part.solid(display), camera) for part in self.parts]
        if self._arrows is not None:
            solids += arrow_solids(display, view.forces, self._arrows, self.size, self.pin)
        return Content(
            title=self.mechanism.model.title,
            caption=self._caption(display, deformed),
            solids=tuple(solids),
            deformed=deformed,
            scale=self.scale,
            camera=camera,
            labels=tuple(self._labels(display)),
            extent=self._extent(display),
            zoom=view.zoom,
            font_scale=view.font_scale,
            outline=view.outline,
        )

    def contents(self, time: float | None = None) -> list[Content]:
        """The contents at a time from each camera."""
        return [self.content(time, camera) for camera in self.cameras]

    def _factor(self) -> float:
        factor = self.view.exaggeration
        if not isinstance(factor, str):
            return float(factor)
        ratios = [0.0]
        for time in some_times(self.times, _FRAMING_TIMES):
            true = Display(self.mechanism.at(time), 1.0, self.view.reference)
            for name in self.mechanism.flexbodies:
                surface = true.surface(name)
                if surface is not None:
                    size = size_of(surface[1])
                    ratios.append(float(surface[2].max()) / max(size, 1e-300))
        return round_exaggeration(max(ratios))

    def _size(self, display: Display) -> float:
        """Diagonal of the box around everything at the start [m]; 1 for a single point."""
        mechanism, clouds = self.mechanism, []
        points = reference_points(mechanism.model, mechanism.flexbodies)
        for name, point in zip(mechanism.model.bodies, points, strict=True):
            own = [] if point.any() else [display.frame(name)[:3, 3]]
            own += map(display.point, mechanism.used_markers(name))
            clouds.append(np.array(own).reshape(-1, 3))
            shape = own_shape(mechanism, name)
            if shape is not None:
                clouds.append(applied(display.frame(name), shape.points))
            surface = display.surface(name) if name in mechanism.flexbodies else None
            if surface is not None:
                clouds.append(surface[1])
        grounded = np.array([display.point(ref) for ref in mechanism.used_markers(GROUND)])
        return size_of(np.vstack([*clouds, grounded.reshape(-1, 3)])) or 1.0

    def _pin(self, display: Display) -> float:
        """Radius of a pin [m]."""
        specs = self.mechanism.model.joints.values()
        points = np.array([display.point(spec.between[0]) for spec in specs]).reshape(-1, 3)
        apart = np.linalg.norm(points[:, None] - points, axis=2)
        apart = apart[apart > 0.02 * self.size]
        least = float(apart.min()) if apart.size else np.inf
        return float(np.clip(_PIN_CLEARANCE * least, 0.35 * _PIN * self.size, _PIN * self.size))

    def _body_parts(self) -> Iterator[Part]:
        mechanism, view = self.mechanism, self.view
        surfaces = {name: body.surface for name, body in mechanism.flexbodies.items()}
        drawn = {name for name, own in surfaces.items() if own is not None and len(own.points)}
        wheels = list(gear_parts(mechanism, self.colors))
        yield from wheels
        bodies = {part.name for part in wheels} & {*self.colors}
        drawn |= {name for name in bodies if own_shape(mechanism, name) is not None}
        for name in mechanism.model.bodies:
            if name not in drawn:
                for part in body_parts(mechanism, name, self.size, self.colors[name]):
                    yield replace(part, opacity=view.opacity * self._opacity(part))

    def _acting_parts(self, camera: Camera) -> Iterator[Part]:
        """Joints, drivers, gears, forces and frames."""
        mechanism, view = self.mechanism, self.view
        half = {name: self._half(name) for name in mechanism.model.joints}
        front = {  # side of each joint on which the eye is
            name: 1.0 if mechanism.joint_axis(name) @ camera.direction >= 0 else -1.0
            for name in half
        }
        lift = {name: front[name] * (half[name] + 0.9 * self.pin) for name in half}
        yield from joint_parts(mechanism, self.pin, half)
        yield from driver_parts(mechanism, self.pin, lift)
        yield from force_parts(mechanism, self.pin, self.size, lift)
        if view.frames:
            references = {
                r for name in mechanism.model.bodies for r in mechanism.used_markers(name)
            }
            for reference in sorted(references):
                for axis, color in zip(np.eye(3), _TRIAD, strict=True):
                    shape = arrow(5.0 * self.pin, 0.22 * self.pin).along(axis)
                    yield Part(reference, shape, color, on_marker(reference), "arrow")

    def _half(self, joint: str) -> float:
        """Half length of a hinge's pin [m], so that it protrudes from the bodies."""
        mechanism, spec, r = self.mechanism, self.mechanism.model.joints[joint], self.pin
        least, most = 1.8 * r, _LONGEST_PIN * self.size
        if spec.type != "revolute":
            return least
        reach = 0.0
        for reference, axes in zip(spec.between, mechanism.joint_axes[joint], strict=True):
            body = split_reference(reference)[0]
            shape = None if body == GROUND else own_shape(mechanism, body)
            points = None if shape is None else shape.points
            if body in mechanism.flexbodies and mechanism.flexbodies[body].surface is not None:
                points = mechanism.flexbodies[body].surface.points  # type: ignore[union-attr]
            if points is None:
                continue
            marker = mechanism.marker(reference)
            local = (points - marker.position) @ (marker.R @ axes)
            near = np.linalg.norm(local[:, :2], axis=1) < 4 * r
            near = near if near.any() else np.ones(len(points), dtype=bool)
            reach = max(reach, float(np.abs(local[near, 2]).max()))
        return min(max(least, reach + 0.6 * r), most)

    def _opacity(self, part: Part) -> float:
        """Opaque, except for a shape of the scene that would hide joints inside it."""
        own, mechanism = own_shape(self.mechanism, part.name), self.mechanism
        if own is None:
            return 1.0
        joints = [
            mechanism.point(reference)
            for name, spec in mechanism.model.joints.items()
            for reference in spec.between
            if split_reference(reference)[0] == part.name
            if spec.type != "revolute" or self._half(name) >= _LONGEST_PIN * self.size
        ]
        frame = mechanism.frame(part.name)
        local = (np.array(joints).reshape(-1, 3) - frame[:3, 3]) @ frame[:3, :3]
        low, high = own.points.min(axis=0), own.points.max(axis=0)
        inside = ((local > low + 0.5 * self.pin) & (local < high - 0.5 * self.pin)).all(axis=1)
        return _SEE_THROUGH if inside.any() else 1.0

    def _cleared(self, body: _Shown, camera: Camera) -> _Shown:
        """A body, half transparent if it hides another one from a camera."""
        if body.name not in self._hiding.get(camera, ()) or getattr(body, "role", "body") != "body":
            return body
        return replace(body, opacity=min(body.opacity, _SEE_THROUGH * self.view.opacity))

    def _deformed(self, display: Display) -> tuple[Deformed, ...]:
        color, mechanism = self.view.color, display.mechanism
        by_stress = color in FIELDS and FIELDS[color].of_stress is not None
        values: dict[str, Array | None] = {}
        if by_stress:
            values = stress_values(mechanism, color, self.view.layer)
        bodies = []
        for name, body in mechanism.flexbodies.items():
            surface = display.surface(name)
            if surface is None or body.surface is None:
                continue
            points, undeformed, displacement = surface
            shades = values.get(name)
            if color == "displacement" and name in self._bending:
                shades = displacement if len(mechanism.pose(name).eta) else None
            faces, lines = body.surface.faces, body.surface.lines
            drawn = Deformed(
                name, points, undeformed, faces, lines, displacement, self.colors[name], shades,
                self.view.opacity, self._sharp[name],
            )  # fmt: skip
            plates = self._plates[name]
            bodies.append(drawn if plates is None else plates.drawn(drawn))
        return tuple(bodies)

    def _cameras(self) -> list[Camera]:
        view = self.view
        samples = []
        if view.direction is None and "auto" in view.camera:
            time = self.mechanism.result.time
            rows = np.unique(np.linspace(0, len(time) - 1, 3).astype(int))
            samples = [self._clouds(self.display(float(time[row]))) for row in rows]
        names = view.camera if view.direction is None else ("auto",)
        return [mechanism_camera(self.mechanism, name, view.direction, samples) for name in names]

    def _surfaces(self, display: Display) -> list[tuple[str, Array, IntArray]]:
        """Name, points (n, 3) and triangles (t, 3) of each body."""
        solids = [part.solid(display) for part in self.parts if part.role == "body"]
        shapes = [(solid.name, solid.points, solid.triangles.faces) for solid in solids]
        bodies = [body for body in self._deformed(display) if len(body.faces)]
        return shapes + [(body.name, body.points, body.faces) for body in bodies]

    def _clouds(self, display: Display) -> list[Array]:
        """Points spread over each body."""
        random, count = np.random.default_rng(7), _OCCLUSION_POINTS
        return [spread_points(p, faces, count, random) for _, p, faces in self._surfaces(display)]

    def _corners(self, display: Display) -> Array:
        """Corners (n, 3) of boxes around everything drawn."""
        boxes = []
        for part in self.parts:
            if part.role in ("grid", "surface"):
                continue
            local = part.shape.points
            boxes.append(applied(part.place(display), _box_corners(local)))
        for name in display.mechanism.flexbodies:
            surface = display.surface(name)
            if surface is not None:
                frame = display.frame(name)
                local = (surface[0] - frame[:3, 3]) @ frame[:3, :3]
                boxes.append(applied(frame, _box_corners(local)))
        return np.vstack(boxes) if boxes else np.zeros((1, 3))

    def _extent(self, display: Display) -> Array:
        """The points (n, 3) to which the view is fitted."""
        view, follow = self.view, self.view.follow
        if view.framing == "moment":
            return self._corners(display)
        if self._moments is None:
            whole = self.mechanism.result.time.tolist()
            times = whole if self._digits is None else self.times
            self._moments = []
            for time in some_times(times, _FRAMING_TIMES):
                moment = self.display(time)
                origin = moment.frame(follow)[:3, 3] if follow else np.zeros(3)
                self._moments.append((self._corners(moment), origin))
        shift = display.frame(follow)[:3, 3] if follow else np.zeros(3)
        motion = np.vstack([corners - origin + shift for corners, origin in self._moments])
        if view.framing == "auto" and len(self.times) == 1:
            here = self._corners(display)
            return here if size_of(here) < _LOCAL_FRAME * size_of(motion) else motion
        return motion

    def _labels(self, display: Display) -> Iterator[Label]:
        which, mechanism = self.view.labels, self.mechanism
        if which in ("bodies", "all"):
            for name in mechanism.model.bodies:
                shapes = [part.solid(display).points for part in self.parts
                          if part.role == "body" and part.name == name]  # fmt: skip
                surface = display.surface(name) if name in mechanism.flexbodies else None
                shapes += [] if surface is None else [surface[0]]
                if shapes:
                    points = np.vstack(shapes)
                    yield Label(name, 0.5 * (points.min(axis=0) + points.max(axis=0)), INK)
        if which in ("joints", "all"):
            for name, spec in mechanism.model.joints.items():
                yield Label(name, display.point(spec.between[1]), "#9a4a00")

    def _caption(self, display: Display, deformed: tuple[Deformed, ...]) -> str:
        if self.is_mode_shape:
            return "shape of a vibration, its amplitude is arbitrary"
        units = self.mechanism.result.units
        digits = self._digits
        time = f"{display.time:.6g}" if digits is None else f"{display.time:.{digits}f}"
        parts = [f"t = {time} {units.label('s')}"]
        moved = max((float(body.displacement.max()) for body in deformed), default=0.0)
        if any(body.bends or body.values is not None for body in deformed):
            seen = "to scale" if self.factor == 1.0 else f"exaggerated {self.factor:g} times"
            parts.append(f"deformation {seen}")
            most = max(deformed, key=lambda body: float(body.displacement.max()))
            largest = Scale.fitting(moved, units)
            amount = f"{largest.top:.3g} {largest.unit}"
            if digits is not None and self.scale and self.scale.quantity == "displacement":
                # so that the number of digits stays the same
                places = max(0, 2 - math.floor(math.log10(self.scale.top or 1.0)))
                amount = f"{moved * self.scale.factor:.{places}f} {self.scale.unit}"
            reference = display.reference_of(most.name)
            shown = "mean axes" if reference == MEAN_AXES else reference
            parts.append(f"largest displacement {amount} ({most.name}, from {shown})")
        scale = self.scale
        if scale is not None and scale.quantity != "displacement":
            coloured = [body for body in deformed if body.values is not None]
            most = max(coloured, key=lambda body: float(np.nanmax(np.abs(body.values))))  # type: ignore[arg-type]
            values = most.values
            assert values is not None
            value = float(values[np.nanargmax(np.abs(values))]) * scale.factor
            parts.append(f"largest {scale.quantity} {value:.3g} {scale.unit} ({most.name})")
        if self._arrows is not None:
            parts.append(self._arrows.caption)
        return ", ".join(parts)

    def _grid(self, camera: Camera) -> list[Part]:
        """The grid on the ground, if a camera sees it from above."""
        up, towards = np.array(camera.up), np.array(camera.direction)
        oblique = 0.2 < abs(up @ towards) < 0.95
        gravity = self.mechanism.model.gravity
        bare = not any(part.role == "surface" for part in self.parts)
        normal = common_axis(self.mechanism)
        level = normal is None or abs(up @ normal) > 0.999  # not seen along vertical joint axes
        floor = oblique and bare and np.any(gravity) and level
        shown = self.view.grid == "on" or (self.view.grid == "auto" and floor)
        return [ground_grid(self._extent(self.display()), up)] if shown else []


def _box_corners(points: Array) -> Array:
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1])
                     for z in (low[2], high[2])])  # fmt: skip
