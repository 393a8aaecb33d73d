"""How many Fourier modes of a shape its nodes keep. Nothing here imports JAX."""

AUTO_NODES = (64, 96, 128, 192, 256)  # the numbers of nodes of a run with `nodes = "auto"`


def removed_modes(N: int) -> int:
    """Returns the number of highest modes of the shape that are removed after every step, by default."""
    return max(2, N // 16)


def kept_modes(N: int) -> int:
    """Returns the highest mode of the shape that N nodes keep."""
    return N // 2 - removed_modes(N)
