"""The linearised equations of a state as an observer sees them: M ÿ + D ẏ + K y = Nᵀ f.

In: derivatives of the equations in all coordinates, an observer. Out: matrices of the independent
coordinates, with the rates of change of what the joints allow.
"""

from __future__ import annotations

import numpy as np

from flexmb.analysis.linear.observer import (
    Coordinates,
    Observer,
    Partition,
    RowsAlongMotion,
    change_of_coordinates,
    in_axes_of,
)
from flexmb.analysis.linear.state_equations import Array, Tangents
from flexmb.engine.compile import Compiled

_AXES = ("x", "y", "z")


class SeenEquations:
    """The equations of a state as an observer sees them: M ÿ + D ẏ + K y = 0 for y.

    `at` are the matrices for x (`observer`), `left` (nv, n) what no multiplier loads.
    """

    def __init__(
        self,
        along: RowsAlongMotion,
        tangents: Tangents,
        name: str,
        partition: Partition | None = None,
    ) -> None:
        self.compiled, self.state = compiled, state = along.compiled, along.state
        self.observer = Observer.at(compiled, state, name)
        self.change = change_of_coordinates(self.observer, compiled, state)
        self.at = at = in_axes_of(self.change, tangents)
        self.coordinates = c = Coordinates(along, self.observer, partition)
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
    def depends_on_observer(self) -> bool:
        """Whether independent coordinates have axes: translations or rotations of bodies."""
        return any(".r." in name or ".rotation." in name for name in self.names)

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
        mass, stiffness = (np.sqrt(np.abs(np.diag(M))) for M in (self.mass, self.stiffness))
        rates = np.maximum(stiffness, rate * mass)  # of each coordinate by itself, times its mass
        changes = [0.0]
        for word, one_side in (("mass", (mass, mass)), ("damping", (rates, mass)),
                               ("stiffness", (rates, rates))):  # fmt: skip
            one, other = getattr(self, word), getattr(later, word)
            near = np.maximum(np.outer(*one_side), np.abs(one))
            gap = np.abs(other - one) / np.where(near > 0.0, near, 1.0)
            changes.append(float(gap.max(initial=0.0)))
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
