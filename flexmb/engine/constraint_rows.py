"""Constraint rows in one pose, for analyses that look at a mechanism without running it."""

from __future__ import annotations

from flexmb.engine.jit import unit
from flexmb.engine.joints.constraint import constraint_jacobian
from flexmb.engine.kernels.stages import (
    begin_run,
    complete_poses,
    constraint_stage,
    pose_stage,
    walk,
)
from flexmb.engine.state import Run

STAGES = ("constants", "functions", "position", "axes", "constraint")
"""The stages that `evaluate_rows` runs."""


@unit
def evaluate_rows(run: Run) -> int:
    """All markers, C, and the rows of Cq on bodies (Dense.jac) at the time and positions given."""
    at = run.state_point
    begin_run(run, at)
    walk(run.stages.functions, run, at)
    pose_stage(run, at)
    complete_poses(run, at)
    constraint_stage(run, at)
    return constraint_jacobian(run)
