"""Expressions such as ``"2*pi*25"`` or ``"r*sin(speed*t)"``, parsed without ever being executed.

In: a text and the values of the names it may use. Out: an immutable :class:`Expression`, a postfix
program over time and, where allowed, over measured channels such as ``slider.x``; its constant
parts are folded. The text is parsed by Python's own parser, and only white-listed nodes are
accepted. A mistake raises a :class:`SceneError` that shows the expression with a caret under the
wrong character.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flexmb.errors import Problem, SceneError, nearest
from flexmb.model.functions.derivatives import Jet, evaluate
from flexmb.units import UNITS

_WINDOW = 60  # characters of a long text shown on either side of a mistake
# characters; a longer text is no formula, and might exceed limits of Python's parser
MAX_LENGTH = 2000


def syntax_tree(text: str) -> ast.expr:
    flat = text.replace("\n", " ").replace("\r", " ").replace("\t", " ")
    body = flat.lstrip()
    lead = len(flat) - len(body)
    if not body:
        raise mistake(text, 0, "the expression is empty")
    if len(body) > MAX_LENGTH:
        raise mistake(text, 0, f"the expression is longer than {MAX_LENGTH} characters")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(body, mode="eval").body
    except SyntaxError as error:
        column = max((error.offset or 1) - 1, 0) + lead
        raise mistake(text, column, f"syntax error: {_reason(error, text)}") from None
    except (ValueError, RecursionError, MemoryError):
        raise mistake(text, lead, "no expression that can be read") from None


def unknown_channel(text: str, name: str, names: tuple[str, ...]) -> Problem:
    """The problem of a name in an expression that is neither a parameter nor a channel."""
    match = re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", text)
    column = match.start() if match else 0
    return mistake(text, column, f'unknown name "{name}"', names, name).problems[0]


def _reason(error: SyntaxError, text: str) -> str:
    """The parser's message in terms of a formula."""
    if any(word in UNITS for word in re.findall(r"\d\s+(?!t\b)([A-Za-z]+)", text)):
        return "a number with a unit stands alone, so make it a parameter and write its name"
    if re.search(r"\bif\b", text, re.IGNORECASE):
        return 'there is no "if"; step, sign, min, max and points of a table change a law'
    message = (error.msg or "").removesuffix(" (<unknown>, line 1)")
    if "Perhaps you forgot a comma" in message or message.startswith("invalid decimal literal"):
        return "two values with no operator between them"
    if message in ("invalid syntax", "unexpected EOF while parsing", ""):
        return "a value or an operator is missing or out of place here"
    return message


def mistake(
    text: str, column: int, what: str, names: tuple[str, ...] = (), name: str = ""
) -> SceneError:
    flat = text.replace("\n", " ").replace("\r", " ").replace("\t", " ")
    column = min(column, len(flat))
    begin = max(0, column - _WINDOW)
    shown = flat[begin : column + _WINDOW]
    caret = " " * (column - begin)
    where = f"{what} at character {column + 1}\n    {shown}\n    {caret}^"
    near = nearest(name, names) if name else ()
    return SceneError.from_problems([Problem("", where, names, near)])


CONSTANTS: dict[str, float] = {"pi": math.pi, "e": math.e, "deg": math.pi / 180}
FUNCTIONS: dict[str, tuple[int, str]] = {
    "sin": (1, "sin(x)"),
    "cos": (1, "cos(x)"),
    "tan": (1, "tan(x)"),
    "asin": (1, "asin(x)"),
    "acos": (1, "acos(x)"),
    "atan": (1, "atan(x)"),
    "atan2": (2, "atan2(y, x)"),
    "sinh": (1, "sinh(x)"),
    "cosh": (1, "cosh(x)"),
    "tanh": (1, "tanh(x)"),
    "exp": (1, "exp(x)"),
    "log": (1, "log(x), natural"),
    "sqrt": (1, "sqrt(x)"),
    "abs": (1, "abs(x)"),
    "sign": (1, "sign(x)"),
    "min": (2, "min(a, b)"),
    "max": (2, "max(a, b)"),
    "hypot": (2, "hypot(a, b), the root of a**2 + b**2"),
    "step": (5, "step(x, x0, y0, x1, y1): y0 before x0, y1 after x1, a cubic between"),
    "step5": (5, "step5(x, x0, y0, x1, y1), a quintic"),
    "havsin": (5, "havsin(x, x0, y0, x1, y1), half a wave of a cosine"),
    "cycloidal": (5, "cycloidal(x, x0, y0, x1, y1), a cycloid"),
    "modsine": (5, "modsine(x, x0, y0, x1, y1), a modified sine"),
}
"""Functions an expression may call: number of arguments and how they are written."""

RISES = {
    "step": "cubicstep",
    "step5": "quinticstep",
    "havsin": "haversinestep",
    "cycloidal": "cycloidalstep",
    "modsine": "modifiedsinestep",
}
"""Functions that rise from y0 at x0 to y1 at x1, and their operation, which rises from 0 to 1."""

Ops = tuple[tuple[str, Any], ...]
"""Pairs (operation, argument); the argument is a number, or a `Piecewise` for "piecewise"."""

_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}


@dataclass(frozen=True)
class Expression:
    """A postfix program: ``ops`` holds pairs (operation, argument); ``@name`` loads a channel."""

    text: str
    ops: Ops

    @property
    def constant(self) -> float | None:
        """The value if it does not depend on time, else None."""
        return self.ops[0][1] if len(self.ops) == 1 and self.ops[0][0] == "const" else None

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels used by the program, each once."""
        return tuple(dict.fromkeys(channel_of(op) for op, _ in self.ops if channel_of(op)))

    def value(self, t: float, variables: Mapping[str, Jet] | None = None) -> Jet:
        """Value, first and second derivative at time ``t`` [s]; not finite outside its domain."""
        return evaluate(self.ops, t, variables)


def rescaled(ops: Ops, x: float, y: float) -> Ops:
    """A program with its variable divided by x and its value multiplied by y: a change of units."""
    if len(ops) == 1 and ops[0][0] == "const":
        return (("const", ops[0][1] * y),)
    if x != 1.0:
        variable: Ops = (("t", 0.0), ("const", x), ("/", 0.0))
        ops = tuple(step for op in ops for step in (variable if op[0] == "t" else (op,)))
    return ops if y == 1.0 else (*ops, ("const", y), ("*", 0.0))


def channel_of(op: str) -> str:
    """The channel that an operation loads; empty for all other operations."""
    return op[1:] if op.startswith("@") else ""


def parse(
    text: str,
    names: Mapping[str, float] | None = None,
    *,
    time: bool = True,
    variable: str = "t",
    channels: bool = False,
) -> Expression:
    """Parse an expression.

    Parameters
    ----------
    text : str
        The expression.
    names : mapping
        Values of the parameters it may use.
    time : bool
        Whether the variable may occur.
    variable : str
        Name of the variable, in place of the time.
    channels : bool
        Whether names that are not parameters are channels (checked once all channels are known).

    Raises
    ------
    SceneError
        One problem, with the text and a caret under the character that is wrong.
    """
    return Expression(text, _Lowering(text, dict(names or {}), time, channels, variable).run())


def names_in(text: str) -> tuple[str, ...]:
    """The names used in an expression, except constants and functions.

    Raises
    ------
    SceneError
        The text is not an expression.
    """
    tree = syntax_tree(text)
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    used = [n for n in ast.walk(tree) if isinstance(n, ast.Name) and id(n) not in called]
    return tuple(dict.fromkeys(node.id for node in used if node.id not in CONSTANTS))


class _Lowering:
    """Converts the syntax tree to postfix operations and folds constants."""

    def __init__(
        self, text: str, names: Mapping[str, float], time: bool, channels: bool, variable: str = "t"
    ) -> None:
        self.text, self.names, self.time, self.channels = text, names, time, channels
        self.variable = variable
        flat = text.replace("\n", " ")
        self.lead = len(flat) - len(flat.lstrip())

    def run(self) -> Ops:
        try:
            return self.lower(syntax_tree(self.text))
        except RecursionError:
            raise mistake(self.text, 0, "the expression is nested too deeply") from None

    def column(self, node: ast.expr) -> int:
        """Character index of a node (Python's parser counts bytes)."""
        body = self.text[self.lead :].encode()
        return self.lead + len(body[: node.col_offset].decode(errors="ignore"))

    def fail(
        self, node: ast.expr, what: str, names: tuple[str, ...] = (), name: str = ""
    ) -> SceneError:
        return mistake(self.text, self.column(node), what, names, name)

    def lower(self, node: ast.expr) -> Ops:
        match node:
            case ast.Constant(value=bool() | str() | bytes() | complex() | None):
                raise self.fail(node, f"{node.value!r} is no number")
            case ast.Constant(value=(int() | float()) as value):
                return self.number(node, value)
            case ast.Name(id=name):
                return self.name(node, name)
            case ast.Attribute(value=ast.Name(id=sensor), attr=component) if self.channels:
                return ((f"@{sensor}.{component}", 0.0),)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.lower(operand)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.fold(node, (*self.lower(operand), ("neg", 0.0)))
            case ast.BinOp(op=operator) if type(operator) in _OPERATORS:
                return self.binary(node, _OPERATORS[type(operator)])
            case ast.Tuple():
                raise self.fail(node, "a comma separates values, decimals are written with a point")
            case ast.BinOp(op=ast.BitXor()):
                raise self.fail(node.right, 'powers are written "**", not "^"')
            case ast.Call(func=ast.Name(id=name)):
                return self.call(node, name)
        raise self.fail(node, "only numbers, names, + - * / ** and functions may be used")

    def number(self, node: ast.expr, value: float) -> Ops:
        try:
            value = float(value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self.fail(node, "the number is too large")
        return (("const", value),)

    def name(self, node: ast.expr, name: str) -> Ops:
        if name == self.variable and self.time:
            return (("t", 0.0),)
        value = self.names.get(name, CONSTANTS.get(name))
        if value is not None:
            return (("const", float(value)),)
        if name == "t":
            raise self.fail(node, "a constant is expected, not the time t")
        if name in FUNCTIONS:
            raise self.fail(node, f'"{name}" is a function, written {FUNCTIONS[name][1]}')
        if self.channels:
            return ((f"@{name}", 0.0),)
        names = (*self.names, *((self.variable,) if self.time else ()), *CONSTANTS)
        raise self.fail(node, f'unknown name "{name}"', names, name)

    def binary(self, node: ast.BinOp, operator: str) -> Ops:
        left, right = self.lower(node.left), self.lower(node.right)
        if operator == "**":
            return self.power(node, left, right)
        if operator == "/" and right == (("const", 0.0),):
            raise self.fail(node.right, "division by zero")
        return self.fold(node, (*left, *right, (operator, 0.0)))

    def power(self, node: ast.BinOp, base: Ops, exponent: Ops) -> Ops:
        if len(exponent) > 1 or exponent[0][0] != "const":
            return self.fold(node, (*base, *exponent, ("pow", 0.0)))
        c = exponent[0][1]
        if c == 0:
            return (("const", 1.0),)
        if c == 0.5 and (length := self.length(node.left)):
            return length
        return base if c == 1 else self.fold(node, (*base, ("powc", c)))

    def call(self, node: ast.Call, name: str) -> Ops:
        if name not in FUNCTIONS:
            raise self.fail(node.func, f'unknown function "{name}"', tuple(FUNCTIONS), name)
        count, usage = FUNCTIONS[name]
        if node.keywords or len(node.args) != count:
            count_here = len(node.args) + len(node.keywords)
            raise self.fail(
                node, f"{name} takes {count} argument{'s' * (count > 1)}, not {count_here}: {usage}"
            )
        if name == "sqrt" and (length := self.length(node.args[0])):
            return length
        args = [self.lower(argument) for argument in node.args]
        if name in RISES:
            return self.rise(node, args, RISES[name])
        return self.fold(node, (*(op for ops in args for op in ops), (name, 0.0)))

    def length(self, node: ast.expr) -> Ops:
        """The root of a sum of squares of channels, by `hypot` or `abs`; empty of all others.

        Their kinks are events, and their derivatives at zero are finite.
        """
        constants = {*self.names, *CONSTANTS, *FUNCTIONS, self.variable}
        parts = list(ast.walk(node)) if self.channels else []
        if not any(isinstance(part, ast.Name) and part.id not in constants for part in parts):
            return ()
        components = [self.lower(one) for one in _components(node)]
        ops = [op for one in components for op in one] + [("hypot", 0.0)] * (len(components) - 1)
        return (*ops, ("abs", 0.0)) if len(components) == 1 else tuple(ops)

    def rise(self, node: ast.Call, args: list[Ops], rise: str) -> Ops:
        """y0 + (y1 - y0) rise((x - x0)/(x1 - x0)), with the one-argument operation `rise`."""
        x, x0, y0, x1, y1 = args
        width = self.fold(node, (*x1, *x0, ("-", 0.0)))
        if width[0][0] == "const" and len(width) == 1 and width[0][1] <= 0:
            raise self.fail(node.args[3], "the end x1 of a step must lie after its beginning x0")
        ratio = self.fold(node, (*x, *x0, ("-", 0.0), *width, ("/", 0.0), (rise, 0.0)))
        height = self.fold(node, (*y1, *y0, ("-", 0.0)))
        return self.fold(node, (*y0, *height, *ratio, ("*", 0.0), ("+", 0.0)))

    def fold(self, node: ast.expr, ops: Ops) -> Ops:
        """Replace a program without time and channels by its value."""
        if any(op == "t" or channel_of(op) for op, _ in ops):
            return ops
        value = evaluate(ops, 0.0)[0]
        if not math.isfinite(value):
            raise self.fail(node, f"the value is {value:g}, no finite number")
        return (("const", value),)


def _components(node: ast.expr) -> list[ast.expr]:
    """What is squared in a square or a sum of squares; empty of all others."""
    match node:
        case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=2)):
            return [base]
        case ast.BinOp(left=base, op=ast.Mult(), right=right):
            return [base] if ast.dump(base) == ast.dump(right) else []
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            some, others = _components(left), _components(right)
            return [*some, *others] if some and others else []
    return []
