"""Records: named tuples of arrays and numbers, and how they lie in memory for compiled code.

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
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np

from flexmb.engine.jit import Unit


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


def array_ndim(hint: Any) -> int:
    """Number of dimensions of an annotation that is an array; 0 for all others."""
    kind, table = _kind(hint)
    return kind.ndim if isinstance(kind, Array) and not table else 0


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


def pack(record: Any, address_of: Callable[[Unit], int]) -> Packed:
    """Lay a record out in memory; arrays are not copied.

    Parameters
    ----------
    record : named tuple
        The record.
    address_of : callable
        Address of the machine code of a unit.

    Raises
    ------
    TypeError
        An array of another dtype or number of dimensions than annotated, or not contiguous.
    """
    words: list[int] = []
    owned: list[Any] = [record]
    _add_words(record, words, owned, address_of)
    memory = np.array(words or [0], np.int64)
    return Packed(memory.ctypes.data, record, (memory, *owned))


def _add_words(
    record: Any, words: list[int], owned: list[Any], address_of: Callable[[Unit], int]
) -> None:
    """Append the words of a record, and to `owned` what they point at in addition to its arrays."""
    for name, _, kind, table in layout(type(record))[0]:
        value = getattr(record, name)
        if table:
            value = _addresses(value, table, owned, address_of)
        if isinstance(kind, Array):
            _check(record, name, value, kind)
            words.append(value.ctypes.data)  # faster than __array_interface__ where it has fields
            words += value.shape
        elif kind is float:
            words.append(int(np.float64(value).view(np.int64)))
        elif kind is int:
            words.append(int(value))
        else:
            _add_words(value, words, owned, address_of)


def _addresses(
    values: Any, table: str, owned: list[Any], address_of: Callable[[Unit], int]
) -> np.ndarray:
    if table == "units":
        numbers = [0 if unit is None else address_of(unit) for unit in values]
    else:
        packed = [pack(record, address_of) for record in values]
        owned.append(packed)
        numbers = [one.address for one in packed]
    addresses = np.array(numbers, np.int64)
    owned.append(addresses)
    return addresses


def _check(record: Any, name: str, value: Any, kind: Array) -> None:
    fits = isinstance(value, np.ndarray) and value.dtype == kind.dtype and value.ndim == kind.ndim
    if not fits or not value.flags.c_contiguous:
        what = f"{type(value).__name__} {getattr(value, 'dtype', '')}{getattr(value, 'shape', '')}"
        raise TypeError(f"{type(record).__name__}.{name} must be a contiguous {kind}, not {what}")


def units_in(record: Any) -> Iterator[Unit]:
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
