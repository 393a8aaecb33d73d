"""Definitions that all other folders use: status words, physical numbers, checks of arguments.

status      codes, words and advice for the end of a run; no JAX
bounds      the allowed values of each kind of number; no JAX
physical_numbers    every physical number of a scene, declared once; no JAX
arguments   checks of the arguments of Python functions
"""
