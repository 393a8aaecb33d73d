"""What is reported of pairs: where they are to each other, and whether the film between them is resolved."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base import status
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import extremes, shapes
from jaxves.geometry.curve import Curve
from jaxves.geometry.domain import Cell
from jaxves.numerics import fourier
from jaxves.observables import classes, diagnostics, registry
from jaxves.observables.checks import Checks
from jaxves.observables.quantities import QUANTITIES
from jaxves.observables.rows import Row
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.physics.waveform import AC

DIRECTION = np.array([0.6, 0.8])


@functools.cache
def _diagnosing(N, M):
    @jax.jit
    def diagnose(x, V_m):
        field = dc_field(3.2, conductivity_ratio=0.1, vesicles=M, direction=DIRECTION)
        equation = equation_for(make_scene(list(x), field=field))
        y = Unknowns.of(x, V_m)
        found = _found(equation, y)
        checks = Checks(tail=np.inf)
        zero = jnp.zeros(())
        return found, checks.judge(equation, zero, y, Row(zero, x, x[..., 0], found))

    def _found(equation, y):
        motion = equation.motion(jnp.zeros(()), y)
        found = diagnostics.diagnose(equation, jnp.zeros(()), y, motion)
        _, rate = jax.jvp(lambda x: _gap(x), (y.x,), (motion.velocity,))
        return found | {"gap_rate": rate}

    def _gap(x):
        return extremes.gap(*(Curve.from_nodes(x) for x in x[:2]))

    def call(x, V_m):
        found, code = diagnose(x, V_m)
        return {name: np.asarray(value) for name, value in found.items()}, int(code)

    return call


def placed(N, centers, V=0.5):
    """Ellipses along the field with V_m = V E_∞·(x - center)."""
    e = jax.jit(lambda: shapes.ellipse(64, 0.9, angle=np.arctan2(*DIRECTION[::-1])))()
    e = fourier.resample(e, N, axis=0)
    x = jnp.stack([e + jnp.asarray(center) for center in centers])
    return x, V * jnp.stack([e @ DIRECTION] * len(centers))


def test_separation_and_the_angle_of_the_line_of_centres():
    """From the second vesicle to the first; numbering them the other way turns it by half a turn."""
    centers = np.array([[-1.5, 0.3], [1.1, -0.9]])
    x, V_m = placed(64, centers)
    found, _ = _diagnosing(64, 2)(x, V_m)
    other, _ = _diagnosing(64, 2)(x[::-1], V_m[::-1])
    dx, dy = centers[0] - centers[1]
    np.testing.assert_allclose(found["separation"], np.hypot(dx, dy), rtol=1e-12)
    np.testing.assert_allclose(found["line_angle"], np.arctan2(dy, dx), rtol=1e-12)
    np.testing.assert_allclose(found["line_angle"] - other["line_angle"], np.pi, rtol=1e-12)
    assert "neighbor_distance" not in found


def test_three_vesicles_know_their_nearest_neighbours():
    x, V_m = placed(64, [[0.0, 0.0], [2.5, 0.0], [0.0, 4.0]])
    found, _ = _diagnosing(64, 3)(x, V_m)
    np.testing.assert_allclose(found["neighbor_distance"], [2.5, 2.5, 4.0], rtol=1e-12)
    assert "separation" not in found


def test_the_dipole_of_a_poor_conductor_points_against_the_field():
    """And of a good one along it; none, as of a circle of Λ = 1 without V_m, has the angle 0 and a derivative."""

    def angle(Lambda, direction=DIRECTION):
        x = shapes.circle(32)
        equation = equation_for(make_scene(x, field=dc_field(1.0, conductivity_ratio=Lambda, direction=direction)))
        y = Unknowns.of(x[None], jnp.zeros((1, 32)))
        motion = equation.motion(jnp.zeros(()), y)
        return diagnostics.diagnose(equation, jnp.zeros(()), y, motion)["dipole_angle"][0]

    along = np.arctan2(*DIRECTION[::-1])
    found = jax.jit(jax.vmap(angle))(jnp.array([0.1, 10.0]))
    np.testing.assert_allclose(found, [along - np.pi, along], atol=1e-12)
    value, slope = jax.jit(jax.value_and_grad(angle))(1.0)
    assert value == 0 and np.isfinite(slope)


@pytest.mark.parametrize("gap", [0.05, 0.1])
def test_the_film_error_tells_how_wrong_the_drainage_is(gap):
    """To an order of magnitude either way, of two ellipses in a row along the field, tip to tip."""
    tip = 2 * 1.2577 + gap  # to be adjusted to the gap asked for
    centers = np.array([[0.0, 0.0], tip * DIRECTION])
    x, _ = placed(64, centers)
    first, second = (jax.vmap(Curve.from_nodes)(x[m][None]) for m in (0, 1))
    now = jax.jit(jax.vmap(extremes.gap))(first, second)[0]
    centers[1] += (gap - now) * DIRECTION
    exact, resolved = _diagnosing(160, 2)(*placed(160, centers))
    np.testing.assert_allclose(exact["min_gap"], gap, rtol=1e-3)
    assert resolved == status.RUNNING
    for N in (48, 64):
        found, code = _diagnosing(N, 2)(*placed(N, centers))
        error = abs(found["gap_rate"] / exact["gap_rate"] - 1)
        assert 0.1 < found["film_error"] / error < 10
        assert (code == status.UNRESOLVED) == (found["film_error"] > 0.1)


def test_every_quantity_has_one_function_which_gives_it():
    """Over scenes that have all of them together; what needs earlier times is computed elsewhere."""
    given = [name for group in registry.GROUPS for name in group.names]
    earlier = {"inclination_unwrapped", "time_error", classes.MEAN, classes.LEAST, classes.GREATEST, classes.CHANGE}
    assert sorted(given) == sorted(set(QUANTITIES) - earlier)
    seen = {}
    field = dc_field(3.2, conductivity_ratio=0.1)
    relaxing = dc_field(3.2, conductivity_ratio=0.1, charge_relaxation=0.1)
    averaged = dc_field(3.2, conductivity_ratio=0.1, history=AC(50.0, averaged=True))
    square = Cell.of([[9.0, 0.0], [0.0, 9.0]])
    cases = [(2, field, Shear(1.0), None), (3, relaxing, Shear(1.0), None), (2, field, Shear(1.0), square)]
    cases.append((1, averaged, None, None))
    for vesicles, field, flow, cell in cases:
        centers = [[3.0 * m, 0.0] for m in range(vesicles)]
        curves = [shapes.ellipse(32, 0.9)] * vesicles
        scene = make_scene(curves, centers=centers, field=field, flow=flow, cell=cell)
        equation = equation_for(scene)
        y = equation.start()
        motion = eqx.filter_jit(equation.motion)(jnp.zeros(()), y)
        instant, found = registry.Instant(equation, jnp.zeros(()), y, motion), {}
        for group in registry.GROUPS:
            if not group.needed(scene):
                continue
            new = group.formula(instant, found)
            assert set(new) <= set(group.names), group.formula
            found |= new
        for name, value in found.items():
            each = "vesicle" in QUANTITIES[name].dims
            seen[name] = value.shape == (vesicles,) * each + (2,) * (len(QUANTITIES[name].dims) - 1 - each)
    assert set(seen) == set(given) and all(seen.values()), seen


def test_a_name_that_is_unknown_or_taken_cannot_be_registered():
    for name in ("areas", "area"):
        with pytest.raises(ValueError, match=f"gives: '{name}', expected a name"):
            registry.gives(name)
