"""Mathematics that knows nothing of vesicles.

arrays      names of array shapes, double precision
fourier     derivatives, integrals, resampling and filters of periodic functions at equispaced points
krylov      GMRES with a guaranteed end
linear      solvers of linear systems: dense factors, elimination by blocks, GMRES
batching    decisions that the lanes of a batch take together
"""
