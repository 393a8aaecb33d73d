"""How many Fourier modes of a shape its nodes keep, and how many nodes wrinkles need. Nothing here imports JAX."""

import math

AUTO_NODES = (64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048)  # the numbers of nodes for `nodes = "auto"`
DEFAULT_NODES = 64  # of each vesicle, wherever the number is fixed and nothing is said
USUAL_NODES = 256  # the largest of them, and the number for all rows, unless the membrane may be compressed strongly
# Potentials below this size, in a E_inf, are resolved relative to it: their high modes do not matter to the motion.
SMALL_POTENTIAL = 1e-2
NODES_PER_WAVE = 3 * math.sqrt(3)  # for the fastest growing wrinkle, to compute its amplitude to 0.1 %


def removed_modes(N: int) -> int:
    """Returns the number of highest modes of the shape that are removed after every step, by default."""
    return max(2, N // 16)


def kept_modes(N: int) -> int:
    """Returns the highest mode of the shape that N nodes keep."""
    return N // 2 - removed_modes(N)


def nodes_for_modes(modes: int) -> int:
    """Returns the fewest nodes of `AUTO_NODES` that keep this many modes, or the largest number."""
    return next((N for N in AUTO_NODES if kept_modes(N) >= modes), AUTO_NODES[-1])


def nodes_for_waves(waves: float) -> float:
    """Returns the number of nodes that this number of wrinkles around a vesicle needs.

    With λ_min, the most negative tension in units of κ_B/ρ² for a perimeter of 2πρ, the fastest growing wrinkle has
    √(|λ_min|/3) waves. The rule is then N = 3 √|λ_min|.
    """
    return NODES_PER_WAVE * waves


def sizes_up_to(nodes: float | int) -> tuple[int, ...]:
    """Returns the numbers of `AUTO_NODES` up to the first that is at least `nodes`, and at least `USUAL_NODES`."""
    wanted = max(nodes, USUAL_NODES)
    last = next((N for N in AUTO_NODES if wanted <= N), AUTO_NODES[-1])
    return tuple(N for N in AUTO_NODES if last >= N)
