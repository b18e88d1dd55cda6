"""What a run cannot vouch for, of flexible bodies: warnings, and bounds beyond which it stops.

Monitors take the rows of a run in order and give indicators: one number for each body and limit,
with the moment at which it was largest. Above its warning level an indicator is a note of the run,
above the bound of `[validity]` the run is refused, at the moment when that is certain. The audit of
effects reads the same indicators.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmb.analysis.dynamics.linear_elasticity import (
    LinearElasticityMonitor,
    loads_without_stiffening,
)
from flexmb.analysis.dynamics.load_factor import LoadFactorMonitor
from flexmb.analysis.dynamics.modal_basis import ModalBasisMonitor
from flexmb.analysis.dynamics.omitted_vibrations import OmittedVibrationMonitor
from flexmb.analysis.monitors import Indicator, Monitor
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.model.model import Model
from flexmb.model.scenes.dynamics import ValiditySpec
from flexmb.results import OutputBlock


class ValidityMonitor:
    """The warnings of a run, and the sentence with which it is refused.

    Parameters
    ----------
    compiled, model : Compiled, Model
        What is run.
    q : (nq,) array
        First positions.
    is_motion : bool
        Whether the rows are a motion, and not equilibria of their own.
    """

    def __init__(
        self, compiled: Compiled, model: Model, q: NDArray[np.float64], is_motion: bool = True
    ) -> None:
        self._spec = model.validity or ValiditySpec()
        self._elasticity = LinearElasticityMonitor(compiled, model, q)
        self._basis = ModalBasisMonitor(compiled, model, is_motion)
        self._load_factor = LoadFactorMonitor(compiled, model, q)
        self._monitors: tuple[Monitor, ...] = ()  # all are of flexible bodies
        if compiled.system.parts.bodies["m"].any():
            self._monitors = (
                self._elasticity,
                self._load_factor,
                self._basis,
                *((OmittedVibrationMonitor(compiled, model, q),) if is_motion else ()),
            )
        self._notes = tuple(loads_without_stiffening(compiled, model))

    def add(self, rows: OutputBlock) -> int:
        """Take the next rows; returns how many, up to that with which the run is refused."""
        n, before = len(rows.t), [_arrays(monitor) for monitor in self._monitors]

        def refused(k: int) -> bool:
            for monitor, arrays in zip(self._monitors, before, strict=True):
                vars(monitor).update(deepcopy(arrays))
                monitor.add(rows.part(0, k))
            return bool(self.refusal())

        if not n or not refused(n):
            return n
        last = bisect_left(range(1, n), True, key=refused) + 1
        refused(last)
        return last

    def indicators(self) -> Iterator[Indicator]:
        """Those of all bodies, below their warning level too."""
        for monitor in self._monitors:
            yield from monitor.indicators()

    @property
    def beyond(self) -> dict[str, str]:
        """A sentence on each body that is driven faster than its omitted modes are known."""
        return self._basis.beyond

    def notes(self) -> Iterator[str]:
        """A sentence for each body and limit that was left."""
        yield from self._notes
        yield from self._basis.notes()
        for one in self.indicators():
            if one.value > one.warning:
                yield one.text()

    def diverging(self, state: State) -> str:
        """The sentence for a body whose equations lose all stiffness, or "".

        By its rotation without stiffening or by loads that buckle it, up to the state in which a
        run ends.
        """
        none = np.zeros((1, 0))
        motion = (state.q, state.v, state.vd, state.lam)
        if all(np.isfinite(one).all() for one in motion):
            last = OutputBlock(state.t[:1].copy(), *(one[None] for one in motion), *[none] * 4)
            self._elasticity.add(last)
            self._load_factor.add_last(last)
        return self._elasticity.diverging() or self._load_factor.diverging()

    def refusal(self) -> str:
        """The sentence for the first bound that was passed, or ""."""
        for one in self.indicators():
            bound = getattr(self._spec, one.quantity, "any")
            if not isinstance(bound, str) and one.value > bound:
                way_on = f'{one.quantity} = "any" under [validity] runs on'
                buckled = self._load_factor.diverging()
                cause = (
                    f"{one.text()}; {buckled}" if buckled != one.text() and buckled else one.text()
                )
                return f"{cause} (bound {bound:g}; {way_on})"
        return ""


def _arrays(monitor: Monitor) -> dict[str, Any]:
    """What a monitor has gathered: its arrays."""
    return {name: value for name, value in vars(monitor).items() if isinstance(value, np.ndarray)}
