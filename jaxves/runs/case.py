"""A scene file as a function of its numbers: it gives the scene, the time stepping, the solvers and the result.

Everything that computes from a scene file uses `Case`. A key therefore means the same in a run, a sweep, a fit, a
sensitivity and a critical field. Keys that a use does not support are refused (`inputs/uses.py`).
"""

import math
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp

from ..base import status
from ..base.resolution import NODES_PER_WAVE
from ..equation.equation import Equation, equation_for
from ..inputs.checking import checked
from ..inputs.scene_files import Readable, read_scene
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import Use, for_use, refuse_unused
from ..numerics.arrays import ScalarLike, Status, as_float
from ..numerics.linear import AbstractSolver, Dense
from ..observables.checks import Checks
from ..operators.interactions import AbstractCoupling
from ..operators.pairs import Pairwise
from ..operators.sums import MatrixFree, accuracy_of_sums, coupling_for, coupling_in_cell, residual_of_systems
from ..physics.scene import Scene
from ..stepping import marching, schemes
from ..stepping.adaptive import Adaptive
from ..stepping.fixed import Fixed
from ..stepping.march import AbstractMarch
from ..stepping.marching import Result
from . import rest
from .build import scene_of
from .strength import strong_steps

_STEPPERS = {"ark4": schemes.ARK4, "ark5": schemes.ARK5, "euler": schemes.SemiImplicitEuler}


class Case(eqx.Module):
    """A scene file as a function of its numbers; build it with `Case.of`."""

    scene_file: SceneFile = eqx.field(static=True)

    @classmethod
    def of(cls, scene_file: Readable, use: Use) -> "Case":
        """Builds a case for `use` from a scene file, or from what `read_scene` reads as one.

        Its file has the number of nodes that `use` has where nothing is said.

        Raises:
            SceneError: `scene_file` is no scene file, has a key that `use` does not support, or has an invalid value.
        """
        scene_file = for_use(read_scene(scene_file), use)
        checked(SceneFile, scene_file.model_dump(by_alias=True, exclude_none=True), "scene")
        refuse_unused(scene_file, use)
        return cls(scene_file)

    def march(self, t_end: float | None = None, saves: int | None = None) -> AbstractMarch:
        """Returns the time stepping that `[numerics]` asks for, with `saves` saved times up to `t_end`.

        Both are those of the file by default. A fixed step is shortened so that a whole number of steps fits between
        saved times.
        """
        file, numerics = self.scene_file, self.scene_file.numerics
        if numerics.method == "auto":
            chosen = schemes.for_tolerance(numerics.tolerance, len(file.vesicles()))
        else:
            chosen = _STEPPERS[numerics.method]()
        waves = NODES_PER_WAVE if numerics.nodes == "auto" else None
        if numerics.time_step is None:
            return Adaptive(numerics.tolerance, chosen, nodes_per_wave=waves, **strong_steps(file))
        spacing = (file.t_end if t_end is None else t_end) / (file.saves if saves is None else saves)
        return Fixed(math.ceil(spacing / numerics.time_step * (1 - 1e-12)), chosen, nodes_per_wave=waves)

    def solved_by(self, scene: Scene) -> tuple[AbstractSolver | None, AbstractCoupling | None]:
        """Returns the solver for the charge of one membrane and the coupling of several, as `[numerics]` asks for."""
        numerics = self.scene_file.numerics
        M, N, _ = scene.x.shape
        fast = accuracy_of_sums(numerics.tolerance), residual_of_systems(numerics.tolerance)
        if scene.cell is not None:
            return None, coupling_in_cell(numerics.neighbours, *fast)
        match numerics.solver:
            case "dense":
                return Dense(), Pairwise(direct=True)
            case "matrix-free":
                return None, MatrixFree(numerics.neighbours)
        return None, coupling_for(M, N, numerics.neighbours, *fast)

    def equation(self, scene: Scene, integrands=None) -> Equation:
        """Returns the equation for a scene built from this file, with the solvers that the file asks for."""
        solver, coupling = self.solved_by(scene)
        return equation_for(scene, solver=solver, coupling=coupling, integrands=integrands)

    def checks(self) -> Checks:
        """Returns the limits of a run, with the stop condition of the file."""
        stop = self.scene_file.stop
        return Checks(steady=None if stop is None or stop.steady is None else as_float(stop.steady))

    def scene(self, values: Mapping[str, ScalarLike]) -> Scene:
        """Returns the scene with these numbers in place of those of the file; vesicles are not relaxed yet. Pure."""
        return scene_of(self.scene_file, values)

    def at_rest(self, scene: Scene, march: AbstractMarch = rest.MARCH) -> tuple[Scene, Status]:
        """Returns the scene with vesicles relaxed as the file asks for, and a status. Pure.

        The status is RUNNING, or the status with which the relaxation of a vesicle failed.
        """
        scene, codes = rest.relaxed(scene, [vesicle.relaxed for vesicle in self.scene_file.vesicles()], march)
        code = jnp.int32(status.RUNNING)
        for found in codes:
            code = jnp.where(found == status.COMPLETE, code, found)
        return scene, code

    def simulate(
        self,
        values: Mapping[str, ScalarLike],
        *,
        march: AbstractMarch,
        t_end: ScalarLike | None = None,
        saves: int,
        averaged: bool = False,
    ) -> Result:
        """Runs the scene with these numbers to `t_end` (by default that of the file). Pure.

        Vesicles are relaxed first if the file asks for it.
        """
        file = self.scene_file
        relaxing = rest.MARCH if march.recorded is not None or isinstance(march, Fixed) else rest.MARCH.forwards()
        scene, code = self.at_rest(self.scene(values), relaxing)
        scene = eqx.tree_at(lambda s: s.x, scene, jnp.where(code == status.RUNNING, scene.x, jnp.nan))
        solver, coupling = self.solved_by(scene)
        result = marching.simulate(
            scene,
            file.t_end if t_end is None else t_end,
            saves=saves,
            march=march,
            average=file.average if averaged else None,
            checks=self.checks(),
            solver=solver,
            coupling=coupling,
        )
        word = jnp.where(code == status.RUNNING, result.status, code)
        return eqx.tree_at(lambda r: r.status, result, word)
