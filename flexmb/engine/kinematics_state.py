"""What a kinematic analysis is asked for, and what it carries from point to point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexmb.engine.records import Matrix, Vector, array_of

#: Memory of a kinematic analysis, from point to point.
PATH_MEMORY = np.dtype([
    ("next_increment", "f8"),  # to try next, s
    ("motion_since_factor", "f8"),  # < 0: the factor is of no use
    ("largest_pivot", "f8"),  # of the least ones so far
])  # fmt: skip

#: What it has done so far.
PATH_COUNTERS = np.dtype([("iterations", "i8"), ("factorisations", "i8"), ("singular_poses", "i8")])


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
    memory: array_of(PATH_MEMORY)  # (1,)
    singular_times: Matrix  # (8, 2) times before and after a singular pose
    singular_positions: Matrix  # (8, nq) positions there
    count: array_of(PATH_COUNTERS)  # (1,)
