"""Vocabulary: how a run ended, the bounds of numbers, the checks of what Python callers pass.

status      codes, words and advice for the end of a run; no JAX
bounds      which values a number may have, declared once; no JAX
arguments   checks of known values, in one line that names the argument
"""
