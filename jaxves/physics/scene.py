"""What is simulated: vesicles, and the field and flow they are in.

Physical numbers are arrays, which can be traced, differentiated and batched. A field or flow that is absent is `None`;
it is then not compiled and costs nothing.
"""

from collections.abc import Callable, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from ..base.arguments import Bounded, is_known, refusal, require, require_count
from ..base.bounds import FINITE
from ..base.physical_numbers import (
    BENDING,
    CHI,
    MEMBRANE_CONDUCTANCE,
    PER_VESICLE,
    PERMITTIVITY_RATIO,
    VISCOSITY_RATIO,
)
from ..geometry import shapes as curves
from ..geometry import starts
from ..geometry.domain import Cell
from ..numerics.arrays import PerVesicle, Scalar, VesiclePoints, as_float, require_x64
from .electric import Field, FieldFunction
from .flow import AbstractFlow, FlowFunction, Shear
from .waveform import AC

_FLOW = "a flow, such as Shear(10.0)"


class Scene(Bounded):
    """The starting nodes and all physical parameters.

    `x` are the nodes (M, N, 2), counter-clockwise and equispaced in arc length. `bending` is κ_B of each vesicle
    relative to the reference, (M,). The transmembrane potential starts at `V_m` (M, N), or at zero if that is None.
    `viscosity_ratio` is ν of each vesicle, (M,), or None if both viscosities are equal. Nodes are not moved back
    into the periodic `cell` (`Cell.of`), whose lattice a shear flow carries along.

    Known values are checked here. Traced values are checked in the run (`is_valid`), which then ends as `invalid`.

    Raises:
        ValueError: shapes do not fit, a number is out of its bounds, or a run cannot start from the curves (see
            `make_scene`).
    """

    bounds: ClassVar = {number.key: number.bounds for number in (BENDING, VISCOSITY_RATIO)}

    x: VesiclePoints = eqx.field(converter=as_float)
    bending: PerVesicle = eqx.field(converter=as_float)
    field: Field | None = None
    flow: AbstractFlow | None = None
    V_m: Float[Array, "M N"] | None = None
    viscosity_ratio: PerVesicle | None = eqx.field(converter=lambda v: None if v is None else as_float(v), default=None)
    cell: Cell | None = None

    def __check_init__(self):
        require_x64()
        if self.x.ndim != 3 or self.x.shape[0] < 1 or self.x.shape[-1] != 2 or self.x.shape[1] % 2:
            raise ValueError(f"Scene.x must have shape (M, N, 2) with N even, but has {self.x.shape}.")
        M, N, _ = self.x.shape
        for name, kind, wanted in (("field", Field, "a field, as dc_field makes it"), ("flow", AbstractFlow, _FLOW)):
            if not isinstance(getattr(self, name), kind | None):
                raise refusal(f"Scene.{name}", getattr(self, name), f"{wanted}, or None")
        self._check_cell()
        if self.bending.shape != (M,):
            raise ValueError(f"Scene.bending must have shape {(M,)}, but has {self.bending.shape}.")
        if self.viscosity_ratio is not None and self.viscosity_ratio.shape != (M,):
            raise ValueError(f"Scene.viscosity_ratio must have shape {(M,)}, but has {self.viscosity_ratio.shape}.")
        if self.field is not None and self.field.conductivity_ratio.shape != (M,):
            raise ValueError(
                f"Scene.field has numbers for {len(self.field.conductivity_ratio)} vesicles, but Scene.x has {M}: "
                f"call dc_field(..., vesicles={M})."
            )
        if self.V_m is not None and self.field is None:
            raise ValueError("Scene.V_m needs Scene.field: without a field nothing charges the membrane.")
        if self.V_m is not None and self.V_m.shape != (M, N):
            raise ValueError(f"Scene.V_m must have shape {(M, N)}, but has {self.V_m.shape}.")
        if self.V_m is not None:
            require("Scene.V_m", self.V_m, FINITE)
        if is_known(self.x):
            _check_start(np.asarray(self.x))

    def periods(self) -> list[Scalar]:
        """Returns the periods of the field and of the flow, as far as they have one, in units of t_κ."""
        found = [part.period() for part in (self.field, self.flow) if part is not None]
        return [period for period in found if period is not None]

    def _check_cell(self) -> None:
        if not isinstance(self.cell, Cell | None):
            raise refusal("Scene.cell", self.cell, "a cell, as Cell.of makes it, or None")
        if self.cell is None:
            return
        if self.cell.rate is not None:
            wanted = "None: the shear flow of the scene carries its cell along"
            raise refusal("Scene.cell.rate", self.cell.rate, wanted)
        if not isinstance(self.flow, Shear | None):
            raise refusal("Scene.flow", self.flow, "Shear or None: in a periodic cell no other flow is supported")
        if self.field is not None and not self.field.is_uniform():
            raise refusal("Scene.field.function", "a field of your own", "a uniform field in a periodic cell")
        if self.field is not None and self.field.charge_relaxation is not None:
            raise refusal("Scene.field.charge_relaxation", self.field.charge_relaxation, "None in a periodic cell")
        if self.field is not None and isinstance(self.field.history, AC) and self.field.history.averaged:
            wanted = "an AC field that is not averaged, in a periodic cell"
            raise refusal("Scene.field.history.averaged", self.field.history.averaged, wanted)

    def is_valid(self) -> Bool[Array, ""]:
        """Returns whether numbers are within bounds and a run can start from the curves; may be traced.

        Contact between vesicles is not checked here; runs find it.
        """
        valid = starts.are_startable(self.x) & self.is_within_bounds()
        parts = (self.field, self.flow, None if self.field is None else self.field.history)
        for part in parts:
            if part is not None:
                valid = valid & part.is_within_bounds()
        return valid


def _check_start(x: Float[np.ndarray, "M N 2"]) -> None:
    starts.check_curves("Scene.x", x)
    for m in np.flatnonzero(starts.is_clockwise(x)):
        raise refusal(f"Scene.x[{m}]", "clockwise nodes", "counter-clockwise ones: make_scene turns them round")
    for m in np.flatnonzero(starts.is_uneven(x)):
        wanted = "nodes equispaced in arc length: make_scene spaces them evenly along the same curve"
        raise refusal(f"Scene.x[{m}]", "unevenly spaced nodes", wanted)


def make_scene(
    shapes: ArrayLike | Sequence[ArrayLike],
    *,
    centers=None,
    bending=BENDING.default,
    viscosity_ratio=None,
    field: Field | None = None,
    flow: AbstractFlow | Callable[[Array, Array], Array] | None = None,
    cell: Cell | None = None,
) -> Scene:
    """Builds a scene from one or more curves.

    Known nodes that are clockwise are reversed. Known nodes that are not equispaced in arc length are moved along the
    trigonometric interpolant of the curve until they are; the first node stays. Traced nodes are not changed, and a run
    ends as `invalid` if they need a change. One number for `bending` or `viscosity_ratio`, and the numbers of a `field`
    for one vesicle, are used for all vesicles.

    Args:
        shapes: nodes (N, 2) of one curve, or of several curves with the same even N.
        centers: (M, 2), or (2,) for one vesicle; added to the nodes of each curve. By default nothing is added.
        bending: κ_B relative to the reference, one number or (M,).
        viscosity_ratio: ν, the viscosity inside over that outside, one number or (M,). With None both are equal.
        field: see `dc_field`.
        flow: `Shear`, `Extension`, `LinearFlow`, `Poiseuille`, one of them as `TimeDependent`, or a function v(x, t) in
            JAX of one point (2,).
        cell: a periodic cell, see `Cell.of`; by default the vesicles are in the plane.

    Raises:
        ValueError: the shapes of the arguments do not fit together; a known number is out of its bounds; or a curve has
            nodes that are not finite, crosses itself, or overlaps or touches another. The message names the argument.
    """
    x = _stacked(shapes)
    if is_known(x):
        x = _put_right(x)
    M = x.shape[0]
    if centers is not None:
        require("centers", centers, FINITE)
        if np.shape(centers) not in ({(M, 2), (2,)} if M == 1 else {(M, 2)}):
            raise ValueError(f"centers must have shape {(M, 2)}, one center a curve, but has {np.shape(centers)}.")
        x = x + jnp.reshape(as_float(centers), (M, 1, 2))
    bending = _for_each("bending", bending, M)
    if viscosity_ratio is not None:
        viscosity_ratio = _for_each("viscosity_ratio", viscosity_ratio, M)
    if isinstance(field, Field) and field.conductivity_ratio.shape == (1,):
        field = field.for_vesicles(M)
    if callable(flow) and not isinstance(flow, AbstractFlow):
        flow = FlowFunction(flow)
    return Scene(as_float(x), bending, field, flow, viscosity_ratio=viscosity_ratio, cell=cell)


def _for_each(name: str, value, M: int) -> PerVesicle:
    if np.shape(value) not in ((), (M,)):
        raise ValueError(f"{name} must be one number or have shape {(M,)}, but has {np.shape(value)}.")
    return jnp.broadcast_to(as_float(value), (M,))


def _stacked(shapes) -> Float[Array | np.ndarray, "M N 2"]:
    several = isinstance(shapes, list | tuple) and all(np.ndim(shape) == 2 for shape in shapes)
    if several and len({np.shape(shape) for shape in shapes}) != 1:
        found = ", ".join(str(np.shape(shape)) for shape in shapes) or "no curve"
        raise ValueError(f"shapes must be curves (N, 2) with the same number of nodes, but they have {found}.")
    wanted = "shapes must be nodes (N, 2) of a curve with N even and at least 8, or several of the same N"
    try:
        known = is_known(shapes)
        x = np.asarray(shapes, dtype=float) if known else jnp.asarray(shapes, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{wanted}, but are no array of numbers.") from None
    x = x[None] if x.ndim == 2 else x
    if x.ndim != 3 or x.shape[0] < 1 or x.shape[-1] != 2 or x.shape[1] % 2 or x.shape[1] < 8:
        raise ValueError(f"{wanted}, but have shape {np.shape(shapes)}.")
    return x


def _put_right(x: Float[np.ndarray, "M N 2"]) -> Float[Array | np.ndarray, "M N 2"]:
    """Returns counter-clockwise curves with equispaced nodes; raises ValueError for curves that cannot be used."""
    for m, nodes in enumerate(x):
        starts.check_curves(f"shapes[{m}]" if len(x) > 1 else "shapes", nodes[None])
    clockwise = starts.is_clockwise(x)
    x = np.where(clockwise[:, None, None], x[:, ::-1], x)
    uneven = starts.is_uneven(x)
    if not np.any(uneven):
        return x
    even = [curves.equispaced(as_float(nodes), x.shape[1]) if uneven[m] else nodes for m, nodes in enumerate(x)]
    return jnp.stack([as_float(nodes) for nodes in even])


def _field_function(E_inf, direction) -> FieldFunction | None:
    if E_inf is None:
        return None
    if direction is not None:
        raise refusal("direction", direction, "no direction beside E_inf, which has its own")
    if not callable(E_inf):
        raise refusal("E_inf", E_inf, "a function E(x, t) in JAX of one point (2,), or None")
    return FieldFunction(E_inf)


def dc_field(
    beta,
    *,
    conductivity_ratio,
    membrane_conductance=MEMBRANE_CONDUCTANCE.default,
    chi=CHI.default,
    permittivity_ratio=PERMITTIVITY_RATIO.default,
    charge_relaxation=None,
    direction=None,
    vesicles: int = 1,
    history=None,
    E_inf: Callable[[Array, Array], Array] | None = None,
) -> Field:
    """Builds a field along `direction`. Each membrane parameter is one number, or one for each vesicle.

    β, Λ, G and χ are those of the paper. If `chi` is given per vesicle, the first one is the reference for β.

    Args:
        beta: field strength β >= 0.
        conductivity_ratio: Λ >= 0, inside over outside; infinity means a perfect conductor inside.
        membrane_conductance: G >= 0.
        chi: charging time divided by t_κ, positive.
        permittivity_ratio: ε_i/ε_e, positive. Without `charge_relaxation` it enters the Maxwell stress only.
        charge_relaxation: δ = ε_e/(a C_m), positive; with None, charge in the fluids is in equilibrium at every
            instant.
        direction: direction of the field, not zero; it is normalised. By default along y.
        vesicles: number of vesicles; `make_scene` repeats the numbers of a field for one vesicle.
        history: a time-dependent factor on the field, such as `Pulse`.
        E_inf: a field that depends on position, instead of `direction`: a function E(x, t) in JAX of one point (2,), in
            units of the reference field to which β refers. It must have neither divergence nor curl.

    Raises:
        ValueError: a known number is out of its bounds, or the number of values differs from that of vesicles; or
            `E_inf` cannot be used.
    """
    require_count("vesicles", vesicles)
    function = _field_function(E_inf, direction)
    direction = (0.0, 1.0) if direction is None else direction
    numbers = {"conductivity_ratio": conductivity_ratio, "membrane_conductance": membrane_conductance}
    numbers |= {"chi": chi, "permittivity_ratio": permittivity_ratio}
    for name, value in numbers.items():
        if np.shape(value) not in ((), (1,), (vesicles,)):
            wanted = f"one number, or one for each of {vesicles} vesicles (`vesicles=` says how many)"
            raise refusal(name, value, wanted)
    for name, value in (numbers | {"beta": beta, "direction": direction}).items():
        require(name, value, Field.bounds[name])

    def each(value):
        return jnp.broadcast_to(as_float(value), (vesicles,))

    chi = as_float(chi)
    return Field(
        beta=beta,
        chi=chi if chi.ndim == 0 else chi[0],
        **{number.per_vesicle: each(numbers[number.key]) for number in PER_VESICLE},
        direction=direction,
        history=history,
        charge_relaxation=charge_relaxation,
        function=function,
    )
