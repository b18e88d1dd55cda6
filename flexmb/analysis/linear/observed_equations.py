"""The linearised equations of a state as an observer sees them: M ÿ + D ẏ + K y = Nᵀ f.

In: derivatives of the equations in all coordinates, an observer. Out: matrices of the independent
coordinates, with the rates of change of what the joints allow.
"""

from __future__ import annotations

import numpy as np

from flexmb.analysis.linear.observer import (
    Coordinates,
    Observer,
    change_of_coordinates,
    in_axes_of,
)
from flexmb.analysis.linear.state_equations import Array, Tangents
from flexmb.engine.compile import Compiled
from flexmb.engine.state import State

_AXES = ("x", "y", "z")


class SeenEquations:
    """The equations of a state as an observer sees them: M ÿ + D ẏ + K y = 0 for y.

    `at` are the matrices for x (`observer`), `left` (nv, n) what no multiplier loads.
    """

    def __init__(self, compiled: Compiled, state: State, tangents: Tangents, name: str) -> None:
        self.compiled, self.state = compiled, state
        self.observer = Observer.at(compiled, state, name)
        self.change = change_of_coordinates(self.observer, compiled, state)
        self.at = at = in_axes_of(self.change, tangents)
        self.coordinates = c = Coordinates(compiled, state, self.observer)
        self.left = left = _left_null(at, c)
        self.mass = left.T @ at.M @ c.N
        self.damping = left.T @ (at.D @ c.N + 2.0 * at.M @ c.Nd)
        self.stiffness = left.T @ (at.K @ c.N + at.D @ c.Nd + at.M @ c.Ndd)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the independent coordinates."""
        names = _coordinate_names(self.compiled)
        return tuple(names[k] for k in self.coordinates.index)

    @property
    def slowest(self) -> float:
        """A rate, 1/s, not above that of the slowest vibration; 0 with rigid motions."""
        try:
            squared = np.trace(np.linalg.solve(self.stiffness, self.mass))
        except np.linalg.LinAlgError:
            return 0.0
        return float(1.0 / np.sqrt(abs(squared))) if np.isfinite(squared) and squared else 0.0

    def difference(self, later: SeenEquations, rate: float) -> float:
        """Largest change of a coefficient, over what compares with it at a rate, 1/s."""
        if not np.array_equal(self.coordinates.index, later.coordinates.index):
            return np.inf
        size = np.sqrt(np.abs(np.diag(self.mass)))
        size = np.outer(size, size)
        changes = [0.0]
        for power, word in enumerate(("mass", "damping", "stiffness")):
            one, other = getattr(self, word), getattr(later, word)
            near = np.maximum(size * rate**power, np.abs(one))
            changes.append(
                float((np.abs(other - one) / np.where(near > 0, near, 1)).max(initial=0))
            )
        return max(changes)


def _left_null(at: Tangents, c: Coordinates) -> Array:
    """(nv, n): what the multipliers do not load; N but where friction follows reactions."""
    extra = at.L - at.Cq.T
    if not extra.size or np.abs(extra).max() <= 1e-12 * np.abs(at.Cq).max(initial=0.0):
        return c.N
    dependent = np.setdiff1d(np.arange(len(c.N)), c.index)
    wanted = at.L.T @ c.N
    change = np.linalg.lstsq(at.L[dependent].T, -wanted, rcond=1e-10)[0]
    Y = c.N.copy()
    Y[dependent] += change
    return Y


def _coordinate_names(compiled: Compiled) -> list[str]:
    """Names of all velocity coordinates."""
    names = []
    for body in compiled.layout.bodies:
        names += [f"{body.name}.r.{a}" for a in _AXES] + [
            f"{body.name}.rotation.{a}" for a in _AXES
        ]
        names += [f"{body.name}.eta.{k}" for k in range(body.m)]
    return [*names, *compiled.layout.coordinates]
