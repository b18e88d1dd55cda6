"""Springs between two nodes of a body.

In: a mesh and ``{name: {between, stiffness, axes}}``. Out: their stiffness matrices, which leave
all six rigid motions free. One stiffness acts along the line between the nodes. Six act on the
motion of the second node relative to the first at the point midway between them, three along and
three about the given axes; rigid arms join that point to the nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.numbering import Numbering, skew
from flexmb.fe.assembly.ties import one_node
from flexmb.fe.meshes.mesh import Mesh
from flexmb.fe.tables import word_problems
from flexmb.flexbody.arrays import FloatArray, IntArray

__all__ = ["Spring", "make_springs", "spring_stiffness"]

_KEYS = ("between", "stiffness", "axes")
_APART = 1e-9  # of the mesh's extent: nearer nodes have no line between them


@dataclass(frozen=True, eq=False)
class Spring:
    """One spring.

    Parameters
    ----------
    name : str
        For messages.
    nodes : (2,) int
        The nodes.
    stiffness : (1,) or (6,) float
        Along the line [N/m]; or along [N/m] and about [N m/rad] the axes.
    axes : (3, 3) float
        As columns, body frame.
    """

    name: str
    nodes: IntArray
    stiffness: FloatArray
    axes: FloatArray


def make_springs(mesh: Mesh, given: Mapping[str, Mapping[str, Any]]) -> tuple[Spring, ...]:
    """Find the nodes of springs ``{name: {between, stiffness, axes}}``.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    given : mapping of str to mapping
        ``between`` two node numbers or groups of one node; ``stiffness`` one number [N/m] or six
        [N/m, N m/rad]; ``axes`` the directions of the first and second axis, the body's by
        default.

    Raises
    ------
    MeshError
        Unknown words or groups, springs to ground, impossible values; all at once.
    """
    found: list[Spring] = []
    problems: list[Problem] = []
    for name, words in given.items():
        try:
            found.append(_make(mesh, name, dict(words)))
        except MeshError as error:
            problems += error.problems
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(found)


def spring_stiffness(
    spring: Spring, numbering: Numbering, points: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Stiffness (1, d, d) of a spring and the numbers (1, d) of its degrees of freedom.

    Raises
    ------
    MeshError
        A node outside the body, or one whose missing rotations the spring would need.
    """
    where, numbers = f"springs.{spring.name}", numbering.table[spring.nodes]
    outside = spring.nodes[numbers[:, 0] < 0]
    if len(outside):
        what = f"node {outside[0]} belongs to no element of the body and to no tie"
        raise MeshError(f"{where}.between: {what}")
    a, b = points[spring.nodes]
    if len(spring.stiffness) == 1:
        n = (b - a) / np.linalg.norm(b - a)
        row = np.concatenate([-n, n])
        return spring.stiffness * np.outer(row, row)[None], numbers[:, :3].reshape(1, -1)
    _require_rotations(spring, numbering, points)
    middle, B = 0.5 * (a + b), np.zeros((6, 2, 6))
    for side, (sign, node) in enumerate(((-1.0, a), (1.0, b))):
        B[:3, side, :3] = sign * spring.axes.T
        B[:3, side, 3:] = -sign * spring.axes.T @ skew(middle - node)
        B[3:, side, 3:] = sign * spring.axes.T
    there = numbers >= 0
    rows = B[:, there]
    K = rows.T @ (spring.stiffness[:, None] * rows)
    return 0.5 * (K + K.T)[None], numbers[there][None]


def _require_rotations(spring: Spring, numbering: Numbering, points: FloatArray) -> None:
    without = spring.nodes[numbering.table[spring.nodes, 3] < 0]
    apart = np.linalg.norm(np.diff(points[spring.nodes], axis=0)) > _APART * np.ptp(points)
    if len(without) and (apart or spring.stiffness[3:].any()):
        why = "turning stiffnesses" if spring.stiffness[3:].any() else "arms to the other node"
        what = f"node {without[0]} has no rotations for the spring's {why}"
        raise MeshError(f"springs.{spring.name}: {what}: use the reference node of a tie")


def _make(mesh: Mesh, name: str, words: dict[str, Any]) -> Spring:
    where = f"springs.{name}"
    problems = word_problems(words, where, _KEYS, _KEYS[:2])
    if problems:
        raise MeshError.from_problems(problems)
    nodes = _between(mesh, words["between"], f"{where}.between")
    stiffness = _stiffness(words["stiffness"], f"{where}.stiffness")
    if len(stiffness) == 1:
        if "axes" in words:
            raise MeshError(f"{where}.axes: belong to a spring with six stiffnesses")
        a, b = mesh.points[nodes]
        if np.linalg.norm(b - a) <= _APART * np.ptp(mesh.points):
            what = f"nodes {nodes[0]} and {nodes[1]} coincide, so there is no line between them"
            raise MeshError(f"{where}.between: {what}: give six stiffnesses")
    return Spring(name, nodes, stiffness, _axes(words.get("axes"), f"{where}.axes"))


def _between(mesh: Mesh, given: Any, where: str) -> IntArray:
    ends = list(given) if isinstance(given, list | tuple) else [given]
    if len(ends) == 1 or "ground" in ends:
        what = "a spring joins two nodes of the body, given"
        why = "the body floats: a spring to the ground is a force of the scene"
        raise MeshError(f"{where}: {what} {given!r}; {why}")
    if len(ends) != 2:
        raise MeshError(f"{where}: two nodes are expected, given {given!r}")
    nodes = np.array([one_node(mesh, end, f"{where}[{k}]") for k, end in enumerate(ends)])
    if nodes[0] == nodes[1]:
        raise MeshError(f"{where}: both ends are node {nodes[0]}")
    return nodes


def _stiffness(given: Any, where: str) -> FloatArray:
    try:
        values = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape not in ((1,), (6,)) or not np.isfinite(values).all():
        what = "one number [N/m], or six along [N/m] and about [N m/rad] the axes"
        raise MeshError(f"{where}: expects {what}, given {given!r}")
    if (values < 0).any() or not values.any():
        raise MeshError(f"{where}: must be positive, given {given!r}")
    return values


def _axes(given: Any, where: str) -> FloatArray:
    if given is None:
        return np.eye(3)
    try:
        first, second = np.asarray(given, dtype=float).reshape(2, 3)
    except (TypeError, ValueError) as error:
        raise MeshError(f"{where}: expects two directions, given {given!r}") from error
    third = np.cross(first, second)
    size = np.linalg.norm(first) * np.linalg.norm(second)
    if not np.linalg.norm(third) > 1e-6 * size:
        raise MeshError(f"{where}: the two directions must not be parallel, given {given!r}")
    third = third / np.linalg.norm(third)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=1)
