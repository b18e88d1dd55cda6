"""Lower functions of time and of channels to the flat table that the kernel reads.

In: expressions of the model (postfix pairs of operation and argument). Out: a
:class:`FunctionTable`, whose programs
:func:`flexmb.engine.kernels.functions.function.evaluate` runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from flexmb.engine.kernels.functions.function import ADD, HYPOT, OPCODES, TIME, VAR, FunctionTable
from flexmb.model.functions.expression import Expression, channel_of
from flexmb.model.functions.piecewise import Piecewise

__all__ = ["FunctionTable", "lower", "stack_for"]


def lower(
    expressions: Sequence[Expression], variables: Mapping[str, int] | None = None
) -> FunctionTable:
    """Table of the programs of all expressions, in their order.

    Parameters
    ----------
    expressions : sequence of Expression
        One for each function of the system.
    variables : mapping of str to int, optional
        Number of each channel that they name.

    Returns
    -------
    FunctionTable
        ops (n,) int32, args (n,) float64, start (k + 1,) int32, depth of the stack, data (m,),
        live (k,) int32.
    """
    ops = [_code(op) for expression in expressions for op, _ in expression.ops]
    args, data = _arguments(expressions, variables or {})
    lengths = [len(expression.ops) for expression in expressions]
    start = np.concatenate([[0], np.cumsum(lengths, dtype=np.int64)])
    depth = max((_depth(expression) for expression in expressions), default=1)
    return FunctionTable(
        np.array(ops, dtype=np.int32),
        np.array(args, dtype=np.float64),
        start.astype(np.int32),
        depth,
        data,
        np.array([bool(expression.channels) for expression in expressions], dtype=np.int32),
    )


def _arguments(
    expressions: Sequence[Expression], variables: Mapping[str, int]
) -> tuple[list[float], np.ndarray]:
    """The argument of every operation, and the piecewise polynomials that some are places of."""
    args: list[float] = []
    places: dict[Piecewise, int] = {}
    size = 0
    for op, argument in (step for expression in expressions for step in expression.ops):
        if channel_of(op):
            args.append(float(variables[channel_of(op)]))
            continue
        if not isinstance(argument, Piecewise):
            args.append(argument)
            continue
        if argument not in places:
            places[argument] = size
            size += len(argument.data)
        args.append(float(places[argument]))
    return args, np.concatenate([*(pieces.data for pieces in places), np.zeros(1)])


def stack_for(table: FunctionTable) -> np.ndarray:
    """(depth, 3) scratch for evaluating any function of the table."""
    return np.full((table.depth, 3), np.nan)


def _code(op: str) -> int:
    return VAR if channel_of(op) else OPCODES[op]


def _depth(expression: Expression) -> int:
    depth = deepest = 0
    for op, _ in expression.ops:
        code = _code(op)
        depth += 1 if code <= TIME or code == VAR else -1 if ADD <= code <= HYPOT else 0
        deepest = max(deepest, depth)
    return deepest
