"""Table of the times at which functions of time or their derivatives jump."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexmb.model.functions.derivatives import derivative_jumps
from flexmb.model.functions.expression import Expression
from flexmb.model.tasks.dynamics import DynamicsSpec

__all__ = ["time_event_table"]

# Round-off of the times at which functions are evaluated, relative.
_SIDE = 4e-15
# Jumps closer than this share of the run are one.
_ONE = 1e-10


def time_event_table(
    programs: Sequence[Expression], spec: DynamicsSpec | None
) -> NDArray[np.float64]:
    """(n, 2) times [s] just before and just after every jump within the run.

    Empty with fixed steps, which fall where they fall.
    """
    if spec is None or spec.step is not None:
        return np.zeros((0, 2))
    end = spec.duration
    found: list[float] = []
    for t in sorted({t for program in programs for t in derivative_jumps(program.ops, end)}):
        if t - (found[-1] if found else 0.0) > _ONE * end and end - t > _ONE * end:
            found.append(t)
    times = np.array(found)
    return np.column_stack([times * (1.0 - _SIDE), times * (1.0 + _SIDE)])
