r"""Layer potentials of all membranes at points away from them, by the trapezoidal rule.

    S[q](x) = ∮ G(x-y) q(y) ds_y                  ∇S[q] = ∮ ∇_x G q ds
    D[V](x) = ∮ ∂G(x-y)/∂n_y V(y) ds_y            ∂G/∂n_y = r·n/(2π|r|²),   D[1] = -1 inside, 0 outside
    S[f]_a(x) = ∮ G_ab(x-y) f_b(y) ds_y           Stokes, viscosity 1; its pressure p[f] = ∮ r·f ds / 2π|r|²

`curves` are M membranes at once (leaves (M, N, ...)), densities (M, N) or (M, N, 2), targets (P, 2); the
result is the sum over membranes. The error is about exp(-2πd/h) at a distance of d node spacings h, so
13 digits from d = 5h on [B] (the "5h rule"); nearer than that it is useless, and nothing here says so.

[B] A. H. Barnett, Evaluation of layer potentials close to the boundary for Laplace and Helmholtz
    problems on analytic planar domains, SIAM J. Sci. Comput. 36 (2014) A427-A451.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics.arrays import Points, VesicleNodes, VesiclePoints
from . import kernels


def _dipole(r: Float[Array, "P *nodes 2"], normal: Float[Array, "*nodes 2"]) -> Float[Array, "P *nodes"]:
    """∂G/∂n_y = r·n / 2π|r|²."""
    return -jnp.sum(kernels.laplace_gradient(r) * normal, axis=-1)


def _dipole_gradient(r: Float[Array, "P *nodes 2"], normal: Float[Array, "*nodes 2"]) -> Float[Array, "P *nodes 2"]:
    """∇_x ∂G/∂n_y = (n - 2 (r·n) r/|r|²) / 2π|r|²."""
    r2 = jnp.sum(r**2, axis=-1, keepdims=True)
    along = jnp.sum(r * normal, axis=-1, keepdims=True)
    return (normal - 2 * along * r / r2) / (2 * jnp.pi * r2)


def separations(curves: Curve, targets: Points) -> Float[Array, "P M N 2"]:
    """The vectors x - y from every node to every target."""
    return targets[:, None, None, :] - curves.x


def _to_sum(curves: Curve, targets: Points):
    """Components of all separations, (P, MN), and 1/|r|²; finite where a target is a node.

    What is formed of them and summed at once is never stored: three times as fast as a kernel and a product.
    """
    y = curves.x.reshape(-1, 2)
    rx, ry = targets[:, 0, None] - y[:, 0], targets[:, 1, None] - y[:, 1]
    r2 = rx**2 + ry**2
    return rx, ry, 1 / jnp.where(r2 > 0, r2, 1.0)


def _weights(curves: Curve) -> VesicleNodes:
    return jax.vmap(lambda curve: curve.weights)(curves)


def laplace_slp(curves: Curve, q: VesicleNodes, targets: Points) -> Float[Array, "P"]:
    """S[q]."""
    kernel = kernels.laplace(separations(curves, targets))
    return jnp.einsum("pmn,mn->p", kernel, q * _weights(curves))


def laplace_slp_gradient(curves: Curve, q: VesicleNodes, targets: Points) -> Points:
    """∇S[q]."""
    rx, ry, inverse_r2 = _to_sum(curves, targets)
    scaled = (q * _weights(curves)).reshape(-1) * inverse_r2
    return jnp.stack([jnp.sum(rx * scaled, axis=1), jnp.sum(ry * scaled, axis=1)], axis=-1) / (-2 * np.pi)


def laplace_dlp(curves: Curve, V: VesicleNodes, targets: Points) -> Float[Array, "P"]:
    """D[V]."""
    kernel = _dipole(separations(curves, targets), curves.normal)
    return jnp.einsum("pmn,mn->p", kernel, V * _weights(curves))


def laplace_dlp_gradient(curves: Curve, V: VesicleNodes, targets: Points) -> Points:
    """∇D[V]."""
    kernel = _dipole_gradient(separations(curves, targets), curves.normal)
    return jnp.einsum("pmna,mn->pa", kernel, V * _weights(curves))


def stokes_slp(curves: Curve, f: VesiclePoints, targets: Points) -> Points:
    """Velocity S[f]."""
    rx, ry, inverse_r2 = _to_sum(curves, targets)
    fx, fy = (f * _weights(curves)[..., None]).reshape(-1, 2).T
    log = 0.5 * jnp.log(inverse_r2)
    along = (rx * fx + ry * fy) * inverse_r2
    rows = jnp.sum(log * fx + rx * along, axis=1), jnp.sum(log * fy + ry * along, axis=1)
    return jnp.stack(rows, axis=-1) / (4 * np.pi)


def stokes_slp_pressure(curves: Curve, f: VesiclePoints, targets: Points) -> Float[Array, "P"]:
    """Pressure of S[f]."""
    kernel = kernels.stokeslet_pressure(separations(curves, targets))
    return jnp.einsum("pmna,mna->p", kernel, f * _weights(curves)[..., None])
