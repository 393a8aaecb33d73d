"""A lone vesicle keeps the symmetries that its start, the field and the flow share, and no others."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.cli.run_summary import summary
from jaxves.equation.equation import equation_for
from jaxves.equation.symmetry import Symmetry
from jaxves.geometry import curve, shapes
from jaxves.geometry.curve import Curve
from jaxves.inputs.scene_files import parse
from jaxves.numerics import fourier
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.results import run_store
from jaxves.runs import runner
from jaxves.runs.build import build, scene_of
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

N = 32
FIELD = dc_field(3.2, conductivity_ratio=0.1)


def ellipse(angle=90.0):
    return shapes.ellipse(N, 0.8, angle=jnp.deg2rad(angle))


def bent(x):
    """Its own image in the axis, and not under a half turn."""
    axis = (x[0] - x.mean(axis=0)) / jnp.linalg.norm(x[0] - x.mean(axis=0))
    return x + 0.05 * jnp.cos(2 * fourier.grid(N))[:, None] * axis


def kept(scene):
    """About the centre? In the axis?"""
    found = jax.jit(Symmetry.of)(scene)
    return bool(found.about_center), bool(found.in_axis)


def tilted_field(degrees):
    return dc_field(3.2, conductivity_ratio=0.1, direction=(np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))))


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (make_scene(ellipse(), field=FIELD), (True, True)),
        (make_scene(ellipse(0.0), field=FIELD), (True, True)),
        (make_scene(ellipse(30.0), field=tilted_field(30.0)), (True, True)),
        (make_scene(ellipse(30.0), field=FIELD), (True, False)),
        (make_scene(ellipse(89.99), field=FIELD), (True, False)),
        (make_scene(ellipse(30.0)), (True, True)),
        (make_scene(ellipse(), flow=Shear(1.0)), (True, False)),
        (make_scene(ellipse() + 3.0, field=FIELD, flow=Shear(1.0)), (True, False)),
        (make_scene(bent(ellipse()), field=FIELD), (False, True)),
        (make_scene(ellipse() + 1e-8 * jnp.sin(2 * fourier.grid(N))[:, None], field=FIELD), (False, False)),
    ],
    ids=["along", "across", "tilted", "oblique", "nearly-along", "free", "shear", "elsewhere", "bent", "noise"],
)
def test_what_start_field_and_flow_share_is_found(scene, expected):
    assert kept(scene) == expected


@pytest.mark.parametrize(
    ("V_m", "expected"),
    [
        (0.3 + 0 * fourier.grid(N), (False, True)),
        (jnp.cos(fourier.grid(N)), (True, True)),
        (jnp.sin(fourier.grid(N)), (True, False)),
        (jnp.sin(2 * fourier.grid(N)), (False, False)),
    ],
    ids=["net", "along", "across", "quadrupole"],
)
def test_a_starting_potential_counts(V_m, expected):
    scene = make_scene(ellipse(), field=FIELD)
    assert kept(Scene(scene.x, scene.bending, scene.field, None, V_m[None])) == expected


def asymmetry(x, V_m, first="on the axis"):
    """Under a half turn, and in the axis along y of the field, on which the first node is or is not."""
    x = x - x.mean(axis=0)
    turned = jnp.max(jnp.abs(x + jnp.roll(x, N // 2, axis=0))) + jnp.max(jnp.abs(V_m + jnp.roll(V_m, N // 2)))
    shift = 1 if first == "on the axis" else 1 + N // 2
    image, V_image = jnp.roll(x[::-1], shift, axis=0) * jnp.array([-1.0, 1.0]), jnp.roll(V_m[::-1], shift)
    return turned, jnp.max(jnp.abs(x - image)) + jnp.max(jnp.abs(V_m - V_image))


@pytest.mark.parametrize("shape", [ellipse(), bent(ellipse())], ids=["both", "mirrored alone"])
def test_what_is_symmetric_at_the_start_remains_so_to_rounding(shape):
    scene = make_scene(shape, field=FIELD)
    about_center, in_axis = kept(scene)
    result = jax.jit(lambda scene: simulate(scene, 0.1, saves=1, march=Adaptive(1e-3)))(scene)
    turned, mirrored = asymmetry(result.x[-1, 0], result.V_m[-1, 0])
    assert in_axis and mirrored < 1e-13
    assert turned < 1e-13 if about_center else turned > 1e-3


def test_a_vesicle_across_the_field_keeps_them_too():
    result = jax.jit(lambda scene: simulate(scene, 0.1, saves=1, march=Adaptive(1e-3)))(
        make_scene(ellipse(0.0), field=FIELD)
    )
    assert jnp.max(jnp.abs(result.V_m[-1])) > 0.1
    assert max(asymmetry(result.x[-1, 0], result.V_m[-1, 0], "across")) < 1e-13


def test_symmetries_are_restored_by_no_more_than_was_lost():
    """Rounding is undone; the solution of a scene without the symmetry is not moved towards it."""
    scene = make_scene(ellipse(), field=FIELD)
    equation = equation_for(scene)
    y = equation.start()
    noise = 1e-9 * np.random.default_rng(0).normal(size=y.x.shape)
    x, scalars = equation.symmetry.restored(y.x[0] + noise[0], {"V_m": y.V_m[0]})
    V_m = scalars["V_m"]
    assert max(asymmetry(x, V_m)) < 1e-14 < 1e-10 < max(asymmetry(y.x[0] + noise[0], V_m))
    for shake in (1e-3 * np.eye(N, 2), 1e-3 * jnp.cos(2 * fourier.grid(N))[:, None] * jnp.ones(2)):
        np.testing.assert_array_equal(equation.symmetry.restored(y.x[0] + shake, {"V_m": y.V_m[0]})[0], y.x[0] + shake)
    lopsided = equation_for(make_scene(bent(ellipse(30.0)), field=FIELD))
    start = lopsided.start()
    np.testing.assert_array_equal(lopsided.symmetry.restored(start.x[0], {"V_m": start.V_m[0]})[0], start.x[0])


def end(scene):
    return simulate(scene, 0.02, saves=1, march=Fixed(4)).x[-1]


@pytest.mark.parametrize("disturbed", ["nodes", "direction"])
def test_derivatives_see_what_breaks_the_symmetry(disturbed):
    """Forwards, and by differences of starts that have it no more."""
    scene = make_scene(ellipse(), field=FIELD)

    def moved(step):
        if disturbed == "nodes":
            return eqx.tree_at(lambda s: s.x, scene, scene.x.at[0, :, 0].add(step * jnp.cos(3 * fourier.grid(N))))
        return eqx.tree_at(lambda s: s.field.direction, scene, jnp.array([step, 1.0]))

    run = jax.jit(lambda step: end(moved(step)))
    slope = jax.jit(lambda step: jax.jvp(lambda s: end(moved(s)), (step,), (1.0,))[1])(0.0)
    differences = (run(1e-5) - run(-1e-5)) / 2e-5
    assert jnp.max(jnp.abs(slope[:, :, 0])) > 0.03
    np.testing.assert_allclose(slope, differences, atol=1e-6)


def test_in_a_batch_each_scene_keeps_its_own():
    fields = [tilted_field(90.0), tilted_field(60.0)]
    scenes = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(make_scene(ellipse(), field=field) for field in fields))
    together = jax.jit(jax.vmap(end))(scenes)
    for i, field in enumerate(fields):
        alone = jax.jit(end)(make_scene(ellipse(), field=field))
        np.testing.assert_allclose(together[i], alone, atol=1e-12)
    assert asymmetry(together[0, 0], jnp.zeros(N))[1] < 1e-13 < 1e-3 < asymmetry(together[1, 0], jnp.zeros(N))[1]


def test_several_vesicles_pay_nothing_for_it():
    field = dc_field(3.2, conductivity_ratio=0.1, vesicles=2)
    pair = make_scene([ellipse(), ellipse()], centers=[[0.0, 2.0], [0.0, -2.0]], field=field)
    assert equation_for(pair).symmetry is None


def test_treading_that_a_bend_would_end_goes_on():
    """Δ = 0.6, Λ = 0.1: what is odd under a half turn grows like e^{12.4 t}, if there is any of it."""
    field = dc_field(6.4, conductivity_ratio=0.1, membrane_conductance=4.0)
    x = shapes.ellipse(48, 0.6, angle=jnp.deg2rad(36.0))
    run = jax.jit(lambda x: simulate(make_scene(x, field=field, flow=Shear(10.0)), 3.0, saves=3, march=Adaptive(1e-3)))
    kept, disturbed = run(x), run(x + 1e-9 * jnp.cos(2 * fourier.grid(48))[:, None])
    assert kept.word == "complete"

    def odd(result, i):
        x = result.x[i, 0] - result.x[i, 0].mean(axis=0)
        return jnp.max(jnp.abs(x + jnp.roll(x, 24, axis=0)))

    assert odd(kept, -1) < 1e-13
    assert odd(disturbed, 1) > 1e-6


def test_a_scene_file_can_ask_for_a_start_without_symmetry():
    tables = {"t_end": 1.0, "vesicle": [{"reduced_area": 0.8}], "numerics": {"nodes": N}}
    plain, moved = build(parse(tables)), scene_of(parse(tables), {"vesicle.disturbance": 1e-6})
    assert kept(plain) == (True, True) and kept(moved) == (False, False)
    assert 1e-6 < jnp.max(jnp.abs(moved.x - plain.x)) < 3e-6
    for measure in (curve.area, curve.length):
        np.testing.assert_allclose(
            measure(Curve.from_nodes(moved.x[0])), measure(Curve.from_nodes(plain.x[0])), rtol=1e-9
        )


def test_a_result_tells_which_symmetries_were_kept(tmp_path):
    vesicle, path = {"reduced_area": 0.8}, tmp_path / "x.h5"
    for flow, told in ((None, "about its centre and in its axis"), ("shear", "about its centre")):
        tables = {"t_end": 1e-3, "saves": 1, "vesicle": [vesicle], "numerics": {"nodes": 32, "certify": False}}
        tables |= {} if flow is None else {"flow": {"kind": flow, "capillary_number": 1.0}}
        runner.run(parse(tables), path, force=True)
        record = run_store.read_result(path)
        assert record.attributes["symmetry"] == told
        assert any(f"kept symmetric {told}, like its start" in str(line) for line in summary(record, path))
    tables["vesicle"] = [vesicle | {"disturbance": 1e-6}]
    runner.run(parse(tables), path, force=True)
    record = run_store.read_result(path)
    assert record.attributes["symmetry"] == "" and not any("symmetric" in str(line) for line in summary(record, path))
