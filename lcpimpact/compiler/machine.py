"""The compiler of LLVM for this processor: from the text of functions to machine code that can be called and kept."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from threading import RLock
from types import ModuleType
from typing import TYPE_CHECKING

from lcpimpact.cache import variable

if TYPE_CHECKING:
    from llvmlite.binding import ExecutionEngine, TargetMachine

LOCK = RLock()
"""Held while code is compiled or loaded."""


@cache
def llvm() -> ModuleType:
    """Return LLVM, ready for this processor; it is loaded at its first use, which takes a second from a cold disk."""
    binding = import_module("llvmlite.binding")
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding


@cache
def processor() -> tuple[str, str]:
    """Return the name and the features of the processor for which code is made, this one unless LCPIMPACT_CPU names it."""
    name = variable("LCPIMPACT_CPU")
    return (name, "") if name else (llvm().get_host_cpu_name(), llvm().get_host_cpu_features().flatten())


@cache
def machine() -> TargetMachine:
    """Return the compiler for this processor."""
    name, features = processor()
    return (
        llvm()
        .Target.from_default_triple()
        .create_target_machine(cpu=name, features=features, opt=2, codemodel="jitdefault", jit=True)
    )


@cache
def engine() -> ExecutionEngine:
    """Return the holder of machine code."""
    other = llvm().Target.from_default_triple().create_target_machine(jit=True)
    return llvm().create_mcjit_compiler(llvm().parse_assembly(""), other)


def machine_code(text: str, *, vectors: bool = False) -> bytes:
    """Return the machine code of a module.

    With ``vectors`` loops over lanes become operations on vectors, which doubles the time of compilation, and gains nothing
    for loops over the few rows of an impact.
    """
    with LOCK:
        module = llvm().parse_assembly(text)
        module.verify()  # LLVM ends the process where it compiles what is not well formed
        options = llvm().create_pipeline_tuning_options(speed_level=3 if vectors else 2)
        options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = vectors
        builder = llvm().create_pass_builder(machine(), options)
        builder.getModulePassManager().run(module, builder)
        return bytes(machine().emit_object(module))


def load(code: bytes, symbols: Mapping[str, int]) -> None:
    """Take machine code into this process, with the addresses of what it calls."""
    with LOCK:
        for name, address in symbols.items():
            llvm().add_symbol(name, address)
        engine().add_object_file(llvm().ObjectFileRef.from_data(code))
        engine().finalize_object()


def address_of(symbol: str) -> int:
    """Return the address of a function that was loaded."""
    with LOCK:
        return int(engine().get_function_address(symbol))
