"""A circle holds all the area that its perimeter allows: it turns, charges and drifts, and keeps its shape."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from conftest import circle

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry.curve import Curve
from jaxves.physics import rigid
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

N = 32


@eqx.filter_jit
def run(scene, t_end=0.5):
    return simulate(scene, t_end, saves=4, march=Adaptive(1e-6))


def phases(x):
    """The unwrapped angle of the first node about the origin."""
    return np.unwrap(np.arctan2(x[:, 0, 0, 1], x[:, 0, 0, 0]))


def test_a_circle_in_shear_turns_with_half_the_shear_rate_and_has_the_viscosity_of_einsteins_disk():
    result = run(make_scene(circle(N), flow=Shear(10.0)))
    assert result.word == "complete"
    np.testing.assert_allclose(phases(result.x), -5.0 * result.t, atol=1e-6)
    np.testing.assert_allclose(result.diagnostics["effective_viscosity"], 2.0, rtol=1e-12)
    np.testing.assert_allclose(result.diagnostics["power_balance"], 0.0, atol=1e-10)
    radius = np.linalg.norm(np.asarray(result.x), axis=-1)
    np.testing.assert_allclose(radius, 1.0, rtol=1e-12)


def steady(beta, share, contrast, G, chi, Ca):
    """Rate of rotation and V_m = A sin θ + B cos θ of a circle that turns in a field along y; by iteration.

    χ ω ∂V/∂θ = 2 share sin θ - (share + G) V, the dipole across the field is -π(1 + η)B, and a torque T turns at T/4π.
    """
    omega, r = -Ca / 2, share + G
    for _ in range(50):
        A = 2 * share / (r + (chi * omega) ** 2 / r)
        B = -chi * omega * A / r
        omega = -Ca / 2 - (beta / chi) * np.pi * (1 + contrast) * B / (4 * np.pi)
    return omega, A, B


def test_a_circle_that_turns_in_a_field_drags_its_charge_behind_and_feels_the_torque():
    beta, ratio, G, chi, Ca = 6.4, 0.5, 1.0, 0.08, 4.0
    field = dc_field(beta, conductivity_ratio=ratio, membrane_conductance=G, chi=chi)
    result = run(make_scene(circle(N), field=field, flow=Shear(Ca)), t_end=2.0)
    omega, A, B = steady(beta, ratio / (1 + ratio), (ratio - 1) / (ratio + 1), G, chi, Ca)
    assert result.word == "complete"
    assert abs(omega + Ca / 2) > 0.1  # the torque matters
    np.testing.assert_allclose(result.diagnostics["tank_treading_speed"][-1], omega, rtol=1e-5)
    sine, cosine = result.x[-1, 0, :, 1], result.x[-1, 0, :, 0]
    np.testing.assert_allclose(result.V_m[-1, 0], A * sine + B * cosine, atol=1e-5)


def test_what_holds_a_circle_makes_its_motion_rigid():
    """Stokes' single layer of the holding force is what the rigid motion lacks, and the pressure is free."""
    equation = equation_for(make_scene(circle(N), flow=Shear(3.0)))
    motion = eqx.filter_jit(equation.motion)(jnp.zeros(()), Unknowns.of(equation.scene.x))
    disturbance = motion.velocity - equation.scene.flow.velocity(equation.scene.x, jnp.zeros(()))
    np.testing.assert_allclose(motion.surfaces.stokes(motion.f_hd), disturbance, atol=1e-12)
    curve = Curve.from_nodes(equation.scene.x[0])
    np.testing.assert_allclose(rigid.rigid_part(curve, motion.velocity[0]), motion.velocity[0], atol=1e-12)


def test_the_motion_of_a_circle_has_a_derivative():
    def force_and_velocity(Ca):
        equation = equation_for(make_scene(circle(N), flow=Shear(Ca)))
        motion = equation.motion(jnp.zeros(()), Unknowns.of(equation.scene.x))
        return motion.f_hd, motion.velocity

    (f, v), (df, dv) = jax.jit(lambda Ca: jax.jvp(force_and_velocity, (Ca,), (jnp.ones(()),)))(jnp.asarray(2.0))
    (f2, v2) = jax.jit(force_and_velocity)(jnp.asarray(3.0))  # both are linear in Ca
    np.testing.assert_allclose(df, f2 - f, atol=1e-9)
    np.testing.assert_allclose(dv, v2 - v, atol=1e-12)
