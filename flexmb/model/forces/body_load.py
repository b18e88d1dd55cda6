"""Loads of a flexible body in a run: pressure, traction, line loads, forces spread over nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np

from flexmb.errors import Problem, nearest
from flexmb.model.functions.function import Function, FunctionOf
from flexmb.model.lookup import Component, Scope, flexbody_of
from flexmb.model.plane import ALIGNED, normal_in_body
from flexmb.model.quantities import Text


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
