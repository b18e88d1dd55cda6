"""Functions of time and of measured channels, evaluated by one small stack machine.

It runs postfix programs at a time t, with the jets (value and two time derivatives) of variables,
and gives the value and the first and second time derivative of a function. Each row of the stack is
a jet (f, df/dt, d²f/dt²), to which the chain rule is applied: exact to round-off, no allocation.
A partial derivative is the first derivative with the rate of one variable set to 1, less that with
all rates 0. Outside the domain of a function (logarithm of a negative number, division by zero) the
result is not finite; the caller reports it. The readable reference is
``flexmb.model.functions.derivatives``.
Source: Griewank and Walther, Evaluating Derivatives, 2nd ed. (2008), chapter 13.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexmb.engine.jit import Matrix, array_of, kernel, unit
from flexmb.engine.kind import Kind
from flexmb.engine.method import SUCCESS
from flexmb.engine.state import EVENT_FUNCTION, Point, Run
from flexmb.engine.tables import FunctionTable

if TYPE_CHECKING:
    from flexmb.model.functions.expression import Expression

CONST, TIME, NEG, POWC = 0, 1, 2, 3
ADD, SUB, MUL, DIV, POW, ATAN2, MIN, MAX, HYPOT = 4, 5, 6, 7, 8, 9, 10, 11, 12
VAR = 15
SIN, COS, TAN, ASIN, ACOS, ATAN = 20, 21, 22, 23, 24, 25
SINH, COSH, TANH, EXP, LOG, SQRT, ABS, SIGN, CUBICSTEP = 26, 27, 28, 29, 30, 31, 32, 33, 34
QUINTICSTEP, HAVERSINESTEP, CYCLOIDALSTEP, MODIFIEDSINESTEP, PIECEWISE = 35, 36, 37, 38, 40
_UNARY = SIN  # codes from here on are functions of one argument

OPCODES = {
    "const": CONST, "t": TIME, "neg": NEG, "powc": POWC,
    "+": ADD, "-": SUB, "*": MUL, "/": DIV, "pow": POW,
    "atan2": ATAN2, "min": MIN, "max": MAX, "hypot": HYPOT,
    "sin": SIN, "cos": COS, "tan": TAN, "asin": ASIN, "acos": ACOS, "atan": ATAN,
    "sinh": SINH, "cosh": COSH, "tanh": TANH, "exp": EXP, "log": LOG, "sqrt": SQRT,
    "abs": ABS, "sign": SIGN, "cubicstep": CUBICSTEP, "quinticstep": QUINTICSTEP,
    "haversinestep": HAVERSINESTEP, "cycloidalstep": CYCLOIDALSTEP,
    "modifiedsinestep": MODIFIEDSINESTEP, "piecewise": PIECEWISE,
}  # fmt: skip
"""Names of the operations (those of ``flexmb.model.functions.expression``) to their codes here."""


# Number of switches of an operation, arguments at which its formula changes: zero, equal arguments,
# the nearest knot, or both ends of a step. Of hypot both are one, as one vector.
_SWITCH_COUNTS = {ABS: 1, SIGN: 1, MIN: 1, MAX: 1, PIECEWISE: 1, HYPOT: 2, **dict.fromkeys(
    (CUBICSTEP, QUINTICSTEP, HAVERSINESTEP, CYCLOIDALSTEP, MODIFIEDSINESTEP), 2
)}  # fmt: skip
_MAX_CORNERS = 50  # a piecewise polynomial with more corners than this counts as one without
_CHANNEL = "@"  # prefix of the name of a channel that an operation loads


def lower(
    expressions: Sequence[Expression], variables: Mapping[str, int] | None = None,
    moves: bool = False,
) -> FunctionTable:  # fmt: skip
    """Table of the programs of all expressions, in their order.

    Parameters
    ----------
    expressions : sequence of Expression
        One for each function of the system.
    variables : mapping of str to int, optional
        Number of each channel that they name.
    moves : bool
        Whether the variable in place of time depends on the motion, as the measure of a spring.

    Returns
    -------
    FunctionTable
        ops (n,) int32, args (n,) float64, start (k + 1,) int32, depth of the stack, data (m,),
        live (k,) int32, switches (n,) int32.
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
        np.array([n for one in expressions for n in _switches(one, moves)], dtype=np.int32),
    )


def _has_corners(curve: Any) -> bool:
    """Whether all knots but those at the ends are corners, and there are not too many."""
    corners, knots = len(curve.jumps()), len(curve.knots)
    return 0 < corners <= _MAX_CORNERS and corners >= knots - 4  # two at each end


def count_switches(expression: Expression, moves: bool = False) -> int:
    """Number of switches of a program that depend on the motion."""
    return sum(_switches(expression, moves))


def _switches(expression: Expression, moves: bool) -> list[int]:
    """Number of switches of every operation; 0 if its arguments do not depend on the motion."""
    counts, stack = [], list[bool]()
    for op, argument in expression.ops:
        code, places = _code(op), 0
        if code <= TIME or code == VAR:
            stack.append(code == VAR or (moves and code == TIME))
        else:
            moving = stack.pop()
            if ADD <= code <= HYPOT:
                moving |= stack.pop()
            stack.append(moving)
            if moving and (code != PIECEWISE or _has_corners(argument)):
                places = _SWITCH_COUNTS.get(code, 0)
        counts.append(places)
    return counts


def _arguments(
    expressions: Sequence[Expression], variables: Mapping[str, int]
) -> tuple[list[float], np.ndarray]:
    """The argument of every operation, and the data of piecewise polynomials that some point to."""
    args: list[float] = []
    places: dict[Any, int] = {}
    size = 0
    for op, argument in (step for expression in expressions for step in expression.ops):
        if op.startswith(_CHANNEL):
            args.append(float(variables[op.removeprefix(_CHANNEL)]))
        elif op != "piecewise":
            args.append(argument)  # type: ignore[arg-type]
        else:
            if argument not in places:
                places[argument] = size
                size += len(argument.data)  # type: ignore[union-attr]
            args.append(float(places[argument]))
    return args, np.concatenate([*(pieces.data for pieces in places), np.zeros(1)])


def _code(op: str) -> int:
    return VAR if op.startswith(_CHANNEL) else OPCODES[op]


def _depth(expression: Expression) -> int:
    """Rows of stack that a program needs."""
    depth = deepest = 0
    for op, _ in expression.ops:
        code = _code(op)
        depth += 1 if code <= TIME or code == VAR else -1 if ADD <= code <= HYPOT else 0
        deepest = max(deepest, depth)
    return deepest


@kernel
def _trigonometric(op, a):
    """(g, g', g'') at a of the circular functions."""
    if op in (SIN, COS):
        s, c = np.sin(a), np.cos(a)
        return (s, c, -s) if op == SIN else (c, -s, -c)
    if op == TAN:
        f = np.tan(a)
        return f, 1.0 + f * f, 2.0 * f * (1.0 + f * f)
    if op == ATAN:
        w = 1.0 / (1.0 + a * a)
        return np.arctan(a), w, -2.0 * a * w * w
    w = 1.0 - a * a
    r = np.sqrt(w)
    if op == ASIN:
        return np.arcsin(a), 1.0 / r, a / (w * r)
    return np.arccos(a), -1.0 / r, -a / (w * r)


@kernel
def _unary(op, a):
    """(g, g', g'') at a of a function of one argument."""
    if op <= ATAN:
        return _trigonometric(op, a)
    if op in (SINH, COSH):
        s, c = np.sinh(a), np.cosh(a)
        return (s, c, s) if op == SINH else (c, s, c)
    if op == TANH:
        f = np.tanh(a)
        return f, 1.0 - f * f, -2.0 * f * (1.0 - f * f)
    if op == EXP:
        f = np.exp(a)
        return f, f, f
    if op == LOG:
        return np.log(a), 1.0 / a, -1.0 / (a * a)
    if op == SQRT:
        f = np.sqrt(a)
        return f, 0.5 / f, -0.25 / (a * f)
    if op == ABS:
        return np.abs(a), np.sign(a), 0.0
    if op == SIGN:
        return np.sign(a), 0.0, 0.0
    return _step_function(op, a)


@kernel
def _step_function(op, s):
    """(g, g', g'') at s of the functions that rise from 0 at s = 0 to 1 at s = 1."""
    if s <= 0.0:
        return 0.0, 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0, 0.0
    if op == CUBICSTEP:
        return s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s), 6.0 - 12.0 * s
    if op == QUINTICSTEP:
        r = s * (1.0 - s)
        f = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        return f, 30.0 * r * r, 60.0 * r * (1.0 - 2.0 * s)
    if op == HAVERSINESTEP:
        half = np.sin(0.5 * np.pi * s)
        a = np.pi * s
        return half * half, 0.5 * np.pi * np.sin(a), 0.5 * np.pi * np.pi * np.cos(a)
    if op == CYCLOIDALSTEP:
        half, wave = np.sin(np.pi * s), np.sin(2.0 * np.pi * s)
        return s - wave / (2.0 * np.pi), 2.0 * half * half, 2.0 * np.pi * wave
    unit = 1.0 / (4.0 + np.pi)  # MODIFIEDSINESTEP
    if s > 0.125 and s < 0.875:
        a = np.pi * (4.0 * s / 3.0 - 1.0 / 6.0)
        wave, slope = np.cos(a), 1.0 + 3.0 * np.sin(a)
        f = unit * (2.0 + np.pi * s - 2.25 * wave)
        return f, np.pi * unit * slope, 4.0 * np.pi * np.pi * unit * wave
    half, wave = np.sin(2.0 * np.pi * s), np.sin(4.0 * np.pi * s)
    f = unit * (np.pi * s - 0.25 * wave)
    if s > 0.5:
        f += 4.0 * unit
    return f, 2.0 * np.pi * unit * half * half, 4.0 * np.pi * np.pi * unit * wave


@kernel
def _piecewise(data, at, x):
    """(g, g', g'') at x of the piecewise polynomial whose data begin at index `at`."""
    n, p, period = int(data[at]), int(data[at + 1]), data[at + 2]
    at += 3
    if period > 0.0:
        x -= np.floor((x - data[at]) / period) * period
    row, high = 0, n + 1  # the row is the number of knots up to x
    while row < high:
        middle = (row + high) // 2
        if data[at + middle] <= x:
            row = middle + 1
        else:
            high = middle
    u = x - data[at + max(row - 1, 0)]
    at += n + 1 + p * row
    f, f1, f2 = 0.0, 0.0, 0.0
    for k in range(p - 1, -1, -1):
        f2 = f2 * u + f1
        f1 = f1 * u + f
        f = f * u + data[at + k]
    return f, f1, 2.0 * f2


@kernel
def _power(c, a):
    """(g, g', g'') at a of a to the constant power c; finite at a = 0 for natural numbers c."""
    if c == 2.0:
        return a * a, 2.0 * a, 2.0
    second = c * (c - 1.0) * a ** (c - 2.0)
    return a**c, c * a ** (c - 1.0), second


@kernel
def _chain(g, g1, g2, row):
    """Replace the jet a in a stack row by g(a); a rate of zero stays zero where g' is infinite."""
    a1, a2 = row[1], row[2]
    first, second = 0.0, 0.0
    if a1 != 0.0:
        first = g1 * a1
        second = g2 * (a1 * a1)
    if a2 != 0.0:
        second += g1 * a2
    row[0], row[1], row[2] = g, first, second


@kernel
def _hypot(a, b):
    """Replace the jet a by √(a² + b²); the derivatives are taken as zero at a = b = 0."""
    a0, a1, a2 = a[0], a[1], a[2]
    b0, b1, b2 = b[0], b[1], b[2]
    f = np.hypot(a0, b0)
    n = 1.0 / f if f > 0.0 else 0.0
    f1 = (a0 * a1 + b0 * b1) * n
    a[0], a[1] = f, f1
    a[2] = (a1 * a1 + a0 * a2 + b1 * b1 + b0 * b2 - f1 * f1) * n


@kernel
def _binary(op, a, b):
    """Replace the jet a by (a op b)."""
    a0, a1, a2 = a[0], a[1], a[2]
    b0, b1, b2 = b[0], b[1], b[2]
    if op == ADD:
        a[0], a[1], a[2] = a0 + b0, a1 + b1, a2 + b2
    elif op == SUB:
        a[0], a[1], a[2] = a0 - b0, a1 - b1, a2 - b2
    elif op == MUL:
        a[0], a[1], a[2] = a0 * b0, a1 * b0 + a0 * b1, a2 * b0 + 2.0 * a1 * b1 + a0 * b2
    elif op == DIV:
        f = a0 / b0
        f1 = (a1 - f * b1) / b0
        a[0], a[1], a[2] = f, f1, (a2 - 2.0 * f1 * b1 - f * b2) / b0
    elif op == POW:
        f, log, ratio = a0**b0, np.log(a0), a1 / a0
        g1 = b1 * log + b0 * ratio
        g2 = b2 * log + 2.0 * b1 * ratio + b0 * (a2 / a0 - ratio * ratio)
        a[0], a[1], a[2] = f, f * g1, f * (g2 + g1 * g1)
    elif op == ATAN2:  # a is y, b is x
        d = b0 * b0 + a0 * a0
        f1 = (b0 * a1 - a0 * b1) / d
        second = (b0 * a2 - a0 * b2 - 2.0 * f1 * (b0 * b1 + a0 * a1)) / d
        a[0], a[1], a[2] = np.arctan2(a0, b0), f1, second
    elif op == HYPOT:
        _hypot(a, b)
    elif (op == MIN and b0 < a0) or (op == MAX and b0 > a0):
        a[0], a[1], a[2] = b0, b1, b2
    elif b0 == a0:  # a tie of MIN or MAX: the mean of both slopes
        a[1], a[2] = 0.5 * (a1 + b1), 0.5 * (a2 + b2)


@kernel
def evaluate(table, k, t, variables, stack):
    """Value, first and second derivative of function k at time t [s].

    ``variables`` (n, 3) are the jets that the operation VAR loads; ``stack`` is (depth, 3)
    float64 scratch, at least ``table.depth`` rows.
    """
    value = run_program(table, k, t, variables, stack)
    return value, stack[0, 1], stack[0, 2]


@unit
def run_program(table: FunctionTable, k: int, t: float, variables: Matrix, stack: Matrix) -> float:
    """Value of function k at t; it and its derivatives are left in the first row of the stack."""
    begin, end = table.start[k], table.start[k + 1]
    top = -1
    for i in range(begin, end):
        top = _operate(table, i, t, variables, stack, top)
    return stack[0, 0]


@kernel
def _operate(table, i, t, variables, stack, top):
    """Do operation i on the top of the stack; return the index of the new top."""
    op = table.ops[i]
    if op <= TIME:
        top += 1
        stack[top, 0] = t if op == TIME else table.args[i]
        stack[top, 1] = 1.0 if op == TIME else 0.0
        stack[top, 2] = 0.0
    elif op == VAR:
        top += 1
        x = variables[int(table.args[i])]
        stack[top, 0], stack[top, 1], stack[top, 2] = x[0], x[1], x[2]
    elif op == NEG:
        stack[top, 0], stack[top, 1], stack[top, 2] = (
            -stack[top, 0],
            -stack[top, 1],
            -stack[top, 2],
        )
    elif op == POWC:
        g, g1, g2 = _power(table.args[i], stack[top, 0])
        _chain(g, g1, g2, stack[top])
    elif op == PIECEWISE:
        g, g1, g2 = _piecewise(table.data, int(table.args[i]), stack[top, 0])
        _chain(g, g1, g2, stack[top])
    elif op >= _UNARY:
        g, g1, g2 = _unary(op, stack[top, 0])
        _chain(g, g1, g2, stack[top])
    else:
        top -= 1
        _binary(op, stack[top], stack[top + 1])
    return top


@unit
def put_switches(
    table: FunctionTable, k: int, t: float, variables: Matrix, stack: Matrix,
    events: array_of(EVENT_FUNCTION), n: int,
) -> int:  # fmt: skip
    """Put event functions of program k, zero at its switches, into events from n on.

    Returns the index after the last one.
    """
    top = -1
    for i in range(table.start[k], table.start[k + 1]):
        op, places = table.ops[i], table.switches[i]
        if places > 0:
            a = stack[top, 0]
            if op in (MIN, MAX):
                a = stack[top - 1, 0] - a
            elif op == PIECEWISE:
                a = _distance_from_knot(table.data, int(table.args[i]), a)
            events[n]["value"] = stack[top - 1, 0] if op == HYPOT else a
            if places == 2:
                events[n + 1]["value"] = a if op == HYPOT else a - 1.0
            for m in range(n, n + places):
                events[m]["rate"], events[m]["of_law"] = math.nan, 2.0 if op == SIGN else 1.0
                if op == HYPOT:
                    events[m]["of_law"] = 3.0 + (m - n)
            n += places
        top = _operate(table, i, t, variables, stack, top)
    return n


@kernel
def _distance_from_knot(data, at, x):
    """Distance of x from the nearest knot; its sign alternates from interval to interval."""
    n, period = int(data[at]), data[at + 2]
    first = at + 3
    if period > 0.0:
        x -= np.floor((x - data[first]) / period) * period
    row = 0
    while row < n and data[first + row] <= x:
        row += 1
    before = x - data[first + row - 1] if row > 0 else math.inf
    behind = data[first + row] - x if row < n else math.inf
    away = min(before, behind)
    return away if row % 2 == 0 else -away


class TimeFunctions(NamedTuple):
    """Functions of time alone (`System.functions`)."""


@unit
def evaluate_functions(run: Run, of: TimeFunctions, at: Point) -> int:
    """Value and two derivatives at t of every function of time alone, into Constraints.fun."""
    table, out, stack = run.system.functions, run.work.con.fun, run.work.trial.stack
    variables, start, ops = run.work.trial.variables, table.start, table.ops
    for k in range(start.shape[0] - 1):
        if table.live[k] == 0:
            first = start[k]
            if start[k + 1] - first == 1 and ops[first] == CONST:
                out[k, 0], out[k, 1], out[k, 2] = table.args[first], 0.0, 0.0
            else:
                out[k, 0] = run_program(table, k, at.t[0], variables, stack)
                out[k, 1], out[k, 2] = stack[0, 1], stack[0, 2]
    return SUCCESS


TIME_FUNCTIONS = Kind("time_functions", TimeFunctions, {"functions": evaluate_functions})
