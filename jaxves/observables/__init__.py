"""What is said about a state, a history or a run.

diagnostics     deformation, tension, energy, gaps and others at one instant
classes         which phase a history shows; no JAX
pair_classes    the same for pairs; no JAX
certificate     how well a run knows its own error; no JAX
fields          flow, pressure and electric field at any points
"""
