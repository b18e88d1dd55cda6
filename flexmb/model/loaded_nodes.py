"""Where joints, drivers and forces act on flexible bodies beside their interfaces: at mesh nodes.

Their modes answer a load at an interface exactly, in the static limit, and at other nodes as well
as the vibration modes do.
"""

from __future__ import annotations

from collections.abc import Iterator

from flexmb.model.body import BodySpec
from flexmb.model.lookup import ModelData


def loads_beside_interfaces(model: ModelData) -> Iterator[tuple[str, str, str]]:
    """Path of each joint, driver or force, the body that it acts on at a node, and the marker."""
    for path, owner, marker in loads_on_bodies(model):
        if is_beside_interfaces(model.bodies[owner], marker.partition(".")[2]):
            yield path, owner, marker


def loads_on_bodies(model: ModelData) -> Iterator[tuple[str, str, str]]:
    """Path of each joint, driver or force, the flexible body that it acts on, and the marker."""
    for section in ("joints", "drivers", "forces"):
        for name, spec in getattr(model, section).items():
            for field in ("between", "marker", "at"):
                ends = getattr(spec, field, None) or ()
                for marker in (ends,) if isinstance(ends, str) else ends:
                    owner = marker.partition(".")[0]
                    body = model.bodies.get(owner)
                    if body is not None and body.flexible:
                        yield f"{section}.{name}", owner, marker


def is_beside_interfaces(body: BodySpec, place: str) -> bool:
    """Whether a marker of a flexible body, or its origin, is carried by no interface."""
    return bool(place) and marker_interface(body, place) is None


def marker_interface(body: BodySpec, place: str) -> str | None:
    """The interface that a marker of a body is, or that carries it."""
    marker = body.markers.get(place)
    return place if marker is None else marker.interface


def load_points(model: ModelData, name: str) -> list[int | tuple[float, ...]]:
    """Nodes of a body at which something acts, or positions [m] whose nearest nodes are meant."""
    points: list[int | tuple[float, ...]] = []
    for _, owner, reference in loads_beside_interfaces(model):
        if owner == name:
            marker = model.bodies[owner].markers[reference.partition(".")[2]]
            point = tuple(marker.position or ()) if marker.node is None else marker.node
            if point != () and point not in points:
                points.append(point)
    return points
