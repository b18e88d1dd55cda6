"""What does not close: the worst joints with their gaps, joints on the wrong branch."""

from __future__ import annotations

import numpy as np

from flexmb.analysis.contacts import branch_problems
from flexmb.engine.compile import Compiled
from flexmb.engine.compile.joint_rows import signs_of_axes
from flexmb.engine.compile.joints import ANGULAR
from flexmb.engine.consistent import RESIDUAL, solve_level
from flexmb.engine.work import State, Work
from flexmb.errors import AssemblyError, Problem
from flexmb.model.model import Model

_SHOWN = 3
_SAME = 0.5  # cosine between axes that belong together; rows leave only 1, or 0 and below


def gap_problems(compiled: Compiled, work: Work) -> list[Problem]:
    """The worst joints and drivers with their gaps in mm and degrees, worst first."""
    system, names = compiled.system, compiled.layout.rows
    found: list[tuple[float, Problem]] = []
    for group in system.groups:
        rows = slice(int(group["row"]), int(group["row"] + group["n"]))
        kinds = system.rows["kind"][rows]
        C = np.where(np.isfinite(work.con.C[rows]), work.con.C[rows], np.inf)
        turned = np.isin(kinds, ANGULAR)
        gap, angle = float(np.linalg.norm(C[~turned])), float(np.linalg.norm(C[turned]))
        where = names[rows.start].split(":")[0]
        what = f"stays open by {1e3 * gap:.4g} mm and {np.degrees(angle):.4g} deg"
        found.append((gap / compiled.length + angle, Problem(where, what)))
    found.sort(key=lambda item: -item[0])
    head = Problem(
        "assembly",
        "the initial positions cannot be assembled; the worst joints follow. "
        "Check lengths, placements and axes there, or begin nearer to a closed pose",
    )
    return [head, *(problem for size, problem in found[:_SHOWN] if size > 0)]


def check_branches(compiled: Compiled, model: Model, state: State, work: Work) -> None:
    """Refuse joints whose axes differ, by 120 or 180 deg, though all their rows vanish."""
    solve_level(compiled.system, state, work, RESIDUAL)
    problems = []
    for name, joint in model.joints.items():
        first = next(
            row
            for row, text in zip(compiled.system.rows, compiled.layout.rows, strict=True)
            if text.startswith(f"joints.{name}:")
        )
        Ri, Rj = (work.now.marker[int(first[side])]["R"] for side in ("I", "J"))
        if any(Ri[:, a] @ Rj[:, a] < _SAME for a in signs_of_axes(joint.type)):
            what = "assembles with its sides turned against each other; turn a marker or body"
            problems.append(Problem(f"joints.{name}", what))
    problems += branch_problems(compiled, model, state, work)
    if problems:
        raise AssemblyError.from_problems(problems)
