"""Marks of compiled code: kernels, units, and calls of units through their addresses.

A *kernel* is a function that only compiled code calls; it takes arrays, records of them by their
address, and numbers. A *unit* is a kernel with a fixed signature, told by its annotations, that is
compiled and cached alone (`engine.compiler`, `engine.units`); other units call it by its name, or
through a table of addresses. Here both are plain Python functions, so all of the engine also runs
without compilation, from the same source; Numba is imported only where units are compiled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple


class Unit:
    """A function that is compiled alone; called from Python it runs without compilation.

    Attributes
    ----------
    name : str
        Module and function, the same in every process.
    symbol : str
        Its name in machine code.
    function : callable
        The Python function.
    """

    __slots__ = ("function", "name", "symbol")

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.symbol = self.name.replace(".", "_")

    def __call__(self, *arguments: Any) -> Any:
        return self.function(*arguments)

    def __repr__(self) -> str:
        return f"Unit({self.name})"

    @property
    def module(self) -> str:
        """Module that defines it."""
        return str(self.function.__module__)


UNITS: dict[str, Unit] = {}
"""All units that were imported, by name."""


class Reached(NamedTuple):
    """What the source of a unit reaches.

    Attributes
    ----------
    units : frozenset of str
        Names of the units that it calls by name.
    kernels : dict
        Size of the code (bytes) of each kernel that is compiled into it, its own function too.
    """

    units: frozenset[str]
    kernels: dict[FunctionType, int]


@cache
def reached(unit: Unit) -> Reached:
    """Units and kernels that a unit calls, its own function among the kernels."""
    units: set[str] = set()
    kernels: dict[FunctionType, int] = {}
    waiting: list[Any] = [unit.function]
    while waiting:
        function = waiting.pop()
        if function in kernels:
            continue
        codes = list(_codes(function.__code__))
        kernels[function] = sum(len(code.co_code) for code in codes)
        for value in _named(codes, function.__globals__):
            if isinstance(value, Unit):
                units.add(value.name)
            elif isinstance(value, FunctionType) and value.__module__.startswith(_PACKAGE):
                waiting.append(value)
    return Reached(frozenset(units), kernels)


_PACKAGE = __name__.rpartition(".")[0]


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from _codes(value)


def _named(codes: list[CodeType], scope: dict[str, Any]) -> Iterator[Any]:
    """Values that code names: globals, and members of modules among them."""
    names = {name for code in codes for name in code.co_names}
    for value in [scope[name] for name in names if name in scope]:
        if isinstance(value, ModuleType):
            yield from (vars(value)[name] for name in names if name in vars(value))
        yield value


_compiler: tuple[Callable[..., Any], Callable[..., Any]] | None = None


def compile_with(
    kernel_mark: Callable[[Callable[..., Any]], Any], unit_mark: Callable[[Unit], Any]
) -> None:
    """Let a compiler mark all kernels and units that are imported from now on."""
    global _compiler  # noqa: PLW0603  one compiler a process
    _compiler = kernel_mark, unit_mark


def kernel(function: Callable[..., Any]) -> Any:
    """Decorator of functions that compiled code calls."""
    return function if _compiler is None else _compiler[0](function)


def unit(function: Callable[..., Any]) -> Any:
    """Decorator of functions that are compiled and cached alone; annotations give the types."""
    made = Unit(function)
    UNITS[made.name] = made
    return made if _compiler is None else _compiler[1](made)


# Calls of a unit that stands in a table; compiled, `unit` and `tables` are addresses.


def call_stage(unit: Any, run: Any, tables: Any, at: Any) -> int:
    """Status of a stage of one kind."""
    return unit(run, tables, at)  # type: ignore[no-any-return]


def call_value(unit: Any, run: Any, tables: Any, at: Any) -> float:
    """Number that one kind gives: an energy, a change."""
    return unit(run, tables, at)  # type: ignore[no-any-return]


def call_matrix(unit: Any, run: Any, tables: Any, at: Any, cv: float, cp: float) -> int:
    """Status of what one kind adds to the iteration matrix."""
    return unit(run, tables, at, cv, cp)  # type: ignore[no-any-return]


def call_step(unit: Any, run: Any, tables: Any, h: float) -> int:
    """Status of one step of a method."""
    return unit(run, tables, h)  # type: ignore[no-any-return]


def call_channel(unit: Any, run: Any, tables: Any, at: Any, k: int) -> float:
    """Value of channel or row k of one kind."""
    return unit(run, tables, at, k)  # type: ignore[no-any-return]


def call_row(unit: Any, at: Any, a: int, b: int, i: int, j: int) -> int:
    """Status of a unit of a kind of row."""
    return unit(at, a, b, i, j)  # type: ignore[no-any-return]


def call_row_value(unit: Any, at: Any, a: int, b: int, i: int, j: int) -> float:
    """Number that a kind of row gives: its measure, its curvature."""
    return unit(at, a, b, i, j)  # type: ignore[no-any-return]


def call_row_tangent(unit: Any, at: Any, a: int, b: int, i: int, j: int, f: float) -> int:
    """Status of the tangent of a kind of row."""
    return unit(at, a, b, i, j, f)  # type: ignore[no-any-return]
