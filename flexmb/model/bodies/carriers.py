"""Whether bodies have their files, and whether markers have something to carry them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from flexmb.errors import FlexmbError, Problem, nearest
from flexmb.model import lookup
from flexmb.model.bodies.body import BodySpec, FlexbodySpec
from flexmb.model.bodies.markers import MarkerSpec, place
from flexmb.model.bodies.mesh_body import MeshBodySpec
from flexmb.model.lookup import ModelData
from flexmb.model.references import Scope
from flexmb.model.values.reading import GROUND, Spec

_FAR = 0.5  # of the body's length; a marker further from its nodes is likely a slip of units


def body_problems(scope: Scope) -> Iterator[Problem]:
    """Problems of the bodies and of ground."""
    if not scope.names("bodies"):
        yield Problem("bodies", "the model has no body: give at least one [bodies.NAME]")
    yield from _markers(scope, GROUND, GROUND, scope.model.ground.markers)
    for name, spec in scope.model.bodies.items():
        where = f"bodies.{name}"
        if name not in scope.flexbodies:
            yield from _files(scope, where, spec)
        yield from _markers(scope, where, name, spec.markers)
        yield from _initial(scope, where, name, spec)


def _initial(scope: Scope, where: str, body: str, spec: BodySpec) -> Iterator[Problem]:
    """Initial velocities are of markers that exist."""
    for name in spec.initial:
        missing = lookup.missing(scope.model, f"{body}.{name}", scope.flexbodies)
        if missing is not None:
            at = f"{where}.initial.{name}"
            yield Problem(at, missing.what, missing.allowed, missing.nearest)


def _files(scope: Scope, where: str, spec: BodySpec) -> Iterator[Problem]:
    key, source = "mesh", spec.mesh if isinstance(spec, MeshBodySpec) else None
    if isinstance(source, Spec):
        return
    if isinstance(spec, FlexbodySpec) and isinstance(spec.flexbody, str):
        key, source = "flexbody", spec.flexbody
    if source is None:
        return
    path = scope.model.path(source)
    if os.path.isdir(path):  # unlike Path.is_dir it answers for any name, however long
        yield Problem(f"{where}.{key}", f'"{source}" is a folder, not a file ({path})')
    elif not os.path.exists(path):
        yield Problem(f"{where}.{key}", f'no file "{source}" ({path})', (), _neighbours(path))


def _neighbours(path: Path) -> tuple[str, ...]:
    try:
        return nearest(path.name, sorted(entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ()


def _markers(
    scope: Scope, where: str, body: str, markers: Mapping[str, MarkerSpec]
) -> Iterator[Problem]:
    taken = lookup.automatic_markers(scope.model, body, scope.flexbodies) if markers else ()
    spec = scope.model.bodies.get(body)
    for name, marker in markers.items():
        at = f"{where}.markers.{name}"
        if name in taken:
            yield Problem(at, f'the name "{name}" is taken by a marker that such a body has anyway')
        if spec is None or not spec.flexible:
            for key in ("node", "interface"):
                if getattr(marker, key) is not None:
                    yield Problem(f"{at}.{key}", "only a flexible body has one")
        elif lookup.has_all_markers(scope.model, body, scope.flexbodies):
            yield from _carrier(scope, at, body, marker)


def _carrier(scope: Scope, at: str, body: str, marker: MarkerSpec) -> Iterator[Problem]:
    taken = lookup.automatic_markers(scope.model, body, scope.flexbodies)
    names = tuple(name for name in taken if name != "origin")
    if marker.interface is not None and marker.interface not in names:
        what = f'the body has no interface "{marker.interface}"'
        yield Problem(f"{at}.interface", what, names, nearest(marker.interface, names))
        return
    flexbody = lookup.flexbody_of(scope.model, body, scope.flexbodies)
    if flexbody is not None:
        try:
            place(body, marker, flexbody)
        except FlexmbError as error:
            yield from (Problem(at, p.what, p.allowed, p.nearest) for p in error.problems)


def far_markers(model: ModelData, flexbodies: lookup.Bodies) -> Iterator[str]:
    """Sentences about markers that lie far away from the flexible body they are on."""
    for body, flexbody in flexbodies.items():
        spec = model.bodies.get(body)
        nodes = flexbody.nodes
        if spec is None or nodes is None or flexbody.m == 0:
            continue
        length = flexbody.characteristic_length
        for name, marker in spec.markers.items():
            if marker.position is None:
                continue
            away = np.linalg.norm(nodes.position - np.array(marker.position), axis=1).min()
            if away > _FAR * length:
                away, long = (model.units.say(value, "m", 3) for value in (away, length))
                yield (
                    f"bodies.{body}.markers.{name}: lies {away} from the nearest node of a body "
                    f"about {long} long, as on a rigid arm; positions are in the scene's units"
                )
