"""What experiments with two vesicles share: the scene of the paper's pairs, and its history."""

import jax.numpy as jnp
import numpy as np

from experiments import _common
from jaxves import shapes, status
from jaxves.marching import AbstractMarch, Adaptive, Checks
from jaxves.scene import Scene, dc_field, make_scene

FIELD = jnp.pi / 2  # direction of the field, and of the vesicles' major axes at the start
_KEPT = (
    "center",
    "min_gap",
    "tank_treading_speed",
    "traction_ratio",
    "deformation",
    "inclination",
    "spectral_tail",
    "tension_tail",
    "residual",
)


def scene(
    conductivity_ratio=0.5, membrane_conductance=0.0, *, N=64, reduced_area=0.9, beta=3.2, offset=20.0, separation=2.6
) -> Scene:
    """Two equal ellipses along the field, the line of their centres `offset` degrees from x, `separation` long."""
    e = shapes.ellipse(N, reduced_area, angle=FIELD)
    direction = np.array([np.cos(np.deg2rad(offset)), np.sin(np.deg2rad(offset))])
    field = dc_field(beta, conductivity_ratio=conductivity_ratio, membrane_conductance=membrane_conductance, vesicles=2)
    return make_scene([e, e], centers=0.5 * separation * np.array([direction, -direction]), field=field)


def history(
    setting: Scene,
    t_end: float,
    saves: int,
    *,
    march: AbstractMarch | None = None,
    thinnest: float = 0.0,
    turned: float = np.inf,
    checks: Checks | None = None,
    together: int = 10,
) -> dict:
    """Marches a pair; what happened, by name, saved times first.

    Ends early ("settled") once the gap is below `thinnest` or the line of centres has turned by `turned` degrees.
    Angles in degrees: `angle` of the line of centres, followed in time, `dipole_angle` of each vesicle's dipole.
    """
    times = t_end * np.arange(1, saves + 1) / saves

    def settled(rows):
        angle = _line(rows)[0]
        return np.nanmin(rows["diagnostics/min_gap"]) < thinnest or abs(angle[-1] - angle[0]) > turned

    march = Adaptive(1e-4) if march is None else march
    state, rows, _ = _common.march(setting, march, times, checks=checks, together=together, until=settled)
    known = ~np.isnan(rows["t"])
    rows = {name: value[known] for name, value in rows.items()}
    angle, separation = _line(rows)
    dipole = rows["diagnostics/dipole"]
    code = int(state.status)
    ended = code == status.RUNNING and len(rows["t"]) < saves
    return {
        "word": "settled" if ended else status.WORDS[max(code, status.COMPLETE)],
        "steps": int(state.steps),
        "angle": angle,
        "separation": separation,
        "dipole_angle": np.rad2deg(np.arctan2(dipole[..., 1], dipole[..., 0])),
        **{name: rows[name] for name in ("t", "x", "V_m", "tension")},
        **{name: rows[f"diagnostics/{name}"] for name in _KEPT},
    }


def _line(rows) -> tuple[np.ndarray, np.ndarray]:
    """Angle in degrees, followed in time, and length of the line of centres."""
    line = rows["diagnostics/center"][:, 0] - rows["diagnostics/center"][:, 1]
    return np.rad2deg(np.unwrap(np.arctan2(line[:, 1], line[:, 0]))), np.hypot(*line.T)
