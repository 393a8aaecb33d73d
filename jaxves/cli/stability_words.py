"""The line of `jaxves show --stability`: whether small disturbances of the last state of a run grow, and which."""

import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.stability import Stability, stability
from ..equation.state import Unknowns
from ..inputs.scene_files import parse
from ..inputs.scene_tables import SceneFile
from ..numerics import fourier
from ..results.run_store import Record
from ..results.sweep_store import SweepRecord
from ..runs.build import build
from .console import start_jax

_MOST_NODES = 64  # a steady state in a few seconds
_NEAR = 0.05  # largest distance of the last state from a steady one, in a and a E_inf
_NEUTRAL = 1e-6  # a rate below this, in 1/t_kappa, is round-off
_PART = 0.01  # a share of the square of a mode that is worth a word


def words(record: Record | SweepRecord) -> str:
    """Returns one line."""
    if isinstance(record, SweepRecord) or not len(record.t):
        return "stability: not known without the last state of a run"
    if "vesicle" not in tomllib.loads(record.scene):
        return "stability: not known for a result made in Python, whose file has no scene"
    start_jax()
    scene_file = parse(tomllib.loads(record.scene))
    if reason := _unsuitable(scene_file):
        return f"stability: not known for {reason}"
    y = _last(record)
    scene = build(scene_file)
    scene = eqx.tree_at(lambda s: (s.x, s.V_m), scene, (y.x, None), is_leaf=lambda leaf: leaf is None)
    try:
        found = stability(scene, y, count=1)
    except ValueError:
        return "stability: not known in a flow or a field that is not uniform"
    apart = max(float(jnp.max(jnp.abs(a - b))) for a, b in zip(*map(jax.tree.leaves, (found.steady.y, y)), strict=True))
    if not (found.steady.converged and apart < _NEAR):
        return "stability: the last state is not near a steady one; a later t_end may help"
    return f"steady state {_told(found)} ({y.x.shape[1]} nodes)"


def _unsuitable(scene_file: SceneFile) -> str | None:
    """Returns which part of a scene excludes a steady state of one vesicle, in words."""
    if len(scene_file.vesicles()) != 1 or scene_file.cell is not None:
        return "several vesicles or a periodic cell"
    for name, table in (("field", scene_file.field), ("flow", scene_file.flow)):
        history = None if table is None else table.time
        if history is not None and history.kind == "ac" and not history.averaged:
            return "an AC field that is resolved; a run with averaged = true has a steady state"
        if history is not None and history.kind not in ("constant", "ac"):
            return f"a {name} that changes"
    return None


def _last(record: Record) -> Unknowns:
    """Returns the last state, with at most `_MOST_NODES` nodes."""
    scalars = record.scalars or ({} if record.V_m is None else {"V_m": record.V_m})
    N = min(_MOST_NODES, record.x.shape[2])
    y = Unknowns(jnp.asarray(record.x[-1]), {name: jnp.asarray(values[-1]) for name, values in scalars.items()})
    return jax.tree.map(lambda leaf: fourier.resample(leaf, N, axis=1), y)


def _told(found: Stability) -> str:
    rate = complex(found.rates[0])
    if np.isnan(rate):
        return "stable: nothing can disturb it"
    shape = float(jnp.sum(jnp.abs(found.shapes[0]) ** 2))
    changed = [name for name, share in (("shape", shape), ("charge", 1 - shape)) if share > _PART]
    which = [f"in {' and '.join(changed)}"]
    which += [f"breaking the symmetry {name}" for name, share in found.breaks.items() if share[0] > 0.5]
    if abs(rate.imag) > _NEUTRAL:
        which.append(f"with an angular frequency of {abs(rate.imag):.3g}/t_kappa")
    what = ", ".join(which)
    if abs(rate.real) < _NEUTRAL:
        return f"neutral: a disturbance neither grows nor decays, {what}"
    if rate.real > 0:
        return f"unstable: a disturbance grows at {rate.real:.3g}/t_kappa, {what}"
    return f"stable: the slowest disturbance decays at {-rate.real:.3g}/t_kappa, {what}"
