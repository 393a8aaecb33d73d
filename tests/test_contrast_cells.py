"""Vesicles with viscosities of their own in periodic cells: rigid motions, lattices of discs, images, derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell
from jaxves.numerics import fourier
from jaxves.observables.diagnostics import diagnose
from jaxves.operators.sums import MatrixFree
from jaxves.operators.surfaces import Surfaces
from jaxves.physics.flow import Shear
from jaxves.physics.scene import make_scene

N, RATE = 32, 4.0
LATTICE = np.array([[5.9, 0.0], [0.6, 3.7]])
RATIOS = np.array([0.2, 15.0])
SUMS = MatrixFree(accuracy=1e-12)
SHEARED = {0.1: 1.192224187648, 0.3: 1.598115977416}  # μ*/μ of the square lattice of rigid discs, see test_cell
MEAN = ("mean_stress", "relative_viscosity", "dissipation")


def ellipses(nodes=N):
    """Two ellipses, closer to each other or to images than five node spacings."""
    x = [shapes.ellipse(nodes, 0.9, angle=0.4), shapes.ellipse(nodes, 0.95, angle=1.9)]
    return np.stack(x) + np.array([[[0.3, -0.2]], [[2.7, 1.2]]])


def scene_of(x, lattice, ratio, rate=RATE):
    return make_scene(list(x), flow=Shear(rate), viscosity_ratio=ratio, cell=Cell.of(lattice))


@eqx.filter_jit
def diagnosed(scene, t=0.0):
    equation, t = equation_for(scene, coupling=SUMS), jnp.asarray(t)
    y = Unknowns.of(scene.x)
    return diagnose(equation, t, y, equation.motion(t, y))


def rigid_of(x, turn=0.7):
    return jnp.stack([0.3 - turn * x[..., 1], 0.2 + turn * x[..., 0]], axis=-1)


def test_the_double_layer_of_a_rigid_motion_of_a_membrane_is_zero_outside():
    """Its value on the membrane is that of the plane, so nothing is left for its images and for the others."""

    @jax.jit
    def at_others(x, lattice):
        surfaces = Surfaces.of(x, electric=False, contrast=True, coupling=SUMS, domain=Cell(lattice))
        moves = jnp.stack([jnp.zeros_like(x).at[m].set(rigid_of(x[m])) for m in range(2)])
        return jax.lax.map(surfaces.double_layers, moves), surfaces.interactions.crowded, surfaces.interactions.near

    # 32 nodes integrate over the ellipses to seven digits
    for lattice in (LATTICE, LATTICE @ np.diag([1.1, 1.4])):
        velocity, crowded, near = at_others(ellipses(), lattice)
        assert not crowded and jnp.any(near.valid)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-7)


@pytest.mark.parametrize("phi", [0.1, 0.3])
def test_circles_with_a_very_viscous_inside_are_the_lattice_of_rigid_discs(phi):
    circle = np.asarray(shapes.circle(64))[None] + np.array([0.3, 0.2])
    found = diagnosed(scene_of(circle, np.sqrt(np.pi / phi) * np.eye(2), 1e7))
    # the deviation is of the order of 1/ν
    np.testing.assert_allclose(found["relative_viscosity"], SHEARED[phi], rtol=1e-6)


def test_images_and_copies_of_the_cell_leave_the_stress_as_it_is():
    """A vesicle moved by a vector of the lattice; the scene moved; and two cells with one vesicle in another image."""
    x, shift = ellipses(16), np.array([0.37, 0.81])
    wanted = diagnosed(scene_of(x, LATTICE, RATIOS))
    moved = x + np.array([[[0.0, 0.0]], [LATTICE[1] - LATTICE[0]]]) + shift
    double = np.concatenate([x, x + LATTICE[1]])
    double[3] = double[3] - 2 * LATTICE[1] + LATTICE[0]
    twice = np.stack([LATTICE[0], 2 * LATTICE[1]]), np.tile(RATIOS, 2)
    for scene in (scene_of(moved, LATTICE, RATIOS), scene_of(double, *twice)):
        found = diagnosed(scene)
        assert found["residual"] < 1e-11
        for name in ("mean_stress", "relative_viscosity"):
            # GMRES to 1e-11, times the condition of the systems
            np.testing.assert_allclose(found[name], wanted[name], rtol=1e-9, atol=1e-9)


@eqx.filter_jit
def moved_by(scene, force, imposed):
    equation = equation_for(scene, coupling=SUMS)
    surfaces = equation.motion(jnp.zeros(()), Unknowns.of(scene.x)).surfaces
    return equation.mobility.at(surfaces).velocity(force, imposed), surfaces.curves.weights[..., None]


def test_the_mobility_is_self_adjoint_and_a_rigid_translation_passes_through():
    """Also for forces with a sum. Both need that the mean velocity over the cell, insides included, is that imposed."""
    scene, alpha = scene_of(ellipses(), LATTICE, RATIOS), np.asarray(fourier.grid(N))
    f = np.moveaxis(np.array([[np.cos(2 * alpha) + 1, np.sin(alpha)], [np.sin(3 * alpha), 0 * alpha]]), 1, 2)
    g = np.moveaxis(np.array([[np.sin(alpha), np.cos(alpha)], [np.cos(alpha) - 2, np.sin(2 * alpha)]]), 1, 2)
    nothing, along = np.zeros_like(f), np.broadcast_to([0.3, 0.2], f.shape)
    (of_f, weights), (of_g, _) = (moved_by(scene, force, nothing) for force in (f, g))
    # quadrature with 32 nodes
    np.testing.assert_allclose(np.sum(weights * g * of_f), np.sum(weights * f * of_g), rtol=1e-6)
    np.testing.assert_allclose(moved_by(scene, nothing, along)[0], along, atol=1e-9)


def test_a_large_cell_has_the_stress_of_the_plane_up_to_one_over_its_area():
    x = ellipses()[:1]
    alone = diagnosed(make_scene(list(x), flow=Shear(RATE), viscosity_ratio=8.0))["stress"]
    errors = []
    for side in (16.0, 32.0):
        found = diagnosed(scene_of(x, side * np.eye(2), 8.0))
        errors.append(np.max(np.abs(found["mean_stress"] * side**2 / found["area"][0] - alone)))
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert errors[1] < 0.01 * np.max(np.abs(alone))


def test_a_ratio_of_one_is_one_viscosity():
    one, none = (diagnosed(scene_of(ellipses(), LATTICE, ratio)) for ratio in (1.0, None))
    for name in MEAN:
        # D of one membrane on another is integrated by quadrature with 32 nodes
        np.testing.assert_allclose(one[name], none[name], rtol=1e-7, atol=1e-7)
    assert abs(one["power_balance"]) < 1e-3 * one["dissipation"]


def test_derivatives_in_the_ratio_and_the_lattice_agree_in_both_modes_and_with_differences():
    """For one vesicle that is near its own images."""
    x = jnp.asarray(ellipses(16)[:1])
    known = scene_of(x, LATTICE, RATIOS[1])

    def work(ratio, lattice):
        scene = eqx.tree_at(lambda s: (s.viscosity_ratio, s.cell.lattice), known, (ratio[None], lattice))
        motion = equation_for(scene, coupling=SUMS).motion(jnp.zeros(()), Unknowns.of(x))
        return jnp.sum(motion.velocity * jnp.sin(x)) + jnp.sum(motion.sigma**2) / 100

    value, start = jax.jit(work), (jnp.asarray(RATIOS[1]), jnp.asarray(LATTICE))
    reverse = jax.jit(jax.grad(work, argnums=(0, 1)))(*start)
    along = jnp.array([[0.2, 0.0], [0.3, -0.1]])
    forward = jax.jit(lambda *push: jax.jvp(work, start, push)[1])
    for push in ((jnp.ones(()), 0 * along), (jnp.zeros(()), along)):
        slope = sum(jnp.sum(a * b) for a, b in zip(reverse, push, strict=True))
        np.testing.assert_allclose(forward(*push), slope, rtol=1e-8)
        h = 1e-3 if push[0] == 0 else 1e-2 * RATIOS[1]
        moved = [value(*(a + k * h * b for a, b in zip(start, push, strict=True))) for k in (-2, -1, 1, 2)]
        change = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * h)
        np.testing.assert_allclose(slope, change, rtol=1e-6)


def test_a_very_viscous_inside_needs_few_more_iterations():
    """The near double layers precondition. Without them, ν = 100 takes twice the iterations of ν = 1."""

    x = near_each_other()

    @eqx.filter_jit
    def iterations(ratio):
        scene = scene_of(x, LATTICE, jnp.full(2, ratio))
        motion = equation_for(scene, coupling=MatrixFree(accuracy=1e-6)).motion(jnp.zeros(()), Unknowns.of(scene.x))
        return motion.iterations, motion.residual

    few, _ = iterations(jnp.asarray(1.0))
    many, residual = iterations(jnp.asarray(100.0))
    assert many <= 1.5 * few and residual < 1e-6


def near_each_other():
    """Returns two ellipses side by side, with a gap of 0.08."""
    x = shapes.ellipse(N, 0.9, angle=np.pi / 2)
    return np.stack([x, x + np.array([2 * float(np.max(x[:, 0])) + 0.08, 0.3])])
