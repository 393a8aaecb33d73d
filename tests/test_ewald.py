"""Fast sums: equal to direct sums in the plane, known constants and symmetries in cells, right derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import of_equal_cells

from jaxves.ewald import splitting
from jaxves.ewald.lists import Excluded
from jaxves.ewald.plans import Plan, accuracy_for, plan_for
from jaxves.ewald.sums import EwaldSums
from jaxves.geometry.domain import Cell, Free
from jaxves.potentials import kernels

RNG = np.random.default_rng(3)
M, N = 16, 8
SQUARE, HEXAGONAL = np.eye(2), np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])


def nothing():
    return Excluded(jnp.zeros(1, int), jnp.zeros(1, int), jnp.zeros((1, 2), int), jnp.zeros(1, bool))


def vesicles():
    """Nodes on ellipses in four rows, turned at random; weights, forces and charges without a pattern."""
    angle = 2 * np.pi * np.arange(N) / N
    turns, places = RNG.uniform(0, np.pi, M), np.stack(np.divmod(np.arange(M), 4), axis=-1) * 2.9
    z = np.exp(1j * turns)[:, None] * (1.25 * np.cos(angle) + 0.68j * np.sin(angle)) + (places @ [1, 1j])[:, None]
    x = np.stack([z.real, z.imag], axis=-1)
    return [jnp.asarray(a) for a in (x, RNG.uniform(0.5, 1, (M, N)), RNG.normal(size=x.shape), RNG.normal(size=(M, N)))]


X, WEIGHTS, F, Q = vesicles()


def all_sums(x, plan, domain, excluded=None):
    """Velocity, ∇S, S and pressure at all nodes, from all nodes but those of the same vesicle (in its own image)."""
    sums = EwaldSums.of(x, WEIGHTS[: len(x)], plan, domain, nothing() if excluded is None else excluded)
    r = x[:, :, None] - x[:, None]
    A, B = (part * WEIGHTS[: len(x), None] for part in sums.smooth(jnp.sum(r**2, axis=-1)))
    along = B * jnp.einsum("mijk,mjk->mij", r, F[: len(x)])
    q = Q[: len(x)]
    own = (
        jnp.einsum("mij,mjk->mik", A, F[: len(x)]) + jnp.einsum("mij,mijk->mik", along, r),
        jnp.einsum("mijk,mij,mj->mik", r, -2 * B, q),
        jnp.einsum("mij,mj->mi", 2 * (A + B * jnp.sum(r**2, axis=-1)) - WEIGHTS[: len(x), None] / (2 * np.pi), q),
        2 * jnp.sum(along, axis=-1),
    )
    f = F[: len(x)]
    found = sums.stokes(f), sums.slp_gradient(q), sums.slp(q), sums.pressure(f)
    return tuple(a - b for a, b in zip(found, own, strict=True)), sums.overflow


def directly(x):
    y, w = x.reshape(-1, 2), WEIGHTS.reshape(-1)
    vesicle = np.arange(M * N) // N
    same = (vesicle[:, None] == vesicle)[..., None]
    r = jnp.where(same, 1.0, y[:, None] - y)
    weights = jnp.where(same[..., 0], 0.0, w)
    f, q = F.reshape(-1, 2), Q.reshape(-1)
    found = (
        jnp.einsum("ij,ijab,jb->ia", weights, kernels.stokeslet(r), f),
        jnp.einsum("ij,ija,j->ia", weights, kernels.laplace_gradient(r), q),
        jnp.einsum("ij,ij,j->i", weights, kernels.laplace(r), q),
        jnp.einsum("ij,ija,ja->i", weights, kernels.stokeslet_pressure(r), f),
    )
    return [value.reshape(M, N, *value.shape[1:]) for value in found]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_local_and_smooth_part_are_the_kernel(tolerance):
    r = jnp.asarray(np.stack([np.geomspace(1e-9, 3, 300), np.linspace(-1.5, 1.5, 300)], axis=-1))
    r2, accuracy, r_c = jnp.sum(r**2, axis=-1), accuracy_for(tolerance), jnp.asarray(1.7)
    A, B = (a + b for a, b in zip(splitting.local(r2, r_c, accuracy), splitting.smooth(r2, r_c, accuracy), strict=True))
    whole = A[:, None, None] * jnp.eye(2) + B[:, None, None] * r[:, :, None] * r[:, None]
    np.testing.assert_allclose(whole, kernels.stokeslet(r), atol=0.1 * tolerance)
    np.testing.assert_allclose(-2 * B[:, None] * r, kernels.laplace_gradient(r), atol=0.2 * tolerance)


def test_the_transform_of_the_blob_is_smooth_up_to_its_end():
    """At κ = c it is c/sinh c, and Stokes (1 + c²/6) c/sinh c. From there on it is zero."""
    accuracy = accuracy_for(1e-12)
    c = accuracy.shape
    kappa2 = jnp.asarray(c**2 - np.array([1e-13, 1e-9, 1e-3, 0.999999, 1.000001, 0.0]))
    gamma, stokes = splitting.blob_transforms(kappa2, accuracy)
    end = c / np.sinh(c)
    np.testing.assert_allclose(gamma[:2], end, rtol=1e-9)
    np.testing.assert_allclose(stokes[:2], end * (1 + c**2 / 6), rtol=1e-9)
    np.testing.assert_allclose(gamma[2], end * (1 + 1e-3 / 6), rtol=1e-7)
    np.testing.assert_allclose([gamma[3], stokes[3]], [gamma[4], stokes[4]], rtol=1e-5)
    assert gamma[5] == stokes[5] == 0


@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
def test_fast_sums_are_the_direct_sums_to_the_tolerance(tolerance):
    plan = plan_for(M, N, tolerance)
    found, overflow = jax.jit(lambda x: all_sums(x, plan, Free()))(X)
    assert not overflow
    for value, exact in zip(found, jax.jit(directly)(X), strict=True):
        np.testing.assert_allclose(value, exact, atol=tolerance * np.max(np.abs(exact)))


def test_lists_without_room_and_patches_without_room_are_noticed():
    plan = plan_for(M, N, 1e-4)
    for smaller in (plan._replace(vesicles=4), plan._replace(room=4), plan._replace(patch=plan.patch - 8)):
        assert jax.jit(lambda x, plan=smaller: all_sums(x, plan, Free()))(X)[1]


@pytest.mark.parametrize(
    ("lattice", "stokes", "laplace"),
    [(SQUARE, -1.3105329259, -0.2085777932), (HEXAGONAL, -1.3930379465, -0.2217088751)],
    ids=["square", "hexagonal"],
)
@pytest.mark.parametrize("grid", [64, 90])
def test_the_constants_of_lattices_do_not_depend_on_the_splitting(lattice, stokes, laplace, grid):
    """The regular part of the periodic kernels at their own place [Hasimoto; Sangani & Acrivos]."""
    plan = Plan(accuracy_for(1e-12), (grid, grid), 16, 1, 8, 8, 1)

    @jax.jit
    def constants(lattice):
        one = jnp.ones((1, 1))
        sums = EwaldSums.of(jnp.array([[[0.3, 0.2]]]), one, plan, Cell(lattice), nothing())
        A, _ = sums.smooth(jnp.zeros(()))
        velocity = sums.stokes(jnp.array([[[1.0, 0.0]]]))[0, 0] - jnp.stack([A, 0.0])
        return 4 * jnp.pi * velocity[0] + 0.5, velocity[1], sums.slp(one)[0, 0] - 2 * A + 0.5 / jnp.pi

    found = constants(jnp.asarray(lattice))
    np.testing.assert_allclose(found, (stokes, 0.0, laplace), atol=6e-11)  # the digits that are known


IN_CELL = Plan(accuracy_for(1e-12), (120, 120), 90, 8, 48, 48, 1)
LATTICE = np.array([[6.2, 0.4], [1.1, 5.9]])


def in_cell(lattice, x=X[:4], plan=IN_CELL):
    return all_sums(x, plan, Cell(lattice))


def test_sums_in_a_cell_do_not_depend_on_basis_and_image():
    for a, b, c in zip(*of_equal_cells(in_cell, LATTICE, X[:4]), strict=True):
        np.testing.assert_allclose(b, a, atol=1e-12 * np.max(np.abs(a)))
        np.testing.assert_allclose(c, a, atol=1e-12 * np.max(np.abs(a)))


def test_a_double_cell_is_the_same_as_one():
    x = X[:2]
    double = np.array([2 * LATTICE[0], LATTICE[1]])
    plan = IN_CELL._replace(grid=(240, 120), vesicles=60, room=60)
    one, overflow = jax.jit(in_cell)(LATTICE, x)
    weights, f, q = WEIGHTS[:2], F[:2], Q[:2]

    @jax.jit
    def twice():
        both = jnp.concatenate([x, x + LATTICE[0]])
        two = lambda a: jnp.concatenate([a, a])  # noqa: E731
        sums = EwaldSums.of(both, two(weights), plan, Cell(double), nothing())
        r = both[:, :, None] - both[:, None]
        A, B = (part * two(weights)[:, None] for part in sums.smooth(jnp.sum(r**2, axis=-1)))
        own = jnp.einsum("mij,mjk->mik", A, two(f))
        own = own + jnp.einsum("mij,mijk->mik", B * jnp.einsum("mijk,mjk->mij", r, two(f)), r)
        gradient = sums.slp_gradient(two(q)) - jnp.einsum("mijk,mij,mj->mik", r, -2 * B, two(q))
        return sums.stokes(two(f)) - own, gradient, sums.overflow

    velocity, gradient, more = twice()
    assert not (overflow or more)
    for found, wanted in ((velocity, one[0]), (gradient, one[1])):
        np.testing.assert_allclose(found[:2], wanted, atol=1e-12 * np.max(np.abs(wanted)))
        np.testing.assert_allclose(found[2:], wanted, atol=1e-12 * np.max(np.abs(wanted)))


@pytest.mark.parametrize("domain", [Free(), Cell(2 * LATTICE)], ids=["plane", "cell"])
def test_derivatives_agree_in_both_modes_and_with_the_forces_of_an_energy(domain):
    """d/dx of ½ Σ q S[q] is q ∇S[q], and second derivatives are those of differences."""
    plan = plan_for(M, N, 1e-12)._replace(images=1, vesicles=40, room=40)
    push = jnp.asarray(RNG.normal(size=X.shape))

    def energy(x):
        found, _ = all_sums(x, plan, domain)
        return 0.5 * jnp.sum(WEIGHTS * Q * found[2]), jnp.sum(F * found[0]), found[1]

    @jax.jit
    def everything(x):
        _, slopes = jax.jvp(energy, (x,), (push,))
        potential = jax.grad(lambda x: energy(x)[0])(x)
        work = jax.grad(lambda x: energy(x)[1])(x)
        second = jax.jvp(jax.grad(lambda x: energy(x)[0]), (x,), (push,))[1]
        return slopes, potential, work, second, energy(x)[2]

    slopes, potential, work, second, gradient = everything(X)
    np.testing.assert_allclose(jnp.sum(work * push), slopes[1], rtol=1e-12)
    exact = (WEIGHTS * Q)[..., None] * gradient
    np.testing.assert_allclose(potential, exact, atol=1e-10 * np.max(np.abs(exact)))
    h = 1e-3
    values = [everything(X + k * h * push)[1] for k in (-2, -1, 1, 2)]
    change = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
    np.testing.assert_allclose(second, change, atol=1e-6 * np.max(np.abs(second)))


def test_the_derivative_in_the_lattice_is_that_of_differences():
    plan = IN_CELL._replace(accuracy=accuracy_for(1e-12))

    @jax.jit
    def value_and_slope(lattice):
        def work(lattice):
            found, _ = in_cell(lattice, plan=plan)
            return jnp.sum(F[:4] * found[0]) + jnp.sum(Q[:4, :, None] * found[1])

        return jax.value_and_grad(work)(lattice)

    turn, h = np.array([[0.3, -0.2], [0.5, 0.1]]), 1e-4
    values = [value_and_slope(LATTICE + k * h * turn)[0] for k in (-2, -1, 1, 2)]
    change = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
    np.testing.assert_allclose(np.sum(value_and_slope(LATTICE)[1] * turn), change, rtol=1e-8)


def test_a_batch_has_the_values_of_one_by_one():
    plan = plan_for(M, N, 1e-6)
    velocity = lambda x: all_sums(x, plan, Free())[0][0]  # noqa: E731
    several = jnp.stack([X, 1.1 * X])
    together, alone = jax.jit(jax.vmap(velocity))(several), jax.jit(velocity)
    for x, found in zip(several, together, strict=True):
        np.testing.assert_allclose(found, alone(x), atol=1e-13 * np.max(np.abs(found)))
