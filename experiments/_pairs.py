"""The scene of the paper's pairs and their time series, for experiments with two vesicles."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from experiments import _common
from jaxves.base import status
from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.observables import pair_classes
from jaxves.observables.checks import Checks
from jaxves.operators.interactions import AbstractCoupling
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.loop import initial_state, stops_of
from jaxves.stepping.march import AbstractMarch
from jaxves.stepping.record import advance

_advance = eqx.filter_jit(advance)
_equation_for = eqx.filter_jit(equation_for)
_initial_state = eqx.filter_jit(initial_state)

FIELD = jnp.pi / 2  # direction of the field, and of the vesicles' major axes at the start
_KEPT = (
    "center",
    "min_gap",
    "tank_treading_speed",
    "traction_ratio",
    "deformation",
    "self_gap",
    "inclination",
    "spectral_tail",
    "tension_tail",
    "residual",
)


def scene(
    conductivity_ratio=0.5, membrane_conductance=0.0, *, N=64, reduced_area=0.9, beta=3.2, offset=20.0, separation=2.6
) -> Scene:
    """Returns two equal ellipses along the field, with the line of centres at `offset` degrees from x."""
    e = shapes.ellipse(N, reduced_area, angle=FIELD)
    direction = np.array([np.cos(np.deg2rad(offset)), np.sin(np.deg2rad(offset))])
    field = dc_field(beta, conductivity_ratio=conductivity_ratio, membrane_conductance=membrane_conductance, vesicles=2)
    return make_scene([e, e], centers=0.5 * separation * np.array([direction, -direction]), field=field)


def resolved(nodes, film: float, t_end: float, saves: int, *, turned: float = 270.0, **parameters) -> dict:
    """The history of a pair, and its class: with the first of `nodes` that resolve it to the end, or else the last.

    With more than the first of them the tolerance is a hundredth: what it leaves in the tension roughens thin films.
    Ends early once the class is known: at rest with the gap below `film`, or turned by `turned` degrees. Where all
    end as unresolved and leave the class open, the first goes on all the same, with "film" as its word.
    """
    for N in nodes:
        march = Adaptive(1e-4 if nodes[0] == N else 1e-6)
        found = history(scene(N=N, **parameters), t_end, saves, march=march, thinnest=film, turned=turned)
        if found["word"] != "unresolved":
            break
    if found["word"] == "unresolved" and classified(found) == "open":
        N = nodes[0]
        going_on = Checks(film=np.inf)
        found = history(scene(N=N, **parameters), t_end, saves, thinnest=film, turned=turned, checks=going_on)
        found["word"] = "film"
    return found | {"N": N, "class": classified(found), "turns": float(np.sign(found["angle"][-1] - found["angle"][0]))}


def classified(found: dict) -> str:
    """Returns the class of a time series from `history`."""
    return pair_classes.classify(
        found["t"], np.deg2rad(found["angle"]), found["separation"], found["min_gap"], float(FIELD)
    )


def summary(found: dict) -> str:
    """Returns one line of text."""
    t, angle, gap = found["t"], found["angle"], found["min_gap"]
    tails = found["spectral_tail"].max(), found["tension_tail"].max()
    return (
        f"{found['class']:11} {found['word']:10} N = {found['N']:3d}, t = {t[-1]:5.2f}; "
        f"angle {angle.min():6.0f} … {angle.max():4.0f}, last {angle[-1]:6.1f}; "
        f"gap {gap.min():.4f}, last {gap[-1]:.4f}; tails {tails[0]:.0e} {tails[1]:.0e}"
    )


def stored(found: dict) -> dict:
    """Returns the part of a time series that is stored."""
    last = {name: found[name][-1] for name in ("tank_treading_speed", "traction_ratio", "deformation")}
    tails = {name: found[name].max() for name in ("spectral_tail", "tension_tail")}
    kept = ("word", "N", "class", "turns", "swings", "t", "angle", "separation", "min_gap")
    return {name: found[name] for name in kept if name in found} | {"last": last, "greatest": tails}


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
    coupling: AbstractCoupling | None = None,
) -> dict:
    """Runs a pair; returns time series by name, with the saved times as first axis.

    The run ends early ("settled") once the gap is below `thinnest` and the line of centres is along the field to 3
    degrees for the last `together` saves, or at rest in another direction, or once that line has turned by `turned`
    degrees. Angles are in degrees: `angle` of the line of centres, continuous in time, and `dipole_angle` of the dipole
    of each vesicle.
    """
    times = t_end * np.arange(1, saves + 1) / saves

    def settled(rows):
        angle, separation = _line(rows)
        gap = rows["min_gap"]
        tilt = (angle[-together:] - np.rad2deg(FIELD) + 90) % 180 - 90
        known = {"t": rows["t"], "angle": angle, "separation": separation, "min_gap": gap}
        at_rest = np.all(np.abs(tilt) < 3) or classified(known) == "slanted"
        return (gap[-1] < thinnest and at_rest) or abs(angle[-1] - angle[0]) > turned

    march = Adaptive(1e-4) if march is None else march
    equation = _equation_for(setting, coupling=coupling)
    state, parts = _initial_state(equation, march), []
    for i in range(0, len(times), together):
        stops, part = stops_of(setting, times[-1]), jnp.asarray(times[i : i + together])
        state, saved = _advance(equation, march, state, part, stops, checks or Checks())
        parts.append(_common.by_name(saved))
        rows = jax.tree.map(lambda *arrays: np.concatenate(arrays), *parts)
        if int(state.status) != status.RUNNING or settled(rows):
            break
    known = ~np.isnan(rows["t"])
    rows = {name: value[known] for name, value in rows.items()}
    angle, separation = _line(rows)
    dipole = rows["dipole"]
    code = int(state.status)
    ended = code == status.RUNNING and len(rows["t"]) < saves
    return {
        "word": "settled" if ended else status.WORDS[max(code, status.COMPLETE)],
        "steps": int(state.steps),
        "angle": angle,
        "separation": separation,
        "dipole_angle": np.rad2deg(np.arctan2(dipole[..., 1], dipole[..., 0])),
        **{name: rows[name] for name in ("t", "x", "V_m", "tension")},
        **{name: rows[name] for name in _KEPT},
    }


def _line(rows) -> tuple[np.ndarray, np.ndarray]:
    """Returns the angle of the line of centres in degrees, continuous in time, and its length."""
    line = rows["center"][:, 0] - rows["center"][:, 1]
    return np.rad2deg(np.unwrap(np.arctan2(line[:, 1], line[:, 0]))), np.hypot(*line.T)
