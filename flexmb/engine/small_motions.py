"""The equations of motion at one state: residual, channels, and the matrices of small motions.

With F(q, v, v̇, λ) the inertia, applied and constraint forces on the left side, small motions δ
about a state obey M δv̇ + ∂F/∂v δv + ∂F/∂q δq + Cqᵀ δλ = −F and Cq δq = −C.
"""

from __future__ import annotations

from flexmb.engine.equations_of_motion import (
    begin_run,
    bias_stage,
    complete_poses,
    energies,
    put_matrix,
    put_rows,
    residual,
    velocity_stage,
)
from flexmb.engine.jit import Vector, unit
from flexmb.engine.sensors.sensor import count_turns, read_channels
from flexmb.engine.state import Run


@unit
def evaluate_equations(run: Run, channels: Vector) -> int:
    """Trial.res, Constraints.C and all channels at the state, v̇ and λ as they are; the status."""
    at, st = run.state_point, run.state
    begin_run(run, at)
    status = residual(run, at)
    velocity_stage(run, at)
    bias_stage(run, at)
    complete_poses(run, at)
    energies(run, at)
    count_turns(run, at, st.angles)
    read_channels(run, at, st.angles, channels)
    return status


@unit
def matrix_at_state(run: Run, cv: float, cp: float) -> int:
    """M + cv ∂F/∂v + cp ∂F/∂q and Cq into the panels, after `evaluate_equations`."""
    run.work.factor.symmetric[0] = 0
    put_matrix(run, run.state_point, cv, cp)
    return put_rows(run, run.state_point, 0.0, 0.0)
