"""Plates and shells drawn with their thickness, which the sections of a flexible body say.

A surface holds the middle of its shells alone. Here each of their triangles is drawn twice, at both
faces, and closed along borders: half the thickness along the mean normal at each point, as the body
is deformed.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.flexbody import FlexBody
from flexmb.flexbody.parts import Surface
from flexmb.view.content import Deformed
from flexmb.view.shapes import face_normals

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Plates:
    """How a surface becomes thick: each point of the new one is an old one, moved along a normal.

    Parameters
    ----------
    middle : (t, 3) int
        Triangles of the shells.
    faces : (f, 3) int
        Those of the new surface.
    source : (k,) int
        The old point of each new one.
    offset : (k,) float
        How far it is moved along the normal there [m].
    """

    middle: Indices
    faces: Indices
    source: Indices
    offset: Array

    def thick(self, points: Array) -> Array:
        """The new points (k, 3) of old ones (n, 3)."""
        corners, n = self.middle.ravel(), len(points)
        each = np.repeat(face_normals(points, self.middle), 3, axis=0)
        normals: Array = np.column_stack([np.bincount(corners, each[:, k], n) for k in range(3)])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = normals / np.maximum(length, 1e-300)
        return np.asarray(points[self.source] + self.offset[:, None] * normals[self.source])

    def drawn(self, body: Deformed) -> Deformed:
        """A body with the thickness of its shells."""
        return replace(
            body,
            points=self.thick(body.points),
            undeformed=self.thick(body.undeformed),
            faces=self.faces,
            displacement=body.displacement[self.source],
            values=None if body.values is None else body.values[self.source],
        )


def plates_of(body: FlexBody) -> Plates | None:
    """The plates of a body; None where it has none, or does not say how thick they are."""
    surface, sections = body.surface, json.loads(body.provenance.get("sections") or "{}")
    shells = {
        name: one for name, one in sections.items() if isinstance(one, dict) and "layers" in one
    }
    if surface is None or not len(surface.faces) or not shells:
        return None
    sides = np.full((len(surface.points), 2), np.nan)
    for name, section in shells.items():
        half = 0.5 * sum(float(layer["thickness"]) for layer in section["layers"])
        middle = section.get("offset") or 0.0
        middle = float(middle) if isinstance(middle, int | float) else 0.0
        sides[_points_of(body, surface, name)] = middle + half, middle - half
    own = np.isfinite(sides[:, 0])
    shell = own[surface.faces].all(axis=1)
    if not shell.any():
        return None
    n, triangles = len(surface.points), surface.faces[shell]
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    keys, where, count = np.unique(
        np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True
    )
    a, b = pairs[where[count == 1]].T
    rim = [
        np.column_stack([a + n, a + 2 * n, b + 2 * n]),
        np.column_stack([a + n, b + 2 * n, b + n]),
    ]
    faces = np.vstack([surface.faces[~shell], triangles + n, triangles[:, ::-1] + 2 * n, *rim])
    source = np.tile(np.arange(n), 3)
    offset = np.concatenate(
        [np.zeros(n), np.where(own, sides[:, 0], 0.0), np.where(own, sides[:, 1], 0.0)]
    )
    used, faces = np.unique(faces, return_inverse=True)
    return Plates(triangles, faces.reshape(-1, 3), source[used], offset[used])


def _points_of(body: FlexBody, surface: Surface, group: str) -> Any:
    """Points of the surface that are nodes of a group; corners of beams are none."""
    ids = surface.node_ids
    beyond = np.flatnonzero(np.diff(ids) <= 0)
    nodes = np.arange(len(ids)) <= (beyond[0] if len(beyond) else len(ids))
    groups = {} if body.nodes is None else body.nodes.groups
    return nodes & np.isin(ids, groups[group]) if group in groups else nodes
