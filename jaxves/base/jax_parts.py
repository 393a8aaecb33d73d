"""Parts of JAX outside of its stable public interface.

Each part has a guard. Its error names the part and a release of JAX that has it.
"""

from collections.abc import Callable
from typing import Any

import jax

KNOWN_JAX = "0.10.2"  # a release that has all of them
_BARRIER = "jax._src.distributed.global_state.client.wait_at_barrier"


def _lacks(part: str, error: Exception) -> str:
    return f"jax {jax.__version__} lacks {part} ({error})"


def tracer_type() -> type:
    """Returns the class of the values that JAX traces.

    Raises:
        ImportError: this release of JAX does not have it under the known name.
    """
    try:
        return jax.core.Tracer
    except AttributeError as error:
        raise ImportError(
            f"jaxves cannot tell traced values from known ones: {_lacks('jax.core.Tracer', error)}; "
            f"python -m pip install jax=={KNOWN_JAX}"
        ) from error


def barrier() -> Callable[..., Any]:
    """Returns the function with which the processes of `jax.distributed` wait for each other, with a time limit.

    JAX's public barrier is a collective operation, which on CPUs fails after half a minute. The service behind
    `jax.distributed` has a barrier whose time limit can be set.

    Raises:
        RuntimeError: this release of JAX does not have it.
    """
    try:
        from jax._src.distributed import global_state

        return global_state.client.wait_at_barrier
    except (ImportError, AttributeError) as error:
        raise RuntimeError(
            f"The processes of a sweep cannot wait for each other: {_lacks(_BARRIER, error)}; use one process, or "
            f"python -m pip install jax=={KNOWN_JAX}"
        ) from error
