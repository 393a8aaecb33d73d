"""The schemes take any equation that has a linear part: here one for an angle, which knows nothing of membranes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest
from conftest import observed_order

from jaxves.stepping import schemes
from jaxves.stepping.split_equation import SplitEquation


class Pendulum(eqx.Module):
    """y' = -k tan(y - cos t) - sin t, of which all solutions tend to cos t. The linear part is -k."""

    k: float
    is_staged: bool = eqx.field(static=True, default=False)

    def freeze(self, t, y):
        return Linear(self.k, self.rate(t, y))

    def rate(self, t, y):
        return {"angle": -self.k * jnp.tan(y["angle"] - jnp.cos(t)) - jnp.sin(t)}

    def rate_of(self, frozen, t):
        return frozen.rate

    def near(self, frozen):
        return self


class Linear(eqx.Module):
    """-k, with the rate at the same instant."""

    k: float
    rate: dict[str, jax.Array]

    def implicit(self, c):
        return Divided(1 + c * self.k)


class Divided(eqx.Module):
    """1 + c k."""

    by: jax.Array

    def solve(self, r):
        return jax.tree.map(lambda r: r / self.by, r)


@pytest.mark.parametrize("scheme", [schemes.SemiImplicitEuler(), schemes.ARK4(), schemes.ARK5()])
def test_a_scheme_has_its_order_for_an_equation_of_other_unknowns(scheme):
    equation = Pendulum(2.0)
    assert isinstance(equation, SplitEquation)

    def off(count):
        h = 2.0 / count

        def step(y, i):
            t = i * h
            return scheme.step(equation, equation.freeze(t, y), t, y, jnp.asarray(h)).y, None

        y, _ = jax.lax.scan(step, {"angle": jnp.asarray(1.3)}, jnp.arange(float(count)))
        return y["angle"]

    exact = jax.jit(off, static_argnums=0)(3000 if scheme.order > 1 else 20_000)
    counts = (20, 40, 80)
    errors = [abs(float(jax.jit(off, static_argnums=0)(count) - exact)) for count in counts]
    assert abs(observed_order([1 / n for n in counts], errors) - scheme.order) < 0.3, errors


def test_what_lacks_a_method_is_no_split_equation():
    assert not isinstance(Linear(1.0, {}), SplitEquation)
