"""Definitions that all other folders use: status words, physical numbers, checks of arguments.

status      codes, words and advice for the end of a run; no JAX
bounds      the allowed values of each kind of number; no JAX
physical_numbers    every physical number of a scene, declared once; no JAX
jax_parts   parts of JAX that are not public, with a guard for each
arguments   checks of the arguments of Python functions
own_functions       checks of functions that users write
progress    how far a long call has come
resolution        modes of a shape that its nodes keep
time_steps  how many steps a run may take; no JAX
"""

from . import status

__all__ = ["status"]
