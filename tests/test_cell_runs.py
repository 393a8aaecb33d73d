"""Scenes in a periodic cell: motion, runs, derivatives, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import Stops, stored

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell
from jaxves.numerics import fourier
from jaxves.observables.fields import fields_at
from jaxves.operators.pairs import Pairwise
from jaxves.physics.flow import Extension, Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.physics.waveform import AC
from jaxves.results import run_store
from jaxves.runs import runner
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

N = 16
CELL = [[3.4, 0.0], [0.5, 3.1]]
FIELD = {"conductivity_ratio": 0.1, "membrane_conductance": 0.2}


def one(rate=4.0, lattice=CELL):
    ellipse = shapes.ellipse(N, 0.9, angle=0.4)
    return make_scene(ellipse, field=dc_field(3.2, **FIELD), flow=Shear(rate), cell=Cell.of(lattice))


def motion(scene, V_m, t=0.13):
    """At an instant at which the lattice leans."""
    return equation_for(scene).motion(jnp.asarray(t), Unknowns.of(scene.x, V_m))


V_M = 0.3 * jnp.sin(fourier.grid(N))[None]


def test_a_double_cell_with_a_vesicle_of_another_image_moves_like_one():
    """Twice the cell along x; the second vesicle is shifted by a vector of the lattice at that instant."""
    alone = jax.jit(motion)(one(), V_M)
    t, rate = 0.13, 4.0
    leaning = np.array(CELL[1]) + rate * t * np.array([CELL[1][1], 0.0])
    double = [[2 * CELL[0][0], 0.0], CELL[1]]
    x = one().x[0]
    shift = np.array(CELL[0]) - leaning
    scene = make_scene([x, x + shift], field=dc_field(3.2, vesicles=2, **FIELD), flow=Shear(rate), cell=Cell.of(double))
    both = jax.jit(motion)(scene, jnp.concatenate([V_M, V_M]))
    assert alone.residual < 1e-10 and both.residual < 1e-10
    size = jnp.max(jnp.abs(alone.velocity))
    np.testing.assert_allclose(both.velocity[0], alone.velocity[0], atol=1e-8 * size)
    moving = rate * shift[1] * np.array([1.0, 0.0])
    np.testing.assert_allclose(both.velocity[1] - moving, alone.velocity[0], atol=1e-8 * size)
    for m in (0, 1):
        np.testing.assert_allclose(both.sigma[m], alone.sigma[0], atol=1e-7 * jnp.max(jnp.abs(alone.sigma)))
        np.testing.assert_allclose(both.rates["V_m"][m], alone.rates["V_m"][0], atol=1e-7)


def test_derivatives_in_the_lattice_and_the_capillary_number_are_those_of_differences():
    @jax.jit
    def work(rate, lattice):
        found = motion(one(rate, lattice), V_M)
        return jnp.sum(jnp.sin(found.velocity)) + jnp.sum(found.rates["V_m"] ** 2)

    start = jnp.asarray(4.0), jnp.asarray(CELL)
    push = jnp.asarray(0.7), jnp.asarray([[0.3, 0.0], [-0.2, 0.4]])
    forward = jax.jit(lambda *args: jax.jvp(work, args, push)[1])(*start)
    reverse = jax.jit(jax.grad(work, argnums=(0, 1)))(*start)
    along = sum(jnp.sum(g * d) for g, d in zip(reverse, push, strict=True))
    np.testing.assert_allclose(along, forward, rtol=1e-7)
    h = 1e-4
    moved = [work(*(a + k * h * b for a, b in zip(start, push, strict=True))) for k in (-2, -1, 1, 2)]
    change = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * h)
    np.testing.assert_allclose(forward, change, rtol=1e-6)


def test_a_run_gives_the_conductivity_of_the_lattice():
    """Circles at area fraction 0.3 with Λ = 0.1, before their membranes charge."""
    side = np.sqrt(np.pi / 0.3)
    cell = Cell.of(side * np.eye(2))
    scene = make_scene(shapes.circle(32), field=dc_field(1.0, conductivity_ratio=0.1), cell=cell)
    result = simulate(scene, 1e-4, saves=1, march=Fixed(1))
    assert result.word == "complete"
    found = result.diagnostics
    np.testing.assert_allclose(found["effective_conductivity"][0], 0.6053136815976, rtol=1e-8)
    np.testing.assert_allclose(found["mean_current"][0], [0.0, 0.6053136815976], atol=1e-8)
    assert np.all(np.isinf(found["min_gap"]))
    assert "stress" not in found


def test_what_a_cell_does_not_support_is_refused():
    ellipse, cell = shapes.ellipse(N, 0.9), Cell.of(CELL)
    with pytest.raises(ValueError, match=r"Scene\.flow = .*, expected Shear or None"):
        make_scene(ellipse, flow=Extension(1.0), cell=cell)
    with pytest.raises(ValueError, match=r"charge_relaxation = .*, expected None in a periodic cell"):
        make_scene(ellipse, field=dc_field(3.2, charge_relaxation=0.01, **FIELD), cell=cell)
    with pytest.raises(ValueError, match=r"averaged = True, expected an AC field that is not averaged"):
        make_scene(ellipse, field=dc_field(3.2, history=AC(9.0, averaged=True), **FIELD), cell=cell)
    with pytest.raises(ValueError, match=r"Scene\.cell\.rate = .*5.*, expected None: the shear flow"):
        make_scene(ellipse, flow=Shear(3.0), cell=Cell.of(CELL, rate=5.0))
    scene = make_scene(ellipse, cell=cell)
    with pytest.raises(ValueError, match=r"coupling = .*, expected MatrixFree with an accuracy"):
        equation_for(scene, coupling=Pairwise(direct=True))
    with pytest.raises(ValueError, match=r"cell = .*, expected no periodic cell"):
        fields_at(equation_for(scene), 0.0, Unknowns(scene.x, {}), jnp.zeros((1, 2)))


def test_a_run_in_a_cell_that_is_stopped_and_resumed_has_the_bits_of_a_whole_one(tmp_path):
    """Two vesicles in shear and a field with fast sums, in a cell that leans over its side between two saved times."""
    tables = {
        "t_end": 0.05,
        "saves": 5,
        "vesicle": [{"reduced_area": 0.95}],
        "cell": {"lattice": [[4.4, 0.0], [2.0, 4.4]]},
        "suspension": {"count": 2, "seed": 3},
        "flow": {"kind": "shear", "capillary_number": 4.0},
        "field": {"beta": 3.2, **FIELD},
        "numerics": {"nodes": 32, "tolerance": 1e-2, "certify": False},
    }
    whole, parts = tmp_path / "whole.h5", tmp_path / "parts.h5"
    assert runner.run(tables, whole) == "complete"
    assert runner.run(tables, parts, progress=Stops(2)) == "interrupted"
    assert stored(parts) != stored(whole)
    assert runner.run(tables, parts, resume=True) == "complete"
    assert stored(parts) == stored(whole)
    rows = run_store.read_result(whole).diagnostics
    assert np.max(np.abs(rows["area"] / rows["area"][0] - 1)) < 1e-6
    assert np.max(rows["residual"]) < 1e-5
