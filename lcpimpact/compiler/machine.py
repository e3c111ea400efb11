"""The compiler of LLVM for this processor: from the text of functions to machine code that can be called and kept."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from threading import RLock

from llvmlite import binding

from lcpimpact.cache import variable

LOCK = RLock()
"""Held while code is compiled or loaded."""


@cache
def processor() -> tuple[str, str]:
    """Return the name and the features of the processor for which code is made, this one unless LCPIMPACT_CPU names it."""
    name = variable("LCPIMPACT_CPU")
    return (name, "") if name else (binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten())


@cache
def machine() -> binding.TargetMachine:
    """Return the compiler for this processor."""
    name, features = processor()
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=2, codemodel="jitdefault", jit=True
    )


@cache
def engine() -> binding.ExecutionEngine:
    """Return the holder of machine code."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    other = binding.Target.from_default_triple().create_target_machine(jit=True)
    return binding.create_mcjit_compiler(binding.parse_assembly(""), other)


def machine_code(text: str, *, vectors: bool = False) -> bytes:
    """Return the machine code of a module.

    With ``vectors`` loops over lanes become operations on vectors, which doubles the time of compilation, and gains nothing
    for loops over the few rows of an impact.
    """
    with LOCK:
        module = binding.parse_assembly(text)
        module.verify()  # LLVM ends the process where it compiles what is not well formed
        options = binding.create_pipeline_tuning_options(speed_level=3 if vectors else 2)
        options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = vectors
        builder = binding.create_pass_builder(machine(), options)
        builder.getModulePassManager().run(module, builder)
        return bytes(machine().emit_object(module))


def load(code: bytes, symbols: Mapping[str, int]) -> None:
    """Take machine code into this process, with the addresses of what it calls."""
    with LOCK:
        for name, address in symbols.items():
            binding.add_symbol(name, address)
        engine().add_object_file(binding.ObjectFileRef.from_data(code))
        engine().finalize_object()


def address_of(symbol: str) -> int:
    """Return the address of a function that was loaded."""
    with LOCK:
        return int(engine().get_function_address(symbol))
