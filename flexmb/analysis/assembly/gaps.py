"""What does not close: the worst joints with their gaps, joints on the wrong branch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.dynamics.contacts import branch_problems
from flexmb.engine.compile import Compiled
from flexmb.engine.joints.joint import signs_of_axes
from flexmb.engine.layout import BodyColumns
from flexmb.engine.row_kinds import ROW_KINDS
from flexmb.engine.state import State, Work
from flexmb.errors import AssemblyError, Problem
from flexmb.model.model import Model
from flexmb.units import UnitSystem

__all__ = ["Gap", "Moved", "check_branches", "gap_problems", "gaps", "moved_bodies", "opened"]

_SHOWN = 3
_SAME = 0.5  # cosine between axes that belong together; rows leave only 1, or 0 and below
_STAYED = 1e-6  # relative to the model size, or radians: what the digits of a mesh file leave
_LITTLE = 0.1 * _STAYED  # of each coordinate: seven of them together make less than that


@dataclass(frozen=True)
class Gap:
    """How far a joint or driver is open: its scene path, metres and radians."""

    where: str
    distance: float
    angle: float

    @property
    def open(self) -> bool:
        """Whether it is more than round-off."""
        return self.distance > 0.0 or self.angle > 0.0

    def said(self, units: UnitSystem) -> str:
        """In the scene's unit of length and in degrees."""
        return f"{units.say(self.distance, 'm', 4)} and {np.degrees(self.angle):.4g} deg"


@dataclass(frozen=True)
class Moved:
    """How far a body was moved and turned to close the gaps: metres and radians."""

    name: str
    distance: float
    angle: float

    def said(self, units: UnitSystem) -> str:
        """In the scene's unit of length and in degrees."""
        return f"{units.say(self.distance, 'm', 4)} and {np.degrees(self.angle):.4g} deg"


def gaps(compiled: Compiled, work: Work) -> list[Gap]:
    """The gaps of all joints and drivers at the last evaluated positions, worst first."""
    system, names = compiled.system, compiled.layout.rows
    found: list[tuple[float, Gap]] = []
    for group in system.groups:
        rows = slice(int(group["row"]), int(group["row"] + group["n"]))
        C = np.where(np.isfinite(work.con.C[rows]), work.con.C[rows], np.inf)
        turned = np.array([ROW_KINDS[kind].angular for kind in system.rows["kind"][rows]], bool)
        gap, angle = float(np.linalg.norm(C[~turned])), float(np.linalg.norm(C[turned]))
        where = names[rows.start].split(":")[0]
        gap, angle = _without_round_off(compiled, gap, angle)
        found.append((gap / compiled.length + angle, Gap(where, gap, angle)))
    found.sort(key=lambda item: -item[0])
    return [gap for _, gap in found]


def moved_bodies(
    compiled: Compiled, before: NDArray[np.float64], after: NDArray[np.float64]
) -> tuple[Moved, ...]:
    """The bodies that differ between two positions (nq), farthest first."""
    found = []
    for body in _changed(compiled, before, after):
        q, p = before[body.iq : body.iq + 7], after[body.iq : body.iq + 7]
        sine = np.linalg.norm(np.outer(q[3:], p[3:]) - np.outer(p[3:], q[3:])) / np.sqrt(2.0)
        angle = 2.0 * float(np.arctan2(sine, abs(q[3:] @ p[3:])))
        far, angle = _without_round_off(compiled, float(np.linalg.norm(p[:3] - q[:3])), angle)
        if not (far == 0.0 and angle == 0.0):
            found.append((far / compiled.length + angle, Moved(body.name, far, angle)))
    return tuple(moved for _, moved in sorted(found, key=lambda item: -item[0]))


def _changed(
    compiled: Compiled, before: NDArray[np.float64], after: NDArray[np.float64]
) -> Iterator[BodyColumns]:
    """The bodies that may have moved: a coordinate of theirs differs by more than a little."""
    least = _LITTLE * np.repeat([compiled.length, 1.0], [3, 4])
    columns = compiled.system.parts.bodies["iq"][:, None] + np.arange(7)
    little = (np.abs(after[columns] - before[columns]) <= least).all(axis=1)
    return (compiled.layout.bodies[k] for k in np.flatnonzero(~little))


def opened(found: Sequence[Gap], moved: Sequence[Moved], units: UnitSystem) -> list[str]:
    """What was open as placed, worst first, and which bodies moved for it, in the scene's units.

    Nothing if no body had to move.
    """
    if not moved:
        return []
    wide = [f"{gap.where} by {gap.said(units)}" for gap in found if gap.open][:_SHOWN]
    far = [f"{body.name} by {body.said(units)}" for body in moved[:_SHOWN]]
    return [
        f"open as placed: {', '.join(wide)}",
        f"closed with least change; moved: {', '.join(far)}",
    ]


def _without_round_off(compiled: Compiled, far: float, angle: float) -> tuple[float, float]:
    return 0.0 if far <= _STAYED * compiled.length else far, 0.0 if angle <= _STAYED else angle


def gap_problems(
    compiled: Compiled, model: Model, work: Work, moved: tuple[Moved, ...]
) -> list[Problem]:
    """The worst joints and drivers with their gaps, and the bodies that were moved most."""
    head = Problem(
        "assembly",
        "the initial positions cannot be assembled; the worst joints follow. "
        "Check lengths, placements and axes there, or begin nearer to a closed pose "
        "(assembly.guess)",
    )
    worst = [
        Problem(gap.where, f"stays open by {gap.said(model.units)}")
        for gap in gaps(compiled, work)[:_SHOWN]
        if gap.open
    ]
    if not moved:
        return [head, *worst]
    told = ", ".join(f"{body.name} by {body.said(model.units)}" for body in moved[:_SHOWN])
    return [head, *worst, Problem("assembly", f"moved in vain: {told}")]


def _turned_joints(compiled: Compiled, model: Model, work: Work) -> Iterator[str]:
    """Scene paths of the joints whose two sides are turned against each other."""
    system = compiled.system
    first, R = system.rows[system.groups["row"]], work.now.marker["R"]
    cosines = np.sum(R[first["I"]] * R[first["J"]], axis=1)  # (groups, 3) between equal axes
    for path, cosine in zip(compiled.layout.reactions, cosines.tolist(), strict=True):
        section, _, name = path.partition(".")
        signs = signs_of_axes(model.joints[name].type) if section == "joints" else ()
        if any(cosine[a] < _SAME for a in signs):
            yield path


def check_branches(compiled: Compiled, model: Model, state: State, work: Work) -> None:
    """Refuse joints whose axes differ, by 120 or 180 deg, though all their rows vanish."""
    what = (
        "assembles with its sides turned against each other; turn a marker or body, or "
        "guess the angle of a joint near it (assembly.guess)"
    )
    problems = [Problem(path, what) for path in _turned_joints(compiled, model, work)]
    problems += branch_problems(compiled, model, state, work)
    if problems:
        raise AssemblyError.from_problems(problems)
