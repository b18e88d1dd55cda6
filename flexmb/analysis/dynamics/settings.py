"""What the loop is told: method, grid of outputs and steps, tolerances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexmb.engine import method
from flexmb.engine.compile import Compiled
from flexmb.engine.integrators import chosen_method
from flexmb.engine.work import kinds_of
from flexmb.model.tasks.dynamics import ACCURACY, DynamicsSpec

__all__ = ["Steps", "local_tolerance", "loop_settings", "time_grid"]

_MAX_ITERATIONS = 15
_NEWTON = 1e-8  # relative, with fixed steps


@dataclass(frozen=True)
class Steps:
    """The grid of a run: output interval and fixed step [s], 0 for steps by error control."""

    interval: float
    step: float


def time_grid(spec: DynamicsSpec) -> Steps:
    """The largest step not above the one asked for with which all outputs fall on steps."""
    interval = spec.duration / spec.outputs
    if spec.step is None:
        return Steps(interval, 0.0)
    every = max(1, math.ceil(interval / spec.step * (1.0 - 1e-12)))
    return Steps(interval, interval / every)


def local_tolerance(spec: DynamicsSpec) -> float:
    """Local error of a step, over the motion, that leaves the accuracy asked for in the end.

    With a local error of order h³ the steps number h⁻¹, and the error of a method of order 2 is of
    order h², so it is the 2/3 power of the local error; of a method of order 3 the first.
    """
    accuracy, chosen = ACCURACY if spec.accuracy is None else spec.accuracy, chosen_method(spec)
    return float(chosen.tolerance_factor * accuracy**chosen.tolerance_power)


def loop_settings(
    compiled: Compiled, spec: DynamicsSpec, grid: Steps, determined: bool
) -> method.Settings:
    """The numbers of the loop; `determined` if the constraints alone fix the motion."""
    system, kinds = compiled.system, kinds_of(compiled.system)
    works = bool(
        any(kind.works for kind in kinds)
        or np.any(system.rows["fun"] >= 0)
        or np.any(system.parts.bodies["damped"])
    )
    stiff = any(kind.stiff for kind in kinds)
    return method.Settings(
        start=0.0,
        end=spec.duration,
        interval=grid.interval,
        step=grid.step,
        tolerance=0.0 if grid.step else local_tolerance(spec),
        accuracy=ACCURACY if spec.accuracy is None else spec.accuracy,
        order=chosen_method(spec).order,
        newton_tolerance=spec.newton_tolerance or (_NEWTON if grid.step else 0.0),
        max_iterations=_MAX_ITERATIONS,
        works=int(works),
        stiff=int(stiff),
        determined=int(determined),
    )
