r"""Sums over all nodes of all membranes with the kernel of the Stokes double layer, in almost linear time.

    D[u]_a = Σ r_a (r·u_j) (r·n_j) w_j/(π r⁴),   r = x_i - x_j

The split into a local part and a smooth rest is that of `sums`, with the same lists, windows and grid. Pairs that are
left out of the lists have only their smooth part in the sum, for which `smooth_matrix` has the matrix.

In a periodic cell the sums run over all images, and the velocity has zero mean over the cell.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.domain import AbstractDomain, Cell
from ..numerics.arrays import VesiclePoints
from . import multipliers, splitting
from .sums import EwaldSums, local_matrices


class StressletSums(eqx.Module):
    """The double layer of the nodes of `sums`: unit normals, C and Q (`splitting`) of pairs in lists, multipliers."""

    sums: EwaldSums
    normal: VesiclePoints
    local: splitting.Kernel
    kernel: Float[Array, "2 3 K L"]

    @classmethod
    def of(cls, sums: EwaldSums, normal: VesiclePoints, domain: AbstractDomain) -> "StressletSums":
        """Builds the double layer for the same nodes, lists and windows as `sums`, in the same domain."""
        plan = sums.plan
        local = local_matrices(splitting.local_stresslet, sums.x, sums.lists, sums.shift, plan, sums.r_c)
        if isinstance(domain, Cell):
            kernel = multipliers.stresslets_in_cell(sums.multipliers, plan, domain.lattice)
        else:
            kernel = multipliers.stresslets_free(plan)
        return cls(sums, normal, local, kernel)

    def __call__(self, u: VesiclePoints) -> VesiclePoints:
        """Returns the velocity D[u] at all nodes."""
        sums, n = self.sums, self.normal
        crossed = n[..., 0] * u[..., 1] + n[..., 1] * u[..., 0]
        density = sums.clusters(jnp.stack([n[..., 0] * u[..., 0], crossed, n[..., 1] * u[..., 1]], axis=-1))
        smooth = sums.multipliers.on_stresslets(self.kernel, sums.windows.spread(density))
        velocity = sums.per_length(sums.windows.interpolated(smooth))

        def local(C, Q, rx, ry, xx, xy, yy):
            along = Q * (rx * (rx * xx + ry * xy) + ry**2 * yy)
            x, y = (rx * (2 * xx) + ry * xy), (rx * xy + ry * (2 * yy))
            return jnp.sum(C * x + rx * along, axis=1), jnp.sum(C * y + ry * along, axis=1)

        return sums.nodes(velocity + sums.locally(local, self.local, density))

    def smooth_matrix(
        self, x: Float[Array, "P 2"], y: Float[Array, "N 2"], normal: Float[Array, "N 2"], weights: Float[Array, "N"]
    ) -> Float[Array, "p n"]:
        """Returns the matrix of the smooth part from densities at nodes y to velocities at x, by component, node."""
        rx, ry = (x[:, None, k] - y[:, k] for k in (0, 1))
        C, Q = splitting.smooth_stresslet(rx**2 + ry**2, self.sums.r_c, self.sums.plan.accuracy)
        nx, ny = normal[:, 0], normal[:, 1]
        across = rx * nx + ry * ny
        equal, along, C = C * across * weights, Q * across * weights, C * weights
        rows = [equal + C * nx * rx + along * rx**2, C * nx * ry + along * rx * ry]
        below = [C * ny * rx + along * rx * ry, equal + C * ny * ry + along * ry**2]
        return jnp.concatenate([jnp.concatenate(rows, axis=1), jnp.concatenate(below, axis=1)])
