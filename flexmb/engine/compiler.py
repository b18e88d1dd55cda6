"""Compile units to machine code; the only module that uses Numba.

It runs as a process of its own, `python -m flexmb.engine.compiler FOLDER`. It reads names of units,
one per line, writes the object file of each into the folder and answers with a line. Numba
translates the kernels that a unit reaches into LLVM code without optimisation. The unit is then
optimised once, as a whole, and becomes one object file. The file's only symbols are the name of the
unit and those of the units that it calls.
"""

from __future__ import annotations

import gc
import importlib
import inspect
import os
import re
import sys
import time
import traceback
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

os.environ["NUMBA_OPT"] = "0"  # each unit is optimised once, as a whole, below

import llvmlite.binding as llvm
import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, codegen, types
from numba.core.typing.templates import AttributeTemplate
from numba.cpython import slicing
from numba.extending import (
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    overload,
    register_model,
    typeof_impl,
)
from numba.np import arrayobj

from flexmb.engine import jit
from flexmb.engine.jit import Array, is_record, layout
from flexmb.engine.unit_cache import checks_indices, write_unit

# `fastmath=True` would let the compiler assume that no NaN exists and make isfinite(nan) true;
# these four flags keep NaN honest and still allow vectorised sums. Without reference counting
# (`_nrt`) nothing can allocate: Numba refuses a kernel that would.
_OPTIONS = {
    "fastmath": {"contract", "reassoc", "arcp", "nsz"},
    "error_model": "numpy",
    "_nrt": False,
}
_WORD = ir.IntType(64)


def _fix_index(builder: ir.IRBuilder, index: ir.Value, size: ir.Value) -> ir.Value:
    """Return the index unchanged, in place of Numba's treatment of negative indices.

    No kernel counts indices from the end, and the test for it would take a quarter of the time of a
    run. With `checks_indices`, an index outside its array ends the process by an illegal
    instruction.
    """
    if checks_indices():
        # bounds of slices may be larger than the size: Numba cuts them
        bound = sys._getframe(1).f_code.co_name == "fix_bound"
        zero = ir.Constant(size.type, 0)
        below = builder.icmp_signed("<", index, zero)
        wrong = below if bound else builder.icmp_unsigned(">=", index, size)
        with builder.if_then(wrong, likely=False):
            kind = ir.FunctionType(ir.VoidType(), [])
            builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.trap"), [])
    return index


slicing.fix_index = _fix_index


class RecordAddress(types.Type):
    """Type of the address of a record."""

    def __init__(self, record: type) -> None:
        self.record = record
        super().__init__(name=f"record({record.__module__}.{record.__qualname__})")


@register_model(RecordAddress)
class _RecordAddressModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, of: RecordAddress) -> None:
        super().__init__(manager, of, _WORD)


@cache
def numba_type(kind: Any) -> types.Type:
    """Numba's type of an annotation: a number, an array, a record of arrays, a row of a table."""
    if kind is float:
        return types.float64
    if kind in (int, bool, type(None)):
        return types.int64
    if isinstance(kind, Array):
        return types.Array(numba.from_dtype(kind.dtype), kind.ndim, "C")
    if isinstance(kind, np.dtype):
        return numba.from_dtype(kind)
    if is_record(kind):
        return RecordAddress(kind)
    raise TypeError(f"no compiled type for {kind!r}")


@infer_getattr
class _FieldTypes(AttributeTemplate):  # type: ignore[misc]
    """Types of the fields of a record."""

    key = RecordAddress

    def generic_resolve(self, of: RecordAddress, name: str) -> types.Type | None:
        for field in layout(of.record)[0]:
            if field.name == name:
                return numba_type(field.kind)
        return None


@lower_getattr_generic(RecordAddress)
def _load_field(context: Any, builder: Any, of: RecordAddress, address: Any, name: str) -> Any:
    field = next(field for field in layout(of.record)[0] if field.name == name)
    at = builder.add(address, ir.Constant(_WORD, 8 * field.word))
    if is_record(field.kind):
        return at
    kind = numba_type(field.kind)
    if not isinstance(field.kind, Array):
        return builder.load(builder.inttoptr(at, context.get_value_type(kind).as_pointer()))
    words = builder.inttoptr(at, _WORD.as_pointer())
    data, *shape = (
        builder.load(builder.gep(words, [ir.Constant(ir.IntType(32), k)]))
        for k in range(1 + field.kind.ndim)
    )
    size = ir.Constant(_WORD, field.kind.dtype.itemsize)
    strides = [size]
    for length in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length))
    array = arrayobj.make_array(kind)(context, builder)
    arrayobj.populate_array(
        array, data=builder.inttoptr(data, array.data.type), shape=shape, strides=strides,
        itemsize=size, meminfo=None,
    )  # fmt: skip
    return array._getvalue()


def _indirect_call(result: types.Type) -> Any:
    """Code generator of an intrinsic that calls the unit at an address; `result`: its type."""
    kind = _WORD if result == types.int64 else ir.DoubleType()

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, *values = arguments
        function = ir.FunctionType(kind, [value.type for value in values])
        return builder.call(builder.inttoptr(address, function.as_pointer()), values)

    return generate


def _define_calls() -> None:
    """Let compiled code call units through tables of addresses, by the functions `jit.call_...`."""
    for call in _CALLS:
        names = ", ".join(inspect.signature(call).parameters)
        result = numba_type(get_type_hints(call)["return"])
        scope: dict[str, Any] = {"result": result, "generate": _indirect_call(result)}
        exec(f"def typing(_, {names}): return result({names}), generate", scope)
        scope["call"] = intrinsic(scope["typing"])
        exec(f"def compiled({names}): return lambda {names}: call({names})", scope)
        overload(call)(scope["compiled"])


_CALLS = (
    jit.call_stage, jit.call_value, jit.call_matrix, jit.call_step, jit.call_channel,
    jit.call_row, jit.call_row_value, jit.call_row_tangent,
)  # fmt: skip


def signature_of(function: Callable[..., Any]) -> Any:
    """Numba's signature of a unit, from its annotations."""
    hints = get_type_hints(function, include_extras=True)
    kinds = {name: _plain(hint) for name, hint in hints.items()}
    result = numba_type(kinds.pop("return"))
    return result(*(numba_type(kind) for kind in kinds.values()))


def _plain(hint: Any) -> Any:
    """The type that an annotation states to the compiler."""
    return hint.__metadata__[0] if hasattr(hint, "__metadata__") else hint


class KernelType(types.Dispatcher):  # type: ignore[misc]
    """Type of a kernel, which is compiled once for all constants in its calls.

    By default Numba compiles a function again for each integer constant in a call.
    """

    def get_call_type(self, context: Any, arguments: Any, named: Any) -> Any:
        plain = tuple(types.unliteral(kind) for kind in arguments)
        named = {name: types.unliteral(kind) for name, kind in named.items()}
        return super().get_call_type(context, plain, named)


register_model(KernelType)(models.OpaqueModel)


class _SeparateArrays(numba.core.compiler.Compiler):  # type: ignore[misc]
    """A compilation of a function whose array arguments do not overlap."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.noalias = True


class _Kernel:
    """A function that Numba compiles into its callers."""

    def __init__(self, function: Callable[..., Any], separate: bool) -> None:
        options = {**_OPTIONS, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        if separate:
            options["pipeline_class"] = _SeparateArrays
        self.compiled = numba.njit(**options)(function)
        self.type = KernelType(self.compiled)


@typeof_impl.register(_Kernel)
def _type_of_kernel(kernel: _Kernel, _: Any) -> KernelType:
    return kernel.type


def _mark_kernel(function: Callable[..., Any], separate: bool = False) -> Any:
    return _Kernel(function, separate)


def _mark_unit(unit: jit.CompiledUnit) -> Any:
    """An intrinsic by which other units call a unit: a call of a symbol of another object file."""
    signature = signature_of(unit.function)
    llvm.add_symbol(unit.symbol, _ANY_ADDRESS)

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        kinds = [context.get_value_type(kind) for kind in signature.args]
        kind = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
        function = cgutils.get_or_insert_function(builder.module, kind, unit.symbol)
        return builder.call(function, arguments)

    def typing(context: Any, *arguments: Any) -> Any:
        return signature, generate

    names = ["_context", *inspect.signature(unit.function).parameters]
    scope: dict[str, Any] = {"typing": typing}
    exec(f"def call({', '.join(names)}): return typing({', '.join(names)})", scope)
    return intrinsic(scope["call"])


_ANY_ADDRESS = 1  # for symbols of a module that is translated but never run


def _translate_only() -> None:
    """Let Numba translate kernels to LLVM code without making machine code of each.

    Nothing of it is called: machine code is made of whole units, below. It would take a sixth of
    the time.
    """

    def address(library: Any, _: str) -> int:
        library._ensure_finalized()
        return 0

    codegen.JITCodeLibrary.get_pointer_to_function = address
    codegen.JITCodeLibrary._finalize_specific = lambda _: None
    codegen.JITCPUCodegen._add_module = lambda *_: None
    codegen.JITCPUCodegen.set_env = lambda *_: None


@cache
def _machine() -> tuple[Any, Any]:
    """Target machine of this processor, and the passes of the optimiser."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=3,
        reloc="pic", codemodel="default",
    )  # fmt: skip
    return machine, llvm.create_pass_builder(machine, _optimiser_options())


def _optimiser_options() -> Any:
    # Measured: level 3, loop unrolling and vectorisation of straight-line code take a tenth more
    # time to compile, and runs are not faster.
    tuning = llvm.create_pipeline_tuning_options(speed_level=2)
    tuning.loop_vectorization = True
    tuning.loop_unrolling = False
    return tuning


def _mark_errors_unreachable(code: str) -> str:
    """The code with all branches that raise a Python exception marked as unreachable.

    Kernels raise nothing, but Numba cannot prove that an index of a short tuple is valid.
    """
    entrance = re.compile(r"^declare (\w+) @numba_gil_ensure\(([^)]*)\).*$", re.MULTILINE)
    return entrance.sub(r"define internal \1 @numba_gil_ensure(\2) {\n  unreachable\n}", code)


def compile_unit(unit: jit.CompiledUnit) -> tuple[bytes, tuple[str, ...]]:
    """Object file of a unit, and the names of the units that it calls."""
    made = numba.cfunc(signature_of(unit.function), nopython=True, **_OPTIONS)(unit.function)
    module = llvm.parse_assembly(_mark_errors_unreachable(made.inspect_llvm()))
    entry = next(f for f in module.functions if f.name == made._wrapper_name)
    for value in (*module.functions, *module.global_variables):
        if not value.is_declaration and value.name != entry.name:
            value.linkage = "internal"
    entry.name = unit.symbol
    machine, builder = _machine()
    passes = builder.getModulePassManager()
    passes.run(module, builder)
    outside = {f.name for f in module.functions if f.is_declaration}
    called = sorted(other.name for other in jit.UNITS.values() if other.symbol in outside)
    return machine.emit_object(module), tuple(called)


def main(arguments: list[str]) -> int:
    """Compile the units that standard input names, line by line, until it ends."""
    folder = Path(arguments[0])
    sys.modules["scipy"] = None  # type: ignore[assignment]  # else Numba loads its linear algebra
    jit.compile_with(_mark_kernel, _mark_unit)
    _define_calls()
    _translate_only()
    gc.set_threshold(500_000)  # Numba makes many objects, but few reference cycles
    for line in sys.stdin:
        name, file = line.rstrip("\n").split("\t")
        start = time.process_time()
        try:
            importlib.import_module(name.rpartition(".")[0])
            code, called = compile_unit(jit.UNITS[name])
            write_unit(folder / file, code, called)
            answer = f"done\t{name}\t{time.process_time() - start:.3f}"
        except OSError as error:
            answer = f"unwritable\t{name}\t{error.strerror or error}"
        except Exception as error:  # noqa: BLE001  the parent process reports it
            lines = f"{type(error).__name__}: {error}"
            if "-v" in arguments:
                lines = traceback.format_exc()
            answer = f"failed\t{name}\t{lines!r}"
        print(answer, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
