"""Plain numbers of a motion that say which effects of a flexible body may matter.

In: rows of a motion, a body and its modes as it is joined. Out: deflection over the length, the
speed of rotation over the lowest frequency, and how fast the accelerations change against that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.assembly.jacobian import ConstraintRows
from flexmb.analysis.dynamics.linear_elasticity import joined_modes
from flexmb.analysis.effects.perturbation import Motion
from flexmb.engine.bodies.flexible_body import modal_reach
from flexmb.engine.compile import Compiled
from flexmb.flexbody import FlexBody

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Indicators:
    """Of one body along a motion.

    Attributes
    ----------
    frequency : float
        Lowest of the body as it is joined [Hz].
    deflection : float
        Largest displacement by deformation over the length of the body.
    speed : float
        Largest angular velocity over the lowest angular frequency.
    excitation : float
        Frequency of the rigid accelerations, weighted by their energy, over the lowest one.
    """

    frequency: float
    deflection: float
    speed: float
    excitation: float


def indicators(compiled: Compiled, motion: Motion, body: FlexBody, name: str) -> Indicators:
    """The indicators of a body of a compiled model along a motion."""
    columns = next(one for one in compiled.layout.bodies if one.name == name)
    rows = ConstraintRows(compiled).evaluate(motion.q[0])
    lowest = joined_modes(body, columns, motion.q[0], rows.Cq)[0].min(initial=np.inf)
    iv, iq = columns.iv, columns.iq + 7
    eta = motion.q[:, iq : iq + body.m]
    size = body.characteristic_length
    moved = float((np.abs(eta) @ modal_reach(body)).max(initial=0.0))
    speed = float(np.linalg.norm(motion.v[:, iv + 3 : iv + 6], axis=1).max())
    rigid = motion.vd[:, iv : iv + 6] * np.repeat([1.0, size], 3)
    change = np.gradient(rigid, motion.t, axis=0)
    total = float(np.sqrt((rigid**2).sum()))
    fast = float(np.sqrt((change**2).sum())) / total if total > 0.0 else 0.0
    return Indicators(
        lowest / (2 * np.pi), moved / size if size > 0.0 else 0.0, speed / lowest, fast / lowest
    )
