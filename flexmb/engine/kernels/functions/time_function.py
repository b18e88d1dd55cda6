"""All functions of time of a system at one time."""

from __future__ import annotations

from flexmb.engine.jit import kernel
from flexmb.engine.kernels.functions.function import evaluate


@kernel
def evaluate_all(functions, t, variables, stack, out):
    """Value and two derivatives at t of every function of time alone, into out (functions, 3)."""
    for k in range(functions.start.shape[0] - 1):
        if functions.live[k] == 0:
            out[k, 0], out[k, 1], out[k, 2] = evaluate(functions, k, t, variables, stack)
