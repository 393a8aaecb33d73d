"""Quantities computed from a state, a time series or a run.

quantities      names, units and axes of the diagnostics; no JAX
registry        how a function registers as the one that computes some of the quantities
of_membranes, of_field, of_suspension   the functions: of each membrane, in a field, of all vesicles
of_charge       the functions for charge that relaxes in a finite time
of_averaging    how far a shape swings within a period that is averaged over
of_cell_stress  the mean stress of a suspension in a periodic cell
inner_stress    the viscous stress of the insides, where viscosities differ
of_ones_own     observables that users write
diagnostics     calls them all for one instant; time averages
rows            everything that is saved at one time
observing       computes a row from a state
outline         how fast shapes and scalars change at fixed places on the outlines
crossings       whether curves cross themselves or each other
checks          limits of a result, and the conditions that end a run early
classes         the class (P, O or POP) of a time series; no JAX
pair_classes    the same for pairs of vesicles; no JAX
angles          whether an inclination turns or only jumps; no JAX
shear_motion    treading, tumbling and swinging in shear: class, period, averages over half-turns; no JAX
pairs_in_cell   vectors between all centres in a periodic cell
pair_distribution, structure_factor   how the vesicles of a suspension are placed
chains          which vesicles form chains
displacements   mean squared displacements and diffusion of vesicles
rotor           the field beyond which a round vesicle turns by itself; no JAX
wrinkles        whether a smooth start missed wrinkles; no JAX
certificate     error estimates of a run, and whether it is inaccurate; no JAX
fields          velocity, pressure and electric field at any points
"""
