"""Free motions of a pose, in words: which bodies move, and whether they turn, slide or screw.

In: the constraint Jacobian of a pose. Out: a :class:`FreeMotion` for each body, and for each pair
of bodies connected by a joint, that can move while all others are at rest; then one for all
remaining motions. A motion of a body between others is idle if nothing else moves with it, such as
the spin of a rod between two spherical joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import ConstraintPose, null_space
from flexmb.engine.tables import BodyColumns
from flexmb.flexbody.arrays import Array
from flexmb.model.markers import rotation_matrix
from flexmb.model.model import Model
from flexmb.model.reading import GROUND, split_reference

_ZERO_TOLERANCE = 1e-7  # components of unit motions below this are zero
_LINE_TOLERANCE = 1e-6  # pitch, and distance from a line, that are zero, over the model size


@dataclass(frozen=True)
class FreeMotion:
    """`count` motions of some bodies that leave the others at rest; `sentence` says what moves."""

    bodies: tuple[str, ...]
    count: int
    idle: bool
    sentence: str


def free_motions(
    model: Model, pose: ConstraintPose, others: Sequence[ConstraintPose] = ()
) -> tuple[FreeMotion, ...]:
    """The free motions of a pose: those of single bodies, of pairs, and the rest; idle ones marked.

    Bodies count as moving by themselves only if they can do so in the poses `others` too: at a dead
    point all other bodies are at rest for a moment.
    """
    motions: list[FreeMotion] = []
    alone = np.zeros((len(pose.jacobian.columns), 0))
    for bodies in _candidate_parts(model, pose):
        mine = _own_motions(pose, bodies)
        if any(_own_motions(other, bodies).shape[1] < mine.shape[1] for other in others):
            continue
        fresh = _orthogonal_part(mine, alone)
        if fresh.shape[1]:
            alone = np.hstack([alone, fresh])
            motions.append(_motion(model, pose, bodies, fresh))
    left = pose.jacobian.decomposition.free.shape[1] - alone.shape[1]
    if left > 0:
        layout = pose.compiled.layout.bodies
        apart = [[body for body in layout if body.name in one.bodies] for one in motions]
        moving = {name for one in (pose, *others) for name in _moving_bodies(one, apart)}
        names = tuple(body.name for body in layout if body.name in moving)
        what = "motion moves" if left == 1 else "motions move"
        motions.append(FreeMotion(names, left, False, f"{left} {what} {', '.join(names)}"))
    return tuple(motions)


def _moving_bodies(pose: ConstraintPose, apart: list[list[BodyColumns]]) -> list[str]:
    """Bodies that move in a pose, without the motions of the sets `apart` by themselves."""
    alone = np.zeros((len(pose.jacobian.columns), 0))
    for bodies in apart:
        alone = np.hstack([alone, _orthogonal_part(_own_motions(pose, bodies), alone)])
    rest = _orthogonal_part(pose.jacobian.decomposition.free, alone)
    size = np.abs(rest).max(axis=1, initial=0.0)
    return [
        body.name
        for body in pose.compiled.layout.bodies
        if size[_columns(pose, body)].max(initial=0.0) > _ZERO_TOLERANCE
    ]


def _candidate_parts(model: Model, pose: ConstraintPose) -> Iterator[tuple[BodyColumns, ...]]:
    """Single bodies, then pairs that a joint connects and that are between others."""
    bodies = {body.name: body for body in pose.compiled.layout.bodies}
    for body in bodies.values():
        yield (body,)
    for joint in model.joints.values():
        pair = tuple(dict.fromkeys(_ends(joint.between)))
        if (
            len(pair) == 2
            and all(name in bodies for name in pair)
            and _is_between_others(model, pair)
        ):
            yield tuple(bodies[name] for name in pair)


def _ends(between: tuple[str, str]) -> tuple[str, str]:
    first, second = (split_reference(reference)[0] for reference in between)
    return first, second


def _neighbours(model: Model, bodies: tuple[str, ...]) -> list[str]:
    """Names of the bodies, or ground, to which these bodies have joints; one for each joint."""
    ends = [_ends(joint.between) for joint in model.joints.values()]
    pairs = [(a, b) if a in bodies else (b, a) for a, b in ends if (a in bodies) != (b in bodies)]
    return [other for _, other in pairs]


def _is_between_others(model: Model, bodies: tuple[str, ...]) -> bool:
    """Whether these bodies have two or more joints to others, not all of them to ground."""
    others = _neighbours(model, bodies)
    return len(others) > 1 and any(other != GROUND for other in others)


def _columns(pose: ConstraintPose, body: BodyColumns) -> NDArray[np.bool_]:
    columns = pose.jacobian.columns
    return np.asarray((columns >= body.iv) & (columns < body.iv + 6 + body.m))


def _own_motions(pose: ConstraintPose, bodies: Sequence[BodyColumns]) -> Array:
    """(columns, k) rigid motions of these bodies that leave all else at rest."""
    inside = np.any([_columns(pose, body) for body in bodies], axis=0) & ~pose.jacobian.modal
    inside |= pose.jacobian.scalar  # scalar coordinates move along with the joints they follow
    mine = null_space(pose.jacobian.A[:, inside], pose.jacobian.norm)
    motions = np.zeros((len(inside), mine.shape[1]))
    motions[inside] = mine
    return motions


def _orthogonal_part(motions: Array, basis: Array) -> Array:
    """(columns, k) orthonormal basis of the part of motions that is orthogonal to a basis."""
    rest = motions - basis @ (basis.T @ motions)
    U, size, _ = np.linalg.svd(rest, full_matrices=False)
    return np.asarray(U[:, size > 1e-6])


def _motion(
    model: Model, pose: ConstraintPose, bodies: tuple[BodyColumns, ...], motions: Array
) -> FreeMotion:
    names, count = tuple(body.name for body in bodies), motions.shape[1]
    who = " and ".join(names) + (" together" if len(names) > 1 else "")
    if not _neighbours(model, names):
        sentence = f"{who} has no joint"
    elif count == 1:
        sentence = f"{who} can {_motion_text(model, pose, bodies, motions[:, 0])}"
    else:
        turns = int(np.linalg.matrix_rank(_twists(pose, bodies[0], motions)[:, 3:], tol=1e-6))
        numbers = ((turns, "turn"), (count - turns, "slide"))
        ways = ", ".join(f"{n} {word}{'s' * (n != 1)}" for n, word in numbers if n)
        sentence = f"{who} can move by {'themselves' if len(names) > 1 else 'itself'}: {ways}"
    return FreeMotion(names, count, _is_between_others(model, names), sentence)


def _twists(pose: ConstraintPose, body: BodyColumns, motions: Array) -> Array:
    """(k, 6) velocity of the body origin over the model size, and angular velocity, global."""
    v = np.zeros((pose.compiled.layout.nv, motions.shape[1]))
    v[pose.jacobian.columns] = motions
    A = rotation_matrix(pose.q[body.iq + 3 : body.iq + 7])
    return np.vstack([v[body.iv : body.iv + 3], A @ v[body.iv + 3 : body.iv + 6]]).T


def _motion_text(
    model: Model, pose: ConstraintPose, bodies: tuple[BodyColumns, ...], motion: Array
) -> str:
    """One motion in words: a turn about a line, a slide, or a screw motion."""
    length, body = pose.compiled.length, bodies[0]
    twist = _twists(pose, body, motion[:, None])[0]
    v, w = twist[:3], twist[3:]
    spin = float(np.linalg.norm(w))
    if spin < _ZERO_TOLERANCE:
        return f"slide along {_direction_text(v)}"
    r = pose.q[body.iq : body.iq + 3]
    point = r + length * np.cross(w, v) / spin**2
    about = _line_text(model, pose, {body.name for body in bodies}, point, w / spin)
    if abs(float(v @ w)) > _LINE_TOLERANCE * spin**2:
        return f"move as a screw about {about}"
    return f"turn about {about}"


def _line_text(
    model: Model, pose: ConstraintPose, bodies: set[str], point: Array, axis: Array
) -> str:
    """A line in words: by the joints of the bodies on it, else by a point and its direction."""
    through = []
    for name, joint in model.joints.items():
        path, inside = f"joints.{name}", [end in bodies for end in _ends(joint.between)]
        if inside[0] != inside[1] and path in pose.jacobian.owners:
            xi, _, xj, _ = pose.markers_of(path)
            x = (xi if inside[0] else xj) * pose.compiled.length
            if np.linalg.norm(np.cross(x - point, axis)) < _LINE_TOLERANCE * pose.compiled.length:
                through.append(name)
    if len(through) > 1:
        return f"the line through its joints {' and '.join(through)}"
    if through:
        return f"{_direction_text(axis)} through its joint {through[0]}"
    noise = _ZERO_TOLERANCE * pose.compiled.length
    point = point + pose.compiled.layout.origin
    rounded = (float(c) if abs(c) > noise else 0.0 for c in point)
    place = ", ".join(f"{model.units.outward(c, 'm'):.4g}" for c in rounded)
    return f"{_direction_text(axis)} through ({place}) {model.units.label('m')}"


def _direction_text(u: Array) -> str:
    """A direction in words: a global axis, or its components."""
    u = u / np.linalg.norm(u)
    k = int(np.argmax(np.abs(u)))
    if abs(u[k]) > 1.0 - 1e-9:
        return "xyz"[k]
    shown = ", ".join(f"{float(c) + 0.0:.3g}" for c in np.round(u * np.sign(u[k]), 9))
    return f"({shown})"
