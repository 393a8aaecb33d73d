"""The mean stress in a periodic cell: tractions across its edges, images, copies of the cell, and the energy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.ewald.lists import Excluded
from jaxves.ewald.plans import Plan, accuracy_for
from jaxves.ewald.sums import EwaldSums
from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell
from jaxves.numerics import fourier
from jaxves.observables.diagnostics import diagnose
from jaxves.observables.of_cell_stress import mean_maxwell_stress
from jaxves.operators.sums import MatrixFree
from jaxves.operators.surfaces import Surfaces
from jaxves.physics import electric
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene

LATTICE = np.array([[3.8, 0.0], [0.5, 3.6]])
E_INF = np.array([0.3, 1.0])
SUMS = MatrixFree(accuracy=1e-12)


def moment_of_tractions(surfaces, q, V_m, ratio):
    """A ⟨T⟩ from T·n on two edges of the cell and the force on the one membrane in it, which no edge crosses."""
    curve = jax.tree.map(lambda leaf: leaf[0], surfaces.curves)
    N, lattice = curve.x.shape[0], jnp.asarray(LATTICE)
    # N points on two edges, as a second curve without charge
    s = np.arange(N // 2) * (2 / N)
    center = jnp.mean(curve.x, axis=0)
    corner = center - 0.5 * (lattice[0] + lattice[1])
    edges = [corner + lattice[0] + s[:, None] * lattice[1], corner + lattice[1] + s[:, None] * lattice[0]]
    x = jnp.stack([curve.x, jnp.concatenate(edges)])
    weights = jnp.stack([curve.weights, jnp.zeros(N)])
    plan = Plan(accuracy_for(1e-12), (120, 120), 130, 8, 49, 6 * N, 2)
    nothing = Excluded(jnp.zeros(1, int), jnp.zeros(1, int), jnp.zeros((1, 2), int), jnp.zeros(1, bool))
    sums = EwaldSums.of(x, weights, plan, Cell(lattice), nothing)

    def gradient(density):
        return sums.slp_gradient(jnp.concatenate([density, density]))[1]

    slope = surfaces.d_ds(V_m)
    turned = gradient(slope)
    mean = E_INF - surfaces.interactions.mean_dipole(V_m)
    e = mean - gradient(q) + jnp.stack([turned[:, 1], -turned[:, 0]], axis=-1)
    found = jnp.zeros((2, 2))
    for k, (edge, along) in enumerate(zip(jnp.split(e, 2), (lattice[1], lattice[0]), strict=True)):
        normal = (1 - 2 * k) * jnp.stack([along[1], -along[0]])  # times the length of the edge
        traction = edge * (edge @ normal)[:, None] - 0.5 * jnp.sum(edge**2, axis=-1)[:, None] * normal
        found = found + jnp.outer(jnp.mean(traction, axis=0), lattice[k])
    own = surfaces.laplace_slp_dn[0] @ (curve.speed * q[0])
    S_dn = own + jnp.sum(curve.normal * surfaces.interactions.slp_gradient(q)[0], axis=-1)
    g = curve.normal @ E_INF - S_dn + surfaces.dlp_dn(V_m)[0]
    fields = electric.fields_beside(curve, jnp.asarray(E_INF), g, q[0], V_m[0], surfaces.potential_slope(q, V_m)[0])
    force, more, less = (electric.maxwell_traction(curve, fields, jnp.asarray(k)) for k in (ratio, 2.0, 1.0))
    moments = [jnp.einsum("na,nb->ab", part * curve.weights[:, None], curve.x) for part in (force, more - less)]
    return found + moments[0], (ratio - 1) * moments[1], sums.overflow


@pytest.mark.parametrize("ratio", [1.0, 3.0])
def test_the_maxwell_stress_is_that_of_tractions_across_the_edges_of_the_cell(ratio):
    """For any charge and potential, with different permittivities too."""
    N = 64
    alpha = np.asarray(fourier.grid(N))

    @jax.jit
    def compared():
        x = shapes.ellipse(N, 0.9, angle=0.4)[None] + jnp.array([0.7, -0.2])
        surfaces = Surfaces.of(x, electric=True, coupling=SUMS, domain=Cell(jnp.asarray(LATTICE)))
        q = (np.cos(alpha - 0.3) + 0.4 * np.sin(3 * alpha))[None] / surfaces.curves.speed
        V_m = (0.5 * np.sin(alpha) + 0.2 * np.cos(2 * alpha) + 0.1)[None] + jnp.zeros((1, N))
        found = mean_maxwell_stress(surfaces, Cell(jnp.asarray(LATTICE)), jnp.asarray(E_INF), q, V_m)
        wanted, inside, overflow = moment_of_tractions(surfaces, q, V_m, ratio)
        return found * np.linalg.det(LATTICE) + inside, wanted, overflow | surfaces.interactions.crowded

    found, wanted, overflow = compared()
    assert not overflow
    np.testing.assert_allclose(found, wanted, atol=1e-10 * np.max(np.abs(wanted)))


N, RATE = 16, 4.0
ALPHA = 2 * np.pi * np.arange(N) / N
V_M = 0.3 * np.sin(ALPHA) + 0.1 * np.cos(2 * ALPHA)
MEAN = ("mean_stress", "normal_stress_difference", "relative_viscosity", "mean_current")


def scene_of(x, lattice, field=True, flow=True):
    given = dc_field(3.2, vesicles=len(x), conductivity_ratio=0.1, membrane_conductance=0.2, direction=(0.3, 1.0))
    return make_scene(x, field=given if field else None, flow=Shear(RATE) if flow else None, cell=Cell.of(lattice))


@eqx.filter_jit
def diagnosed(scene):
    """At t = 0 with charged membranes."""
    equation = equation_for(scene, coupling=SUMS)
    charged = None if scene.field is None else jnp.broadcast_to(V_M, scene.x.shape[:2])
    y = Unknowns.of(scene.x, charged)
    return diagnose(equation, jnp.zeros(()), y, equation.motion(jnp.zeros(()), y))


def test_images_and_copies_of_the_cell_leave_the_stress_as_it_is():
    """A vesicle moved by a vector of the lattice; the scene moved; and two cells with one vesicle in another image."""
    x = np.stack([shapes.ellipse(N, 0.9, angle=0.4), shapes.ellipse(N, 0.95, angle=1.9) + np.array([2.9, 1.4])])
    wide = np.array([[5.9, 0.0], [0.6, 3.7]])
    wanted = diagnosed(scene_of(list(x), wide))
    moved = x + np.array([[[0.0, 0.0]], [wide[1] - wide[0]]]) + np.array([0.37, 0.81])
    double = np.concatenate([x, x + wide[1]])
    double[3] = double[3] - 2 * wide[1] + wide[0]
    for scene in (scene_of(list(moved), wide), scene_of(list(double), np.stack([wide[0], 2 * wide[1]]))):
        found = diagnosed(scene)
        assert found["residual"] < 1e-11
        for name in MEAN:
            # GMRES to 1e-11, times the condition of the systems
            np.testing.assert_allclose(found[name], wanted[name], rtol=1e-9, atol=1e-9)
    assert abs(wanted["mean_stress"][0, 1] - wanted["mean_stress"][1, 0]) < 1e-6 * abs(wanted["mean_stress"][0, 1])


def test_the_flow_does_the_work_of_the_mean_stress():
    """Without a field, dE_b/dt = A Σ:Γ - dissipation."""
    # 48 nodes resolve bending forces to four digits
    found = diagnosed(scene_of([np.asarray(shapes.ellipse(48, 0.9, angle=0.4))], LATTICE, field=False))
    work = np.linalg.det(LATTICE) * RATE * found["mean_stress"][0, 1]
    np.testing.assert_allclose(found["power_flow"], work, rtol=1e-10)
    np.testing.assert_allclose(found["power_balance"], 0.0, atol=1e-4 * abs(work))
    assert found["dissipation"] > 0
    np.testing.assert_allclose(found["relative_viscosity"], 1 + found["mean_stress"][0, 1] / RATE, rtol=1e-14)


def test_the_stress_without_a_field_is_that_of_the_plane_in_a_large_cell():
    """Per area of the vesicle: the particle stress. Images act like 1/A."""
    x = [np.asarray(shapes.ellipse(N, 0.9, angle=0.4))]
    alone = diagnosed(make_scene(x, flow=Shear(RATE)))["stress"]
    errors = []
    for side in (8.0, 16.0):
        found = diagnosed(scene_of(x, side * np.eye(2), field=False))
        errors.append(np.max(np.abs(found["mean_stress"] * side**2 / found["area"][0] - alone)))
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert errors[1] < 0.05 * np.max(np.abs(alone))
