"""Wrong input from Python: one clear line that names the argument, and no run; inside of tracing the status tells."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.base import status
from jaxves.geometry import starts
from jaxves.geometry.curve import Curve, area
from jaxves.stepping.fixed import Fixed

E = jaxves.ellipse(64, 0.9, angle=np.pi / 2)
NAN, INF = float("nan"), float("inf")
T = np.linspace(0, 2 * np.pi, 64, endpoint=False)


def field(**changed):
    return jaxves.dc_field(**({"beta": 3.2, "conductivity_ratio": 0.1} | changed))


def pair(**changed):
    return jaxves.make_scene(**({"shapes": [E, E], "centers": [[0, 0], [3, 0]]} | changed))


@pytest.fixture(scope="module")
def complaints(tmp_path_factory):
    """What every wrong call raised, by its name; and the files that were left behind."""
    folder = tmp_path_factory.mktemp("wrong")
    program = Path(__file__).with_name("wrong_arguments.py")
    path = os.pathsep.join([str(program.parents[1]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, cwd=folder, env=os.environ | {"PYTHONPATH": path}
    )
    assert done.returncode == 0, done.stderr
    assert not list(folder.iterdir())
    return json.loads(done.stdout)


def test_wrong_input_is_one_line_that_names_the_argument(complaints):
    """ValueError, or an error of the package that is none: no call goes through."""
    assert len(complaints) >= 100
    bad = {
        name: (kind, message)
        for name, (said, kind, message) in complaints.items()
        if kind not in {"ValueError", "SceneError", "NoCriticalValue"}
        or "\n" in message
        or not re.search(said, message)
    }
    assert not bad


def test_clockwise_nodes_are_turned_round():
    turned = jaxves.make_scene(E[::-1])
    assert np.array_equal(turned.x, jaxves.make_scene(E).x) and area(Curve.from_nodes(turned.x[0])) > 0


@pytest.mark.parametrize(("a", "b"), [(0.7, 1.3), (1.0, 1.2), (0.5, 1.4), (1.3, 0.6)])
def test_uneven_nodes_are_spaced_along_the_same_curve(a, b):
    """(a cos t, b sin t) become nodes equispaced on the same ellipse, beginning at the same one."""
    for N in (64, 96, 128):
        t = 2 * np.pi * np.arange(N) / N
        uneven = np.stack([a * np.cos(t), b * np.sin(t)], axis=-1)
        x = np.asarray(jaxves.make_scene(uneven).x[0])
        assert np.max(np.abs((x[:, 0] / a) ** 2 + (x[:, 1] / b) ** 2 - 1)) < 1e-9
        assert starts.is_uneven(uneven[None]).all() and not starts.is_uneven(x[None]).any()
        chord = np.linalg.norm(x - np.roll(x, 1, axis=0), axis=1)  # of even nodes: s (1 - (κ s)²/24), κ <= a/b²
        assert np.ptp(chord) / chord.mean() < (np.pi * 1.5 * max(a, b) / min(a, b) ** 2 / N) ** 2
        np.testing.assert_allclose(x[0], uneven[0], atol=1e-12)


@pytest.mark.parametrize("N", [16, 32, 64, 128])
def test_even_nodes_stay_as_they_are(N):
    """Also where so few resolve the curve badly."""
    for reduced_area in (0.2, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0):
        x = jaxves.ellipse(N, reduced_area, angle=0.3)
        assert np.array_equal(jaxves.make_scene(x).x[0], x)


def test_numbers_of_a_field_for_one_vesicle_hold_for_all():
    scene = pair(field=field(membrane_conductance=0.3))
    assert np.array_equal(scene.field.membrane_conductance, [0.3, 0.3])


RIGHT = {"beta": 3.2, "chi": 0.08, "bending": 1.0, "t_end": 0.01, "x": E, "rate": 1.0}
TRACED = {
    "beta": -1.0,
    "chi": -0.08,
    "bending": 0.0,
    "t_end": -0.01,
    "rate": 0.0,
}  # fmt: skip


@jax.jit
def _status(values):
    scene = jaxves.make_scene(
        values["x"],
        bending=values["bending"],
        field=field(beta=values["beta"], chi=values["chi"]),
        flow=jaxves.Shear(values["rate"]),
    )
    return jaxves.simulate(scene, values["t_end"], saves=1, march=Fixed(1)).status


@pytest.mark.parametrize("name", TRACED)
def test_a_traced_number_out_of_its_bounds_ends_the_run_as_invalid(name):
    assert int(_status(RIGHT)) == status.COMPLETE
    assert int(_status(RIGHT | {name: TRACED[name]})) == status.INVALID


@pytest.mark.parametrize(
    "x", [E[::-1], np.stack([0.7 * np.cos(T), 1.3 * np.sin(T)], axis=-1)], ids=["clockwise", "uneven"]
)
def test_traced_nodes_that_are_no_start_end_the_run_as_invalid(x):
    assert int(_status(RIGHT | {"x": jnp.asarray(x)})) == status.INVALID


def test_known_values_are_checked_inside_of_jit_too():
    """There the functions of JAX trace even what is known."""
    direction, times, gradient = jnp.array([1.0, 1.0]), jnp.array([0.0, 1.0]), jnp.array([[0.0, 1.0], [0.0, 0.0]])

    @jax.jit
    def built(beta):
        history = jaxves.PiecewiseLinear(times, times)
        shear = jaxves.make_scene(
            E, field=field(beta=beta, direction=direction, history=history), flow=jaxves.Shear(1.0)
        )
        linear = jaxves.make_scene(E, flow=jaxves.LinearFlow(gradient))
        window = jnp.array([0.0, 0.01])
        result = jaxves.simulate(linear, 0.01, saves=1, march=Fixed(1), average=window)
        return shear.field.beta, result.status

    assert float(built(2.0)[0]) == 2.0
    nothing = jnp.zeros(2)
    with pytest.raises(ValueError, match=r"Field\.direction"):
        jax.jit(lambda beta: field(beta=beta, direction=nothing).beta)(2.0)


def test_traced_vesicles_in_one_place_end_the_run_as_a_collision():
    @jax.jit
    def of(centers):
        return jaxves.simulate(pair(centers=centers), 0.01, saves=1, march=Fixed(1)).status

    assert int(of(jnp.array([[0.0, 0.0], [4.0, 0.0]]))) == status.COMPLETE
    for other in ([0.0, 0.0], [0.5, 0.1]):
        assert int(of(jnp.array([[0.0, 0.0], other]))) == status.COLLISION


def test_bounds_hold_for_numbers_and_entry_by_entry_for_arrays():
    from jaxves.base.bounds import NOT_NEGATIVE, POSITIVE, RATIO

    for bounds, bad, good in ((POSITIVE, 0.0, 1.0), (NOT_NEGATIVE, -1e-300, 0.0), (RATIO, NAN, INF)):
        assert not bounds.hold(bad) and bounds.hold(good)
        assert np.array_equal(bounds.hold(np.array([bad, good])), [False, True])
