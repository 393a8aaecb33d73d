"""A membrane near itself: the neck of a dumbbell narrows while its nodes stay as many."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base import status
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.numerics.batching import greatest
from jaxves.observables.checks import Checks
from jaxves.observables.rows import Row
from jaxves.operators.surfaces import Surfaces
from jaxves.physics.scene import make_scene
from jaxves.potentials import self_refined
from jaxves.potentials.chords import Chords
from jaxves.potentials.self_refined import SelfKernels, self_kernels


def dumbbell(N, width):
    """Two bulbs, joined by a neck along x of this width."""
    alpha = fourier.grid(N)
    return jnp.stack([1.5 * jnp.cos(alpha), jnp.sin(alpha) * (width / 2 + 0.8 * jnp.cos(alpha) ** 2)], axis=-1)


def spacing(N, width):
    return float(jnp.max(Curve.from_nodes(dumbbell(N, width)).weights))


def by_kress(x):
    curve = Curve.from_nodes(x)
    return curve, SelfKernels.of(curve, Chords.of(curve), electric=True)


def refined(x):
    return jax.tree.map(lambda leaf: leaf[0], self_kernels(x[None], electric=True))


def _potentials(x, kernels_of):
    """S q, S' q and Stokes S f of two smooth densities."""
    curve, kernels = kernels_of(x)
    alpha = fourier.grid(x.shape[0])
    q = jnp.exp(jnp.sin(alpha)) * curve.speed
    f = jnp.stack([q, jnp.cos(2 * alpha) * curve.speed], axis=-1)
    return {"S": kernels.laplace_slp @ q, "S'": kernels.laplace_slp_dn @ q, "Stokes S": kernels.stokes_slp @ f}


potentials = jax.jit(_potentials, static_argnums=1)


@pytest.mark.parametrize("width", [0.2, 0.1, 0.05])
def test_potentials_of_a_membrane_stay_accurate_in_its_neck(width):
    """Against Kress's rule on a grid fine enough for the neck; S' loses what one derivative loses."""
    N, fine = 128, 1024
    assert self_refined.FAR / 8 < width / spacing(N, width) < self_refined.FAR
    assert width / spacing(fine, width) > self_refined.FAR
    exact = potentials(dumbbell(fine, width), by_kress)
    found, plain = potentials(dumbbell(N, width), refined), potentials(dumbbell(N, width), by_kress)
    for name, tolerance in {"S": 1e-11, "Stokes S": 2e-11, "S'": 1e-9}.items():
        reference = exact[name][:: fine // N]
        scale = jnp.max(jnp.abs(reference))
        np.testing.assert_allclose(found[name], reference, atol=tolerance * scale, rtol=0, err_msg=name)
        # the trapezoidal error e^{-2πd}, which the refined grid has removed
        assert jnp.max(jnp.abs(plain[name] - reference)) > 1e-2 * np.exp(-2 * np.pi * width / spacing(N, width)) * scale


def test_kernels_in_a_neck_stay_self_adjoint():
    _, kernels = jax.jit(refined)(dumbbell(64, 0.1))
    for kernel in (kernels.laplace_slp, kernels.stokes_slp.xx, kernels.stokes_slp.xy, kernels.stokes_slp.yy):
        np.testing.assert_allclose(kernel, kernel.T, atol=1e-15)


@pytest.mark.parametrize(
    ("gap", "level"), [(6.0, 0), (4.6, 0), (3.9, 1), (2.6, 1), (1.9, 2), (1.3, 2), (0.9, 3), (0.3, 3)]
)
def test_the_refinement_follows_the_distance_in_node_spacings(gap, level):
    """Two straight strands of a stadium; p d ≥ 4 with p = 1, 2, 4, 8, and half a spacing of caution."""
    N = 256
    width = gap * 2 * np.pi / N
    straight = np.pi * (1 - width / 2)
    s = np.arange(N) * 2 * np.pi / N
    arc = np.pi * width / 2
    place = np.mod(s, straight + arc)
    angle = np.maximum(place - straight, 0) / (width / 2) - np.pi / 2
    x = np.minimum(place, straight) - straight / 2 + width / 2 * np.cos(angle) * (place > straight)
    y = width / 2 * np.sin(angle)
    turn = np.where(s < straight + arc, 1.0, -1.0)[:, None]
    curve = Curve.from_nodes(jnp.asarray(turn * np.stack([x, y], axis=-1)))
    uniform = jnp.ones(N)  # the corners of the curvature would disturb the spectral one
    curve = Curve(curve.x, curve.tangent, curve.normal, uniform, curve.curvature)
    assert int(self_refined.Refinement().level(curve)) == level


def test_apart_from_itself_a_membrane_has_the_plain_kernels(shape):
    """To round-off, for the compiler orders sums as it likes: nothing is refined."""
    x = shape(64)
    assert int(self_refined.Refinement().level(Curve.from_nodes(x))) == 0
    same = functools.partial(np.testing.assert_allclose, rtol=0, atol=1e-14)
    jax.tree.map(same, jax.jit(refined)(x)[1], jax.jit(by_kress)(x)[1])


def test_lanes_decide_together_and_branches_stay_branches():
    """Under vmap, a round vesicle beside a necked one keeps its potentials to the accuracy of the rule."""
    x = jnp.stack([dumbbell(64, 1.0), dumbbell(64, 0.2)])
    lanes = jax.vmap(lambda x: self_kernels(x[None], electric=True)[1].laplace_slp[0])
    together = jax.jit(lanes)(x)
    np.testing.assert_allclose(together[1], refined(x[1])[1].laplace_slp, atol=1e-14)
    smooth = jnp.cos(fourier.grid(64))
    np.testing.assert_allclose(together[0] @ smooth, by_kress(x[0])[1].laplace_slp @ smooth, atol=1e-9)
    assert "cond[" in str(jax.make_jaxpr(lanes)(x))
    np.testing.assert_array_equal(jax.vmap(greatest)(jnp.array([1, 3, 2])), [3, 3, 3])


@pytest.mark.parametrize("width", [0.5, 0.12])
def test_gradients_through_a_neck_are_right(width):
    """Reverse mode against central differences, along a direction that widens the neck."""
    x = dumbbell(32, width)
    direction = dumbbell(32, width + 1) - x
    alpha = fourier.grid(32)

    @jax.jit
    def total(x):
        surfaces = Surfaces.of(x[None], electric=True)
        u = surfaces.stokes(jnp.stack([jnp.cos(alpha), jnp.exp(jnp.sin(alpha))], axis=-1)[None])
        return jnp.sum(jnp.sin(u)) + jnp.sum(surfaces.potential_slope(jnp.cos(alpha)[None], jnp.sin(alpha)[None]) ** 2)

    assert int(self_refined.Refinement().level(Curve.from_nodes(x))) > 0
    slope = jnp.sum(jax.grad(total)(x) * direction)
    h = 1e-4

    def difference(h):
        return (total(x + h * direction) - total(x - h * direction)) / (2 * h)

    np.testing.assert_allclose(slope, (4 * difference(h) - difference(2 * h)) / 3, rtol=1e-7)


def test_what_reverse_mode_keeps_knows_nothing_of_finer_grids():
    """What one branch keeps, all the others fill with zeros: the finest alone would keep 64 times as much."""
    N = 32
    _, pull = jax.vjp(lambda x: self_kernels(x[None], electric=True)[1], dumbbell(N, 1.0))
    assert max(leaf.size for leaf in jax.tree.leaves(pull)) <= N * N


@pytest.mark.parametrize(("share", "code"), [(1.2, status.RUNNING), (0.8, status.UNRESOLVED)])
def test_a_neck_finer_than_the_finest_grid_resolves_is_reported(share, code):
    N = 64
    scene = make_scene(dumbbell(N, 1.0))
    equation = equation_for(scene)
    found = {name: jnp.zeros(()) for name in ("spectral_tail", "residual")}
    found |= {"area": equation.area, "length": 2 * np.pi * equation.speed}
    found |= {"self_gap": share * self_refined.RESOLVED * 2 * np.pi * equation.speed / N}
    row = Row(jnp.zeros(()), scene.x, jnp.zeros(()), found)
    assert int(Checks().judge(equation, jnp.zeros(()), Unknowns.of(scene.x), row)) == code
