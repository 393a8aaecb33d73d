"""Two viscosities: the Stokes double layer on a curve, the mobility, exact motions of one vesicle for every ratio ν."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import circle, diagnosed, ellipse, motion_of, star

from jaxves.equation.contrast import ViscosityContrast
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import curve, shapes
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.observables import diagnostics
from jaxves.operators.surfaces import Surfaces
from jaxves.physics.flow import LinearFlow, Shear
from jaxves.physics.rigid import RigidMotion
from jaxves.physics.scene import dc_field, make_scene
from jaxves.potentials import self_stokes_dlp
from jaxves.potentials.chords import Chords
from jaxves.potentials.self_refined import SelfKernels
from jaxves.potentials.self_stokes_dlp import RigidPart, deflated_dlp

N = 64


def whole(kernel, c):
    """The matrix of D on velocities at the nodes, as the kernel gives it."""
    return jnp.block([[kernel.xx, kernel.xy], [kernel.xy, kernel.yy]]) * jnp.tile(c.speed, 2)


@jax.jit
def dlp_of(x):
    c = Curve.from_nodes(x)
    kernel = self_stokes_dlp.dlp(c, Chords.of(c))
    rigid = RigidPart.of(c)
    return c, whole(kernel, c), rigid, deflated_dlp(c, kernel, rigid)


@pytest.mark.parametrize("R", [1.0, 0.6])
def test_the_double_layer_on_a_circle_has_its_symbol(R):
    """On v₁ + i v₂ = c e^{ikθ}: -½ on translations and the rotation, ½ on the normal, 0 on every other mode."""
    _, D, _, deflated = dlp_of(circle(N, R))
    theta = np.asarray(fourier.grid(N))
    symbols = {(0, 1): -0.5, (0, 1j): -0.5, (1, 1j): -0.5, (1, 1): 0.5}
    symbols |= {(k, c): 0.0 for k in (-7, -2, -1, 2, 3, 20) for c in (1, 1j)}
    for (k, c), symbol in symbols.items():
        v = c * np.exp(1j * k * theta)
        v = np.concatenate([v.real, v.imag])
        np.testing.assert_allclose(D @ v, symbol * v, atol=1e-13, err_msg=f"{k} {c}")
        np.testing.assert_allclose(deflated @ v, 0.0, atol=1e-13, err_msg=f"{k} {c}")


def test_the_double_layer_converges_to_its_eigenvalues_on_rigid_motions_and_on_the_flux():
    """D R = -½ R and ∮ n·D[u] ds = ½ ∮ n·u ds; the deflated one has zero instead, on rigid motions to round-off."""
    errors = []
    for nodes in (32, 64, 128):
        c, D, rigid, deflated = dlp_of(star(nodes))
        R = rigid.motions
        flux = (c.normal * c.weights[:, None]).T.reshape(-1)
        np.testing.assert_allclose(rigid.motions.T @ (rigid.weights[:, None] * R), np.eye(3), atol=1e-13)
        np.testing.assert_allclose(deflated @ R, 0.0, atol=1e-14)
        found = [D @ R + 0.5 * R, flux @ D - 0.5 * flux, flux @ deflated]
        errors.append([float(jnp.max(jnp.abs(error))) for error in found])
    errors = np.array(errors)
    assert np.all(errors[1] < 1e-2 * errors[0]) and np.all(errors[2] < 1e-9), errors


def test_strains_in_the_axes_of_an_ellipse_are_eigenvectors():
    """Strain along the axes has -½ ((a-b)/(a+b))², and (y, 0), (0, x) mix to the rotation and the opposite of it."""
    c, D, _, _ = dlp_of(ellipse(N))
    value, zero = 0.5 * ((1.4 - 0.7) / (1.4 + 0.7)) ** 2, jnp.zeros(N)
    x, y = c.x.T
    strain = jnp.concatenate([x, -y])
    np.testing.assert_allclose(D @ strain, -value * strain, atol=1e-13)
    others = jnp.stack([jnp.concatenate([y, zero]), jnp.concatenate([zero, x])], axis=1)
    mixed, *_ = np.linalg.lstsq(others, D @ others)
    np.testing.assert_allclose(others @ mixed, D @ others, atol=1e-13)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(mixed)), [-0.5, value], atol=1e-13)


def test_in_a_neck_the_finer_grid_keeps_the_double_layer_accurate():
    """On a dumbbell with a neck of about one node spacing: D R = -½ R, which the plain rule misses by far."""
    alpha = fourier.grid(N)
    x = jnp.stack([2.0 * jnp.cos(alpha), jnp.sin(alpha) * (0.06 + jnp.cos(alpha) ** 2)], axis=-1)
    c = Curve.from_nodes(x)
    R = RigidPart.of(c).motions

    def error(kernels):
        return float(jnp.max(jnp.abs(whole(kernels.stokes_dlp, c) @ R + 0.5 * R)))

    plain = jax.jit(lambda: SelfKernels.of(c, Chords.of(c), electric=False, contrast=True))()
    finer = [jax.jit(lambda p=p: SelfKernels.refined(x, p, electric=False, contrast=True))() for p in (2, 8)]
    assert error(plain) > 1e-2
    assert error(finer[0]) < 0.1 * error(plain) and error(finer[1]) < 1e-8


@eqx.filter_jit
def mobility_matrix(x, ratio):
    """S_ν as a matrix on forces per arc length, (2N, 2N), and the weights and normals."""
    surfaces = Surfaces.of(x[None], electric=False, contrast=True)
    response = ViscosityContrast(jnp.reshape(ratio, (1,))).at(surfaces)

    def velocity(f):
        return response.velocity(jnp.swapaxes(f.reshape(1, 2, -1), 1, 2))[0].T.reshape(-1)

    c = jax.tree.map(lambda leaf: leaf[0], surfaces.curves)
    matrix = jax.vmap(velocity, out_axes=1)(jnp.eye(2 * x.shape[0]))
    return matrix, jnp.tile(c.weights, 2), c.normal.T.reshape(-1)


@pytest.mark.parametrize("ratio", [1e-3, 1.0, 30.0])
def test_the_mobility_is_self_adjoint_and_not_negative_and_the_pressure_moves_nothing(ratio):
    """⟨f, S_ν g⟩ in ds is symmetric, without negative eigenvalues, and S_ν n = 0, for every ν."""
    S, weights, normal = mobility_matrix(ellipse(N), jnp.asarray(ratio))
    form = weights[:, None] * S
    size = jnp.max(jnp.abs(form))
    np.testing.assert_allclose(form, form.T, atol=1e-9 * size)
    assert np.min(np.linalg.eigvalsh(0.5 * (form + form.T))) > -1e-9 * size
    np.testing.assert_allclose(S @ normal, 0.0, atol=1e-9)


@eqx.filter_jit
def strained(x, ratio, flow):
    response = ViscosityContrast(ratio[None]).at(Surfaces.of(x[None], electric=False, contrast=True))
    return response.velocity(jnp.zeros((1, *x.shape)), flow[None])[0]


@pytest.mark.parametrize("ratio", [1e-6, 1.0, 1e8])
def test_a_rigid_flow_passes_through_and_the_flux_is_zero(ratio):
    x = ellipse(N)
    c = Curve.from_nodes(x)
    rigid = jnp.stack([0.3 - 0.7 * x[:, 1], 0.2 + 0.7 * x[:, 0]], axis=-1)
    np.testing.assert_allclose(strained(x, jnp.asarray(ratio), rigid), rigid, atol=1e-13)
    v = strained(x, jnp.asarray(ratio), jnp.stack([x[:, 1], x[:, 0]], axis=-1))
    assert abs(jnp.sum(c.weights * jnp.sum(v * c.normal, axis=-1))) < 1e-12


@eqx.filter_jit
def in_shear(x, ratio, Ca):
    """Rotation rate, tank-treading speed and [μ] at one instant in shear."""
    s = make_scene(x, flow=Shear(Ca), viscosity_ratio=ratio)
    equation, y = equation_for(s), Unknowns.of(s.x)
    motion = equation.motion(jnp.zeros(()), y)
    c, v = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves), motion.velocity[0]
    found = diagnostics.diagnose(equation, jnp.zeros(()), y, motion)
    return RigidMotion.nearest(c, v).rotation, found["tank_treading_speed"][0], found["effective_viscosity"]


@pytest.mark.parametrize("ratio", [1e-6, 0.3, 1.0, 1e8])
def test_a_circle_in_shear_is_the_same_for_every_ratio(ratio):
    """It turns at -Ca/2, and [μ] = 2."""
    rotation, speed, viscosity = in_shear(circle(N), jnp.asarray(ratio), jnp.asarray(10.0))
    np.testing.assert_allclose([rotation, speed], -5.0, rtol=1e-12)
    np.testing.assert_allclose(viscosity, 2.0, rtol=1e-11 if ratio < 1e7 else 1e-7)


def axes_of(x):
    """The semi-axes of an ellipse, from its second moments and its area."""
    c = Curve.from_nodes(x)
    small, large = np.linalg.eigvalsh(curve.second_moments(c))
    area = float(curve.area(c))
    return np.sqrt(4 * large / area), np.sqrt(4 * small / area)


def rigid_ellipse(a, b, angle, Ca):
    """Jeffery's rotation rate, and [μ] = k cos² 2θ + k_d sin² 2θ."""
    rate = -Ca / (a**2 + b**2) * (a**2 * np.sin(angle) ** 2 + b**2 * np.cos(angle) ** 2)
    k, k_d = (a + b) ** 2 / (a**2 + b**2), (a + b) ** 2 / (2 * a * b)
    return rate, k * np.cos(2 * angle) ** 2 + k_d * np.sin(2 * angle) ** 2


def test_a_very_viscous_vesicle_turns_as_a_rigid_ellipse():
    """Rotation rate and [μ] deviate by the order of 1/ν, and [μ] has the mean 2 over half a turn."""
    Ca, start = jnp.asarray(10.0), jax.jit(lambda: shapes.ellipse(N, 0.8))()
    axes, errors = axes_of(start), []
    for ratio in (1e2, 1e4, 1e6, 1e8):
        x = shapes.rotated(start, 0.4)
        rotation, _, viscosity = in_shear(x, jnp.asarray(ratio), Ca)
        errors.append(np.abs(np.array([rotation, viscosity]) / rigid_ellipse(*axes, 0.4, 10.0) - 1))
    powers = np.log10(errors[0] / errors[1]) / 2
    np.testing.assert_allclose(powers, 1.0, atol=0.05, err_msg=str(errors))
    assert np.all(np.array(errors[2:]) < 1e-6), errors
    angles = np.pi * np.arange(16) / 16
    turns = [in_shear(shapes.rotated(start, angle), jnp.asarray(1e8), Ca) for angle in angles]
    times = np.array([1 / rotation for rotation, _, _ in turns])
    mean = np.sum(times * np.array([viscosity for _, _, viscosity in turns])) / np.sum(times)
    np.testing.assert_allclose(mean, 2.0, rtol=1e-5)


@pytest.mark.parametrize("ratio", [0.1, 1.0, 3.0, 100.0])
def test_a_nearly_round_vesicle_relaxes_at_the_rates_of_the_theory(ratio):
    """f_k' = -k (k² - 3/2 + λ₀) f_k/2(1 + ν): the modes 2, 3 and 4 give one λ₀, which is the mean tension."""
    theta = np.asarray(fourier.grid(N))
    sizes = {2: 1e-4, 3: 0.7e-4, 4: 0.5e-4}
    radius = 1 + sum(2 * size * np.cos(k * theta) for k, size in sizes.items())
    x = jnp.asarray(radius[:, None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1))
    s = make_scene(x, viscosity_ratio=ratio)
    motion = motion_of(s, Unknowns.of(s.x))
    angle = np.arctan2(s.x[0, :, 1], s.x[0, :, 0])
    c = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
    radial = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    r = np.linalg.norm(s.x[0], axis=-1)
    share = np.sum(c.normal * radial, axis=-1) * c.weights / r / (2 * np.pi)  # dθ/2π
    outward = np.sum(motion.velocity[0] * c.normal, axis=-1) / np.sum(c.normal * radial, axis=-1)  # ∂r/∂t at fixed θ
    tension = np.mean(motion.sigma)
    for k, size in sizes.items():
        rate = np.sum(share * outward * np.cos(k * angle))
        expected = -k * (k**2 - 1.5 + tension + 1.5) * size / (2 * (1 + ratio))
        np.testing.assert_allclose(rate, expected, rtol=2e-3, atol=2e-8 / (1 + ratio), err_msg=str(k))
    # The perimeter is conserved: Σ (k² - 1) f_k f_k' = 0 gives the tension.
    weights = {k: (k**2 - 1) * k * size**2 for k, size in sizes.items()}
    mean = -sum(w * (k**2 - 1.5) for k, w in weights.items()) / sum(weights.values())
    np.testing.assert_allclose(tension + 1.5, mean, rtol=2e-3)


def everything(ratio, **more):
    x = shapes.ellipse(N, 0.9, angle=0.4)
    field = dc_field(3.2, conductivity_ratio=0.1, membrane_conductance=0.3)
    return make_scene(x, viscosity_ratio=ratio, field=field, flow=LinearFlow([[1.0, 9.0], [-2.0, -1.0]]), **more)


@pytest.mark.parametrize("ratio", [0.05, 7.0])
def test_the_energy_balance_closes_and_both_fluids_dissipate(ratio):
    """In a flow with strain and rotation, and a field, on a charged membrane."""
    s = everything(ratio)
    alpha = fourier.grid(N)
    y = Unknowns.of(s.x, 0.4 * (jnp.sin(alpha) + 0.3 * jnp.cos(2 * alpha))[None])
    found = diagnosed(s, y)
    assert found["dissipation"] > 0
    assert abs(found["power_balance"] / found["dissipation"]) < 1e-5


def test_a_ratio_of_one_is_one_viscosity():
    alone, equal = everything(None), everything(1.0)
    y = Unknowns.of(alone.x, 0.3 * jnp.sin(fourier.grid(N))[None])
    np.testing.assert_allclose(motion_of(equal, y).velocity, motion_of(alone, y).velocity, atol=1e-11)


def test_one_viscosity_computes_no_double_layer(calls_of):
    calls = calls_of(self_stokes_dlp, "dlp")

    def step(scene):
        equation = equation_for(scene)
        y = equation.start()
        return equation.freeze(jnp.zeros(()), y).implicit(jnp.asarray(1e-3)).solve(y).x

    jax.make_jaxpr(step)(everything(None))
    assert not calls
    jax.make_jaxpr(step)(everything(1.0))
    assert calls


@pytest.mark.parametrize("ratio", [1.0, 20.0])
def test_an_implicit_step_has_equal_forward_and_reverse_derivatives_that_are_those_of_differences(ratio):
    """At ν = 1 as well, where the motion is that of one viscosity but its derivative is not zero."""
    value, forward, reverse = step_with_derivatives(jnp.asarray(ratio))
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    h = 1e-3 * ratio
    (high, *_), (low, *_) = (step_with_derivatives(jnp.asarray(ratio + d)) for d in (h, -h))
    np.testing.assert_allclose(forward, (high - low) / (2 * h), rtol=1e-5)
    assert abs(forward) > 1e-3 * abs(value) / ratio


@jax.jit
def step_with_derivatives(ratio):
    """A component of (1 - c A)⁻¹ F, and its derivative in ν in both modes."""
    x = shapes.ellipse(32, 0.9, angle=0.4)

    def moved(ratio):
        equation = equation_for(make_scene(x, viscosity_ratio=ratio, flow=Shear(5.0)))
        frozen = equation.freeze(jnp.zeros(()), Unknowns.of(x[None]))
        step = frozen.implicit(jnp.asarray(0.02)).solve(equation.rate_of(frozen, jnp.zeros(())))
        return jnp.sum(step.x[0, :, 1] * x[:, 0])

    value, forward = jax.jvp(moved, (ratio,), (jnp.ones(()),))
    return value, forward, jax.grad(moved)(ratio)
