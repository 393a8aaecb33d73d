"""The motion of vesicles in a shear flow, as a sweep keeps it: class, time of half a turn, average [μ].

The compiled program gives the time series from which they follow, under names that begin with SERIES. They are reduced
on the host, because the number of half-turns is not known in advance.
"""

import numpy as np
from jaxtyping import Array

from ..inputs.scene_tables import SceneFile
from ..observables import shear_motion
from ..physics.scene import Scene
from ..results.sweep_store import Variable

SERIES = "motion/"
VARIABLES = {
    "motion": Variable("1", "motion in shear: treading, tumbling, swinging, or open; joined by +", dtype="S64"),
    "half_turn": Variable("t_kappa", "mean time of half a turn, of vesicles that tumble", ("vesicle",)),
    "effective_viscosity_tumbling": Variable("1", "average over whole half-turns, of one vesicle that tumbles"),
}
DIAGNOSTICS = ("inclination_unwrapped", "effective_viscosity")  # of which time series are needed


def has_motion(scene_file: SceneFile) -> bool:
    """Returns whether the vesicles of a scene have a motion in shear."""
    return shear_motion.is_sheared(scene_file.model_dump(by_alias=True, exclude_none=True))


def series(t: Array, found: dict[str, Array] | None, scene: Scene) -> dict[str, Array]:
    """Returns what `reduced` needs of one case, by name; `found` has the time series of DIAGNOSTICS, or is None."""
    if found is None:
        return {}
    M = scene.x.shape[0]
    ratio = np.ones(M) if scene.viscosity_ratio is None else scene.viscosity_ratio
    return {f"{SERIES}{name}": value for name, value in (found | {"t": t, "ratio": ratio}).items()}


def reduced(found: dict[str, np.ndarray], useful: list[bool]) -> dict[str, np.ndarray]:
    """Returns the arrays of several cases with the motion in place of its time series, first axis the cases.

    Cases that are not `useful` have no class.
    """
    if f"{SERIES}t" not in found:
        return found
    own = {name.removeprefix(SERIES): value for name, value in found.items() if name.startswith(SERIES)}
    viscosity = own.get("effective_viscosity", [None] * len(useful))  # some scenes in cells have none
    cases = zip(own["t"], own["inclination_unwrapped"], own["ratio"], viscosity, strict=True)
    motions = [shear_motion.motion_of(*case) for case in cases]
    words = ["+".join(motion.names) if use else "" for motion, use in zip(motions, useful, strict=True)]
    rest = {name: value for name, value in found.items() if not name.startswith(SERIES)}
    return rest | {
        "motion": np.array(words, dtype="S64"),
        "half_turn": np.array([motion.half_turn for motion in motions]),
        "effective_viscosity_tumbling": np.array([motion.viscosity for motion in motions]),
    }
