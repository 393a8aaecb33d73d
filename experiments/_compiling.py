"""Compiler options for programs that run once: toy runs and tests spend most of their time compiling."""

from jaxves.base.compiling import FOR_SHORT_RUNS, flags

QUICKLY = flags(FOR_SHORT_RUNS)
