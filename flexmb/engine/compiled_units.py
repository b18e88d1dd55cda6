"""Compiled units in this process: loading them, and calling them.

Machine code is loaded by LLVM alone, so a run whose units are all in the cache
(`engine.unit_cache`) does not import Numba. Missing units are compiled first
(`engine.compiler_pool`). If compilation is not wanted (`call_without_compiling`, `interpretation`),
or with NUMBA_DISABLE_JIT=1, units run as plain Python.
"""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from threading import RLock
from typing import Any, get_type_hints

import numpy as np

from flexmb.engine.compiler_pool import compile_units
from flexmb.engine.jit import (
    UNITS,
    Array,
    CompiledUnit,
    Packed,
    array_kind,
    pack,
    reached,
    units_in,
)
from flexmb.engine.unit_cache import Stored, read_stored
from flexmb.progress import Progress, silent

_in_python = ContextVar("_in_python", default=False)


def interpreted() -> bool:
    """Whether units run as plain Python: NUMBA_DISABLE_JIT=1, or within `interpretation`."""
    return _in_python.get() or os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


@contextmanager
def interpretation() -> Iterator[None]:
    """Let units that this thread calls run as plain Python, from the same source.

    As in compiled code, division of array elements by zero gives infinity or NaN. Python's own
    numbers may still raise ArithmeticError, and a function outside its domain ValueError.
    """
    before = _in_python.set(True)
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        _in_python.reset(before)


class _Loader:
    """The units that this process has loaded."""

    def __init__(self) -> None:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        target = llvm.Target.from_triple(llvm.get_process_triple())
        machine = target.create_target_machine(reloc="pic", codemodel="default", jit=True)
        self._llvm = llvm
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        self.addresses: dict[str, int] = {}

    def add(self, codes: dict[str, bytes]) -> None:
        """Load machine code; the units that it calls are among it or were loaded before."""
        for code in codes.values():
            self._engine.add_object_file(self._llvm.object_file.ObjectFileRef.from_data(code))
        self._engine.finalize_object()
        for name in codes:
            symbol = name.replace(".", "_")
            self.addresses[name] = self._engine.get_function_address(symbol)


_lock = RLock()
_loader = functools.cache(_Loader)


def _collect_missing(
    names: Iterable[str], stored: dict[str, Stored], is_loaded: Callable[[str], bool]
) -> list[str]:
    """Read units and all they call from the cache into `stored`; return the missing names."""
    missing, seen = [], set()
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name in seen or is_loaded(name):
            continue
        seen.add(name)
        if name not in stored and (file := read_stored(name)) is not None:
            stored[name] = file
        if name in stored:
            waiting.extend(stored[name][1])
        else:
            missing.append(name)
            waiting.extend(reached(UNITS[name]).units)
    return missing


def missing_units(units: Iterable[CompiledUnit]) -> list[str]:
    """Names of the units that would have to be compiled."""
    return _collect_missing([unit.name for unit in units], {}, lambda name: False)


def load_units(units: Iterable[CompiledUnit], progress: Progress = silent) -> bool:
    """Load units and all they call if none has to be compiled; return whether this was so.

    Parameters
    ----------
    units : iterable of Unit
        Units that will be called.
    progress : Progress
        Receives the phase `load` if anything is loaded.
    """
    if interpreted():
        return True
    with _lock:
        names = frozenset(unit.name for unit in units)
        loaded = _loader().addresses
        if names <= loaded.keys():
            return True
        stored: dict[str, Stored] = {}
        if names in _incomplete or _collect_missing(names, stored, loaded.__contains__):
            _incomplete.add(names)
            return False
        progress("load", 0.0)
        _loader().add({name: code for name, (code, _) in stored.items()})
        progress("load", 1.0)
        return True


_incomplete: set[frozenset[str]] = set()
"""Requested sets of units of which some were missing; emptied when units are compiled."""


def prepare_units(units: Iterable[CompiledUnit], progress: Progress = silent) -> int:
    """Load units and all they call; compile missing ones. Returns how many were compiled.

    Parameters
    ----------
    units : iterable of Unit
        Units that will be called.
    progress : Progress
        Receives the phase `compile` if anything is compiled, else `load`.

    Raises
    ------
    CompilationError
        A unit does not compile, or its compiler cannot be started.
    """
    if interpreted():
        return 0
    with _lock:
        names = [unit.name for unit in units]
        loaded = _loader().addresses
        if all(name in loaded for name in names):
            return 0
        compiled = 0
        stored: dict[str, Stored] = {}
        progress("load", 0.0)
        while missing := _collect_missing(names, stored, loaded.__contains__):
            compiled += compile_units(missing, progress)
            _incomplete.clear()
        _loader().add({name: code for name, (code, _) in stored.items()})
        progress("compile" if compiled else "load", 1.0)
        return compiled


_word_at = ctypes.c_size_t.from_address
# Offset of the data pointer in an array object of NumPy, and whether an example has it there. To
# read it takes a twentieth of the time of `ctypes.data`.
_DATA_OFFSET = object.__basicsize__
_DATA_IS_AT_OFFSET = (
    _word_at(id(_EXAMPLE := np.zeros(1)) + _DATA_OFFSET).value == _EXAMPLE.ctypes.data
)


def _address(unit: CompiledUnit | np.ndarray) -> int:
    """Address of the machine code of a unit, or of the data of an array."""
    if isinstance(unit, np.ndarray):
        if _DATA_IS_AT_OFFSET:
            return _word_at(id(unit) + _DATA_OFFSET).value
        return int(unit.ctypes.data)
    addresses = _loader().addresses
    if unit.name not in addresses:
        prepare_units([unit])
    return addresses[unit.name]


_C_TYPES: dict[Any, Any] = {int: ctypes.c_int64, float: ctypes.c_double}


@functools.cache
def _parameters(name: str) -> tuple[Any, ...]:
    """Kinds of the parameters of a unit: its annotations, for arrays dtype and dimensions."""
    hints = get_type_hints(UNITS[name].function, include_extras=True)
    return tuple(array_kind(hint) or hint for word, hint in hints.items() if word != "return")


@functools.cache
def _c_function(name: str, address: int) -> Any:
    result = _C_TYPES[get_type_hints(UNITS[name].function)["return"]]
    types: list[Any] = []
    for kind in _parameters(name):
        words = 5 + 2 * kind.ndim if isinstance(kind, Array) else 1
        types += [_C_TYPES[kind]] if kind in _C_TYPES else [ctypes.c_int64] * words
    return ctypes.CFUNCTYPE(result, *types)(address)


def call(unit: CompiledUnit, *arguments: Any) -> Any:
    """Run a unit on records, arrays and numbers, as machine code unless `interpreted`.

    Parameters
    ----------
    unit : Unit
        The unit; it is compiled if it is missing.
    arguments : records, arrays and numbers
        Of the annotated types; records may also be results of `packed_record`. Arrays, and those of
        records, are changed in place.

    Raises
    ------
    TypeError
        An array of another dtype or number of dimensions than annotated, or not contiguous.
    """
    if interpreted():
        return unit.function(*(v.record if isinstance(v, Packed) else v for v in arguments))
    if any(isinstance(v, tuple) for v in arguments) or unit.name not in _loader().addresses:
        prepare_units(_units_needed(unit, arguments))
    owned, words = [], []
    for value, kind in zip(arguments, _parameters(unit.name), strict=True):
        if isinstance(value, tuple):
            owned.append(pack(value, _address))
            words.append(owned[-1].address)
        elif isinstance(value, Packed):
            owned.append(value if value.address else pack(value.record, _address))
            words.append(owned[-1].address)
        else:
            words += _array_words(value, kind) if isinstance(kind, Array) else [value]
    return _c_function(unit.name, _address(unit))(*words)


def bind(unit: CompiledUnit, *first: Any) -> Callable[..., Any]:
    """A unit with its first arguments bound, for many calls; the others, if any, are numbers.

    Parameters
    ----------
    unit : Unit
        The unit.
    first : records from `packed_record`, and arrays
        Arrays may be changed in place, not replaced.
    """
    if interpreted():
        return functools.partial(call, unit, *first)
    prepare_units([unit])
    words: list[Any] = []
    for value, kind in zip(first, _parameters(unit.name), strict=False):
        words += [value.address] if isinstance(value, Packed) else _array_words(value, kind)
    bound = functools.partial(_c_function(unit.name, _address(unit)), *words)
    bound.owned = first  # type: ignore[attr-defined]
    return bound


def packed_record(record: Any, like: Packed | None = None) -> Packed:
    """A record for many calls: laid out in memory once, what `like` has in common with it too.

    Its arrays may be changed in place, not replaced. Missing units of its tables are compiled.
    """
    if interpreted():
        return Packed(0, record, (), {})
    prepare_units(units_in(record))
    return pack(record, _address, like)


def call_without_compiling(unit: CompiledUnit, *arguments: Any) -> Any:
    """As `call`, but without compiling: if a unit is missing, all units run as plain Python."""
    with nullcontext() if load_units(_units_needed(unit, arguments)) else interpretation():
        return call(unit, *arguments)


def caller_without_compiling(unit: CompiledUnit, record: Any) -> Callable[[], None]:
    """`call_without_compiling` on a record for many calls: packed once, if no unit is missing."""
    handed: list[Packed] = []

    def run() -> None:
        if not (handed or interpreted()) and load_units(_units_needed(unit, (record,))):
            handed.append(packed_record(record))
        if handed:
            call(unit, handed[0])
        else:
            call_without_compiling(unit, record)

    return run


def _units_needed(unit: CompiledUnit, arguments: Iterable[Any]) -> list[CompiledUnit]:
    """A unit, and those in the tables of its records."""
    records = [value for value in arguments if isinstance(value, tuple)]
    return [unit, *(other for record in records for other in units_in(record))]


def _array_words(array: np.ndarray, kind: Array) -> list[int]:
    """The words that pass an array to compiled code: owner, parent, sizes, data, shape, strides."""
    if not kind.fits(array):
        what = f"{array.dtype}{array.shape}, strides {array.strides}"
        raise TypeError(f"the array must be a contiguous {kind}, not {what}")
    return [0, 0, array.size, array.itemsize, _address(array), *array.shape, *array.strides]
