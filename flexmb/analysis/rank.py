"""Whether the constraints alone fix the motion, so that no free coordinate is left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmb.engine.compile import Compiled
from flexmb.engine.work import Work

# Dense rank is affordable up to this many coordinates; larger models are taken as free, which only
# costs digits of the reported reactions.
_LARGEST = 600
_RANK = 1e-8  # relative to the largest singular value; round-off leaves 1e-13


def dense_jacobian(compiled: Compiled, work: Work) -> NDArray[np.float64]:
    """Cq (nc, nv) from the Jacobian rows of the last factorisation."""
    system = compiled.system
    Cq = np.zeros((compiled.layout.nc, compiled.layout.nv))
    for k, row in enumerate(system.rows):
        for side, place in (("I", "jac_I"), ("J", "jac_J")):
            if row[place] >= 0:
                body = system.parts.bodies[system.parts.markers[row[side]]["body"]]
                n = 6 + int(body["m"])
                values = work.dense.jac[row[place] : row[place] + n]
                Cq[k, body["iv"] : body["iv"] + n] = values
    return Cq


def motion_is_determined(compiled: Compiled, work: Work) -> bool:
    """True if the rows of Cq at the first state span all velocity coordinates."""
    nc, nv = compiled.layout.nc, compiled.layout.nv
    if nc < nv or nv > _LARGEST:
        return False
    values = np.linalg.svd(dense_jacobian(compiled, work), compute_uv=False)
    return int(np.sum(values > _RANK * values[0])) == nv
