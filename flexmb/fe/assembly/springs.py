"""Springs between nodes of a body: their stiffness, and what their forces add to it.

A spring has one stiffness along the line between its nodes, or six on the motion of the second node
relative to the first at the point midway between them, three along and three about its axes; rigid
arms join that point to the nodes. The line of the one turns with its nodes; the axes of the other
turn with the mean of theirs, so that the order of the nodes does not matter. Source: MSC Nastran
Quick Reference Guide, entries CELAS2 and CBUSH.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

from flexmb.errors import MeshError, Problem
from flexmb.fe.assembly.connections import one_node
from flexmb.fe.assembly.numbering import Numbering
from flexmb.fe.meshes.mesh import Mesh
from flexmb.flexbody.arrays import FloatArray, IntArray, rotation_stiffness, skew
from flexmb.flexbody.mesh_options import NodeSpringOptions
from flexmb.flexbody.options import read_options

_MIN_DISTANCE = 1e-9  # of the mesh's extent: nearer nodes have no line between them


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


def make_springs(
    mesh: Mesh, options_by_name: Mapping[str, Mapping[str, Any]]
) -> tuple[Spring, ...]:
    """Find the nodes of springs ``{name: {between, stiffness, axes}}``.

    Parameters
    ----------
    mesh : Mesh
        In metres.
    options_by_name : mapping of str to mapping
        ``between`` two node numbers or groups of one node; ``stiffness`` one number [N/m] or six
        [N/m, N m/rad]; ``axes`` the directions of the first and second axis, the body's by
        default.

    Raises
    ------
    MeshError
        Unknown words or groups, springs to ground, impossible values; all at once.
    """
    springs: list[Spring] = []
    problems: list[Problem] = []
    for name, words in options_by_name.items():
        try:
            springs.append(_make_spring(mesh, name, words))
        except MeshError as error:
            problems += error.problems
    if problems:
        raise MeshError.from_problems(problems)
    return tuple(springs)


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
    _check_rotations(spring, numbering, points)
    there = numbers >= 0
    rows = _relative_motion(spring, points)[:, there]
    K = rows.T @ (spring.stiffness[:, None] * rows)
    return 0.5 * (K + K.T)[None], numbers[there][None]


def spring_geometric_stiffness(
    spring: Spring, numbering: Numbering, points: FloatArray, u: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Geometric stiffness (1, 12, 12) of a spring under displacements u (n_all,) and the numbers
    (1, 12) of its degrees of freedom, -1 where there is none.

    With the force N of one stiffness, N/L across the line. With six, the force F and the moment M
    at the middle do second-order work on the ends of the arms r_b and r_a, F.(theta_b x (theta_b x
    r_b) - theta_a x (theta_a x r_a))/2; on the axes, which turn by theta_m = (theta_a + theta_b)/2
    under the deflection d_0 = C^-1 F, -theta_m.(d x F + d_0 x C d); and on the relative rotation,
    -M.(theta_a x theta_b)/2. A spring of equal stiffnesses has no axes: there the second vanishes.
    """
    numbers = numbering.table[spring.nodes].reshape(12)
    q = np.where(numbers >= 0, u[numbers], 0.0).reshape(2, 6)
    H = np.zeros((12, 12))
    a, b = points[spring.nodes]
    if len(spring.stiffness) == 1:
        length = np.linalg.norm(b - a)
        n = (b - a) / length
        force = spring.stiffness[0] * (n @ (q[1, :3] - q[0, :3]))
        across = np.kron([[1.0, -1.0], [-1.0, 1.0]], np.eye(3) - np.outer(n, n))
        translations = np.r_[0:3, 6:9]
        H[np.ix_(translations, translations)] = force / length * across
        return H[None], numbers[None]
    B = _relative_motion(spring, points).reshape(6, 12)
    x = B @ q.reshape(12)
    F = spring.axes @ (spring.stiffness[:3] * x[:3])
    M = spring.axes @ (spring.stiffness[3:] * x[3:])
    d0 = spring.axes @ np.where(spring.stiffness[:3] > 0, x[:3], 0.0)
    D = spring.axes @ B[:3]
    C = spring.axes * spring.stiffness[:3] @ spring.axes.T
    middle = 0.5 * (a + b)
    for side, (sign, node) in enumerate(((-1.0, a), (1.0, b))):
        turn = slice(6 * side + 3, 6 * side + 6)
        H[turn, turn] = sign * rotation_stiffness(np.outer(middle - node, F))
        H[turn] -= 0.5 * (skew(d0) @ C - skew(F)) @ D
        H[:, turn] -= 0.5 * ((skew(d0) @ C - skew(F)) @ D).T
    H[3:6, 9:] += 0.5 * skew(M)
    H[9:, 3:6] += 0.5 * skew(M).T
    return 0.5 * (H + H.T)[None], numbers[None]


def turning_share(spring: Spring, numbering: Numbering, points: FloatArray, u: FloatArray) -> float:
    """Relative error of the geometric stiffness of a spring whose axes rotate, for displacements u.
    The neglected work (k_i - k_j) d_j^2/4 is divided by the stiffness about the third axis; it
    grows with the square of u."""
    if len(spring.stiffness) == 1:
        return 0.0
    numbers = numbering.table[spring.nodes].reshape(12)
    k, about = np.split(np.asarray(spring.stiffness), 2)
    d = _relative_motion(spring, points).reshape(6, 12) @ np.where(numbers >= 0, u[numbers], 0.0)
    if not (k.all() and about.all()):
        return 0.0
    gaps = np.abs(k[:, None] - k) * d[:3] ** 2 / 4  # [i, j]
    return float(max(gaps[i, j] / about[3 - i - j] for i, j in permutations(range(3), 2)))


def _relative_motion(spring: Spring, points: FloatArray) -> FloatArray:
    """(6, 2, 6) deflections of a spring with six stiffnesses, per unit motion of its nodes."""
    a, b = points[spring.nodes]
    middle, B = 0.5 * (a + b), np.zeros((6, 2, 6))
    for side, (sign, node) in enumerate(((-1.0, a), (1.0, b))):
        B[:3, side, :3] = sign * spring.axes.T
        B[:3, side, 3:] = -sign * spring.axes.T @ skew(middle - node)
        B[3:, side, 3:] = sign * spring.axes.T
    return B


def _check_rotations(spring: Spring, numbering: Numbering, points: FloatArray) -> None:
    without = spring.nodes[numbering.table[spring.nodes, 3] < 0]
    apart = np.linalg.norm(np.diff(points[spring.nodes], axis=0)) > _MIN_DISTANCE * np.ptp(points)
    if len(without) and (apart or spring.stiffness[3:].any()):
        why = "turning stiffnesses" if spring.stiffness[3:].any() else "arms to the other node"
        what = f"node {without[0]} has no rotations for the spring's {why}"
        raise MeshError(f"springs.{spring.name}: {what}: use the reference node of a tie")


def _make_spring(mesh: Mesh, name: str, words: Mapping[str, Any]) -> Spring:
    where = f"springs.{name}"
    options = read_options(NodeSpringOptions, words, where, MeshError)
    nodes = _spring_nodes(mesh, options.between, f"{where}.between")
    stiffness = _spring_constants(options.stiffness, f"{where}.stiffness")
    if len(stiffness) == 1:
        a, b = mesh.points[nodes]
        if np.linalg.norm(b - a) <= _MIN_DISTANCE * np.ptp(mesh.points):
            what = f"nodes {nodes[0]} and {nodes[1]} coincide, so there is no line between them"
            raise MeshError(f"{where}.between: {what}: give six stiffnesses")
    return Spring(name, nodes, stiffness, _spring_axes(options.axes, f"{where}.axes"))


def _spring_nodes(mesh: Mesh, between: Any, where: str) -> IntArray:
    ends = list(between) if isinstance(between, list | tuple) else [between]
    if len(ends) == 1 or "ground" in ends:
        what = "a spring joins two nodes of the body, given"
        why = "the body floats: a spring to the ground is a force of the scene"
        raise MeshError(f"{where}: {what} {between!r}; {why}")
    if len(ends) != 2:
        raise MeshError(f"{where}: two nodes are expected, given {between!r}")
    nodes = np.array([one_node(mesh, end, f"{where}[{k}]") for k, end in enumerate(ends)])
    if nodes[0] == nodes[1]:
        raise MeshError(f"{where}: both ends are node {nodes[0]}")
    return nodes


def _spring_constants(value: Any, where: str) -> FloatArray:
    try:
        values = np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape not in ((1,), (6,)) or not np.isfinite(values).all():
        what = "one number [N/m], or six along [N/m] and about [N m/rad] the axes"
        raise MeshError(f"{where}: expects {what}, given {value!r}")
    if (values < 0).any() or not values.any():
        raise MeshError(f"{where}: must be positive, given {value!r}")
    return values


def _spring_axes(axes: Any, where: str) -> FloatArray:
    if axes is None:
        return np.eye(3)
    try:
        first, second = np.asarray(axes, dtype=float).reshape(2, 3)
    except (TypeError, ValueError) as error:
        raise MeshError(f"{where}: expects two directions, given {axes!r}") from error
    third = np.cross(first, second)
    size = np.linalg.norm(first) * np.linalg.norm(second)
    if not np.linalg.norm(third) > 1e-6 * size:
        raise MeshError(f"{where}: the two directions must not be parallel, given {axes!r}")
    third = third / np.linalg.norm(third)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third], axis=1)
