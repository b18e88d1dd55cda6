"""Decorators of compiled code, and records: its arguments and their layout in memory.

A *kernel* is a function that only compiled code calls. Its arguments are arrays, records of arrays
(by address) and numbers. A *unit* is a kernel with a fixed signature, given by its annotations,
that is compiled and cached alone (`engine.compiler`, `engine.compiled_units`). Other units call it
by name, or through a table of addresses. In this module both are plain Python functions, so that
the whole engine also runs without compilation, from the same source. Only the compiler process
imports Numba.

A record class annotates every field that compiled code reads: an array (`array_of`), a number (int,
float), another record, a table of units (`Units`) or of records (`Records`). In memory a record is
a row of words of 8 bytes. An array takes one word for the address of its data, one for each length
(contiguous, in C order), a number one word, a record within a record its own words. Tables of units
and of records are arrays of addresses, 0 for a unit that is None. Other fields are for Python only.
Compiled code receives only the address of a record, so its types are the same for all scenes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np


class CompiledUnit:
    """A function that is compiled and cached alone; a plain call from Python interprets it.

    Attributes
    ----------
    name : str
        Module and function, the same in every process.
    symbol : str
        The name in machine code.
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
"""All units of imported modules, by name."""


class Reached(NamedTuple):
    """Units and kernels that the source of a unit reaches.

    Attributes
    ----------
    units : frozenset of str
        Names of the units that it calls by name.
    kernels : dict
        Code size (bytes) of each kernel that is compiled into it, including its own function.
    """

    units: frozenset[str]
    kernels: dict[FunctionType, int]


@cache
def reached(unit: CompiledUnit) -> Reached:
    """Units and kernels that a unit calls, directly or not; its own function is one of them."""
    units: set[str] = set()
    kernels: dict[FunctionType, int] = {}
    waiting: list[Any] = [unit.function]
    while waiting:
        function = waiting.pop()
        if function in kernels:
            continue
        codes = list(_codes(function.__code__))
        kernels[function] = sum(len(code.co_code) for code in codes)
        for value in _referenced_values(codes, function.__globals__):
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


def _referenced_values(codes: list[CodeType], scope: dict[str, Any]) -> Iterator[Any]:
    """Values of the names in code: globals, and members of modules."""
    names = {name for code in codes for name in code.co_names}
    for value in [scope[name] for name in names if name in scope]:
        if isinstance(value, ModuleType):
            yield from (vars(value)[name] for name in names if name in vars(value))
        yield value


_compiler: tuple[Callable[..., Any], Callable[..., Any]] | None = None


def compile_with(kernel_mark: Callable[..., Any], unit_mark: Callable[[CompiledUnit], Any]) -> None:
    """Let a compiler decorate all kernels and units that are imported from now on."""
    global _compiler  # noqa: PLW0603  one compiler per process
    _compiler = kernel_mark, unit_mark


def kernel(function: Callable[..., Any]) -> Any:
    """Decorator of functions that compiled code calls."""
    return function if _compiler is None else _compiler[0](function)


def separate(function: Callable[..., Any]) -> Any:
    """Decorator of kernels whose array arguments do not overlap where they are written.

    So loops are vectorised without a test for overlap.
    """
    return function if _compiler is None else _compiler[0](function, True)


def unit(function: Callable[..., Any]) -> Any:
    """Decorator of functions that are compiled and cached alone, with the types of annotations."""
    made = CompiledUnit(function)
    UNITS[made.name] = made
    return made if _compiler is None else _compiler[1](made)


# Calls of a unit from a table. In compiled code, `unit` and `tables` are addresses.


def call_stage(unit: Any, run: Any, tables: Any, at: Any) -> int:
    """Status of a stage of one kind."""
    return unit(run, tables, at)  # type: ignore[no-any-return]


def call_value(unit: Any, run: Any, tables: Any, at: Any) -> float:
    """Number that the unit of one kind returns: an energy, a change."""
    return unit(run, tables, at)  # type: ignore[no-any-return]


def call_matrix(unit: Any, run: Any, tables: Any, at: Any, cv: float, cp: float) -> int:
    """Status of the unit by which one kind adds to the iteration matrix."""
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
    """Number that the unit of a kind of row returns: its value, its curvature."""
    return unit(at, a, b, i, j)  # type: ignore[no-any-return]


def call_row_tangent(unit: Any, at: Any, a: int, b: int, i: int, j: int, f: float) -> int:
    """Status of the unit that adds the tangent of a kind of row."""
    return unit(at, a, b, i, j, f)  # type: ignore[no-any-return]


class Array(NamedTuple):
    """An array of a dtype with a number of dimensions."""

    dtype: np.dtype
    ndim: int

    def fits(self, value: Any) -> bool:
        """Whether a value is such an array, and contiguous."""
        return (
            isinstance(value, np.ndarray)
            and value.ndim == self.ndim
            and (value.dtype is self.dtype or value.dtype == self.dtype)
            and value.flags.c_contiguous
        )


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
Matrices = array_of("f8", 3)
Integers = array_of("i8")
Units = Annotated[tuple, _UnitTable]
Records = Annotated[tuple, _RecordTable]
_ADDRESSES = Array(np.dtype("i8"), 1)


class Field(NamedTuple):
    """One field of a record in memory: its name, first word and kind."""

    name: str
    word: int
    kind: Any  # Array, int, float, or a record class
    table: str  # "units", "records", or ""


@cache
def layout(record: type) -> tuple[tuple[Field, ...], int]:
    """Fields of a record class that compiled code reads, and the number of words of the record."""
    fields: list[Field] = []
    word = 0
    for name, hint in get_type_hints(record, include_extras=True).items():
        kind, table = _field_kind(hint)
        if kind is None:
            continue
        fields.append(Field(name, word, kind, table))
        word += _word_count(kind)
    return tuple(fields), word


def _field_kind(hint: Any) -> tuple[Any, str]:
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
    """The `Array` of an annotation; None if it is not that of an array."""
    kind, table = _field_kind(hint)
    return kind if isinstance(kind, Array) and not table else None


def is_record(hint: Any) -> bool:
    """Whether an annotation is a class of named tuples."""
    return isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields")


def _word_count(kind: Any) -> int:
    if isinstance(kind, Array):
        return 1 + kind.ndim
    return 1 if kind in (int, float) else layout(kind)[1]


class Packed:
    """A record in memory: its address, and the objects that must live as long as it does.

    `parts` are the words of the records within it, by `id`, each with the objects that it needs.
    """

    __slots__ = ("address", "owned", "parts", "record")

    def __init__(self, address: int, record: Any, owned: tuple[Any, ...], parts: _Parts) -> None:
        self.address, self.record, self.owned, self.parts = address, record, owned, parts


_Parts = dict[int, tuple[list[int], list[Any]]]


def pack(record: Any, address_of: Callable[[Any], int], like: Packed | None = None) -> Packed:
    """Lay a record out in memory; arrays are not copied.

    Parameters
    ----------
    record : named tuple
        The record.
    address_of : callable
        Returns the address of the machine code of a unit, or of the data of an array.
    like : Packed, optional
        A record that has parts in common with this one: these are laid out once.

    Raises
    ------
    TypeError
        An array has another dtype or number of dimensions than annotated, or is not contiguous.
    """
    parts: _Parts = {} if like is None else dict(like.parts)
    made = _pack(record, address_of, {}, parts)
    return Packed(made.address, record, (*made.owned, like), parts)


def _pack(
    record: Any, address_of: Callable[[Any], int], packed: dict[int, Packed], parts: _Parts
) -> Packed:
    """As `pack`; `packed`: records of tables that are packed already, by `id`."""
    words: list[int] = []
    owned: list[Any] = [record]
    _add_words(record, words, owned, address_of, packed, parts)
    memory = np.array(words or [0], np.int64)
    return Packed(address_of(memory), record, (memory, *owned), parts)


def _add_words(
    record: Any, words: list[int], owned: list[Any], address_of: Callable[[Any], int],
    packed: dict[int, Packed], parts: _Parts,
) -> None:  # fmt: skip
    """Append the words of a record; append to `owned` what they point to beside its arrays."""
    for place, field in _places(type(record)):
        value, kind = record[place], field.kind
        if field.table:
            value = _addresses(value, field.table, owned, address_of, packed, parts)
        if type(kind) is Array:
            if not kind.fits(value):
                _refuse_array(record, field, value)
            words.append(address_of(value))
            words += value.shape
        elif kind is float:
            words.append(int(np.float64(value).view(np.int64)))
        elif kind is int:
            words.append(int(value))
        else:
            if id(value) not in parts:
                own: tuple[list[int], list[Any]] = [], [value]
                _add_words(value, *own, address_of, packed, parts)
                parts[id(value)] = own
            words += parts[id(value)][0]
            owned += parts[id(value)][1]


@cache
def _places(record: type) -> tuple[tuple[int, Field], ...]:
    """Fields of a record class that compiled code reads, each with its number in the tuple."""
    fields = record._fields  # type: ignore[attr-defined]
    return tuple((fields.index(field.name), field) for field in layout(record)[0])


_NO_ADDRESSES = np.zeros(0, np.int64)


def _addresses(
    values: Any, table: str, owned: list[Any], address_of: Callable[[Any], int],
    packed: dict[int, Packed], parts: _Parts,
) -> np.ndarray:  # fmt: skip
    if not values:
        return _NO_ADDRESSES
    if table == "units":
        numbers = [0 if unit is None else address_of(unit) for unit in values]
    else:
        numbers = []
        for record in values:
            if id(record) not in packed:
                packed[id(record)] = _pack(record, address_of, packed, parts)
            owned.append(packed[id(record)])
            numbers.append(packed[id(record)].address)
    addresses = np.array(numbers, np.int64)
    owned.append(addresses)
    return addresses


def _refuse_array(record: Any, field: Field, value: Any) -> None:
    what = f"{type(value).__name__} {getattr(value, 'dtype', '')}{getattr(value, 'shape', '')}"
    name = f"{type(record).__name__}.{field.name}"
    raise TypeError(f"{name} must be a contiguous {field.kind}, not {what}")


def units_in(record: Any) -> Iterator[CompiledUnit]:
    """All units in the tables of a record."""
    for name, table in _fields_with_units(type(record)):
        value = getattr(record, name)
        if table == "units":
            yield from (unit for unit in value if unit is not None)
        elif table == "records":
            for entry in value:
                yield from units_in(entry)
        else:
            yield from units_in(value)


@cache
def _fields_with_units(record: type) -> tuple[tuple[str, str], ...]:
    """Fields of a record class that may hold units, each with its kind of table ("": a record)."""
    fields = layout(record)[0]
    return tuple(
        (field.name, field.table)
        for field in fields
        if field.table or (is_record(field.kind) and _fields_with_units(field.kind))
    )
