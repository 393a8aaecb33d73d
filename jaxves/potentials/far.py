r"""Layer potentials of all membranes at points far from them, by the trapezoidal rule.

    S[q](x) = ∮ G(x-y) q(y) ds_y                  ∇S[q] = ∮ ∇_x G q ds
    D[V](x) = ∮ ∂G(x-y)/∂n_y V(y) ds_y            ∂G/∂n_y = r·n/(2π|r|²),   D[1] = -1 inside, 0 outside
    S[f]_a(x) = ∮ G_ab(x-y) f_b(y) ds_y           Stokes, viscosity 1; its pressure p[f] = ∮ r·f ds / 2π|r|²
    D[u](x) = ∮ r (r·u) (r·n) ds / π|r|⁴          Stokes, D[1] = -1 inside, 0 outside; its pressure is
                                                  p[u] = ∮ (2 (r·n) (r·u)/|r|⁴ - n·u/|r|²) ds / π

`curves` has M membranes (leaves (M, N, ...)), densities are (M, N) or (M, N, 2), targets (P, 2). The result is the sum
over all membranes. At a distance d from a membrane with node spacing h the error is about exp(-2πd/h). That is 13
digits for d ≥ 5h [B] (the "5h rule"). The functions here do not check the distance; at shorter distances use close
evaluation.

[B] A. H. Barnett, Evaluation of layer potentials close to the boundary for Laplace and Helmholtz
    problems on analytic planar domains, SIAM J. Sci. Comput. 36 (2014) A427-A451.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics.arrays import Points, VesicleNodes, VesiclePoints
from ..numerics.logarithm import log
from . import kernels


def _dipole(r: Float[Array, "P *nodes 2"], normal: Float[Array, "*nodes 2"]) -> Float[Array, "P *nodes"]:
    """Returns ∂G/∂n_y = r·n / 2π|r|²."""
    return -jnp.sum(kernels.laplace_gradient(r) * normal, axis=-1)


def _dipole_gradient(r: Float[Array, "P *nodes 2"], normal: Float[Array, "*nodes 2"]) -> Float[Array, "P *nodes 2"]:
    """Returns ∇_x ∂G/∂n_y = (n - 2 (r·n) r/|r|²) / 2π|r|²."""
    r2 = jnp.sum(r**2, axis=-1, keepdims=True)
    along = jnp.sum(r * normal, axis=-1, keepdims=True)
    return (normal - 2 * along * r / r2) / (2 * jnp.pi * r2)


def separations(curves: Curve, targets: Points) -> Float[Array, "P M N 2"]:
    """Returns the vectors x - y from every node y to every target x."""
    return targets[:, None, None, :] - curves.x


def _to_sum(curves: Curve, targets: Points):
    """Returns the components of all separations, (P, MN), and |r|², which is 1 if a target is a node.

    XLA does not store sums that are formed directly from them. This is three times as fast as storing a kernel and
    multiplying by it.
    """
    y = curves.x.reshape(-1, 2)
    rx, ry = targets[:, 0, None] - y[:, 0], targets[:, 1, None] - y[:, 1]
    r2 = rx**2 + ry**2
    return rx, ry, jnp.where(r2 > 0, r2, 1.0)


def _weights(curves: Curve) -> VesicleNodes:
    return jax.vmap(lambda curve: curve.weights)(curves)


def laplace_slp(curves: Curve, q: VesicleNodes, targets: Points) -> Float[Array, "P"]:
    """Returns S[q] at the targets."""
    kernel = kernels.laplace(separations(curves, targets))
    return jnp.einsum("pmn,mn->p", kernel, q * _weights(curves))


def laplace_slp_gradient(curves: Curve, q: VesicleNodes, targets: Points) -> Points:
    """Returns ∇S[q] at the targets."""
    rx, ry, r2 = _to_sum(curves, targets)
    scaled = (q * _weights(curves)).reshape(-1) * (1 / r2)
    return jnp.stack([jnp.sum(rx * scaled, axis=1), jnp.sum(ry * scaled, axis=1)], axis=-1) / (-2 * np.pi)


def laplace_dlp(curves: Curve, V: VesicleNodes, targets: Points) -> Float[Array, "P"]:
    """Returns D[V] at the targets."""
    kernel = _dipole(separations(curves, targets), curves.normal)
    return jnp.einsum("pmn,mn->p", kernel, V * _weights(curves))


def laplace_dlp_gradient(curves: Curve, V: VesicleNodes, targets: Points) -> Points:
    """Returns ∇D[V] at the targets."""
    kernel = _dipole_gradient(separations(curves, targets), curves.normal)
    return jnp.einsum("pmna,mn->pa", kernel, V * _weights(curves))


def stokes_slp(curves: Curve, f: VesiclePoints, targets: Points) -> Points:
    """Returns the velocity S[f] at the targets."""
    rx, ry, r2 = _to_sum(curves, targets)
    fx, fy = (f * _weights(curves)[..., None]).reshape(-1, 2).T
    equal = -0.5 * log(r2)
    along = (rx * fx + ry * fy) / r2
    rows = jnp.sum(equal * fx + rx * along, axis=1), jnp.sum(equal * fy + ry * along, axis=1)
    return jnp.stack(rows, axis=-1) / (4 * np.pi)


def stokes_slp_pressure(curves: Curve, f: VesiclePoints, targets: Points) -> Float[Array, "P"]:
    """Returns the pressure of S[f] at the targets."""
    kernel = kernels.stokeslet_pressure(separations(curves, targets))
    return jnp.einsum("pmna,mna->p", kernel, f * _weights(curves)[..., None])


def stokes_dlp(curves: Curve, u: VesiclePoints, targets: Points) -> Points:
    """Returns the velocity D[u] at the targets."""
    rx, ry, r2 = _to_sum(curves, targets)
    ux, uy = (u * _weights(curves)[..., None]).reshape(-1, 2).T
    nx, ny = curves.normal.reshape(-1, 2).T
    along = (rx * ux + ry * uy) * (rx * nx + ry * ny) / r2**2
    return jnp.stack([jnp.sum(rx * along, axis=1), jnp.sum(ry * along, axis=1)], axis=-1) / np.pi


def stokes_dlp_pressure(curves: Curve, u: VesiclePoints, targets: Points) -> Float[Array, "P"]:
    """Returns the pressure of D[u] at the targets."""
    rx, ry, r2 = _to_sum(curves, targets)
    ux, uy = (u * _weights(curves)[..., None]).reshape(-1, 2).T
    nx, ny = curves.normal.reshape(-1, 2).T
    kernel = 2 * (rx * ux + ry * uy) * (rx * nx + ry * ny) / r2 - (nx * ux + ny * uy)
    return jnp.sum(kernel / r2, axis=1) / np.pi
