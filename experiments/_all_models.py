"""Random scene files of all models: effects alone and combined, with numbers over their whole ranges."""

from typing import NamedTuple

import numpy as np
from shapely import LineString

from jaxves.geometry import outlines
from jaxves.inputs.scene_files import SceneError, SceneFile, parse

SAVES = 5


class Model(NamedTuple):
    """Which effects a scene has.

    `field` is "" for none, "dc", "ac" (resolved), "averaged" or "pulse"; `place` is "alone", "pair" or "cell".
    """

    field: str = ""
    flow: bool = False
    viscosities: bool = False
    relaxing: bool = False
    place: str = "alone"

    def label(self) -> str:
        """Returns the effects in words."""
        words = {"dc": "field", "ac": "AC field", "averaged": "averaged AC", "pulse": "pulse"}
        parts = [words.get(self.field, ""), "flow" * self.flow, "ν" * self.viscosities, "δ" * self.relaxing]
        return ", ".join([part for part in parts if part] + [self.place] * (self.place != "alone"))


MODELS = (
    Model("dc"),
    Model("dc", flow=True),
    Model(flow=True),
    Model(flow=True, viscosities=True),
    Model("dc", viscosities=True),
    Model("dc", flow=True, viscosities=True),
    Model("dc", relaxing=True),
    Model("dc", flow=True, relaxing=True),
    Model("dc", flow=True, viscosities=True, relaxing=True),
    Model("ac"),
    Model("ac", relaxing=True),
    Model("averaged"),
    Model("averaged", relaxing=True),
    Model("averaged", flow=True, viscosities=True),
    Model("pulse"),
    Model("pulse", viscosities=True, relaxing=True),
    Model("dc", place="pair"),
    Model("dc", flow=True, viscosities=True, place="pair"),
    Model(flow=True, place="pair"),
    Model("averaged", relaxing=True, place="pair"),
    Model("dc", flow=True, place="cell"),
    Model(flow=True, place="cell"),
    Model("dc", place="cell"),
    Model("ac", flow=True, place="cell"),
)


def model_of(index: int) -> Model:
    """Returns the model of scene `index`: all models take turns."""
    return MODELS[index % len(MODELS)]


def drawn(seed: int, index: int) -> tuple[SceneFile, list[str]]:
    """Returns scene `index` of a seed, and the messages for the scenes that were drawn before it and refused.

    It ends after 3 to 20 of its shortest time scales, at most at 0.5.
    """
    rng, refused = np.random.default_rng([seed, index]), []
    while True:
        tables = _tables(rng, model_of(index))
        try:
            return parse(tables), refused
        except SceneError as error:
            refused.append(str(error))


def _log(rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _tables(rng, model: Model) -> dict:
    """Returns the tables of a random scene."""
    vesicle = {"reduced_area": float(rng.uniform(0.3, 1.0)), "angle": float(rng.uniform(0.0, 180.0))}
    tables, rates = {"vesicle": [vesicle], "saves": SAVES}, [2.0]
    if model.field:
        tables["field"], strength = _field(rng, model)
        rates.append(strength)
    if model.flow:
        tables["flow"], rate = _flow(rng, model)
        rates.append(2 * rate)
    if model.viscosities:
        tables["fluid"] = {"viscosity_ratio": _log(rng, 1e-6, 1e8)}
    auto = rng.random() < (0.3 if model.place == "alone" else 0.1)
    tables["numerics"] = {"nodes": "auto" if auto and max(rates) < 300 else 64}
    t_end = min(0.5, _log(rng, 3.0, 20.0) / max(rates))
    if model.field in ("ac", "averaged"):
        # A resolved field has up to ten periods, an averaged one any number.
        averaged = model.field == "averaged"
        frequency = _log(rng, 1e-2, 1e3) / tables["field"]["chi"] if averaged else _log(rng, 0.5, 10.0) / t_end
        tables["field"]["time"] = {
            "kind": "ac", "frequency": frequency, "averaged": averaged,
            "offset": float(rng.choice([0.0, 0.3])), "phase": float(rng.uniform(0, 360)),
        }  # fmt: skip
    if model.field == "pulse":
        tables["field"]["time"] = {
            "kind": "pulse", "start": 0.1 * t_end,
            "duration": _log(rng, 0.05, 0.5) * t_end, "rise": _log(rng, 1e-3, 0.2) * t_end,
        }  # fmt: skip
    if model.place == "pair":
        tables["pair"] = _pair(rng, vesicle)
    if model.place == "cell":
        vesicle["reduced_area"] = float(rng.uniform(0.6, 1.0))
        side = float(rng.uniform(2.8, 5.0))
        tables["cell"] = {"lattice": [[side, 0.0], [0.0, float(rng.uniform(0.9, 1.4)) * side]]}
        if rng.random() < 0.3:
            tables["suspension"] = {"count": 2, "seed": int(rng.integers(1000))}
    return tables | {"t_end": t_end}


def _field(rng, model: Model) -> tuple[dict, float]:
    """Returns a [field], and its strength relative to the bending stress."""
    chi, strength = _log(rng, 1e-7, 10.0), _log(rng, 0.1, 1e5)
    ratio = _log(rng, 1e-3, 1e3)
    if rng.random() < 0.2:
        ratio = 0.0 if rng.random() < 0.5 or model.relaxing else float("inf")
    field = {
        "beta": strength * chi,
        "chi": chi,
        "conductivity_ratio": ratio,
        "membrane_conductance": 0.0 if rng.random() < 0.5 else _log(rng, 1e-2, 1e3),
        "permittivity_ratio": _log(rng, 0.03, 30.0),
    }
    if model.relaxing:
        field["charge_relaxation"] = _log(rng, 1e-5, 1.0)
    return field, strength


def _flow(rng, model: Model) -> tuple[dict, float]:
    """Returns a [flow] and its rate: a shear in cells, and elsewhere any direction between a shear and an extension."""
    rate = _log(rng, 0.1, 1e3)
    if model.place == "cell":
        return {"kind": "shear", "capillary_number": rate}, rate
    turn, spin = rng.uniform(0, 2 * np.pi), rate * rng.uniform()
    c, s = rate * np.cos(turn), rate * np.sin(turn)
    return {"kind": "linear", "gradient": [[float(c), float(s + spin)], [float(s - spin), float(-c)]]}, rate


def _pair(rng, vesicle: dict) -> dict:
    """Returns a [pair] with a gap of 0.02 to 1 along the line of the centres."""
    offset, gap = float(rng.uniform(0.0, 90.0)), _log(rng, 0.02, 1.0)
    return {"separation": touching(vesicle, offset) + gap, "offset_angle": offset}


def touching(vesicle: dict, offset_angle: float) -> float:
    """Returns the distance of the centres at which two copies of an ellipse touch: its width in this direction."""
    shape = outlines.ellipse_polygon(vesicle["reduced_area"])
    shape = outlines.placed(shape, 1.0, vesicle["angle"], (0.0, 0.0))
    x, y = 4 * np.cos(np.deg2rad(offset_angle)), 4 * np.sin(np.deg2rad(offset_angle))
    return shape.intersection(LineString([(-x, -y), (x, y)])).length
