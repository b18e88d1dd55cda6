"""What one unit of a function does: the generalised force that feedback acts through."""

from __future__ import annotations

from flexmb.engine.bodies.wrench import add_pulled_back
from flexmb.engine.jit import unit
from flexmb.engine.method import FINE
from flexmb.engine.state import Run


@unit
def pull_back(run: Run, k: int, first: int) -> int:
    """feedback.left = Jᵀ w of marker k, w the six numbers of dense.g[1] from `first` on.

    The first velocity coordinate of its body and how many it has go into feedback.block.
    """
    parts, work = run.system.parts, run.work
    left, block = work.feedback.left, work.feedback.block
    body = parts.bodies[parts.markers[k]["body"]]
    n = 6 + body["m"]
    for c in range(n):
        left[c] = 0.0
    add_pulled_back(parts, work.now, k, work.dense.g[1], first, 1.0, left, 0)
    block[0], block[1] = body["iv"], n
    return FINE
