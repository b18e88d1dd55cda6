"""Constraint rows in one pose, for analyses that look at a mechanism without running it."""

from __future__ import annotations

from flexmb.engine.jit import unit
from flexmb.engine.kernels.joints.constraint import constraint_jacobian, evaluate_constraints
from flexmb.engine.kernels.stages import begin_run, complete_poses, pose_stage, walk
from flexmb.engine.state import Run

STAGES = ("constants", "functions", "position", "axes")
"""The stages that `evaluate_rows` runs."""


@unit
def evaluate_rows(run: Run) -> int:
    """All markers, C, and the rows of Cq on bodies (Dense.jac) at the time and positions given."""
    at = run.state_point
    begin_run(run, at)
    walk(run.stages.functions, run, at)
    pose_stage(run, at)
    complete_poses(run, at)
    evaluate_constraints(run)
    return constraint_jacobian(run)
