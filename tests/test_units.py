"""SI and the paper's numbers: the definitions, both ways."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.units import Numbers, Physical

# A giant vesicle in a weak electrolyte: orders of magnitude of the experiments.
LABORATORY = dict(
    a=10e-6,
    E=1e5,
    sigma_i=6e-4,
    sigma_e=1.5e-3,
    epsilon=7.08e-10,
    C_m=0.01,
    G_m=3.0,
    kappa_B=1e-19,
    mu=1e-3,
    shear_rate=0.5,
)


def test_the_numbers_are_the_papers():
    numbers = Physical(**LABORATORY).numbers()
    np.testing.assert_allclose(numbers.conductivity_ratio, 0.4, rtol=1e-14)
    np.testing.assert_allclose(numbers.membrane_conductance, 10e-6 * 3.0 / 1.5e-3, rtol=1e-14)
    np.testing.assert_allclose(numbers.beta, 7.08e-10 * 1e10 * 10e-6 * 0.01 / (1e-3 * 1.5e-3), rtol=1e-14)
    np.testing.assert_allclose(numbers.chi, 0.01 * 1e-19 / (1.5e-3 * 1e-3 * 1e-10), rtol=1e-14)
    np.testing.assert_allclose(numbers.capillary_number, 1e-3 * 0.5 * 1e-15 / 1e-19, rtol=1e-14)


@pytest.mark.parametrize("power", range(4))
def test_the_numbers_do_not_depend_on_the_units_of_measurement(power):
    """Changing the unit of length, mass, time or current by 7 changes no dimensionless number."""
    dimensions = dict(  # powers of m, kg, s, A
        a=(1, 0, 0, 0),
        E=(1, 1, -3, -1),
        sigma_i=(-3, -1, 3, 2),
        sigma_e=(-3, -1, 3, 2),
        epsilon=(-3, -1, 4, 2),
        C_m=(-4, -1, 4, 2),
        G_m=(-4, -1, 3, 2),
        kappa_B=(2, 1, -2, 0),
        mu=(-1, 1, -1, 0),
        shear_rate=(0, 0, -1, 0),
    )
    rescaled = {key: value * 7.0 ** dimensions[key][power] for key, value in LABORATORY.items()}
    expected, found = Physical(**LABORATORY).numbers(), Physical(**rescaled).numbers()
    for a, b in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-13)


def test_there_and_back_is_the_same():
    physical = Physical(**LABORATORY)
    reference = {key: LABORATORY[key] for key in ("a", "kappa_B", "mu", "sigma_e", "epsilon")}
    back = physical.numbers().physical(**reference)
    for key, value in LABORATORY.items():
        np.testing.assert_allclose(getattr(back, key), value, rtol=1e-13, err_msg=key)

    numbers = Numbers(3.2, 0.08, 0.1, 4.0, 10.0)
    again = numbers.physical(**reference).numbers()
    for a, b in zip(jax.tree.leaves(numbers), jax.tree.leaves(again), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-13)


def test_the_scales_agree_with_the_numbers():
    physical = Physical(**LABORATORY)
    numbers, scales = physical.numbers(), physical.scales()
    np.testing.assert_allclose(scales.time, 1e-3 * 1e-15 / 1e-19, rtol=1e-14)
    np.testing.assert_allclose(scales.V_m, 1.0, rtol=1e-14)
    np.testing.assert_allclose(scales.maxwell_stress, numbers.beta / numbers.chi * scales.stress, rtol=1e-13)
    np.testing.assert_allclose(scales.charging_time, numbers.chi * scales.time, rtol=1e-13)
    np.testing.assert_allclose(physical.shear_rate, numbers.capillary_number / scales.time, rtol=1e-13)
    # Forces per area balance viscous stresses and tension over length, energy is force times length.
    np.testing.assert_allclose(scales.stress, physical.mu * scales.velocity / scales.length, rtol=1e-13)
    np.testing.assert_allclose(scales.stress, scales.tension / scales.length, rtol=1e-13)
    np.testing.assert_allclose(scales.energy, scales.tension * scales.length, rtol=1e-13)


def test_conversions_can_be_traced_batched_and_differentiated():
    def beta(E):
        return Physical(**(LABORATORY | {"E": E})).numbers().beta

    E = 1e5
    np.testing.assert_allclose(jax.jit(jax.grad(beta))(E), 2 * beta(E) / E, rtol=1e-13)
    np.testing.assert_allclose(jax.vmap(beta)(jnp.array([E, 2 * E])), beta(E) * np.array([1, 4]), rtol=1e-13)
    numbers = eqx.filter_jit(lambda physical: physical.numbers())(Physical(**LABORATORY))
    np.testing.assert_allclose(numbers.beta, beta(E), rtol=1e-14)
