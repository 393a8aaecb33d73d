"""Many membranes without matrices of all pairs: the same answers, in memory that grows with their number."""

import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.geometry.domain import Free
from jaxves.numerics import krylov
from jaxves.operators import direct_sums, interactions
from jaxves.operators.near_pairs import NearPairs
from jaxves.operators.pairs import Pairwise
from jaxves.operators.sums import MatrixFree, coupling_for
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

DIRECT, ITERATIVE = Pairwise(direct=True), Pairwise(direct=False)
SOLVED = 1e-9  # GMRES to 1e-11, times the condition of what is compared


def row_of(M, N, *, spacing=2.4):
    """Ellipses in a zigzag row, turned and charged each in its own way; neighbours are near at 32 nodes."""
    turned = [shapes.ellipse(N, 0.9, angle=1.3 + 0.3 * m, length=1 - 0.05 * (m % 3)) for m in range(M)]
    field = dc_field(3.2, conductivity_ratio=jnp.linspace(0.1, 2.0, M), membrane_conductance=0.2, vesicles=M)
    scene = make_scene(turned, centers=[[spacing * m, 0.4 * (m % 2)] for m in range(M)], field=field)
    alpha = np.arange(N) * (2 * np.pi / N)
    return scene, Unknowns.of(scene.x, jnp.stack([0.4 * jnp.sin(alpha + m) for m in range(M)]))


@eqx.filter_jit
def motion_of(scene, y, coupling):
    return equation_for(scene, coupling=coupling).motion(jnp.zeros(()), y)


@pytest.mark.parametrize("coupling", [ITERATIVE, MatrixFree(2)], ids=["matrices", "sums"])
def test_every_coupling_gives_the_motion_of_the_direct_solve(coupling):
    scene, y = row_of(3, 32)
    exact, found = motion_of(scene, y, DIRECT), motion_of(scene, y, coupling)
    assert found.residual < 1e-11
    assert 4 < found.iterations < 60

    def compared(motion):
        return motion.velocity, motion.sigma, motion.rates["V_m"], motion.electric.w, motion.electric.traction

    for value, wanted in zip(compared(found), compared(exact), strict=True):
        np.testing.assert_allclose(value, wanted, atol=SOLVED * jnp.max(jnp.abs(wanted)))


def test_the_row_has_near_and_far_pairs():
    """So that the test above sees both rules; the spacing of the source decides, hence not (1, 2)."""
    scene, _ = row_of(3, 32)
    near = jax.jit(lambda x: NearPairs.of(jax.vmap(Curve.from_nodes)(x), 2, interactions.NEAR, Free()))(scene.x)
    pairs = {(int(i), int(j)) for i, j in zip(near.target[near.valid], near.source[near.valid], strict=True)}
    assert pairs == {(0, 1), (1, 0), (2, 1)}


@pytest.mark.parametrize("coupling", [ITERATIVE, MatrixFree(1)], ids=["matrices", "sums"])
def test_derivatives_through_iterations_are_those_of_the_direct_solve(coupling):
    """Forward and reverse, in nodes and potentials, of velocities and charging of a near pair."""
    N = 16
    scene, y = row_of(2, N)
    alpha = np.arange(N) * (2 * np.pi / N)
    turn = jnp.stack([jnp.cos(2 * alpha), jnp.sin(alpha)], axis=-1)
    direction = Unknowns.of(jnp.stack([turn, -0.5 * turn]), jnp.stack([jnp.cos(alpha), jnp.sin(3 * alpha)]))

    @eqx.filter_jit
    def slopes(y, coupling):
        def work(y):
            rate = equation_for(scene, coupling=coupling).rate(jnp.zeros(()), y)
            return jnp.sum(jnp.sin(rate.x)) + jnp.sum(rate.V_m**2)

        forward = jax.jvp(work, (y,), (direction,))[1]
        gradient = jax.grad(work)(y)
        return forward, sum(jnp.sum(g * d) for g, d in zip(*map(jax.tree.leaves, (gradient, direction)), strict=True))

    exact, _ = slopes(y, DIRECT)
    np.testing.assert_allclose(jnp.stack(slopes(y, coupling)), exact, rtol=1e-7)


def test_scenes_side_by_side_are_solved_as_one_by_one():
    scene, y = row_of(2, 16)
    moved = jnp.stack([y.x, y.x.at[1].add(jnp.array([1.5, 0.0]))])

    def velocity(x):
        return equation_for(scene, coupling=MatrixFree(1)).rate(jnp.zeros(()), Unknowns.of(x, y.V_m)).x

    together, alone = jax.jit(jax.vmap(velocity))(moved), jax.jit(velocity)
    for x, found in zip(moved, together, strict=True):
        np.testing.assert_allclose(found, alone(x), atol=SOLVED * jnp.max(jnp.abs(found)))


@pytest.mark.parametrize("at_once", [2, 32])
def test_sums_for_several_targets_at_once_as_on_a_gpu_are_the_same(monkeypatch, at_once):
    scene, y = row_of(3, 16)

    def velocity():
        return jax.jit(lambda: equation_for(scene, coupling=MatrixFree(1)).rate(jnp.zeros(()), y).x)()

    alone = velocity()
    monkeypatch.setattr(direct_sums, "_ON_ACCELERATOR", at_once)
    monkeypatch.setattr(direct_sums.jax, "default_backend", lambda: "gpu")
    np.testing.assert_allclose(velocity(), alone, atol=SOLVED * jnp.max(jnp.abs(alone)))


@jax.jit
def crowd(seed):
    """Curves of 24 ellipses strewn at random; that they overlap does not matter here."""
    places, turns = jax.random.uniform(seed, (24, 2), maxval=14.0), jax.random.uniform(seed, (24,), maxval=np.pi)
    x = jax.vmap(lambda angle: shapes.rotated(shapes.ellipse(32, 0.6), angle))(turns) + places[:, None]
    return jax.vmap(Curve.from_nodes)(x)


@pytest.mark.parametrize("seed", range(3))
def test_neighbours_are_those_of_a_search_through_all_pairs(seed):
    curves = crowd(jax.random.key(seed))
    targets, sources = interactions.pair_frames(curves)
    expected = np.zeros((24, 24), bool)
    is_near = jax.jit(jax.vmap(lambda source, x: interactions.is_near_curve(source, x, 5.0)))
    expected[~np.eye(24, dtype=bool)] = is_near(sources, targets.x)
    near = jax.jit(NearPairs.of, static_argnums=(1, 2))(curves, 12, 5.0, Free())
    assert not near.overflow
    found = np.zeros((24, 24), bool)
    found[near.target[near.valid], near.source[near.valid]] = True
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(near.sources_of(jnp.int32(5), 24), expected[5])
    assert jax.jit(NearPairs.of, static_argnums=(1, 2))(curves, int(expected.sum()) // 24 - 1, 5.0, Free()).overflow


def test_near_pairs_without_room_end_a_run_as_crowded():
    """Four in a square: each has two neighbours, where there is room for one."""
    e = shapes.circle(16)
    scene = make_scene([e] * 4, centers=[[0.0, 0.0], [2.2, 0.0], [0.0, 2.2], [2.2, 2.2]])

    @eqx.filter_jit
    def run(march):
        return simulate(scene, 1e-3, saves=1, march=march, coupling=MatrixFree(1))

    words = [run(march).word for march in (Fixed(1), Adaptive())]
    assert words == ["crowded", "crowded"]


def test_memory_without_matrices_grows_like_the_number_of_vesicles():
    def bytes_of(M, coupling):
        scene, y = row_of(M, 16)
        rate = jax.jit(lambda y: equation_for(scene, coupling=coupling).rate(jnp.zeros(()), y))
        return rate.lower(y).compile().memory_analysis().temp_size_in_bytes

    few, many = (bytes_of(M, MatrixFree(2)) for M in (16, 64))
    assert many < 4.4 * few
    few, many = (bytes_of(M, ITERATIVE) for M in (8, 32))
    assert many > 10 * few


def test_the_size_decides_how_membranes_are_coupled():
    assert coupling_for(1, 64) is None
    assert coupling_for(2, 64).direct
    assert not coupling_for(2, 128).direct
    assert isinstance(coupling_for(32, 64), MatrixFree)


_SHARDED = """
import jax, jax.numpy as jnp, numpy as np
from test_summation import row_of
from jaxves.equation.equation import equation_for
from jaxves.geometry.curve import Curve
from jaxves.geometry.domain import Free
from jaxves.operators.sums import MatrixFree

scene, y = row_of(3, 16)
weights = jnp.cos(jnp.arange(y.x.size)).reshape(y.x.shape)

def found(coupling):
    def sums(x, V_m):
        between = coupling.between(jax.vmap(Curve.from_nodes)(x), Free(), electric=True)
        return between.stokes(jnp.sin(x)), between.slp_gradient(V_m)

    def everything(x):
        value, back = jax.vjp(sums, x, y.V_m)
        rate = equation_for(scene, coupling=coupling).rate(jnp.zeros(()), type(y).of(x, y.V_m))
        return value, back((weights, weights)), rate

    compiled = jax.jit(everything).lower(y.x).compile()
    return compiled.as_text(), compiled(y.x)

assert jax.device_count() == 2
text, many = found(MatrixFree(2, jax.make_mesh((2,), ("targets",), axis_types=(jax.sharding.AxisType.Auto,))))
assert "all-gather" in text or "all-reduce" in text
_, one = found(MatrixFree(2))
for a, b in zip(*map(jax.tree.leaves, (many, one)), strict=True):
    np.testing.assert_allclose(a, b, atol=1e-9 * np.max(np.abs(b)))
print("agreed")
"""


def test_two_devices_share_the_targets_and_agree_with_one():
    """Three vesicles on two devices: sums, their gradients, and F with its iterations."""
    flags = {"XLA_FLAGS": "--xla_force_host_platform_device_count=2", "JAX_PLATFORMS": "cpu"}
    environment = os.environ | flags | {"PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
    done = subprocess.run(
        [sys.executable, "-c", _SHARDED], env=environment, capture_output=True, text=True, timeout=900
    )
    assert done.stdout.strip() == "agreed", done.stderr


def test_gmres_counts_the_directions_it_needs():
    """As many as there are distinct eigenvalues; with the inverse as preconditioner, one."""
    diagonal = jnp.asarray(np.resize([1.0, 2.0, 5.0], 30))
    b = jnp.ones(30) + jnp.arange(30) / 7
    options = {"tol": 1e-12, "restart": 10, "max_cycles": 3}
    x, residual, count = jax.jit(lambda b: krylov.gmres(lambda v: diagonal * v, lambda r: r, b, **options))(b)
    np.testing.assert_allclose(x, b / diagonal, rtol=1e-11)
    assert (count, residual < 1e-12) == (3, True)
    _, _, count = jax.jit(lambda b: krylov.gmres(lambda v: diagonal * v, lambda r: r / diagonal, b, **options))(b)
    assert count == 1
