"""Markers, the points and axes of a body through which everything acts on it, and orientations.

A marker is a place on a body, given in the body frame of the undeformed body; :class:`PlacedMarker`
contains what the engine needs of it. On a flexible body a marker is carried by an interface or a
mesh node; if its ``position`` differs from the node's, the arm between them rotates with the node.

An orientation is a quaternion [w, x, y, z] (Euler parameters, scaled to unit length), a 3x3 matrix
(columns: the body's axes in global components), or one of the tables ``{axis, angle}``; ``{x_along,
y_towards}`` (any two of the axes: the first exactly along its direction, the second as near as
possible to the other direction); ``{euler, angles}`` (a sequence such as "zxz" of rotations about
body-fixed axes, each about the axis as the previous rotations have left it). It is read as a unit
quaternion p, scalar first, w >= 0; A(p) transforms body components to global ones. SciPy's Rotation
is not used, since it takes 0.1 s to load and is not exact for rotations about coordinate axes.
Source: Shabana, Dynamics of Multibody Systems, ch. 2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import model_validator

from flexmb.errors import Problem, SceneError, nearest
from flexmb.flexbody.arrays import Array
from flexmb.model.quantities import Integer, Position, Text, read_axis, read_number, unit_vector
from flexmb.model.reading import (
    NUMBER,
    Entry,
    Names,
    ReadContext,
    Reader,
    Spec,
    context_of,
    fail,
    list_form,
    quote,
    under,
    unknown_key,
)

if TYPE_CHECKING:
    from flexmb.flexbody import FlexBody


Quaternion = tuple[float, float, float, float]
# deviation from orthogonality: a matrix typed with seven digits passes, a wrong one does not
_ORTHOGONAL = 1e-6
_PARALLEL = 1e-9  # sine of the angle below which two directions are parallel
_TURN = 2 * math.pi * (1 + 1e-9)
_AXIS_ANGLE = ("axis", "angle")
_EULER = ("euler", "angles")
_DIRECTIONS = tuple(f"{axis}_{how}" for axis in "xyz" for how in ("along", "towards"))
_FORMS = "{axis, angle}, {x_along, y_towards} or {euler, angles}"

EULER_SEQUENCES = tuple(f"{a}{b}{c}" for a, b, c in product("xyz", repeat=3) if b not in (a, c))
"""The twelve sequences of axes that reach every orientation."""


def rotation_matrix(p: Any) -> Array:
    """Direction-cosine matrix A (3, 3), body to global, of a unit quaternion p = [w, x, y, z]."""
    return np.array(_cosines(*map(float, p))).reshape(3, 3)


def rotation_matrices(p: Array) -> Array:
    """(n, 3, 3) rotation matrices of many quaternions (n, 4)."""
    return np.stack(_cosines(*p.T), axis=1).reshape(-1, 3, 3)


def _cosines(w: Any, x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """The nine direction cosines of a quaternion, row by row."""
    return (
        w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z,
    )  # fmt: skip


def quaternion_from_axis(axis: Any, angle: float) -> Quaternion:
    """Unit quaternion of a rotation about a unit axis by an angle [rad]."""
    s = math.sin(angle / 2)
    x, y, z = (float(c) for c in axis)
    return _unit([math.cos(angle / 2), s * x, s * y, s * z])


def quaternion_from_matrix(A: Any) -> Quaternion:
    """Unit quaternion of a rotation matrix (Shepperd, J. Guidance and Control 1 (1978) 223)."""
    A = np.asarray(A, dtype=float)
    K = np.array(
        [
            [A[0, 0] + A[1, 1] + A[2, 2], A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]],
            [0, A[0, 0] - A[1, 1] - A[2, 2], A[0, 1] + A[1, 0], A[0, 2] + A[2, 0]],
            [0, 0, A[1, 1] - A[0, 0] - A[2, 2], A[1, 2] + A[2, 1]],
            [0, 0, 0, A[2, 2] - A[0, 0] - A[1, 1]],
        ]
    )
    K = K + np.triu(K, 1).T
    largest = int(np.argmax(np.diag(K)))
    column = K[:, largest].copy()
    column[largest] += 1.0  # 4 p_i p_k = K_ik + delta_ik
    return _unit(column)


def triad(axis: Any) -> Array:
    """Rotation matrix (3, 3) with a given z axis (unit vector): the shortest rotation that takes z
    there.

    For axes below the xy plane it is the shortest rotation after a rotation by 180 degrees about x,
    which is exact near -z, where the shortest rotation from z is not unique.
    """
    x, y, z = (float(c) for c in axis)
    below = z < 0
    if below:
        y, z = -y, -z
    c = 1 / (1 + z)
    R = np.array([[1 - c * x * x, -c * x * y, x], [-c * x * y, 1 - c * y * y, y], [-x, -y, z]])
    return np.diag([1.0, -1.0, -1.0]) @ R if below else R


def quaternion_from_euler(sequence: str, angles: Iterable[float]) -> Quaternion:
    """Unit quaternion of successive rotations [rad] about the body's own axes.

    A = R_1(angle 1) R_2(angle 2) R_3(angle 3); "zxz" are the classical Euler angles, "xyz" Cardan's
    (Shabana, Dynamics of Multibody Systems, ch. 2; Goldstein, Classical Mechanics, app. A).
    """
    p = [1.0, 0.0, 0.0, 0.0]
    for letter, angle in zip(sequence, angles, strict=True):
        c, s = math.cos(angle / 2), math.sin(angle / 2)
        turned = [c * value for value in p]
        i = 1 + "xyz".index(letter)
        j, k = 1 + i % 3, 1 + (i + 1) % 3
        turned[0] -= s * p[i]
        turned[i] += s * p[0]
        turned[j] += s * p[k]
        turned[k] -= s * p[j]
        p = turned
    return _unit(p)


def _unit(p: Any) -> Quaternion:
    w, x, y, z = unit_vector(float(c) for c in p)
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    return (w + 0.0, x + 0.0, y + 0.0, z + 0.0)


def read_orientation(value: Any, names: Names) -> Quaternion:
    """A unit quaternion from any form of an orientation.

    Raises
    ------
    SceneError
        No form of an orientation, several forms at once, or numbers that give none.
    """
    value = value.tolist() if hasattr(value, "tolist") else value
    names = ReadContext.of(names)
    if isinstance(value, Mapping):
        return _from_table(value, names)
    if isinstance(value, list | tuple) and len(value) == 4:
        p = [read_number(item, names) for item in value]
        if not any(p):
            raise SceneError("a quaternion must not be zero")
        return _unit(p)
    if isinstance(value, list | tuple) and len(value) == 3:
        return _from_rows(value, names)
    raise SceneError(
        f"an orientation is a quaternion [w, x, y, z], a 3x3 matrix or a table {_FORMS}, "
        f"given {quote(value)}"
    )


def _from_table(table: Mapping[str, Any], names: ReadContext) -> Quaternion:
    forms = [keys for keys in (_AXIS_ANGLE, _EULER, _DIRECTIONS) if set(keys) & set(table)]
    if len(forms) > 1:
        keys = ", ".join(f'"{key}"' for key in table)
        raise SceneError(f"an orientation is given in one way, {_FORMS}; given {keys}")
    if not forms:
        allowed = (*_AXIS_ANGLE, *_EULER, *_DIRECTIONS)
        wrong = [unknown_key(key, allowed) for key in table]
        raise SceneError.from_problems(
            wrong or [Problem("", f"an orientation is a table {_FORMS}, given an empty one")]
        )
    if forms[0] is _DIRECTIONS:
        return _from_directions(table, names)
    readers: dict[str, Callable[[Any, ReadContext], Any]] = (
        {"axis": read_axis, "angle": _read_angle}
        if forms[0] is _AXIS_ANGLE
        else {"euler": _read_sequence, "angles": _read_angles}
    )
    missing = [Problem(key, "is missing") for key in readers if key not in table]
    values = _values(table, readers, names, missing)
    if forms[0] is _AXIS_ANGLE:
        return quaternion_from_axis(values["axis"], values["angle"])
    return quaternion_from_euler(values["euler"], values["angles"])


def _from_directions(table: Mapping[str, Any], names: ReadContext) -> Quaternion:
    """The orientation with one axis exactly along a direction, another one towards a second
    direction."""
    along = [key for key in table if key in _DIRECTIONS and key.endswith("_along")]
    towards = [key for key in table if key in _DIRECTIONS and key.endswith("_towards")]
    if len(along) != 1 or len(towards) != 1 or along[0][0] == towards[0][0]:
        keys = ", ".join(f'"{key}"' for key in table)
        what = 'give one axis "along" a direction and another one "towards" one, such as '
        raise SceneError(what + f"{{x_along = ..., y_towards = ...}}; given {keys}")
    readers = {along[0]: read_axis, towards[0]: read_axis}
    values = _values(table, readers, names, [])
    first = np.array(values[along[0]])
    second = np.array(values[towards[0]])
    across = second - (second @ first) * first
    if np.linalg.norm(across) < _PARALLEL:
        raise SceneError(f"the directions of {along[0]} and {towards[0]} are parallel")
    i, j = "xyz".index(along[0][0]), "xyz".index(towards[0][0])
    A = np.zeros((3, 3))
    A[:, i] = first
    A[:, j] = across / np.linalg.norm(across)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    A[:, 3 - i - j] = sign * np.cross(A[:, i], A[:, j])
    return quaternion_from_matrix(A)


def _values(
    table: Mapping[str, Any],
    readers: Mapping[str, Callable[[Any, ReadContext], Any]],
    names: ReadContext,
    problems: list[Problem],
) -> dict[str, Any]:
    """The entries of a table, each read by its reader; collects all problems."""
    problems = [unknown_key(key, tuple(readers)) for key in table if key not in readers] + problems
    values: dict[str, Any] = {}
    for key, read in readers.items():
        try:
            values[key] = read(table[key], names) if key in table else None
        except SceneError as error:
            problems += under(key, error.problems)
    if problems:
        raise SceneError.from_problems(problems)
    return values


def _read_angle(value: Any, names: ReadContext) -> float:
    try:
        plain = float(value)
    except (TypeError, ValueError):
        plain = 0.0  # an expression, or no angle
    if abs(plain) > _TURN and math.isfinite(plain):
        what = f"an angle [rad] is expected, given {quote(value)}, more than a turn"
        raise SceneError(f'{what}; degrees are written "{plain:g} deg"')
    return read_number(value, names, "rad")


def _read_angles(value: Any, names: ReadContext) -> tuple[float, ...]:
    value = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise SceneError(f"three angles are expected, given {quote(value)}")
    return tuple(_read_angle(item, names) for item in value)


def _read_sequence(value: Any, names: ReadContext) -> str:
    if isinstance(value, str) and value in EULER_SEQUENCES:
        return value
    near = nearest(str(value), EULER_SEQUENCES)
    what = f"unknown sequence of axes {quote(value)}"
    raise SceneError.from_problems([Problem("", what, EULER_SEQUENCES, near)])


def _from_rows(rows: Any, names: ReadContext) -> Quaternion:
    if not all(isinstance(row, list | tuple) and len(row) == 3 for row in rows):
        raise SceneError(f"a 3x3 matrix has three rows of three numbers, given {quote(rows)}")
    A = np.array([[read_number(item, names) for item in row] for row in rows])
    with np.errstate(all="ignore"):
        error = float(np.abs(A.T @ A - np.eye(3)).max())
    if not error <= _ORTHOGONAL:
        raise SceneError(
            "the matrix is no rotation: its columns are not orthogonal unit vectors, "
            f"by {error:.2g}"
        )
    if np.linalg.det(A) < 0:
        raise SceneError("the matrix is no rotation but a reflection: its determinant is -1")
    return quaternion_from_matrix(A)


_ROWS = list_form(list_form(NUMBER, 3), 3)
_FORM = {"anyOf": [list_form(NUMBER, 4), _ROWS, {"type": "object"}]}
Orientation = Annotated[
    Quaternion, Reader(lambda value, info: read_orientation(value, context_of(info)), form=_FORM)
]


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
    def _check_carrier(self) -> Self:
        if self.node is not None and self.interface is not None:
            raise fail(Problem("", 'give "node" or "interface", not both'))
        return self

    @property
    def is_frame(self) -> bool:
        """Whether it is the origin of the body frame, which on a flexible body is no material
        point."""
        return self.position is None and self.node is None and self.interface is None


Marker = Annotated[MarkerSpec, Entry()]


class GroundSpec(Spec):
    """The fixed body: its markers, in the global frame."""

    markers: dict[str, Marker] = {}


@dataclass(frozen=True, eq=False)
class PlacedMarker:
    """A marker in the form that the engine needs, in axes of the undeformed body.

    Parameters
    ----------
    body : str
        Name of the body, or ``"ground"``.
    rho : (3,) float
        Position of the carrying point [m].
    arm : (3,) float
        From the carrying point to the marker [m]; rotates with the carrier.
    R : (3, 3) float
        Marker axes (columns) in body axes.
    Phi_t, Phi_r : (3, m) float or None
        Translation and rotation of the carrier per unit modal coordinate; None: moves rigidly.
    bend : (6, m, m) float, optional
        Second-order displacement of the carrier: along each axis -1/2 eta^T bend eta [m], and that
        of its rotation vector [rad].
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
    bare = marker.node is None and marker.interface is None
    if flexbody is None or marker.is_frame or (flexbody.m == 0 and bare):  # nothing carries it
        rho = zero if marker.position is None else np.array(marker.position)
        return PlacedMarker(body, rho, zero, R)
    rho, Phi_t, Phi_r, bend = _carrier(marker, flexbody)
    arm = zero if marker.position is None else np.array(marker.position) - rho
    return PlacedMarker(body, rho, arm, R, Phi_t, Phi_r, bend)


def _carrier(marker: MarkerSpec, flexbody: FlexBody) -> tuple[Array, Array, Array, Array | None]:
    """Position, translation modes, rotation modes and bend of the interface or node that carries
    it."""
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
    return nodes.position[row], nodes.Phi_t[row], nodes.Phi_r[row], nodes.bend_at(row)
