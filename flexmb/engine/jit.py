"""Marks of compiled code, and records: the arguments of compiled code and how they lie in memory.

A *kernel* is a function that only compiled code calls; it takes arrays, records of them by their
address, and numbers. A *unit* is a kernel with a fixed signature, given by its annotations, that is
compiled and cached alone (`engine.compiler`, `engine.compiled_units`); other units call it by its
name, or through a table of addresses. Here both are plain Python functions, so all of the engine
also runs without compilation, from the same source; Numba is imported only where units are
compiled.

A record class annotates every field that compiled code reads: an array (`array_of`), a number (int,
float), another record, a table of units (`Units`) or of records (`Records`). In memory it is a row
of words of 8 bytes. An array takes one for its data and one for each length (contiguous, in C
order), a number one, a record within a record the words of that one; tables of units and of records
are arrays of addresses, 0 for a unit that is None. Other fields stay with Python. Compiled code is
handed the address alone, so its types are the same for all scenes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np


class CompiledUnit:
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


UNITS: dict[str, CompiledUnit] = {}
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
def reached(unit: CompiledUnit) -> Reached:
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
            if isinstance(value, CompiledUnit):
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


def compile_with(kernel_mark: Callable[..., Any], unit_mark: Callable[[CompiledUnit], Any]) -> None:
    """Let a compiler mark all kernels and units that are imported from now on."""
    global _compiler  # noqa: PLW0603  one compiler a process
    _compiler = kernel_mark, unit_mark


def kernel(function: Callable[..., Any]) -> Any:
    """Decorator of functions that compiled code calls."""
    return function if _compiler is None else _compiler[0](function)


def separate(function: Callable[..., Any]) -> Any:
    """Decorator of kernels that write no number which they also reach by another argument.

    So loops need not find out first whether their arrays overlap.
    """
    return function if _compiler is None else _compiler[0](function, True)


def unit(function: Callable[..., Any]) -> Any:
    """Decorator of functions that are compiled and cached alone; annotations give the types."""
    made = CompiledUnit(function)
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


class Array(NamedTuple):
    """An array of a dtype with a number of dimensions."""

    dtype: np.dtype
    ndim: int


class _UnitTable:
    """Mark of a table of units."""


class _RecordTable:
    """Mark of a table of records."""


def array_of(dtype: Any, ndim: int = 1) -> Any:
    """Annotation of an array field: contiguous, of this dtype and number of dimensions."""
    return Annotated[np.ndarray, Array(np.dtype(dtype), ndim)]


Vector = array_of("f8")
Complexes = array_of("c16")
Matrix = array_of("f8", 2)
Integers = array_of("i8")
Units = Annotated[tuple, _UnitTable]
Records = Annotated[tuple, _RecordTable]
_ADDRESSES = Array(np.dtype("i8"), 1)


class Field(NamedTuple):
    """One field of a record in memory: its first word, and what it is."""

    name: str
    word: int
    kind: Any  # Array, int, float, or a record class
    table: str  # "units", "records", or ""


@cache
def layout(record: type) -> tuple[tuple[Field, ...], int]:
    """Fields of a record class that compiled code reads, and the words it takes."""
    fields: list[Field] = []
    word = 0
    for name, hint in get_type_hints(record, include_extras=True).items():
        kind, table = _kind(hint)
        if kind is None:
            continue
        fields.append(Field(name, word, kind, table))
        word += _words(kind)
    return tuple(fields), word


def _kind(hint: Any) -> tuple[Any, str]:
    if get_origin(hint) is Annotated:
        mark = get_args(hint)[1]
        if mark is _UnitTable:
            return _ADDRESSES, "units"
        if mark is _RecordTable:
            return _ADDRESSES, "records"
        return (mark, "") if isinstance(mark, Array) else (None, "")
    if hint in (int, float) or is_record(hint):
        return hint, ""
    return None, ""


def array_kind(hint: Any) -> Array | None:
    """What an annotation says of an array; None for all others."""
    kind, table = _kind(hint)
    return kind if isinstance(kind, Array) and not table else None


def is_record(hint: Any) -> bool:
    """Whether it is a class of named tuples."""
    return isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields")


def _words(kind: Any) -> int:
    if isinstance(kind, Array):
        return 1 + kind.ndim
    return 1 if kind in (int, float) else layout(kind)[1]


class Packed:
    """A record in memory: its address, and all that must live as long."""

    __slots__ = ("address", "owned", "record")

    def __init__(self, address: int, record: Any, owned: tuple[Any, ...]) -> None:
        self.address, self.record, self.owned = address, record, owned


def pack(record: Any, address_of: Callable[[Any], int]) -> Packed:
    """Lay a record out in memory; arrays are not copied.

    Parameters
    ----------
    record : named tuple
        The record.
    address_of : callable
        Address of the machine code of a unit, or of the data of an array.

    Raises
    ------
    TypeError
        An array of another dtype or number of dimensions than annotated, or not contiguous.
    """
    return _pack(record, address_of, {})


def _pack(record: Any, address_of: Callable[[Any], int], packed: dict[int, Packed]) -> Packed:
    """The same; `packed` has the records of tables by `id`, which many stages share."""
    words: list[int] = []
    owned: list[Any] = [record]
    _add_words(record, words, owned, address_of, packed)
    memory = np.array(words or [0], np.int64)
    return Packed(address_of(memory), record, (memory, *owned))


def _add_words(
    record: Any, words: list[int], owned: list[Any], address_of: Callable[[Any], int],
    packed: dict[int, Packed],
) -> None:  # fmt: skip
    """Append the words of a record, and to `owned` what they point at in addition to its arrays."""
    for name, _, kind, table in layout(type(record))[0]:
        value = getattr(record, name)
        if table:
            value = _addresses(value, table, owned, address_of, packed)
        if isinstance(kind, Array):
            _check(record, name, value, kind)
            words.append(address_of(value))
            words += value.shape
        elif kind is float:
            words.append(int(np.float64(value).view(np.int64)))
        elif kind is int:
            words.append(int(value))
        else:
            _add_words(value, words, owned, address_of, packed)


def _addresses(
    values: Any, table: str, owned: list[Any], address_of: Callable[[Any], int],
    packed: dict[int, Packed],
) -> np.ndarray:  # fmt: skip
    if table == "units":
        numbers = [0 if unit is None else address_of(unit) for unit in values]
    else:
        numbers = []
        for record in values:
            if id(record) not in packed:
                packed[id(record)] = _pack(record, address_of, packed)
            owned.append(packed[id(record)])
            numbers.append(packed[id(record)].address)
    addresses = np.array(numbers, np.int64)
    owned.append(addresses)
    return addresses


def _check(record: Any, name: str, value: Any, kind: Array) -> None:
    fits = isinstance(value, np.ndarray) and value.dtype == kind.dtype and value.ndim == kind.ndim
    if not fits or not value.flags.c_contiguous:
        what = f"{type(value).__name__} {getattr(value, 'dtype', '')}{getattr(value, 'shape', '')}"
        raise TypeError(f"{type(record).__name__}.{name} must be a contiguous {kind}, not {what}")


def units_in(record: Any) -> Iterator[CompiledUnit]:
    """All units that stand in the tables of a record."""
    for name, table in _holders(type(record)):
        value = getattr(record, name)
        if table == "units":
            yield from (unit for unit in value if unit is not None)
        elif table == "records":
            for entry in value:
                yield from units_in(entry)
        else:
            yield from units_in(value)


@cache
def _holders(record: type) -> tuple[tuple[str, str], ...]:
    """Fields of a record class that may hold units, and which tables they are, "" of records."""
    fields = layout(record)[0]
    return tuple(
        (field.name, field.table)
        for field in fields
        if field.table or (is_record(field.kind) and _holders(field.kind))
    )
