"""Markers: the points and axes of a body through which everything acts on it.

In: a place on a body in the body frame of the undeformed body. Out: :class:`PlacedMarker`, what the
engine needs of it. On a flexible body a marker is carried by an interface or a mesh node; where
``position`` differs from the node's, the arm between them turns with the node.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from flexmb.errors import Problem, SceneError
from flexmb.model.orientation import Orientation, rotation_matrix
from flexmb.model.quantities import Integer, Position, Text
from flexmb.model.reading import Entry, Spec, fail

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody

Array = NDArray[np.float64]


class MarkerSpec(Spec):
    """A marker of a body, in its body frame.

    ``position`` defaults to the carrying node's, else to the body's origin. ``node`` (0-based
    index in the mesh) or ``interface`` name the carrier on a flexible body; with a position alone
    the nearest node carries it, and without modes the body itself.
    """

    position: Position | None = None
    orientation: Orientation = (1.0, 0.0, 0.0, 0.0)
    node: Annotated[int, Integer(0)] | None = None
    interface: Text | None = None

    @model_validator(mode="after")
    def _one_carrier(self) -> Self:
        if self.node is not None and self.interface is not None:
            raise fail(Problem("", 'give "node" or "interface", not both'))
        return self

    @property
    def is_frame(self) -> bool:
        """Whether it is the body frame's own origin (on a flexible body no material point)."""
        return self.position is None and self.node is None and self.interface is None


Marker = Annotated[MarkerSpec, Entry()]


class GroundSpec(Spec):
    """The fixed body: its markers, in the global frame."""

    markers: dict[str, Marker] = {}


@dataclass(frozen=True, eq=False)
class PlacedMarker:
    """A marker as the engine needs it, all in axes of the undeformed body.

    Parameters
    ----------
    body : str
        Name of the body, or ``"ground"``.
    rho : (3,) float
        Position of the carrying point [m].
    arm : (3,) float
        From the carrying point to the marker [m]; turns with the carrier.
    R : (3, 3) float
        Marker axes (columns) in body axes.
    Phi_t, Phi_r : (3, m) float or None
        Translation and rotation of the carrier per unit modal coordinate; None: moves rigidly.
    bend : (3, m, m) float, optional
        Twice what the carrier falls back by along each axis per product of modal coordinates [m].
    """

    body: str
    rho: Array
    arm: Array
    R: Array
    Phi_t: Array | None = None
    Phi_r: Array | None = None
    bend: Array | None = None

    @property
    def position(self) -> Array:
        """(3,) undeformed position in the body frame [m]."""
        return self.rho + self.arm


def place(body: str, marker: MarkerSpec, flexbody: FlexBody | None = None) -> PlacedMarker:
    """Place a marker on a body.

    Parameters
    ----------
    body : str
        Name of the body.
    marker : MarkerSpec
        The marker.
    flexbody : FlexBody, optional
        The body's modes; None for a rigid body or ground.

    Raises
    ------
    SceneError
        The flexible body has no such node or interface.
    """
    R = rotation_matrix(marker.orientation)
    zero = np.zeros(3)
    if flexbody is None or marker.is_frame or _at_rigid_place(marker, flexbody):
        rho = zero if marker.position is None else np.array(marker.position)
        return PlacedMarker(body, rho, zero, R)
    rho, Phi_t, Phi_r, bend = _carrier(marker, flexbody)
    arm = zero if marker.position is None else np.array(marker.position) - rho
    return PlacedMarker(body, rho, arm, R, Phi_t, Phi_r, bend)


def _at_rigid_place(marker: MarkerSpec, flexbody: FlexBody) -> bool:
    """Whether it is a mere position on a body without modes, where nothing needs to carry it."""
    return flexbody.m == 0 and marker.node is None and marker.interface is None


def _carrier(marker: MarkerSpec, flexbody: FlexBody) -> tuple[Array, Array, Array, Array | None]:
    """Position, translation, rotation modes and bend of the interface or node that carries it."""
    if marker.interface is not None:
        interface = flexbody.interface(marker.interface)
        return interface.position, interface.Phi_t, interface.Phi_r, interface.bend
    nodes = flexbody.nodes
    if nodes is None:
        raise SceneError("the flexible body holds no nodes, only its interfaces can carry markers")
    if marker.node is not None:
        row = nodes.row(marker.node)
        if row < 0:
            numbers = f"{nodes.ids[0]} to {nodes.ids[-1]}"
            raise SceneError(f"the flexible body has no node {marker.node}; it has nodes {numbers}")
    else:
        row = int(np.argmin(((nodes.position - np.array(marker.position)) ** 2).sum(axis=1)))
    if nodes.Phi_r is None:
        raise SceneError("the flexible body holds no nodal rotations; use an interface")
    return nodes.position[row], nodes.Phi_t[row], nodes.Phi_r[row], None
