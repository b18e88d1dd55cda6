"""Statics: equilibria of a model, one, a series over time, or all that can be reached.

In: a compiled model. Out: equilibria with their reactions, as rows of a result, and their
stability.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmb.analysis.assembly.initial_state import StartValues, assemble
from flexmb.analysis.equilibrium import settle
from flexmb.analysis.linear.linearization import Linearization, linearize_state
from flexmb.analysis.linear.state_equations import Array
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State
from flexmb.model.model import Model


@dataclass(frozen=True)
class Equilibrium:
    """An equilibrium of a model.

    Attributes
    ----------
    state : State
        Positions q and multipliers λ; v and v̇ are zero. SI.
    steps : int
        How many it took.
    """

    compiled: Compiled
    model: Model
    state: State
    steps: int

    def linearize(self) -> Linearization:
        """The equations of motion linearised about it; `stable` says whether it is stable."""
        return linearize_state(self.compiled, self.model, self.state, frame="ground")


def find_equilibrium(
    compiled: Compiled, model: Model, *, time: float = 0.0, start: Array | None = None
) -> Equilibrium:
    """The equilibrium that a model settles in from a pose.

    Parameters
    ----------
    compiled, model : Compiled, Model
        The model.
    time : float
        At which functions and drivers are taken [s].
    start : (nq,) array, optional
        Where to begin; by default where the scene places the bodies.

    Raises
    ------
    AssemblyError
        Positions that cannot be closed; no equilibrium, with what moves on and under which force.
    """
    q = compiled.initial_q if start is None else start
    begin = StartValues(q, np.zeros(compiled.layout.nv), time)
    if start is None and time == 0.0:
        state = assemble(compiled, model).state
    else:
        state = assemble(compiled, model, begin=begin).state
    steps = settle(compiled, model, state)
    return Equilibrium(compiled, model, state, steps)
