"""What a kinematic analysis is asked for, and what it carries from point to point."""

from __future__ import annotations

from typing import NamedTuple

from flexmb.engine.records import Integers, Matrix, Vector

# Places in Path.memory: the increment to try next, motion since the factor (< 0: none of use),
# largest of the least pivots so far.
NEXT, MOVED, PIVOT = 0, 1, 2
# Places in Path.count.
ITERATIONS, FACTORISATIONS, SINGULAR_POSES = 0, 1, 2


class KinematicsSettings(NamedTuple):
    """What a kinematic analysis is asked for."""

    start: float  # s
    interval: float  # between points, s
    outputs: int  # intervals
    gap: float  # gap of the constraints that is round-off, weighted
    redundant: int  # rows that repeat others


class Path(NamedTuple):
    """Memory of a kinematic analysis, from point to point."""

    metric: Vector  # (nv,) W
    probe: Vector  # (nc,) right side whose solution shows singular poses
    direction_before: Vector  # (nv,) that solution at the last point
    direction: Vector  # (nv,) and at the trial point
    jerk: Vector  # (nv,) last difference of v̇
    correction: Vector  # (nv,) of the prediction
    functions_before: Matrix  # (functions, 3) functions at the last point
    powers: Matrix  # (4, 3) powers at the last outputs, newest first
    memory: Vector  # (3,) NEXT, MOVED, PIVOT
    singular_times: Matrix  # (8, 2) times before and after a singular pose
    singular_positions: Matrix  # (8, nq) positions there
    count: Integers  # (3,) Newton iterations, factorisations, singular poses passed
