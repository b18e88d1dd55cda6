"""Applied loads: forces and torques at a marker, along a line, and loads of a flexible body.

The components of a force are in global axes, in the marker's own axes, which rotate with the body,
or in those of any marker. Values may be expressions over channels of sensors, states and
controllers.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.flexbody.planar_body import PLANES
from flexmb.model import lookup
from flexmb.model.functions.function import Function, FunctionOf
from flexmb.model.lookup import Component, Scope, flexbody_of
from flexmb.model.plane import ALIGNED, normal_in_body
from flexmb.model.quantities import Pair, Text
from flexmb.model.reading import GROUND, split_reference

ForceFunction = Annotated[Function, FunctionOf("N", channels=True)]
TorqueFunction = Annotated[Function, FunctionOf("N m", channels=True)]


class LoadSpec(Component):
    """A force or a torque on a marker: three functions of time.

    The opposite acts on ground, or on the body of the marker ``reaction``.
    """

    type: Literal["force", "torque"]
    at: Text
    value: tuple[Function, Function, Function]
    axes: Text = "global"
    reaction: Text | None = None

    @property
    def axes_marker(self) -> str | None:
        """The marker whose axes are used, if they are neither global nor the marker's own."""
        return None if self.axes in ("global", "body") else self.axes

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        for i, function in enumerate(self.value):
            yield from function.problems(f"{where}.value[{i}]")
        body = split_reference(self.at)[0]
        if body == GROUND:
            yield Problem(f"{where}.at", f"a {self.type} on ground has no effect")
        yield from scope.material(f"{where}.at", self.at)
        if self.reaction is not None:
            if split_reference(self.reaction)[0] == body:
                what = f'is on "{body}" like the {self.type} itself: the two would cancel'
                yield Problem(f"{where}.reaction", what)
            yield from scope.marker(f"{where}.reaction", self.reaction)
            yield from scope.material(f"{where}.reaction", self.reaction)
        axes = self.axes_marker
        if axes is not None:
            problems = list(scope.marker(f"{where}.axes", axes, "global", "body"))
            yield from problems or scope.material(f"{where}.axes", axes)

    def planar_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        """Problems of components out of the plane, which must be the number zero."""
        normal = np.array(PLANES[plane])
        if self.axes != "global":
            reference = self.at if self.axes == "body" else self.axes
            body = reference.partition(".")[0]
            try:
                marker = lookup.place_marker(scope.model, reference, scope.flexbodies)
            except FlexmbError:
                return
            if body in scope.model.bodies:
                normal = normal_in_body(scope.model.bodies[body], plane)
            normal = marker.R.T @ normal
        for i, function in enumerate(self.value):
            in_plane = abs(normal[i]) <= ALIGNED
            if in_plane != (self.type == "force") and function.expression.constant != 0.0:
                what = "normal" if self.type == "force" else "parallel"
                yield Problem(f"{where}.value[{i}]", f"has a component {what} to the plane {plane}")


class ForceSpec(LoadSpec):
    """A force on the marker ``at``, in ``global`` axes, in the marker's own with ``axes = "body"``,
    or in those of any marker named; with ``reaction`` its opposite acts on the body of that marker,
    at the same point.
    """

    type: Literal["force"]
    value: tuple[ForceFunction, ForceFunction, ForceFunction]


class TorqueSpec(LoadSpec):
    """A torque on the body of the marker ``at``; axes and reaction as for a force."""

    type: Literal["torque"]
    value: tuple[TorqueFunction, TorqueFunction, TorqueFunction]


class LineForceSpec(Component):
    """A force along the line between two markers; positive values push them apart."""

    type: Literal["line-force"]
    between: Pair
    value: ForceFunction

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.pair(where, self.between, "a line-force")
        yield from scope.line_problems(where, self.between, "force along a line")
        yield from self.value.problems(f"{where}.value")


class BodyLoadSpec(Component):
    """A load of a flexible body times ``value``: pressure, traction, line load, or force on nodes.

    ``load`` is one of the ``loads`` of the ``body``. Its direction is fixed in the body frame,
    whatever the deformation, and it acts at the displaced nodes; a rigid body gets its resultant.
    """

    type: Literal["body-load"]
    body: Text
    load: Text
    value: Annotated[Function, FunctionOf("", channels=True)]

    def problems(self, scope: Scope, where: str) -> Iterator[Problem]:
        yield from scope.unknown(f"{where}.body", "body", self.body, "bodies")
        yield from self.value.problems(f"{where}.value")
        spec = scope.model.bodies.get(self.body)
        if spec is None:
            return
        body = flexbody_of(scope.model, self.body, scope.flexbodies)
        if body is None and spec.flexible and not hasattr(spec, "loads"):
            return  # its file is not read yet
        names = [one.name for one in body.loads] if body else [*getattr(spec, "loads", ())]
        if self.load not in names:
            what = f'bodies.{self.body} has no load "{self.load}"'
            if not names:
                what += ": give it in the table loads of the body, from which its modes are made"
            yield Problem(f"{where}.load", what, tuple(names), nearest(self.load, names))
        elif body is not None and not body.load(self.load).points:
            what = f'the file of bodies.{self.body} has only the resultant of "{self.load}": reduce'
            yield Problem(f"{where}.load", f"{what} the body again")

    def planar_problems(self, scope: Scope, where: str, plane: str) -> Iterator[Problem]:
        """The load must have its resultant in the plane."""
        body = flexbody_of(scope.model, self.body, scope.flexbodies)
        if body is None:
            return
        load = body.load(self.load)
        n = normal_in_body(scope.model.bodies[self.body], plane)
        size = max((float(np.abs(one.wrench[:3]).max()) for one in load.points), default=0.0)
        arm = body.characteristic_length
        moment = load.moment - np.cross(body.center, load.force)
        out = abs(float(n @ load.force)) + float(np.linalg.norm(np.cross(n, moment))) / arm
        if out > ALIGNED * size:
            yield Problem(f"{where}.load", f"has a resultant that leads out of the plane {plane}")
