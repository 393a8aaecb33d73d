"""How many time steps a run with adaptive steps may take, and how many a period needs. Nothing here imports JAX."""

MOST_STEPS = 200_000
STEPS_PER_PERIOD = 8  # the error estimate must see a field or a flow change
