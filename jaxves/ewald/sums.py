r"""Sums over all nodes of all membranes with the kernels of Laplace and Stokes, in almost linear time.

    velocity   Σ S(x_i - x_j) f_j w_j        ∇S   Σ ∇G(x_i - x_j) q_j w_j        S   Σ G q_j w_j       pressure of f

The smooth part of every pair is summed by FFT. The local part is summed for the pairs in the lists. Pairs that are left
out of the lists, as each vesicle with itself, have only their smooth part in the sum; the caller replaces it, for which
`smooth_blocks` has its matrices. Subtracting the whole kernel instead would cancel digits between close nodes.

In a periodic cell the sums run over all images. The kernels then have zero mean over the cell.

The matrices of the local part are kept, because several sums share one geometry.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..geometry.domain import AbstractDomain, Cell
from ..numerics.arrays import Scalar, VesicleNodes, VesiclePoints
from ..numerics.valid_rows import over_valid
from . import multipliers, splitting
from .lists import Excluded, Lists
from .mesh import Windows, as_clusters
from .multipliers import Multipliers
from .plans import CHUNK, Plan


class EwaldSums(eqx.Module):
    """Everything that sums over the same nodes share; build it with `EwaldSums.of`.

    `scale` is the grid spacing in the plane, and None in a cell, where the multipliers contain it. `local` are A and B
    (`splitting`) of the pairs in the lists, whose sources are displaced by `shift` in a cell.
    """

    x: VesiclePoints
    weights: VesicleNodes
    r_c: Scalar
    scale: Scalar | None
    lists: Lists
    shift: Float[Array, "T 2"] | None
    local: splitting.Kernel
    windows: Windows
    multipliers: Multipliers
    plan: Plan = eqx.field(static=True)

    @classmethod
    def of(
        cls, x: VesiclePoints, weights: VesicleNodes, plan: Plan, domain: AbstractDomain, excluded: Excluded
    ) -> "EwaldSums":
        """Builds the sums over nodes x with quadrature weights, without the local part of the `excluded` pairs."""
        if isinstance(domain, Cell):
            r_c = lax.stop_gradient(multipliers.cut_off(plan, domain.lattice))
            z, scale = domain.coordinates(x) * np.array(plan.grid), None
            spectral = multipliers.periodic(plan, domain.lattice, r_c)
        else:
            z, scale = _on_grid(x, plan)
            r_c = (2 * plan.accuracy.shape / np.pi) * scale
            spectral = multipliers.free(plan)
        lists = Lists.of(x, r_c, plan, domain, excluded)
        shift = None if lists.image is None else lists.image @ domain.lattice

        windows = Windows.of(as_clusters(z, plan.cluster), plan.grid, plan.patch, plan.accuracy.width)
        local = local_matrices(splitting.local, x, lists, shift, plan, r_c)
        return cls(x, weights, r_c, scale, lists, shift, local, windows, spectral, plan)

    @property
    def overflow(self) -> Bool[Array, ""]:
        """Whether lists or patches were too small, so that the sums are wrong."""
        return self.lists.overflow | ~self.windows.fits

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Returns the velocity at all nodes from forces per arc length."""
        f = self.clusters(f)
        velocity = self.windows.interpolated(self.multipliers.on_forces(self.windows.spread(f)))
        if self.scale is not None:
            velocity = velocity - jnp.log(self.scale) / (4 * np.pi) * jnp.sum(f, axis=(0, 1))

        def local(A, B, rx, ry, fx, fy):
            along = B * (rx * fx + ry * fy)
            return jnp.sum(A * fx + rx * along, axis=1), jnp.sum(A * fy + ry * along, axis=1)

        return self.nodes(velocity + self.locally(local, self.local, f))

    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        """Returns ∇S[q] at all nodes."""
        q = self.clusters(q[..., None])
        gradient = self.per_length(self.windows.interpolated(self.multipliers.on_charges(self.windows.spread(q))))

        def local(A, B, rx, ry, q):
            along = -2 * B * q
            return jnp.sum(rx * along, axis=1), jnp.sum(ry * along, axis=1)

        return self.nodes(gradient + self.locally(local, self.local, q))

    def slp(self, q: VesicleNodes) -> VesicleNodes:
        """Returns S[q] at all nodes."""
        q = self.clusters(q[..., None])
        potential = self.windows.interpolated(self.multipliers.potentials(self.windows.spread(q)))
        if self.scale is not None:
            potential = potential - jnp.log(self.scale) / (2 * np.pi) * jnp.sum(q)

        def local(A, B, rx, ry, q):
            return (jnp.sum(2 * (A + B * (rx**2 + ry**2)) * q, axis=1),)

        return self.nodes(potential + self.locally(local, self.local, q))[..., 0]

    def pressure(self, f: VesiclePoints) -> VesicleNodes:
        """Returns the pressure at all nodes from forces per arc length."""
        f = self.clusters(f)
        pressure = self.per_length(self.windows.interpolated(self.multipliers.pressure(self.windows.spread(f))))

        def local(A, B, rx, ry, fx, fy):
            return (jnp.sum(2 * B * (rx * fx + ry * fy), axis=1),)

        return self.nodes(pressure + self.locally(local, self.local, f))[..., 0]

    def smooth(self, r2: Float[Array, "*pairs"]) -> splitting.Kernel:
        """Returns A and B of the smooth part at these squared distances, without quadrature weights."""
        return splitting.smooth(r2, self.r_c, self.plan.accuracy)

    def clusters(self, density: Float[Array, "M N k"]) -> Float[Array, "C n k"]:
        """Returns a density times the quadrature weights, by clusters."""
        return as_clusters(density * self.weights[..., None], self.plan.cluster)

    def nodes(self, values: Float[Array, "C n k"]) -> Float[Array, "M N k"]:
        """Returns values by clusters as values at all nodes."""
        return values.reshape(*self.x.shape[:2], -1)

    def per_length(self, values: Float[Array, "C n k"]) -> Float[Array, "C n k"]:
        """Returns values of a kernel that is homogeneous of degree -1, which in the plane is known for a unit grid."""
        return values if self.scale is None else values / self.scale

    def locally(
        self, kernel: Callable, matrices: splitting.Kernel, density: Float[Array, "C n k"]
    ) -> Float[Array, "C n out"]:
        """Returns the local sums of `kernel(*matrices, rx, ry, *components)` for every target cluster."""
        n = self.plan.cluster

        def of_pairs(rx, ry, source, local, density):
            parts = (part.reshape(-1, n) for part in local)
            components = jnp.moveaxis(jnp.repeat(density[source], n, axis=0), -1, 0)
            return jnp.stack(kernel(*parts, rx, ry, *components), axis=-1)

        values = over_pairs(of_pairs, self.x, self.lists, self.shift, self.plan, matrices, density)
        values = values.reshape(self.lists.target.size, n, -1)
        return jnp.zeros((*density.shape[:2], values.shape[-1])).at[self.lists.target].add(values)


def local_matrices(
    kernel: Callable, x: VesiclePoints, lists: Lists, shift, plan: Plan, r_c: Scalar
) -> splitting.Kernel:
    """Returns both parts of `kernel(r2, r_c, accuracy)` for the pairs in the list, and zeros for unused rows."""

    def of_pairs(rx, ry, source, valid, r_c):
        valid = jnp.repeat(valid, plan.cluster)[:, None]
        return [jnp.where(valid, part, 0.0) for part in kernel(rx**2 + ry**2, r_c, plan.accuracy)]

    parts = over_pairs(of_pairs, x, lists, shift, plan, lists.valid, r_c)
    return tuple(part.reshape(-1, plan.cluster, plan.cluster) for part in parts)


def over_pairs(function: Callable, x: VesiclePoints, lists: Lists, shift, plan: Plan, rows=None, shared=None):
    """Returns `function(rx, ry, source, rows, shared)` for every chunk of the list; zeros without a valid pair.

    The separations have a row for each target node of all pairs in the chunk, and a column for each source node. XLA
    vectorises two axes of pairs on CPUs, and not three.
    """

    def of_chunk(part, common):
        (target, source, shift, rows), (clusters, shared) = part, common
        targets, sources = clusters[target], clusters[source]
        if shift is not None:
            sources = sources + shift[:, None]
        targets, sources = targets.reshape(-1, 2), jnp.repeat(sources, plan.cluster, axis=0)
        rx, ry = (targets[:, k, None] - sources[..., k] for k in (0, 1))
        return function(rx, ry, source, rows, shared)

    pairs = lists.target, lists.source, shift, rows
    return over_valid(of_chunk, lists.valid, pairs, (as_clusters(x, plan.cluster), shared), CHUNK)


def _on_grid(x: VesiclePoints, plan: Plan) -> tuple[VesiclePoints, Scalar]:
    """Returns the nodes in grid cells, with the grid around all of them, and the grid spacing."""
    fixed = lax.stop_gradient(x)
    low, high = jnp.min(fixed, axis=(0, 1)), jnp.max(fixed, axis=(0, 1))
    width = plan.accuracy.width
    scale = jnp.max(high - low) / (plan.grid[0] - width - 2)
    # Not a whole number: a node at the very edge of a window would have no derivative.
    return (x - low) / scale + (width / 2 + 1.25), scale
