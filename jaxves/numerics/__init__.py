"""Numerical methods that do not depend on vesicles.

arrays      names for array shapes, double precision
fourier     derivatives, integrals, resampling and filters of periodic functions on equispaced points
krylov      GMRES that stops when it no longer converges, and Chebyshev iteration
linear      solvers for linear systems: LU, Cholesky, elimination, GMRES
logarithm   the logarithm as arithmetic that XLA vectorises on CPUs
batching    one common branch for all elements of a batch
valid_rows  functions over lists of fixed length whose valid rows come first
"""
