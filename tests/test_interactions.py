"""Several membranes: what they do to each other, near and far."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import diagnosed, motion_of

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import extremes, shapes
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.operators import pairs
from jaxves.physics import flow
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

REACH = 1.8996  # distance of the centers at which the two shapes of `pair` touch


def pair(N, gap, *, separate=None, M=2):
    """Two different vesicles whose nearest points are about `gap` apart, charged without symmetry."""
    first = shapes.ellipse(N, 0.9, angle=0.3)
    second = shapes.ellipse(N, 0.94, angle=1.2, length=0.9)
    reach = REACH + gap if separate is None else separate
    field = dc_field(3.2, conductivity_ratio=[0.1, 0.4], membrane_conductance=[0.0, 0.3], vesicles=M)
    s = make_scene([first, second], centers=[[0.0, 0.0], [reach, 0.0]], field=field, flow=flow.Shear(2.0))
    alpha = fourier.grid(N)
    return s, Unknowns.of(s.x, jnp.stack([0.4 * jnp.sin(alpha) + 0.1 * jnp.cos(2 * alpha), 0.3 * jnp.cos(alpha)]))


def test_vesicles_far_apart_move_as_if_alone():
    """What one does to the other falls like 1/r at least: velocity differences at r = 1e4 are below 1e-3 of it."""
    s, y = pair(48, None, separate=1e4)
    s = eqx.tree_at(lambda s: s.flow, s, None)
    both = motion_of(s, y)
    for m in range(2):
        pick = slice(m, m + 1)
        ratio, conductance = s.field.conductivity_ratio[m], s.field.membrane_conductance[m]
        field = dc_field(3.2, conductivity_ratio=ratio, membrane_conductance=conductance)
        single = motion_of(make_scene(s.x[m], field=field), Unknowns.of(y.x[pick], y.V_m[pick]))
        np.testing.assert_allclose(both.velocity[m], single.velocity[0], atol=1e-3 * jnp.max(jnp.abs(single.velocity)))
        np.testing.assert_allclose(both.electric.w[m], single.electric.w[0], atol=1e-6)


@pytest.mark.parametrize("gap", [0.6, 0.05])
def test_a_pair_converges_spectrally_near_and_far(gap):
    """Velocity at the first node of both and the charging rate, against twice and four times the nodes."""
    found = {}
    for N in (64, 128, 256):
        s, y = pair(N, gap)
        motion = motion_of(s, y)
        found[N] = jnp.concatenate([motion.velocity[:, 0].ravel(), motion.rates["V_m"][:, 0]])
    coarse, fine = (jnp.max(jnp.abs(found[N] - found[256])) for N in (64, 128))
    assert fine < 1e-5 * jnp.max(jnp.abs(found[256]))
    assert fine < 0.02 * coarse


def test_near_and_far_rules_agree_where_both_hold():
    """At six spacings the trapezoidal rule is exact to 14 digits, on densities that the nodes resolve."""
    N = 64
    source = Curve.from_nodes(shapes.circle(N))
    x = shapes.circle(N) + jnp.array([2 + 6 * 2 * np.pi / N, 0.0])
    alpha = fourier.grid(N)
    f = jnp.stack([jnp.exp(jnp.sin(alpha)), jnp.cos(3 * alpha)], axis=-1)
    far, close = (
        jax.jit(lambda rule=rule: rule(source, x, True))() for rule in (pairs.far_matrices, pairs.close_matrices)
    )
    np.testing.assert_allclose(far[0] @ f, close[0] @ f, atol=1e-12)
    np.testing.assert_allclose(far[1] @ f[:, 0], close[1] @ f[:, 0], atol=1e-12)


@pytest.mark.parametrize("gap", [0.6, 0.05])
def test_forces_of_a_pair_balance_and_its_energy_closes(gap):
    s, y = pair(128, gap)
    motion = motion_of(s, y)
    weights = motion.surfaces.curves.weights[..., None]
    total = jnp.sum(motion.electric.traction * weights, axis=(0, 1))
    assert jnp.max(jnp.abs(total)) < 1e-7 * jnp.sum(jnp.abs(motion.electric.traction * weights))
    # each feels the other: only together are they free of force
    assert jnp.max(jnp.abs(jnp.sum(motion.electric.traction[0] * weights[0], axis=0))) > 1e-4
    d = diagnosed(s, y)
    assert abs(d["power_balance"]) < 1e-7 * d["dissipation"]
    assert jnp.max(jnp.abs(d["charge"])) < 1e-7


def test_the_order_of_vesicles_does_not_matter():
    s, y = pair(64, 0.1)

    def per_vesicle(f):
        return f.conductivity_ratio, f.membrane_conductance, f.membrane_chi, f.permittivity_ratio

    field = eqx.tree_at(per_vesicle, s.field, tuple(leaf[::-1] for leaf in per_vesicle(s.field)))
    swapped = eqx.tree_at(lambda s: (s.x, s.field), s, (s.x[::-1], field))
    one, other = motion_of(s, y), motion_of(swapped, Unknowns.of(y.x[::-1], y.V_m[::-1]))
    scale = jnp.max(jnp.abs(one.velocity))
    np.testing.assert_allclose(other.velocity[::-1], one.velocity, atol=1e-9 * scale)


def test_a_lone_vesicle_traces_nothing_of_interactions():
    x = shapes.ellipse(32, 0.9)
    y = Unknowns.of(x[None])
    text = str(jax.make_jaxpr(lambda x: equation_for(make_scene(x)).rate(jnp.zeros(()), y))(x))
    assert "c128" not in text  # the arithmetic of close evaluation
    assert "scatter" not in text  # the assembly of coupled systems


def test_the_gap_is_the_distance_of_the_curves_not_of_the_nodes():
    """Two circles, nodes turned away from the nearest points."""
    turned = shapes.rotated(shapes.circle(32), 0.05)
    first, second = Curve.from_nodes(turned), Curve.from_nodes(turned + jnp.array([2.3, 0.4]))
    np.testing.assert_allclose(jax.jit(extremes.gap)(first, second), np.hypot(2.3, 0.4) - 2, atol=1e-12)


def test_crossing_vesicles_end_a_run_as_a_collision():
    e = shapes.ellipse(32, 0.9)

    @jax.jit
    def run(centers):  # known ones would be refused
        return simulate(make_scene([e, e], centers=centers), 1e-3, saves=1, march=Adaptive(1e-2))

    assert run(jnp.array([[0.0, 0.0], [1.0, 0.0]])).word == "collision"


def test_aligned_vesicles_attract_and_vesicles_side_by_side_repel():
    """In a field, as dipoles of one orientation do (Λ = 0.1, uncharged membranes)."""
    e = shapes.ellipse(48, 0.9, angle=jnp.pi / 2)

    def separation_rate(offset):
        field = dc_field(3.2, conductivity_ratio=0.1, vesicles=2)
        s = make_scene([e, e], centers=[offset, -offset], field=field)
        motion = motion_of(s, Unknowns.of(s.x, jnp.zeros((2, 48))))
        relative = jnp.mean(motion.velocity[0], axis=0) - jnp.mean(motion.velocity[1], axis=0)
        force = jnp.sum((motion.electric.traction * motion.surfaces.curves.weights[..., None])[0], axis=0)
        return relative @ offset, -force @ offset

    along, along_force = separation_rate(jnp.array([0.0, 2.2]))
    across, across_force = separation_rate(jnp.array([2.2, 0.0]))
    assert along_force < 0 < across_force
    assert np.isfinite(along) and np.isfinite(across)
