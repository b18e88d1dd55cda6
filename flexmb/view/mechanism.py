"""A mechanism at one time of a run: poses, markers, surfaces, joint axes.

In: a :class:`Result`, a time. Out: poses, marker positions, deformed surfaces and joint axes in
global axes [m]. The scene in the result names the parts; the flexible-body files
say how the modes move their surfaces.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.errors import ViewError
from flexmb.flexbody import von_mises
from flexmb.model import Model
from flexmb.model.body import BodySpec
from flexmb.model.lookup import frames, place_marker
from flexmb.model.orientation import rotation_matrix
from flexmb.model.reading import GROUND, split_reference
from flexmb.results import Pose, Result

Array = NDArray[np.float64]

_GROUND_POSE = Pose(np.zeros(3), np.eye(3), np.zeros(0))


class Mechanism:
    """The bodies, joints and markers of a result's scene at a time of the run.

    Parameters
    ----------
    result : Result
        The run.
    time : float, optional
        Within the run, in the scene's units; by default what its ``[view]`` says, else the end.

    Raises
    ------
    ViewError
        The result holds no rows.
    BodyFileError
        A flexible-body file is missing or damaged.
    ResultFileError
        The time lies outside the run, or a flexible-body file is not the one of this run.
    """

    def __init__(self, result: Result, time: float | None = None) -> None:
        if not len(result.time):
            raise ViewError(f"{result.path}: the result holds no rows to draw")
        self.result = result
        self.flexbodies = {name: result.flexbody(name) for name in result.flexbodies}
        self.model = Model.from_scene_dict(_reduced(result), result.path.parent)
        if time is None and self.model.view.time is not None:
            time = result.units.outward(self.model.view.time, "s")
        self.time = float(result.time[-1] if time is None else time)
        self._poses: dict[str, Pose] = {}

    def pose(self, body: str) -> Pose:
        """Origin, direction cosines and modal coordinates of a body or the ground."""
        if body == GROUND:
            return _GROUND_POSE
        if body not in self._poses:
            self._poses[body] = self.result.pose(body, self.time)
        return self._poses[body]

    def point(self, reference: str) -> Array:
        """Position (3,) of the marker ``"body.marker"``, its body deformed."""
        marker = place_marker(self.model, reference, self.flexbodies)
        pose = self.pose(marker.body)
        s = marker.position
        if marker.Phi_t is not None and marker.Phi_r is not None:
            turn = marker.Phi_r @ pose.eta
            s = s + marker.Phi_t @ pose.eta + np.cross(turn, marker.arm)
        return pose.r + pose.A @ s

    def travel(self, reference: str, axis: Array) -> tuple[float, float]:
        """Least and greatest position of a marker along an axis through the run, rigidly [m]."""
        body, _ = split_reference(reference)
        if body == GROUND:
            here = float(self.point(reference) @ axis)
            return here, here
        marker = place_marker(self.model, reference, self.flexbodies)
        times = np.linspace(self.result.time[0], self.result.time[-1], 60)
        poses = [self.result.pose(body, float(t)) for t in times]
        along = [float((p.r + p.A @ marker.position) @ axis) for p in poses]
        return min(along), max(along)

    def used_markers(self, body: str) -> list[str]:
        """References to the markers of a body that joints and forces use."""
        return [
            reference
            for spec in (*self.model.joints.values(), *self.model.forces.values())
            for reference in getattr(spec, "between", ())
            if split_reference(reference)[0] == body
        ]

    @cached_property
    def axes(self) -> dict[str, Array]:
        """Global direction (3,) of each joint's axis, in the pose of the scene."""
        axes = {}
        for name, spec in self.model.joints.items():
            marker, _ = frames(self.model, spec.between, spec.axis, self.flexbodies)
            A = np.eye(3)
            if marker.body != GROUND:
                A = rotation_matrix(self.model.bodies[marker.body].orientation)
            axes[name] = A @ marker.R[:, 2]
        return axes

    def surface(self, name: str, exaggeration: float) -> tuple[Array, Array, Array] | None:
        """Exaggerated and undeformed points (n, 3), true displacements (n,) of a flexible body.

        None where the body has no surface.
        """
        surface = self.flexbodies[name].surface
        if surface is None or not len(surface.points):
            return None
        pose = self.pose(name)
        u = surface.modes @ pose.eta
        undeformed = pose.r + surface.points @ pose.A.T
        return undeformed + exaggeration * (u @ pose.A.T), undeformed, np.linalg.norm(u, axis=1)

    def von_mises(self, name: str, layer: str | None) -> Array | None:
        """(n,) the largest von Mises stress [Pa] over layers and sections at each surface point.

        NaN where the body has none there; None where it has none at all, or none in the layer.
        """
        body = self.flexbodies[name]
        if body.stress is None or body.surface is None:
            return None
        rows = body.stress.rows(layer=layer)
        if not len(rows):
            return None
        ids, nodes = body.stress.ids[rows], body.surface.node_ids
        largest = np.full(max(ids.max(), nodes.max()) + 1, np.nan)
        np.fmax.at(largest, ids, von_mises(body.stress.at(self.pose(name).eta, rows)))
        return largest[nodes] if np.isfinite(largest[nodes]).any() else None


def _reduced(result: Result) -> dict[str, Any]:
    """The scene with its flexible bodies as files next to the result: no mesh is needed."""
    bodies = dict(result.model.get("bodies", {}))
    for name, path in result.flexbodies.items():
        fields = {key: value for key, value in bodies[name].items() if key in BodySpec.model_fields}
        bodies[name] = {**fields, "flexbody": str(path.resolve())}
    return {**result.model, "bodies": bodies}


def size_of(points: Any) -> float:
    """Diagonal of the box around points (n, 3) [m]."""
    return float(np.linalg.norm(np.ptp(np.asarray(points), axis=0))) if len(points) else 0.0
