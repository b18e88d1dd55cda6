"""What does not close: the worst joints with their gaps, joints on the wrong branch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.dynamics.contacts import branch_problems
from flexmb.engine.compile import Compiled
from flexmb.engine.compile.joints.groups import ANGULAR
from flexmb.engine.compile.joints.joint_rows import signs_of_axes
from flexmb.engine.state import State, Work
from flexmb.errors import AssemblyError, Problem
from flexmb.model.model import Model
from flexmb.units import UnitSystem

__all__ = ["Gap", "Moved", "check_branches", "gap_problems", "gaps", "moved_bodies", "opened"]

_SHOWN = 3
_SAME = 0.5  # cosine between axes that belong together; rows leave only 1, or 0 and below
_STAYED = 1e-6  # relative to the model size, or radians: what the digits of a mesh file leave


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
        turned = np.isin(system.rows["kind"][rows], ANGULAR)
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
    for body in compiled.layout.bodies:
        q, p = before[body.iq : body.iq + 7], after[body.iq : body.iq + 7]
        sine = np.linalg.norm(np.outer(q[3:], p[3:]) - np.outer(p[3:], q[3:])) / np.sqrt(2.0)
        angle = 2.0 * float(np.arctan2(sine, abs(q[3:] @ p[3:])))
        far, angle = _without_round_off(compiled, float(np.linalg.norm(p[:3] - q[:3])), angle)
        if not (far == 0.0 and angle == 0.0):
            found.append((far / compiled.length + angle, Moved(body.name, far, angle)))
    return tuple(moved for _, moved in sorted(found, key=lambda item: -item[0]))


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


def check_branches(compiled: Compiled, model: Model, state: State, work: Work) -> None:
    """Refuse joints whose axes differ, by 120 or 180 deg, though all their rows vanish."""
    problems = []
    for name, joint in model.joints.items():
        first = next(
            row
            for row, text in zip(compiled.system.rows, compiled.layout.rows, strict=True)
            if text.startswith(f"joints.{name}:")
        )
        Ri, Rj = (work.now.marker[int(first[side])]["R"] for side in ("I", "J"))
        if any(Ri[:, a] @ Rj[:, a] < _SAME for a in signs_of_axes(joint.type)):
            what = (
                "assembles with its sides turned against each other; turn a marker or body, or "
                "guess the angle of a joint near it (assembly.guess)"
            )
            problems.append(Problem(f"joints.{name}", what))
    problems += branch_problems(compiled, model, state, work)
    if problems:
        raise AssemblyError.from_problems(problems)
