"""To how many digits are the positions of two vesicles known?

    python -m experiments.pair_accuracy          # five minutes: table, data/pair_accuracy.json

A circulating pair (Λ = 0.5, G = 0) at t = 5 and a chain (Λ = 0.1, G = 0) at t = 4.5 with a gap of a few hundredths are
compared with runs with more nodes and a lower tolerance. The circulating pair is also computed with its vesicles
numbered the other way round, which changes only round-off. It is also computed rotated by 0.7 with its field. This
changes the steps too, because their size follows from the errors of components. Round-off in the highest modes grows
to the size of the tolerance. With tolerance 1e-4 and 64 nodes this leads to differences of 1e-3 at t = 5, so all runs
here have low tolerances.

What to expect: centres and angles of the circulating pair to 1e-6, those of the chain and its gap to 1e-4.
"""

import equinox as eqx
import numpy as np

from experiments import _common, _pairs
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.schemes import ARK4, ARK5

CASES = {  # Λ, end, (nodes, tolerance) and those of the finer run
    "circulating": (0.5, 5.0, (96, 1e-7), (128, 2e-8)),
    "chain": (0.1, 4.5, (96, 1e-6), (128, 3e-7)),
}
TURN = 0.7
ROTATION = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])  # of rows, from the right
QUICK = dict(
    cases={"circulating": (0.5, 0.5, (32, 1e-3), (32, 1e-5))}, symmetries=(32, 1e-3, 0.5), saves=4, stepper=ARK4()
)


def run(cases=CASES, symmetries=(96, 1e-7, 5.0), saves=10, stepper=ARK5()):  # noqa: B008
    """Returns {case: differences and steps}. `symmetries` has nodes, tolerance and end for the equivalent scenes."""
    found = {}
    for name, (ratio, t_end, *both) in cases.items():
        coarse, fine = (
            _pairs.history(_pairs.scene(ratio, N=N), t_end, saves, march=Adaptive(tolerance, stepper))
            for N, tolerance in both
        )
        found[name] = difference(coarse, fine) | {
            "words": (coarse["word"], fine["word"]),
            "steps": (coarse["steps"], fine["steps"]),
            "cases": both,
            "gap at the end": float(fine["min_gap"][-1]),
        }
    N, tolerance, t_end = symmetries
    march = Adaptive(tolerance, stepper)
    settings = same_scenes(_pairs.scene(0.5, N=N))
    base, swapped, turned = (_pairs.history(setting, t_end, saves, march=march) for setting in settings)
    found["numbered anew"] = difference(base, {**swapped, "center": swapped["center"][:, ::-1]}) | {
        "inclination": angle_between(base["inclination"][-1], swapped["inclination"][-1][::-1])
    }
    found["turned"] = difference(base, {**turned, "center": turned["center"] @ ROTATION.T}) | {
        "inclination": angle_between(base["inclination"][-1] + TURN, turned["inclination"][-1])
    }
    return found


def same_scenes(setting):
    """Returns the scene, with its vesicles in the other order, and rotated by TURN with its field."""
    swapped = eqx.tree_at(lambda s: s.x, setting, setting.x[::-1])
    turned = eqx.tree_at(
        lambda s: (s.x, s.field.direction),
        setting,
        (setting.x @ ROTATION, setting.field.direction @ ROTATION),
    )
    return setting, swapped, turned


def angle_between(a, b) -> float:
    """Returns the largest angle between axes of these directions."""
    return float(np.max(np.abs((a - b + 0.5 * np.pi) % np.pi - 0.5 * np.pi)))


def difference(a: dict, b: dict) -> dict:
    """Returns the differences of two time series at the end: centres, inclinations (radians), relative gap."""
    return {
        "t": float(a["t"][-1]),
        "center": float(np.max(np.abs(a["center"][-1] - b["center"][-1]))),
        "inclination": angle_between(a["inclination"][-1], b["inclination"][-1]),
        "gap": float(abs(a["min_gap"][-1] / b["min_gap"][-1] - 1)),
    }


def main():
    found = run()
    for name, case in found.items():
        print(
            f"{name}, t = {case['t']:g}: centres {case['center']:.1e}, inclinations {case['inclination']:.1e}, "
            f"gap {case['gap']:.1e}",
            *(f"; {key} {case[key]}" for key in ("words", "steps", "cases", "gap at the end") if key in case),
        )
    _common.store("pair_accuracy", found)


if __name__ == "__main__":
    main()
