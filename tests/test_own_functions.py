"""What a function of the user's own must return, and how JAX must be able to trace it: refusals in one line."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.physics.waveform import AbstractHistory

N = 16
ELLIPSE = jaxves.ellipse(N, 0.9)


def switched(x, t):
    """At t = 0 this looks like a shear flow, so that a check of one value would not find the branch."""
    if t < 0.5:
        return jnp.array([x[1], 0.0])
    return jnp.zeros(2)


def half_plane(x, t):
    return jnp.array([x[1], 0.0]) if x[0] > 0 else jnp.zeros(2)


FUNCTIONS = {
    "list": (lambda x, t: [x[1], 0.0], "a function that returns a list of 2, expected"),
    "tuple": (lambda x, t: (x[1], x[0]), "a function that returns a tuple of 2, expected"),
    "nothing": (lambda x, t: None, "a function that returns None, expected"),
    "three": (lambda x, t: jnp.zeros(3), r"a function that returns an array of shape \(3,\), expected"),
    "column": (lambda x, t: jnp.zeros((2, 1)), r"a function that returns an array of shape \(2, 1\), expected"),
    "complex": (
        lambda x, t: 1j * x,
        r"a function that returns an array of complex128 values of shape \(2,\), expected",
    ),
    "one_argument": (lambda x: x, "takes 1 positional argument but 2 were given, expected"),
    "if_time": (switched, r"decides in Python .*, expected jax.numpy.where\(condition, a, b\) instead"),
    "if_point": (half_plane, r"decides in Python .*, expected jax.numpy.where\(condition, a, b\) instead"),
    "float": (lambda x, t: float(t) * x, "makes a Python number .*, expected the functions of jax.numpy"),
    "math": (lambda x, t: jnp.full(2, math.sin(t)), "makes a Python number .*, expected the functions of jax.numpy"),
    "numpy": (lambda x, t: np.sin(x), "gives a traced value to NumPy, expected the functions of jax.numpy"),
    "mask": (lambda x, t: x[x > 0], r"selects entries by a traced condition, expected jax.numpy.where"),
    "index": (lambda x, t: [x, -x][t.astype(int)], "uses a traced value as an index"),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_flow_or_a_field_that_cannot_be_used_is_refused_where_the_scene_is_made(name):
    function, message = FUNCTIONS[name]
    with pytest.raises(ValueError, match=f"^flow = .*{message}") as flow:
        jaxves.make_scene(ELLIPSE, flow=function)
    with pytest.raises(ValueError, match="^E_inf = .*" + message) as field:
        jaxves.dc_field(1.0, conductivity_ratio=0.1, E_inf=function)
    assert "\n" not in str(flow.value) + str(field.value)


def test_a_function_with_traced_numbers_is_checked_too():
    """The check of its divergence needs numbers; that of its shape does not."""

    class Module(eqx.Module):
        strength: jnp.ndarray

        def __call__(self, x, t):
            return [self.strength * x[1], 0.0]

    def divergence(strength):
        return jaxves.make_scene(ELLIPSE, flow=Module(strength)).flow.velocity(ELLIPSE[None], 0.0)

    with pytest.raises(ValueError, match=r"^flow = a function that returns a list of 2, expected a function v"):
        eqx.filter_jit(divergence)(jnp.asarray(1.0))


def test_errors_of_the_function_itself_stay_what_they_are():
    with pytest.raises(NameError, match="speed"):
        jaxves.make_scene(ELLIPSE, flow=lambda x, t: jnp.array([speed, 0.0]))


class Factor(AbstractHistory):
    value: object = eqx.field(static=True)

    def __call__(self, t):
        return self.value(t)

    def breakpoints(self):
        return jnp.zeros(0)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (
            lambda t: [t],
            "a function that returns a list of 1, expected a factor of time in JAX that returns one number",
        ),
        (lambda t: jnp.stack([t, t]), r"an array of shape \(2,\), expected a factor of time"),
        (lambda t: 1.0 if t < 0.5 else 0.0, "decides in Python .*, expected jax.numpy.where"),
        (lambda t: math.exp(t), "makes a Python number"),
    ],
)
def test_a_factor_of_time_that_cannot_be_used_is_refused_where_it_is_given(value, message):
    with pytest.raises(ValueError, match="^Field.history = .*" + message):
        jaxves.dc_field(1.0, conductivity_ratio=0.1, history=Factor(value))
    with pytest.raises(ValueError, match="^TimeDependent.history = .*" + message):
        jaxves.TimeDependent(jaxves.Shear(1.0), Factor(value))


def test_a_factor_of_time_that_can_be_traced_is_taken():
    factor = Factor(lambda t: jnp.where(t < 0.5, 1.0, 0.0))
    field = jaxves.dc_field(1.0, conductivity_ratio=0.1, history=factor)
    np.testing.assert_array_equal(field.E_inf(jnp.asarray(0.2)), [0.0, 1.0])
    np.testing.assert_array_equal(field.E_inf(jnp.asarray(0.7)), [0.0, 0.0])


OBSERVABLES = [
    (
        lambda row: row.x,
        rf"an array of shape \(1, {N}, 2\), expected a function of a row .* one for each of 1 vesicles",
    ),
    (lambda row: [1.0], "a function that returns a list of 1, expected a function of a row"),
    (lambda row: {"a": row.t}, "a function that returns a dict of 1, expected a function of a row"),
    (lambda row: 1.0 if row.t < 1 else 0.0, "decides in Python .*, expected jax.numpy.where"),
    (lambda row: np.ptp(np.asarray(row.x)), "gives a traced value to NumPy, expected the functions of jax.numpy"),
    (lambda row: float(row.t), "makes a Python number"),
]


@pytest.mark.parametrize(("function", "message"), OBSERVABLES)
def test_an_observable_that_cannot_be_used_is_refused_before_anything_is_compiled(function, message, monkeypatch):
    scene = jaxves.make_scene(ELLIPSE)

    def computed(*_, **__):
        raise AssertionError("the run began")

    from jaxves.stepping import marching

    simulated = marching._simulated
    monkeypatch.setattr(marching, "_simulated", lambda *given: simulated(*given) if _is_traced(given) else computed())
    with pytest.raises(ValueError, match=r"^observables\['mine'\] = .*" + message) as caught:
        jaxves.simulate(scene, 1e-3, saves=1, march=jaxves.Fixed(1), observables={"mine": function})
    assert "\n" not in str(caught.value)


def _is_traced(given):
    return not jaxves.base.arguments.is_known(given)


def test_a_run_refuses_an_observable_and_writes_nothing(tmp_path):
    tables = {"t_end": 1e-3, "saves": 1, "vesicle": [{"reduced_area": 0.9}], "numerics": {"nodes": N, "certify": False}}
    with pytest.raises(ValueError, match=r"^observables\['mine'\] = .*decides in Python"):
        jaxves.run(tables, tmp_path / "run.h5", observables={"mine": lambda row: 1.0 if row.t < 1 else 0.0})
    assert not list(tmp_path.glob("*.h5"))


@pytest.mark.parametrize(
    ("quantity", "message"),
    [
        (lambda result: [1.0], "a function that returns a list of 1, expected one number"),
        (lambda result: 1.0 if result.t[-1] > 0 else 0.0, "decides in Python .*, expected jax.numpy.where"),
    ],
)
def test_a_quantity_to_be_steered_that_cannot_be_used_is_refused(quantity, message):
    scene = jaxves.make_scene(ELLIPSE, field=jaxves.dc_field(1.0, conductivity_ratio=0.1))
    with pytest.raises(ValueError, match="^quantity = .*" + message):
        jaxves.steer(scene, quantity, 0.1, t_end=1e-3, knots=2, march=jaxves.Fixed(1))
