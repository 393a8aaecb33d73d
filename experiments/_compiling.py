"""Compiler options for programs that run once: toy runs and tests spend most of their time compiling."""

from importlib.metadata import version

# Machine code that is not optimised takes half the time to make; kernels by XLA's older emitters, which JAX 0.10 is the
# last to have, half of that again, and then run 1.7 times as long as optimised ones instead of three times.
QUICKLY = "--xla_backend_optimization_level=0"
if version("jaxlib").startswith("0.10."):
    QUICKLY += " --xla_cpu_use_fusion_emitters=false"
