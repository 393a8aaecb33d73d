"""What an averaged AC field leaves out, told by the run itself, against runs that resolve the field."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.geometry import shapes
from jaxves.observables.certificate import weakest
from jaxves.physics.scene import dc_field, make_scene
from jaxves.physics.waveform import AC
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

N, T_END, SAVES = 24, 0.1, 8
X = shapes.ellipse(N, 0.97, angle=1.0)


@eqx.filter_jit
def run(numbers, averaged, steps, delta=None):
    """Runs with β, frequency and offset, which are traced, and so many `steps` per saved time."""
    beta, frequency, offset = numbers
    history = AC(frequency, offset=offset, averaged=averaged)
    field = dc_field(beta, conductivity_ratio=0.5, history=history, charge_relaxation=delta)
    return simulate(make_scene(X, field=field), T_END, saves=SAVES, march=Fixed(steps))


STEPS = 40  # per saved time: 35 or more in a period


@pytest.mark.parametrize(("offset", "delta"), [(0.0, None), (0.7, 0.05)])
def test_the_swing_is_the_difference_from_a_run_that_resolves_the_field(offset, delta):
    """At saved times a quarter of a swing apart. The estimate leaves out what the flow makes of a displacement."""
    delta = None if delta is None else jnp.asarray(delta)
    found = []
    for frequency in (50.0, 90.0):
        numbers = jnp.array([8.0, frequency, offset])
        resolved, averaged = (run(numbers, flag, STEPS, delta) for flag in (False, True))
        apart = float(jnp.max(jnp.linalg.norm(resolved.x - averaged.x, axis=-1)))
        told = averaged.certificate["averaging"].value
        assert "averaging" not in resolved.certificate
        assert 0.4 * told < apart < 2.5 * told
        found.append((told, apart))
    np.testing.assert_allclose(found[0][0] / found[1][0], 90 / 50, rtol=0.2)


def test_a_run_that_is_averaged_over_too_slow_a_field_is_inaccurate():
    averaged = run(jnp.array([8.0, 2.0, 0.0]), True, STEPS)
    links = averaged.certificate
    assert averaged.word == "inaccurate" and weakest(links) == "averaging"
    assert run(jnp.array([8.0, 50.0, 0.0]), True, STEPS).word == "complete"
