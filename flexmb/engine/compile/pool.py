"""The pool of numbers whose size depends on the number of modes, and the functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmb.model.functions.expression import Expression, Ops


@dataclass
class Pool:
    """Grows while the tables are built; every block is remembered by its offset."""

    blocks: list[NDArray[np.float64]] = field(default_factory=list)
    size: int = 0

    def add(self, values: ArrayLike) -> int:
        """Append the values, row by row; returns their offset."""
        flat = np.ascontiguousarray(values, dtype=np.float64).ravel()
        offset = self.size
        self.blocks.append(flat)
        self.size += flat.size
        return offset

    def array(self) -> NDArray[np.float64]:
        """All blocks in one array (at least one number, so that it has an address)."""
        return np.concatenate([*self.blocks, np.zeros(1)])


@dataclass
class Functions:
    """Functions of time and of channels by index; equal programs share one.

    `resolve` puts in what stands behind the names of channels.
    """

    resolve: Callable[[Expression], Expression]
    programs: list[Expression] = field(default_factory=list)
    _known: dict[Ops, int] = field(default_factory=dict)

    def add(self, expression: Expression) -> int:
        """Index of a function as the scene gives it."""
        return self.put(self.resolve(expression))

    def put(self, expression: Expression) -> int:
        """Index of a function over measured channels and states in SI."""
        k = self._known.setdefault(expression.ops, len(self.programs))
        if k == len(self.programs):
            self.programs.append(expression)
        return k
