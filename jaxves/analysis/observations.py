"""Observations of a vesicle, and the model that computes the same quantities from the numbers of a scene.

observed = {"deformation_along_field": D}, any diagnostics (T, …) at t_end k/T, k = 1 … T, and "radii" (T, M, K)

Several runs that differ in some numbers of the scene, such as a sweep of the frequency, are observed together. Their
`conditions` have these numbers, and every quantity has a leading axis for the runs.

The outlines of a film are observed as "outline" (F, q), by the gauge that compares them with shapes (`film_gauge`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base import status
from ..base.arguments import require
from ..base.bounds import POSITIVE
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..geometry.frames import Frames
from ..inputs.parameters import check_numbers
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import FIT
from ..numerics import fourier
from ..numerics.arrays import ScalarLike, VesiclePoints, as_float
from ..runs.case import Case
from ..stepping.march import AbstractMarch
from ..stepping.marching import Result
from .film_gauge import Gauge, gauge


class Observations(NamedTuple):
    """Observed quantities by name, at T equally spaced times up to `t_end`, and their standard deviations.

    The times are t_end k/T for k = 1 … T, so t = 0 is not among them. Diagnostics of vesicles have the shape (T, M).

    With `conditions` = {"field.time.frequency": f}, f of shape (C,), there are C runs with these numbers, and the
    quantities have shape (C, T, ...).
    """

    t_end: float
    seen: dict[str, Float[np.ndarray, "..."]]
    deviation: dict[str, float]
    gauge: Gauge | None = None  # of "outline"
    conditions: Mapping[str, Sequence[float]] | None = None

    @classmethod
    def of_frames(cls, frames: Frames, time_unit: ScalarLike) -> "Observations":
        """Returns the outlines of a film as observations; `time_unit` is t_κ in s, and lengths are in units of a."""
        made, seen, t_end = gauge(frames, time_unit)
        return cls(t_end, {"outline": seen}, {"outline": 1.0}, made)


def radii(x: VesiclePoints, K: int) -> Float[Array, "M K"]:
    """Returns the distances from the centroid to the outline in K directions (M, K), the first along x.

    This is the form in which an observed shape is given. A ray from the centroid must meet the outline once. The
    outline is interpolated linearly between four times as many nodes.
    """

    def one(x):
        fine = fourier.resample(x, 4 * x.shape[0], axis=0) - geometry.centroid(Curve.from_nodes(x))
        angle = jnp.unwrap(jnp.arctan2(fine[:, 1], fine[:, 0]))
        radius = jnp.sqrt(jnp.sum(fine**2, axis=-1))
        wanted = 2 * jnp.pi * jnp.arange(K) / K
        return jnp.interp(wanted, angle, radius, period=2 * jnp.pi)

    return jax.vmap(one)(x)


Translation = Callable[[Mapping[str, Array]], Mapping[str, ScalarLike]]


class Model(eqx.Module):
    """A function from the unknowns to the observed quantities at the observed times.

    The unknowns are numbers of the scene, or what `numbers` translates into numbers of the scene.
    """

    scene_file: SceneFile = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    directions: int = eqx.field(static=True)  # of "radii"
    saves: int = eqx.field(static=True)
    t_end: float = eqx.field(static=True)
    march: AbstractMarch
    gauge: Gauge | None = None
    conditions: dict[str, Float[Array, "C"]] | None = None
    numbers: Translation | None = eqx.field(static=True, default=None)

    @classmethod
    def of(
        cls,
        scene_file: SceneFile,
        observations: Observations,
        march: AbstractMarch | None = None,
        numbers: Translation | None = None,
    ) -> "Model":
        """Returns the model of a scene for these observations.

        Raises:
            ValueError: the observations do not fit together.
            SceneError: the scene has a key that no fit can honour.
        """
        require("observations.t_end", observations.t_end, POSITIVE)
        conditions = _conditions(scene_file, observations)
        seen = {name: values for name, values in observations.seen.items() if name != "outline"}
        counts = {len(values if conditions is None else values[0]) for values in seen.values()}
        if observations.gauge is not None:
            counts.add(observations.gauge.saves)
        if len(counts) != 1 or 0 in counts:
            raise ValueError(f"observations.seen: {sorted(counts)} times, expected the same number of all, at least 1.")
        for name in observations.seen:
            if not observations.deviation.get(name, 0.0) > 0:
                raise ValueError(f"observations.deviation: {name} is missing, expected a positive number.")
            if not np.all(np.isfinite(observations.seen[name])):
                raise ValueError(f"observations.seen: {name} has entries that are not finite, expected finite numbers.")
        directions = np.shape(observations.seen["radii"])[-1] if "radii" in observations.seen else 0
        saves = counts.pop()
        case = Case.of(scene_file, FIT)
        if observations.gauge is not None and len(scene_file.vesicles()) > 1:
            raise ValueError(f"scene has {len(scene_file.vesicles())} vesicles, expected one, as in a film.")
        march = (case.march(observations.t_end, saves) if march is None else march).forwards()
        return cls(
            case.scene_file,
            tuple(sorted(observations.seen)),
            directions,
            saves,
            observations.t_end,
            march,
            observations.gauge,
            conditions,
            numbers,
        )

    def __call__(self, values: Mapping[str, Array]) -> dict[str, Float[Array, "..."]]:
        """Returns the observed quantities (T, ...) by name, (C, T, ...) of several runs; NaN where a run breaks down.

        The runs are computed side by side by one program.
        """
        if self.numbers is not None:
            values = self.numbers(values)
        if self.conditions is None:
            return self._of_run(values)
        return jax.vmap(lambda own: self._of_run({**values, **own}))(self.conditions)

    def status(self, values: Mapping[str, Array]) -> Int[Array, "*C"]:
        """Returns the status of the run, or of each of the C runs, with these unknowns."""
        if self.numbers is not None:
            values = self.numbers(values)
        if self.conditions is None:
            return self._run(values).status
        return jax.vmap(lambda own: self._run({**values, **own}).status)(self.conditions)

    def _run(self, values: Mapping[str, ScalarLike]) -> Result:
        return Case(self.scene_file).simulate(values, t_end=self.t_end, saves=self.saves, march=self.march)

    def _of_run(self, values: Mapping[str, ScalarLike]) -> dict[str, Float[Array, "T ..."]]:
        result = self._run(values)
        complete = result.status == status.COMPLETE
        found = {name: jnp.where(complete, value, jnp.nan) for name, value in result.diagnostics.items()}
        if self.directions:
            found["radii"] = jnp.where(complete, jax.vmap(lambda x: radii(x, self.directions))(result.x), jnp.nan)
        found = {name: history[1:] for name, history in found.items()}
        if self.gauge is not None:
            found["outline"] = jnp.where(complete, self.gauge(result.x), jnp.nan)
        for name in self.names:
            if name not in found:
                raise ValueError(f"observations.seen: {name!r}, expected some of radii, {', '.join(sorted(found))}.")
        return {name: found[name] for name in self.names}


def _conditions(scene_file: SceneFile, observations: Observations) -> dict[str, Float[Array, "C"]] | None:
    """Returns the numbers in which the runs differ as arrays (C,), None for a single run. Refuses what does not fit."""
    if observations.conditions is None:
        return None
    found = {name: np.asarray(values, dtype=float) for name, values in observations.conditions.items()}
    shapes = {values.shape for values in found.values()}
    if len(shapes) != 1 or len(*shapes) != 1 or shapes == {(0,)}:
        raise ValueError(f"observations.conditions: shapes {sorted(shapes)}, expected (C,), one number for each run.")
    if observations.gauge is not None:
        raise ValueError("observations.conditions: expected none with the outlines of a film, which is one run.")
    ((count,),) = shapes
    for name, values in observations.seen.items():
        if np.ndim(values) < 2 or len(values) != count:
            raise ValueError(
                f"observations.seen: {name} has shape {np.shape(values)}, expected ({count}, T, ...) for {count} runs."
            )
    for run in range(count):
        check_numbers(scene_file, {name: float(values[run]) for name, values in found.items()})
    return {name: as_float(values) for name, values in found.items()}


@eqx.filter_jit
def _status(model: Model, values):
    return model.status(values)


def words(model: Model, values: Mapping[str, float]) -> set[str]:
    """Returns the status words of the runs with these unknowns."""
    codes = _status(model, {name: as_float(value) for name, value in values.items()})
    return {status.WORDS[int(code)] for code in np.ravel(codes)}


@eqx.filter_jit
def _shown(model: Model, values):
    return model(values)


def shown(model: Model, values: Mapping[str, float]) -> dict[str, Float[np.ndarray, "..."]]:
    """Returns what the model computes from these unknowns, for synthetic observations or for plots."""
    found = _shown(model, {name: as_float(value) for name, value in values.items()})
    return {name: np.asarray(history) for name, history in found.items()}
