"""Compiler options for programs that run once: toy runs and tests spend most of their time compiling."""

from jaxves.base.compiling import FOR_SHORT_RUNS, flags

# Both together shorten compiling by about a fifth. Code is then not generated in parallel, but tests run in parallel.
_ONCE = {"xla_llvm_disable_expensive_passes": True, "xla_cpu_parallel_codegen_split_count": 1}
QUICKLY = flags(FOR_SHORT_RUNS | _ONCE)
