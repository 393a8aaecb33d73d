"""Membranes in a periodic cell: drag, conductivity and viscosity of lattices of circles, and symmetries.

The numbers are those of the square lattice of discs, which Kress quadrature with the kernels of a Gaussian Ewald sum
gives to all digits shown with 64 and 96 nodes.
"""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell
from jaxves.operators.sums import MatrixFree
from jaxves.operators.surfaces import Surfaces

N = 64
DRAG = {0.1: 24.831675248849, 0.3: 102.8813036700}
INSULATING = {0.1: 0.8181767630136, 0.3: 0.5375799839701}
TENTH = {0.1: 0.8487366332156, 0.3: 0.6053136815976}
SHEARED = {0.1: 1.192224187648, 0.3: 1.598115977416}
STRETCHED = {0.1: 1.263337588751, 0.3: 2.538390621439}
SURE = 1e-9  # fast sums to 1e-12 of the largest value, times the condition of the systems


@eqx.filter_jit
def lattice_of_circles(x, lattice):
    """The matrices of S_Stokes (2N, 2N), S' and D' (N, N) of one circle with all its images."""
    surfaces = Surfaces.of(x, electric=True, coupling=MatrixFree(accuracy=1e-12), domain=Cell.of(lattice))
    curves = surfaces.curves

    def charged(q):
        own = jnp.einsum("mij,mj->mi", surfaces.laplace_slp_dn, curves.speed * q)
        return own + jnp.sum(curves.normal * surfaces.interactions.slp_gradient(q), axis=-1)

    forces = jnp.eye(2 * N).reshape(2 * N, 1, N, 2)
    scalars = jnp.eye(N)[:, None]
    stokes = jax.lax.map(surfaces.stokes, forces).reshape(2 * N, 2 * N).T
    S_dn, D_dn = (jax.lax.map(f, scalars).reshape(N, N).T for f in (charged, surfaces.dlp_dn))
    return curves, stokes, S_dn, D_dn, surfaces.interactions.crowded


@pytest.fixture(scope="module", params=[0.1, 0.3])
def square(request):
    side = np.sqrt(np.pi / request.param)
    circle = jax.jit(lambda: shapes.circle(N))()[None] + np.array([0.3, 0.2])
    found = lattice_of_circles(circle, side * np.eye(2))
    assert not found[-1]
    curve = SimpleNamespace(
        x=np.asarray(found[0].x[0]), normal=np.asarray(found[0].normal[0]), weights=np.asarray(found[0].weights[0])
    )
    return request.param, curve, *map(np.asarray, found[1:-1])


def test_the_drag_on_a_lattice_of_discs_is_the_known_one(square):
    """S f = -U on each disc; the force is what holds it in the mean velocity U."""
    phi, curve, stokes, *_ = square
    one = np.tile([1.0, 0.0], N)
    # S n = 0: the pressure inside is fixed by adding n ∮ f·n ds
    normal = curve.normal.reshape(-1)
    f = np.linalg.solve(stokes + np.outer(normal, normal * np.repeat(curve.weights, 2)), one).reshape(N, 2)
    np.testing.assert_allclose(curve.weights @ f, [DRAG[phi], 0.0], rtol=SURE, atol=SURE * DRAG[phi])


@pytest.mark.parametrize("way", ["charge", "membrane"])
def test_the_conductivity_of_a_lattice_is_the_known_one(square, way):
    """By charge on discs with Λ = 0.1, 10, and 0; and by the potential of membranes that let no current through.

    The second needs the constant of the harmonic conjugate in a cell. σ*(Λ) σ*(1/Λ) = 1.
    """
    phi, curve, _, S_dn, D_dn = square
    area, weights = np.pi / phi, curve.weights
    flux = curve.normal[:, 0]
    if way == "membrane":
        # D' is singular for constants, which ∮ V ds = 0 fixes
        V = np.linalg.solve(D_dn + weights, -flux)
        np.testing.assert_allclose(1 - weights @ (V * flux) / area, INSULATING[phi], rtol=SURE)
        return

    def conductivity(ratio):
        eta = (ratio - 1) / (ratio + 1)
        q = np.linalg.solve(0.5 * np.eye(N) + eta * S_dn, eta * flux)
        return 1 + weights @ (q * curve.x[:, 0]) / area

    np.testing.assert_allclose(conductivity(0.0), INSULATING[phi], rtol=SURE)
    np.testing.assert_allclose(conductivity(0.1), TENTH[phi], rtol=SURE)
    np.testing.assert_allclose(conductivity(0.1) * conductivity(10.0), 1.0, rtol=SURE)


@pytest.mark.parametrize("flow", ["shear", "extension"])
def test_the_viscosity_of_a_lattice_of_rigid_discs_is_the_known_one(square, flow):
    """At the instant at which the lattice is square; the discs turn at half the vorticity."""
    phi, curve, stokes, *_ = square
    gradient = {"shear": np.array([[0.0, 1.0], [0.0, 0.0]]), "extension": np.diag([1.0, -1.0])}[flow]
    arm = curve.x - weights_mean(curve)
    turn = np.stack([-arm[:, 1], arm[:, 0]], axis=-1)
    rotation = 0.5 * (gradient[1, 0] - gradient[0, 1])
    normal = curve.normal.reshape(-1)
    matrix = stokes + np.outer(normal, normal * np.repeat(curve.weights, 2))
    f = np.linalg.solve(matrix, (rotation * turn - arm @ gradient.T).reshape(-1)).reshape(N, 2)
    # force and torque vanish, so that the rotation is the free one
    np.testing.assert_allclose(curve.weights @ f, 0.0, atol=1e-8)
    np.testing.assert_allclose(curve.weights @ np.sum(turn * f, axis=-1), 0.0, atol=1e-8)
    stress = -np.einsum("n,na,nb->ab", curve.weights, f, arm) * (phi / np.pi)
    if flow == "shear":
        np.testing.assert_allclose(1 + stress[0, 1], SHEARED[phi], rtol=SURE)
    else:
        np.testing.assert_allclose(1 + (stress[0, 0] - stress[1, 1]) / 4, STRETCHED[phi], rtol=SURE)


def weights_mean(curve):
    return curve.weights @ curve.x / np.sum(curve.weights)


def test_a_sheared_lattice_comes_back():
    """After one strain of a square cell the lattice is the same, and in between its second vector is the shortest."""
    cell = Cell.of([[2.0, 0.0], [0.3, 2.0]], rate=5.0)
    np.testing.assert_allclose(cell.at(jnp.asarray(0.2)).lattice, cell.lattice, atol=1e-15)
    np.testing.assert_allclose(cell.at(jnp.asarray(0.1)).lattice, [[2.0, 0.0], [-0.7, 2.0]], atol=1e-15)
    slope = jax.jacfwd(lambda rate: Cell.of([[2.0, 0.0], [0.3, 2.0]], rate=rate).at(jnp.asarray(0.1)).lattice)(5.0)
    np.testing.assert_allclose(slope, [[0.0, 0.0], [0.2, 0.0]], atol=1e-15)


@pytest.mark.parametrize(
    ("lattice", "rate"),
    [([[1.0, 0.0], [1.0, 0.0]], None), ([[0.0, 1.0], [1.0, 0.0]], None), ([[1.0, 0.1], [0.0, 1.0]], 2.0), ("x", None)],
)
def test_a_lattice_that_is_none_is_refused(lattice, rate):
    with pytest.raises(ValueError, match=r"lattice = .*, expected"):
        Cell.of(lattice, rate)
