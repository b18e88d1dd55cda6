"""Assembly errors: the joints with the largest gaps, joints and cams on the wrong branch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import Compiled
from flexmb.engine.joints import DOT1, ROW_KINDS
from flexmb.engine.joints.curve_marker import Pieces
from flexmb.engine.state import State, Work
from flexmb.engine.tables import BodyColumns
from flexmb.errors import AssemblyError, Problem
from flexmb.model.model import Model
from flexmb.units import UnitSystem

_MAX_SHOWN = 3
# Least cosine between two axes of the same direction; closed rows allow only 1, or 0 and below.
_SAME_DIRECTION = 0.5
_ROUND_OFF = 1e-6  # over the size of the model, or in radians: rounding of numbers in a mesh file
_COORDINATE_ROUND_OFF = 0.1 * _ROUND_OFF  # of one of the seven coordinates of a body
_PENETRATION = 1e-6  # of a follower into its curve, over the size of the curve


@dataclass(frozen=True)
class Offset:
    """The gap of a joint or driver, or the displacement of a body: in metres and radians.

    `name` is a scene path, or the name of the body.
    """

    name: str
    distance: float
    angle: float

    def text(self, units: UnitSystem) -> str:
        """Text, in the scene's unit of length and in degrees."""
        return f"{units.say(self.distance, 'm', 4)} and {np.degrees(self.angle):.4g} deg"

    def size(self, length: float) -> float:
        """One number for sorting: distances over a length, angles in radians."""
        return self.distance / length + self.angle


def joint_gaps(compiled: Compiled, work: Work) -> list[Offset]:
    """The gaps of all joints and drivers at the last evaluated positions, largest first.

    Equations for the coordinates of forces and sensors can be satisfied in any pose: they have no
    gaps.
    """
    system, names = compiled.system, compiled.layout.rows
    gaps = []
    for group in system.groups:
        name = names[int(group["row"])].split(":")[0]
        if name.startswith(("forces.", "sensors.")):
            continue
        rows = slice(int(group["row"]), int(group["row"] + group["n"]))
        C = np.where(np.isfinite(work.con.C[rows]), work.con.C[rows], np.inf)
        kinds = system.rows["kind"][rows]
        angular, cosine = np.array([ROW_KINDS[k].angular for k in kinds], bool), kinds == DOT1
        distance, angle = (float(np.linalg.norm(C[w])) for w in (~angular, angular & ~cosine))
        angle += np.arcsin(min(1.0, float(np.linalg.norm(C[cosine]))))  # C: sine of the gap
        if angular.sum() == 3:  # noqa: PLR2004  (all axes are held: the rotation between them)
            ends = system.rows[rows][angular][0]
            first, second = (work.now.marker["R"][ends[word]] for word in ("I", "J"))
            angle = float(np.arccos(np.clip(0.5 * (np.sum(first * second) - 1.0), -1.0, 1.0)))
        gaps.append(Offset(name, *_without_round_off(compiled, distance, angle)))
    return sorted(gaps, key=lambda gap: -gap.size(compiled.length))


def moved_bodies(
    compiled: Compiled, before: NDArray[np.float64], after: NDArray[np.float64]
) -> tuple[Offset, ...]:
    """The bodies that differ between two positions (nq), farthest first."""
    moved = []
    for body in _changed_bodies(compiled, before, after):
        q, p = before[body.iq : body.iq + 7], after[body.iq : body.iq + 7]
        sine = np.linalg.norm(np.outer(q[3:], p[3:]) - np.outer(p[3:], q[3:])) / np.sqrt(2.0)
        angle = 2.0 * float(np.arctan2(sine, abs(q[3:] @ p[3:])))
        distance = float(np.linalg.norm(p[:3] - q[:3]))
        offset = Offset(body.name, *_without_round_off(compiled, distance, angle))
        moved += [offset] if offset.distance > 0.0 or offset.angle > 0.0 else []
    return tuple(sorted(moved, key=lambda body: -body.size(compiled.length)))


def _changed_bodies(
    compiled: Compiled, before: NDArray[np.float64], after: NDArray[np.float64]
) -> Iterator[BodyColumns]:
    """The bodies with a coordinate that differs by more than round-off."""
    least = _COORDINATE_ROUND_OFF * np.repeat([compiled.length, 1.0], [3, 4])
    columns = compiled.system.parts.bodies["iq"][:, None] + np.arange(7)
    little = (np.abs(after[columns] - before[columns]) <= least).all(axis=1)
    return (compiled.layout.bodies[k] for k in np.flatnonzero(~little))


def assembly_notes(gaps: Sequence[Offset], moved: Sequence[Offset], units: UnitSystem) -> list[str]:
    """Notes on gaps in the pose of the scene, largest first, and on the bodies that were moved.

    No notes if no body had to move.
    """
    if not moved:
        return []
    return [f"position error before assembly: {_listing(gaps, units)}", *moved_notes(moved, units)]


def moved_notes(moved: Sequence[Offset], units: UnitSystem) -> list[str]:
    """Notes on the bodies that were moved from their pose in the scene, farthest first."""
    return [f"assembled with least change; moved: {_listing(moved, units)}"] if moved else []


def _listing(offsets: Sequence[Offset], units: UnitSystem) -> str:
    shown = [one for one in offsets[:_MAX_SHOWN] if one.distance > 0.0 or one.angle > 0.0]
    return ", ".join(f"{one.name} by {one.text(units)}" for one in shown)


def _without_round_off(compiled: Compiled, far: float, angle: float) -> tuple[float, float]:
    return (
        0.0 if far <= _ROUND_OFF * compiled.length else far,
        0.0 if angle <= _ROUND_OFF else angle,
    )


def open_by(model: Model, gap: Offset) -> str:
    """Text on a gap; of a joint with its two markers, and with its axis if the scene gives none."""
    section, _, name = gap.name.partition(".")
    text = f"open by {gap.text(model.units)}"
    if section != "joints":
        return text
    joint = model.joints[name]
    text += f", from {joint.between[0]} to {joint.between[1]}"
    if "ground" in joint.between and gap.distance > 0.0:
        text += " (ground alone is the origin; [ground.markers] names other points)"
    across = joint.type in ("universal", "perpendicular") and joint.second_axis is None
    if across and gap.angle > 0.0:
        text += ": it has no second_axis, that of J across the axis of I"
    return text


def gap_problems(
    compiled: Compiled, model: Model, work: Work, moved: tuple[Offset, ...]
) -> list[Problem]:
    """The joints and drivers with the largest gaps, and the bodies that were moved farthest."""
    head = Problem(
        "assembly",
        "the initial positions cannot be assembled; the worst joints follow. "
        "Check lengths, placements and axes there, or begin nearer to a closed pose "
        "(assembly.guess)",
    )
    worst = [
        Problem(gap.name, f"stays {open_by(model, gap)}")
        for gap in joint_gaps(compiled, work)[:_MAX_SHOWN]
        if gap.distance > 0.0 or gap.angle > 0.0
    ]
    if not moved:
        return [head, *worst]
    return [head, *worst, Problem("assembly", f"moved in vain: {_listing(moved, model.units)}")]


def check_branches(
    compiled: Compiled, model: Model, state: State, work: Work, initial_axes: NDArray[np.float64]
) -> None:
    """Refuse joints whose axes differ by 120 or 180 deg although all their rows are zero.

    ``initial_axes`` (markers, 3, 3) are the axes of the markers before the joints closed.

    Raises
    ------
    AssemblyError
        Such joints, and cams that pass through their followers.
    """
    what = (
        "assembles with its sides turned against each other: axes that it makes equal are {:.4g} "
        "deg apart as placed; turn a marker or body, or guess the angle of a joint near it "
        "(assembly.guess)"
    )
    turned = _turned_joints(compiled, model, work, initial_axes)
    problems = [Problem(path, what.format(angle)) for path, angle in turned]
    problems += _cam_problems(compiled, model, state, work)
    if problems:
        raise AssemblyError.from_problems(problems)


def _turned_joints(
    compiled: Compiled, model: Model, work: Work, initial_axes: NDArray[np.float64]
) -> Iterator[tuple[str, float]]:
    """Scene paths of joints whose two triads differ in orientation, and the largest angle [deg]
    between their axes in the pose of the scene."""
    system = compiled.system
    first = system.rows[system.groups["row"]]
    cosines, before = (  # (groups, 3) between equal axes
        np.sum(R[first["I"]] * R[first["J"]], axis=1) for R in (work.now.marker["R"], initial_axes)
    )
    rows = zip(compiled.layout.reactions, cosines.tolist(), before, strict=True)
    for path, cosine, start in rows:
        section, _, name = path.partition(".")
        signs = signs_of_axes(model.joints[name].type) if section == "joints" else ()
        if any(cosine[a] < _SAME_DIRECTION for a in signs):
            yield path, float(np.degrees(np.arccos(np.clip(start[list(signs)], -1, 1).min())))


def _cam_problems(compiled: Compiled, model: Model, state: State, work: Work) -> Iterator[Problem]:
    """Followers that penetrate their cam in the assembled pose: they are on a wrong branch."""
    system = compiled.system
    for curve in system.parts.curve_markers:
        name = compiled.layout.coordinates[curve["coordinate"]].split(".")[1]
        joint = model.joints[name]
        if joint.type not in ("cam-flat", "cam-roller"):
            continue
        points, size = _curve_points(compiled, curve, state, work)
        row = system.rows[system.groups[curve["group"]]["row"]]
        follower = work.now.marker[int(row["I" if curve["side"] else "J"])]
        if joint.type == "cam-flat":
            height = (points - follower["x"]) @ follower["R"][:, 2]
            cut = min(height.max(), -height.min())
        else:
            assert joint.radius is not None  # a roller has one
            cut = joint.radius - np.linalg.norm(points - follower["x"], axis=1).min()
        if cut > _PENETRATION * size:
            deep = model.units.say(float(cut), "m", 3)
            what = (
                f"touches the curve, but another part of it reaches {deep} into the follower; "
                "begin on the other side or at another place (start), or change the shape there"
            )
            yield Problem(f"joints.{name}", what)


def _curve_points(
    compiled: Compiled, curve: np.void, state: State, work: Work
) -> tuple[NDArray[np.float64], float]:
    """Points (n, 3) of a curve at the present pose of its marker, and the size of the curve [m]."""
    parts, at, n = compiled.system.parts, int(curve["at"]), int(curve["n"])
    pieces = Pieces.of_pool(parts.pool, at, n)
    ends = pieces.ends
    s = state.q[parts.coordinates[curve["coordinate"]]["iq"]]
    s = s % ends[-1] if curve["closed"] else s
    here, tangent, _ = pieces.at(np.array([s]))[0]
    places = ends[:-1] + np.linspace(0.0, 1.0, 5)[:, None] * np.diff(ends)
    points = pieces.at(places.ravel())[:, 0]
    now, turn = work.now.marker[int(curve["marker"])], np.eye(3)
    c, d = tangent[:2] / np.linalg.norm(tangent[:2])
    turn[:2, :2] = [[c, -d], [d, c]]
    R = now["R"] @ turn.T  # of the marker that carries the curve
    return now["x"] + (points - here) @ R.T, float(np.linalg.norm(np.ptp(points, axis=0)))


def signs_of_axes(kind: str) -> tuple[int, ...]:
    """Axes of the two triads that must have the same, not the opposite direction, by joint type."""
    if kind in ("fixed", "prismatic", "orientation"):
        return (0, 1, 2)
    return (2,) if kind in ("revolute", "cylindrical", "screw", "planar", "parallel") else ()
