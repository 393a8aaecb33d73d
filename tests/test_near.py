"""Layer potentials next to a curve: symbols on a circle, Green's identities, matrices, sides, derivatives."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import circle, ellipse

from experiments import close_evaluation
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.potentials import close_laplace, close_stokes, far, kernels
from jaxves.potentials.cauchy import complex_of, real_of
from jaxves.potentials.close_laplace import CloseGeometry

DISTANCES = np.array([0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 1e-1])


@partial(jax.jit, static_argnums=0)
def five_star(N):
    t = fourier.grid(N)
    return (1 + 0.3 * jnp.cos(5 * t))[:, None] * jnp.stack([jnp.cos(t), jnp.sin(t)], axis=-1)


@partial(jax.jit, static_argnums=0)
def crescent(N):
    """A bent strip with blunt ends, its centroid outside."""
    t = fourier.grid(N)
    angle, radius = 2.0 * jnp.cos(t), 1 - 0.3 * jnp.sin(t)
    return jnp.stack([radius * jnp.sin(angle), -radius * jnp.cos(angle)], axis=-1)


def curve_of(x):
    return jax.jit(Curve.from_nodes)(x)


@jax.jit
def both_sides(x, distances=DISTANCES):
    """Points inside, then as many outside, at every distance from nodes and from points between: (2·P, 2), mask."""
    fine = Curve.from_nodes(fourier.resample(x, 2 * x.shape[0], axis=0))
    some = slice(None, None, 9)
    steps = jnp.concatenate([-distances, distances])[:, None, None]
    targets = (fine.x[some] + steps * fine.normal[some]).reshape(-1, 2)
    return targets, jnp.arange(len(targets)) < len(targets) // 2


def harmonic(x, inside):
    """A harmonic function of either side with its gradient; the outer one has a charge, and log r at infinity."""
    z, pole = complex_of(x), complex_of(x) - 0.05
    value = jnp.where(inside, jnp.exp(z), jnp.log(pole) + 0.1 / pole).real
    return value, real_of(jnp.conj(jnp.where(inside, jnp.exp(z), 1 / pole - 0.1 / pole**2)))


@pytest.mark.parametrize(("make", "N"), [(circle, 96), (lambda N: ellipse(N, 1.0, 0.25), 288), (five_star, 288)])
def test_green_identity_holds_to_twelve_digits_at_any_distance(make, N):
    """±(S[∂_n u] - D[u]) is u on its side and 0 on the other; so are the gradients, to ten digits."""
    x = make(N)
    targets, inside = both_sides(x)

    @jax.jit
    def residuals(x, targets):
        curve = Curve.from_nodes(x)
        close = CloseGeometry.of(curve, targets, inside=inside)
        found = []
        for own in (True, False):
            u, gradient = harmonic(x, own)
            sign = 1 if own else -1
            slope = sign * jnp.sum(gradient * curve.normal, axis=-1)
            value = close_laplace.laplace_slp(close, slope) - close_laplace.laplace_dlp(close, sign * u)
            flow = close_laplace.laplace_slp_gradient(close, slope) - close_laplace.laplace_dlp_gradient(
                close, sign * u
            )
            here = jnp.where(inside == own, 1.0, 0.0)
            exact, exact_gradient = harmonic(targets, own)
            exact, exact_gradient = here * exact, here[:, None] * exact_gradient
            found.append(
                [
                    jnp.abs(value - exact) / jnp.max(jnp.abs(exact)),
                    jnp.abs(flow - exact_gradient) / jnp.max(jnp.abs(exact_gradient)),
                ]
            )
        return found

    for value, gradient in residuals(x, targets):
        assert jnp.max(value) < 1e-12
        assert jnp.max(gradient) < 1e-10


def test_potentials_of_a_circle_are_the_known_ones():
    """S cos kθ = (R/2k)(r/R)^±k cos kθ, S 1 = -R log max(r, R); D halves and signs likewise; radius 0.6."""
    R, k = 0.6, 3
    x = circle(64, R)
    targets, inside = both_sides(x)
    r, angle = jnp.hypot(targets[:, 0], targets[:, 1]), jnp.arctan2(targets[:, 1], targets[:, 0])
    mode = jnp.cos(k * fourier.grid(64))

    @jax.jit
    def found(x):
        close = CloseGeometry.of(Curve.from_nodes(x), targets, inside=inside)
        ones = jnp.ones(64)
        single = close_laplace.laplace_slp(close, mode), close_laplace.laplace_slp(close, ones)
        return *single, close_laplace.laplace_dlp(close, mode), close_laplace.laplace_dlp(close, ones)

    decay = jnp.where(inside, r / R, R / r) ** k * jnp.cos(k * angle)
    exact = (
        R / (2 * k) * decay,
        -R * jnp.log(jnp.where(inside, R, r)),
        jnp.where(inside, -0.5, 0.5) * decay,
        jnp.where(inside, -1.0, 0.0),
    )
    for a, b in zip(found(x), exact, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-13)


@jax.jit
def stokeslet_data(x, normal):
    """Velocity and traction of a point force outside."""
    place, force = jnp.array([1.5, 1.2]), jnp.array([0.6, 0.8])
    r = x - place
    traction = -r * ((r @ force) * jnp.sum(r * normal, -1) / (jnp.pi * jnp.sum(r**2, -1) ** 2))[:, None]
    return kernels.stokeslet(r) @ force, traction


def test_stokes_green_identity_and_stress_at_any_distance():
    """S[T] - D[u] is u inside and 0 outside; the stress of S is -p + ∇u + ∇uᵀ, and S[n] is a pressure alone."""
    x = ellipse(192, 1.0, 0.25)
    targets, inside = both_sides(x)

    @jax.jit
    def found(x, targets):
        curve = Curve.from_nodes(x)
        close = CloseGeometry.of(curve, targets, inside=inside)
        u, traction = stokeslet_data(x, curve.normal)
        flow = close_stokes.stokes_slp(close, traction) - close_stokes.stokes_dlp(close, u)
        stress = close_stokes.stokes_slp_stress(close, traction)

        def velocity(moved):
            return close_stokes.stokes_slp(CloseGeometry.of(curve, moved, inside=inside), traction)

        columns = [jax.jvp(velocity, (targets,), (jnp.zeros_like(targets).at[:, b].set(1.0),))[1] for b in (0, 1)]
        slope = jnp.stack(columns, axis=-1)
        pressure = close_stokes.stokes_slp_pressure(close, traction)
        expected = slope + jnp.swapaxes(slope, 1, 2) - pressure[:, None, None] * jnp.eye(2)
        still = close_stokes.stokes_slp(close, curve.normal), close_stokes.stokes_slp_pressure(close, curve.normal)
        return flow, stress, expected, still

    flow, stress, expected, (velocity, pressure) = found(x, targets)
    exact = jnp.where(inside[:, None], stokeslet_data(targets, targets)[0], 0.0)
    np.testing.assert_allclose(flow, exact, atol=1e-12)
    np.testing.assert_allclose(stress, expected, atol=1e-10 * float(jnp.max(jnp.abs(stress))))
    np.testing.assert_allclose(velocity, 0, atol=1e-12)
    np.testing.assert_allclose(pressure, jnp.where(inside, -1.0, 0.0), atol=1e-12)


def test_matrices_and_applications_agree_with_each_other_and_far_away_with_the_trapezoidal_rule():
    """On a crescent with net charge and force, whose centroid lies outside it."""
    x = crescent(320)
    targets, inside = both_sides(x, np.array([0.0, 1e-8, 0.04]))
    V = jnp.exp(jnp.sin(2 * fourier.grid(320))) + 0.3
    flux = jnp.stack([V, jnp.cos(3 * fourier.grid(320)) - 0.2], axis=-1)

    @jax.jit
    def found(x):
        curve, fine = (Curve.from_nodes(fourier.resample(x, K, axis=0)) for K in (320, 2560))
        close = CloseGeometry.of(curve, targets)
        f, f_fine = (fourier.resample(flux, c.speed.size, axis=0) / c.speed[:, None] for c in (curve, fine))
        V_fine, one = fourier.resample(V, 2560), jax.tree.map(lambda leaf: leaf[None], fine)
        pairs = [
            (
                close_laplace.laplace_slp(close, f[:, 0]),
                close_laplace.laplace_slp_matrix(close) @ f[:, 0],
                far.laplace_slp,
                f_fine[:, 0],
            ),
            (close_laplace.laplace_dlp(close, V), close_laplace.laplace_dlp_matrix(close) @ V, far.laplace_dlp, V_fine),
            (close_stokes.stokes_slp(close, f), close_stokes.stokes_slp_matrix(close) @ f, far.stokes_slp, f_fine),
        ]
        for name, density, finer in (
            ("laplace_slp_gradient", f[:, 0], f_fine[:, 0]),
            ("laplace_dlp_gradient", V, V_fine),
        ):
            matrix = getattr(close_laplace, name + "_matrix")(close)
            pairs.append(
                (getattr(close_laplace, name)(close, density), (matrix @ density).T, getattr(far, name), finer)
            )
        return [(a, b, rule(one, density[None], targets)) for a, b, rule, density in pairs], close.inside

    values, sides = found(x)
    # Targets: distances 0, 1e-8, 0.04 inside, then outside; on the curve itself either side may be found.
    distance = np.repeat([0, 1, 2, 0, 1, 2], len(targets) // 6)
    np.testing.assert_array_equal(sides[distance > 0], inside[distance > 0])
    for applied, by_matrix, trapezoidal in values:
        scale = float(jnp.max(jnp.abs(applied)))
        np.testing.assert_allclose(applied, by_matrix, atol=1e-12 * scale)
        np.testing.assert_allclose(applied[distance == 2], trapezoidal[distance == 2], atol=1e-10 * scale)


def test_derivatives_with_respect_to_nodes_densities_and_targets_hold_down_to_touching():
    """Forward, reverse and central differences agree at distances 0, 1e-10, 1e-6 and 1e-2, on either side."""
    x = ellipse(64, 1.0, 0.6)
    curve = curve_of(x)
    distances = np.array([0.0, 1e-10, 1e-6, 1e-2])[:, None, None]
    targets = jnp.concatenate([curve.x[::16] + s * distances * curve.normal[::16] for s in (-1, 1)]).reshape(-1, 2)
    inside = jnp.arange(len(targets)) < len(targets) // 2
    t = fourier.grid(64)
    f = jnp.stack([jnp.exp(jnp.sin(t)), jnp.cos(2 * t)], axis=-1)

    @jax.jit
    def value(x, f, targets):
        close = CloseGeometry.of(Curve.from_nodes(x), targets, inside=inside)
        return jnp.concatenate(
            [
                close_stokes.stokes_slp_matrix(close) @ f,
                close_laplace.laplace_slp_gradient(close, f[:, 0]),
                jnp.stack(
                    [close_laplace.laplace_slp(close, f[:, 0]), close_laplace.laplace_dlp(close, f[:, 1])], axis=-1
                ),
            ]
        )

    at = (x, f, targets)
    along = (jnp.stack([jnp.sin(3 * x[:, 0]), jnp.cos(20 * t) / 20], -1), jnp.sin(x), jnp.cos(3 * targets))
    weights = jnp.cos(jnp.arange(6.0 * len(targets))).reshape(-1, 2)
    reverse = jax.jit(jax.grad(lambda *at: jnp.sum(weights * value(*at)), argnums=(0, 1, 2)))(*at)
    derivative = jax.jit(lambda *tangent: jax.jvp(value, at, tangent)[1])
    for which in range(3):
        tangent = tuple(d if i == which else jnp.zeros_like(d) for i, d in enumerate(along))
        forward = derivative(*tangent)
        step = 1e-5
        ahead, behind = (value(*(a + s * step * d for a, d in zip(at, tangent, strict=True))) for s in (1, -1))
        difference = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(forward, difference, atol=1e-6 * float(jnp.max(jnp.abs(difference))))
        np.testing.assert_allclose(jnp.sum(reverse[which] * along[which]), jnp.sum(weights * forward), rtol=1e-10)


def test_a_batch_of_curves_gives_what_each_gives_alone():
    """Under vmap, over curves and targets, with the side decided for each; without finer nodes."""
    curves = jnp.stack([ellipse(32), ellipse(32) * 0.7])
    targets = jnp.array([[0.9, 0.3], [0.0, 0.71]])

    def value(x, y):
        close = CloseGeometry.of(Curve.from_nodes(x), y[None], upsample=1)
        return close_laplace.laplace_slp(close, x[:, 0])[0], close.inside[0]

    batched, sides = jax.jit(jax.vmap(value))(curves, targets)
    alone = [jax.jit(value)(x, y) for x, y in zip(curves, targets, strict=True)]
    np.testing.assert_allclose(batched, jnp.stack([v for v, _ in alone]), atol=1e-14)
    assert sides.tolist() == [True, False] == [bool(side) for _, side in alone]


def test_the_four_cases_on_the_star_are_as_accurate_as_published_codes():
    """L-GRF, L-S, S-GRF, S-S at distance 1e-3: within 5% of what BIE2D reaches, or better."""
    published = {150: [8e-13, 5.9e-7, 2.7e-7, 3.9e-6]}
    found = close_evaluation.four_cases(sizes=tuple(published), reference=480)
    for N, errors in published.items():
        assert np.all(np.array(found[N]) < 1.05 * np.array(errors))


def test_the_experiment_shows_what_it_claims():
    """Every rule of ours holds on the circle at every distance; the trapezoidal rule does not."""
    errors = close_evaluation.by_distance("circle", distances=(1e-1, 1e-10), count=16)
    for name, error in errors.items():
        assert (np.max(error) > 1e-3) if name.startswith("trapezoidal") else (np.max(error) < 1e-12)
