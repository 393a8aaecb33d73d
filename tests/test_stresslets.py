"""Fast sums of the Stokes double layer: equal to direct sums, exact on rigid motions, right derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import of_equal_cells

from jaxves.ewald import splitting
from jaxves.ewald.lists import Excluded
from jaxves.ewald.plans import Plan, accuracy_for, plan_for
from jaxves.ewald.stresslets import StressletSums
from jaxves.ewald.sums import EwaldSums
from jaxves.geometry.domain import Cell, Free

RNG = np.random.default_rng(7)
M, N = 16, 8
LATTICE = np.array([[6.2, 0.4], [1.1, 5.9]])
IN_CELL = Plan(accuracy_for(1e-12, contrast=True), (120, 120), 90, 8, 48, 48, 1)


def vesicles():
    """Nodes on ellipses in four rows, turned at random; normals, velocities and weights without a pattern."""
    angle = 2 * np.pi * np.arange(N) / N
    turns, places = RNG.uniform(0, np.pi, M), np.stack(np.divmod(np.arange(M), 4), axis=-1) * 2.9
    z = np.exp(1j * turns)[:, None] * (1.25 * np.cos(angle) + 0.68j * np.sin(angle)) + (places @ [1, 1j])[:, None]
    x, turn = np.stack([z.real, z.imag], axis=-1), RNG.uniform(0, 2 * np.pi, (M, N))
    normal = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return [jnp.asarray(a) for a in (x, normal, RNG.normal(size=x.shape), RNG.uniform(0.5, 1, (M, N)))]


X, NORMAL, U, WEIGHTS = vesicles()


def others(x, plan, domain):
    """The velocity at all nodes from all nodes but those of the same vesicle (in its own image), and `overflow`."""
    m = len(x)
    nothing = Excluded(jnp.zeros(1, int), jnp.zeros(1, int), jnp.zeros((1, 2), int), jnp.zeros(1, bool))
    base = EwaldSums.of(x, WEIGHTS[:m], plan, domain, nothing)
    sums = StressletSums.of(base, NORMAL[:m], domain)
    own = jax.vmap(lambda *parts: sums.smooth_matrix(parts[0], *parts))(x, NORMAL[:m], WEIGHTS[:m])
    of_own = jnp.einsum("mij,mj->mi", own, jnp.swapaxes(U[:m], 1, 2).reshape(m, -1))
    return sums(U[:m]) - jnp.swapaxes(of_own.reshape(m, 2, -1), 1, 2), base.overflow


def kernel(r, normal, u):
    """r (r·n) (r·u)/π r⁴ for separations (P, N, 2) from N sources; zero for coinciding points."""
    r2 = np.sum(r**2, axis=-1)
    along = np.sum(r * normal, axis=-1) * np.sum(r * u, axis=-1) / np.where(r2 > 0, r2, 1.0) ** 2
    return r * along[..., None] / np.pi


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_local_and_smooth_part_are_the_kernel(tolerance):
    r2, accuracy, r_c = jnp.asarray(np.geomspace(1e-9, 3, 300)) ** 2, accuracy_for(tolerance), jnp.asarray(1.7)
    parts = splitting.local_stresslet(r2, r_c, accuracy), splitting.smooth_stresslet(r2, r_c, accuracy)
    (C, Q), (C_smooth, Q_smooth) = parts
    np.testing.assert_allclose(C + C_smooth, 0.0, atol=1e-15)
    np.testing.assert_allclose(Q + Q_smooth, 1 / (np.pi * r2**2), rtol=1e-14)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
def test_fast_sums_are_the_direct_sums_to_the_tolerance(tolerance):
    plan = plan_for(M, N, tolerance, contrast=True)
    found, overflow = jax.jit(lambda x: others(x, plan, Free()))(X)
    assert not overflow
    y = np.asarray(X).reshape(-1, 2)
    n, u = (np.asarray(a).reshape(-1, 2) for a in (NORMAL, WEIGHTS[..., None] * U))
    each = kernel(y[:, None] - y, n, u)
    vesicle = np.arange(M * N) // N
    exact = np.sum(np.where((vesicle[:, None] == vesicle)[..., None], 0.0, each), axis=1).reshape(M, N, 2)
    np.testing.assert_allclose(found, exact, atol=tolerance * np.max(np.abs(exact)))


def gaussian_sums(x, lattice, xi):
    """The same sums in a cell by a Gaussian in place of the blob, with images and modes until nothing is left."""
    m = len(x)
    y, n, u = (np.asarray(a).reshape(-1, 2) for a in (x, NORMAL[:m], WEIGHTS[:m, :, None] * U[:m]))
    steps = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    found = np.zeros_like(y)
    for image in steps @ lattice:
        r = y[:, None] - y - image
        s = np.sum(r**2, axis=-1)
        left = np.exp(-(xi**2) * s)
        ru, rn = np.einsum("ija,ja->ij", r, u), np.einsum("ija,ja->ij", r, n)
        safe = np.where(s > 0, s, 1.0)
        C = -2 * xi**2 * left / (4 * np.pi)
        Q = np.where(s > 0, 4 * left * (1 / safe**2 + xi**2 / safe) / (4 * np.pi), 0.0)
        local = C[..., None] * (n * ru[..., None] + u * rn[..., None]) + (Q * ru * rn)[..., None] * r
        if not np.any(image):
            # a vesicle has no part of itself, but the smooth part of the Gaussian is in the modes
            own = np.arange(len(y)) // N
            same = (own[:, None] == own)[..., None]
            whole = kernel(r, n, u)
            local = np.where(same, local - whole, local)
        found += np.sum(local, axis=1)
    modes = np.stack(np.meshgrid(*[np.arange(-40, 41)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    k = 2 * np.pi * modes[np.any(modes != 0, axis=1)] @ np.linalg.inv(lattice).T
    k2 = np.sum(k**2, axis=1)
    gamma = np.exp(-k2 / (4 * xi**2))
    across = np.eye(2) - k[:, :, None] * k[:, None] / k2[:, None, None]
    S = across * (gamma * (1 + k2 / (4 * xi**2)) / k2)[:, None, None]
    phase = np.exp(1j * k @ y.T)
    W = np.einsum("kn,nj,nl->kjl", phase.conj(), n, u)
    W = W + np.swapaxes(W, 1, 2)
    pressed = (0.5 * np.trace(W, axis1=1, axis2=2) * gamma / k2)[:, None] * k
    modes = -1j * (pressed + np.einsum("kij,kjl,kl->ki", S, W, k))
    found = found + np.real(phase.T @ modes) / np.linalg.det(lattice)
    return found.reshape(len(x), N, 2)


def in_cell(lattice, x=X[:4], plan=IN_CELL):
    return others(x, plan, Cell(lattice))


def test_sums_in_a_cell_are_those_of_a_gaussian_splitting():
    exact, also = (gaussian_sums(X[:4], LATTICE, xi) for xi in (1.4, 1.7))
    np.testing.assert_allclose(exact, also, atol=1e-13 * np.max(np.abs(exact)))
    found, overflow = jax.jit(in_cell)(LATTICE)
    assert not overflow
    np.testing.assert_allclose(found, exact, atol=1e-12 * np.max(np.abs(exact)))


def test_sums_in_a_cell_do_not_depend_on_basis_and_image():
    wanted, *equal = of_equal_cells(in_cell, LATTICE, X[:4])
    for found in equal:
        np.testing.assert_allclose(found, wanted, atol=2e-12 * np.max(np.abs(wanted)))


@pytest.mark.parametrize("domain", [Free(), Cell(2 * LATTICE)], ids=["plane", "cell"])
def test_derivatives_agree_in_both_modes_and_with_differences(domain):
    plan = plan_for(M, N, 1e-12, contrast=True)._replace(images=1, vesicles=40, room=40)
    push, pull = (jnp.asarray(RNG.normal(size=X.shape)) for _ in range(2))

    def work(x):
        return jnp.sum(pull * others(x, plan, domain)[0])

    value = jax.jit(work)
    forward, reverse = jax.jit(lambda x: (jax.jvp(work, (x,), (push,))[1], jnp.sum(push * jax.grad(work)(x))))(X)
    np.testing.assert_allclose(forward, reverse, rtol=1e-12)
    h = 1e-3
    values = [value(X + k * h * push) for k in (-2, -1, 1, 2)]
    change = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
    np.testing.assert_allclose(forward, change, rtol=1e-6)
