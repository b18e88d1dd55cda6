"""Whether forces fit into their model: markers, joints, lengths, laws that are finite.

In: the model under check. Out: problems, with scene paths.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.model import lookup
from flexmb.model.forces.contact_checks import contact_problems, joint_friction_problems
from flexmb.model.forces.contacts import ContactSpec
from flexmb.model.forces.elements import BeamForceSpec, BushingSpec
from flexmb.model.forces.force import JointSpringSpec, LineForceSpec, LoadSpec, SpringDamperSpec
from flexmb.model.forces.friction import JointFrictionSpec
from flexmb.model.forces.laws import Law
from flexmb.model.forces.stops import JointStopSpec, StopSpec
from flexmb.model.joints.driver_problems import finite
from flexmb.model.scenes.scope import Scope
from flexmb.model.values.names import GROUND, split_reference
from flexmb.model.values.reading import Spec

__all__ = ["force_problems"]

_PARALLEL = 1e-6  # sine of the angle below which a direction says nothing about the axis across
_NOUNS = {
    "spring-damper": "a spring-damper",
    "line-force": "a line-force",
    "bushing": "a bushing",
    "beam": "a beam",
    "stop": "a stop",
}


_PAIRS = SpringDamperSpec | LineForceSpec | BushingSpec | BeamForceSpec | StopSpec


def force_problems(scope: Scope) -> Iterator[Problem]:
    """All problems of the forces of a model."""
    yield from scope.markers("forces")
    for name, spec in scope.model.forces.items():
        where = f"forces.{name}"
        if isinstance(spec, LoadSpec):
            yield from _load(scope, where, spec)
        elif isinstance(spec, JointSpringSpec | JointStopSpec):
            yield from scope.coordinate(where, spec.joint, spec.coordinate)
        elif isinstance(spec, ContactSpec):
            yield from contact_problems(scope, where, spec)
        elif isinstance(spec, JointFrictionSpec):
            yield from joint_friction_problems(scope, where, spec)
        elif isinstance(spec, _PAIRS):
            yield from scope.pair(where, spec.between, _NOUNS[spec.type])
            yield from _length(scope, where, spec)
        if isinstance(spec, SpringDamperSpec | JointSpringSpec):
            yield from _laws(where, spec)
        elif isinstance(spec, LineForceSpec):
            yield from finite(f"{where}.value", spec.value)


def _load(scope: Scope, where: str, spec: LoadSpec) -> Iterator[Problem]:
    for i, function in enumerate(spec.value):
        yield from finite(f"{where}.value[{i}]", function)
    body = split_reference(spec.at)[0]
    if body == GROUND:
        yield Problem(f"{where}.at", f"a {spec.type} on ground moves nothing")
    yield from scope.material(f"{where}.at", spec.at)
    if spec.reaction is not None:
        if split_reference(spec.reaction)[0] == body:
            what = f'is on "{body}" like the {spec.type} itself: the two would cancel'
            yield Problem(f"{where}.reaction", what)
        yield from scope.marker(f"{where}.reaction", spec.reaction)
        yield from scope.material(f"{where}.reaction", spec.reaction)
    axes = spec.axes_marker
    if axes is not None:
        found = list(scope.marker(f"{where}.axes", axes))
        if found and "." not in axes:
            names = ("global", "body", "a marker (body.name)")
            what = f'unknown axes "{axes}"'
            found = [Problem(f"{where}.axes", what, names, nearest(axes, names))]
        yield from found or scope.material(f"{where}.axes", axes)


def _laws(where: str, spec: SpringDamperSpec | JointSpringSpec) -> Iterator[Problem]:
    if spec.value is not None:
        yield from finite(f"{where}.value", spec.value)
    if spec.does_nothing:
        what = "does nothing: give stiffness, damping or value"
        yield Problem(where, f"{what}, or spring_force or damper_force")
    for word, law in (("spring_force", spec.spring_force), ("damper_force", spec.damper_force)):
        if law is not None:
            yield from _law(f"{where}.{word}", law)


def _law(where: str, law: Law) -> Iterator[Problem]:
    """A law has a value and a slope at rest."""
    for part, value in zip(("value", "slope"), law.expression.value(0.0), strict=False):
        if not math.isfinite(value):
            what = f'the {part} of "{law.expression.text}" is {value:g} at 0, not finite'
            yield Problem(where, what)
            return


def _length(scope: Scope, where: str, spec: Spec) -> Iterator[Problem]:
    """A direction needs two points apart, as far as they are known."""
    if isinstance(spec, BushingSpec) or (isinstance(spec, StopSpec) and spec.axis is not None):
        return
    model = scope.model
    assert isinstance(spec, _PAIRS)  # the caller knows
    try:
        ends = [lookup.placed(model, reference, scope.flexbodies) for reference in spec.between]
    except FlexmbError:
        return
    flexible = {m.body for m in ends if m.body != GROUND and model.bodies[m.body].flexible}
    if any(lookup.flexbody_of(model, body, scope.flexbodies) is None for body in flexible):
        return
    points = [lookup.global_position(model, marker) for marker in ends]
    line = points[1] - points[0]
    if np.linalg.norm(line) == 0:
        kinds = {"beam": "beam", "stop": "distance", "line-force": "force along a line"}
        kind = kinds.get(spec.type, "spring")
        what = f"its markers coincide in the placed pose: a {kind} of length zero"
        told = {"beam": "has no axis", "distance": "has no direction"}.get(kind, "pulls nowhere")
        yield Problem(f"{where}.between", f"{what} {told}")
    elif isinstance(spec, BeamForceSpec) and spec.orientation is not None:
        across = np.cross(line / np.linalg.norm(line), spec.orientation)
        if np.linalg.norm(across) < _PARALLEL:
            what = "leads along the beam: give the direction of the section's y axis"
            yield Problem(f"{where}.orientation", what)
