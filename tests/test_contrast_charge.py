"""Two viscosities and charge that relaxes in a finite time, in one pair: a run, its derivatives, its energy balance."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from conftest import diagnosed

from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

N = 24
AT = jnp.array([0.2, 0.05, 0.6])  # viscosity ratio of the first vesicle, δ, permittivity ratio


@jax.jit
def pair(numbers):
    """Two unlike vesicles, the first less viscous inside and the second more, in shear and a field."""
    ratio, delta, epsilon = numbers
    field = dc_field(4.0, conductivity_ratio=0.3, permittivity_ratio=epsilon, charge_relaxation=delta, vesicles=2)
    x = [shapes.ellipse(N, 0.95, angle=0.7), shapes.ellipse(N, 0.97, angle=1.2)]
    viscosities = jnp.stack([ratio, 1 / ratio])
    return make_scene(x, centers=[[-1.4, 0.0], [1.4, 0.2]], field=field, flow=Shear(2.0), viscosity_ratio=viscosities)


@eqx.filter_jit
def stepped(numbers):
    """Returns the equation, and the state after one step."""
    equation = equation_for(pair(numbers))
    return equation, Fixed(1).step(equation, jnp.zeros(()), equation.start(), jnp.asarray(4e-3))


def test_a_run_with_both_ends_complete_and_each_of_them_changes_it():
    @jax.jit
    def ended(numbers):
        return simulate(pair(numbers), 0.05, saves=1, march=Adaptive(1e-4, recorded=None))

    result = ended(AT)
    assert result.word == "complete"
    assert float(jnp.max(result.diagnostics["residual"])) < 1e-8
    for name in ("area", "length"):
        kept = np.asarray(result.diagnostics[name])
        np.testing.assert_allclose(kept[-1], kept[0], rtol=1e-6)
    for other in (AT.at[0].set(0.9), AT.at[1].set(0.01), AT.at[2].set(1.0)):
        assert float(jnp.max(jnp.abs(ended(other).x[-1] - result.x[-1]))) > 1e-3


def test_the_energy_balance_closes_while_charge_relaxes_on_vesicles_of_different_viscosities():
    equation, y = stepped(AT)
    assert float(jnp.max(jnp.abs(y.scalars["Q"]))) > 0.1  # charge that has not relaxed
    found = diagnosed(equation.scene, y)
    powers = jnp.abs(jnp.stack([found["dissipation"], found["power_electric"]]))
    assert float(jnp.min(powers)) > 1e-2
    assert abs(found["power_balance"]) < 1e-4 * float(jnp.max(powers))


def test_derivatives_of_both_are_those_of_differences_in_both_modes():
    @jax.jit
    def outcome(numbers):
        _, y = stepped(numbers)
        weight = jnp.cos(jnp.arange(2 * N)).reshape(2, N)
        return jnp.sum(weight * (y.x[..., 0] + y.scalars["Q"] + y.scalars["W"]))

    h = 1e-3 * AT
    reverse = jax.jit(jax.grad(outcome))(AT)
    forward = jax.jit(lambda e: jax.jvp(outcome, (AT,), (e,))[1])
    for i, e in enumerate(np.eye(3)):
        np.testing.assert_allclose(forward(e), reverse[i], rtol=1e-8)
        one, two = ((outcome(AT + k * h * e) - outcome(AT - k * h * e)) / (2 * k * h[i]) for k in (1, 2))
        np.testing.assert_allclose(reverse[i], (4 * one - two) / 3, rtol=1e-6)
