"""Which of the paper's phases a vesicle went through, from the history of its deformation along the field.

    P      prolate throughout              D never below -THRESHOLD
    O      becomes oblate and stays        D below -THRESHOLD at the end
    POP    prolate, oblate, prolate        D below -THRESHOLD on the way, above THRESHOLD at the end
    open   none of these yet               the run ended on the way, or the vesicle is nearly round

D = (√I_∥ - √I_⊥)/(√I_∥ + √I_⊥); THRESHOLD = 0.01 keeps round-off and near-circles out. A start that is
already oblate counts from where it is: becoming and staying prolate is then "P".
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

THRESHOLD = 0.01
NAMES = ("open", "P", "O", "POP")
OPEN, P, O, POP = range(4)  # noqa: E741


def classify(deformation: Float[Array, "T *rest"]) -> Int[Array, "*rest"]:
    """Index into `NAMES`, from D at the saved times (first axis); rows that are NaN are ignored."""
    known = ~jnp.isnan(deformation)
    last = jnp.max(jnp.where(known, jnp.arange(deformation.shape[0]).reshape(-1, *[1] * (deformation.ndim - 1)), 0), 0)
    end = jnp.take_along_axis(deformation, last[None], axis=0)[0]
    start_prolate = deformation[0] > -THRESHOLD
    dipped = jnp.any(jnp.where(known, deformation, 0.0) < -THRESHOLD, axis=0) & start_prolate
    ends_prolate, ends_oblate = end > THRESHOLD, end < -THRESHOLD
    return jnp.where(ends_oblate, O, jnp.where(ends_prolate, jnp.where(dipped, POP, P), OPEN))
