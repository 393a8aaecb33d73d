"""Quantities computed from a state, a time series or a run.

quantities      names, units and axes of the diagnostics; no JAX
diagnostics     deformation, tension, energy, gaps and others at one instant
rows            what is saved of one instant; no JAX
observing       computes a row from a state
checks          limits beyond which a saved instant is no result
classes         the class (P, O or POP) of a time series; no JAX
pair_classes    the same for pairs of vesicles; no JAX
rows            everything that is saved at one time
checks          limits of a result, and the end of a run
certificate     error estimates of a run; no JAX
fields          velocity, pressure and electric field at any points
"""
