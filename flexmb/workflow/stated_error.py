"""What the stated error of a run does not contain: it is that of the integration alone.

In: a model and its flexible bodies. Out: one line, empty where nothing is missing. What is missing
can be told apart by ``flexmb budget``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from flexmb.model.flexible_body import FlexibleBodySpec
from flexmb.model.mesh_body import MeshBodySpec

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody
    from flexmb.model import Model


def not_contained(model: Model, bodies: Mapping[str, FlexBody]) -> str:
    """``mesh, modes (20), interface model, geometric stiffening``; empty if nothing is missing."""
    specs = {
        name: spec for name, spec in model.bodies.items() if isinstance(spec, FlexibleBodySpec)
    }
    elastic = {name: spec for name, spec in specs.items() if name in bodies and bodies[name].m}
    parts = []
    if elastic:
        counts = {name: _mode_count(spec, bodies[name]) for name, spec in elastic.items()}
        same = len(set(counts.values())) == 1
        words = [f"{n} of {name}" for name, n in counts.items()]
        parts = ["mesh", f"modes ({next(iter(counts.values())) if same else ', '.join(words)})"]
    if any(has_several_nodes(spec, bodies[name]) for name, spec in elastic.items()):
        parts.append("interface model")
    effects: dict[str, list[str]] = {}
    for name, spec in specs.items():
        for effect in _effects_left_out(spec, bodies.get(name)):
            effects.setdefault(effect, []).append(name)
    for effect, names in effects.items():
        every = len(names) == len(specs)
        parts.append(effect if every else f"{effect} of {' and '.join(names)}")
    return ", ".join([*parts, *(model.effects.absent if model.effects is not None else ())])


def _mode_count(spec: FlexibleBodySpec, body: FlexBody) -> int:
    """The number of modes as the scene says it, else of the body's coordinates."""
    if isinstance(spec, MeshBodySpec) and isinstance(spec.modes, int | None):
        return spec.mode_count
    return body.m


def has_several_nodes(spec: FlexibleBodySpec, body: FlexBody) -> bool:
    """Whether an interface holds more than one node, so that its rigidity is a model."""
    if not isinstance(spec, MeshBodySpec):
        return bool(body.interfaces)
    groups = {} if body.nodes is None else body.nodes.groups
    for nodes in spec.interfaces.values():
        group = nodes if isinstance(nodes, str) else nodes.group
        if group is not None:
            count = len(groups.get(group, (0, 1)))
        else:
            count = 1 if nodes.node is not None else len(nodes.nodes or (0, 1))
        if count > 1:
            return True
    return False


def _effects_left_out(spec: FlexibleBodySpec, body: FlexBody | None) -> Iterator[str]:
    if spec.deformation == "rigid":
        yield "deformation"
        return
    if spec.deformation == "quasi-static":
        yield "vibration"
    if spec.inertia_coupling != "full":
        yield "full inertia coupling"
    if body is not None and body.m and body.centrifugal_stiffness is None:
        yield "geometric stiffening"
