"""An observable of one's own in `simulate`, and results of Python in files."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.results.hdf5 import StoreError
from jaxves.runs.problem import reconstructed

N = 32
FIELD = jaxves.dc_field(3.2, conductivity_ratio=0.1)
MARCH = jaxves.Fixed(1)


def height(row):
    """One number for each vesicle."""
    return jnp.ptp(row.x[..., 1], axis=-1)


def energy_at_end(row):
    """One number for all vesicles."""
    return row.t * jnp.sum(row.diagnostics["bending_energy"])


@jax.jit
def run(length):
    """The result, and nothing more than the height after a short run."""
    ellipse = jaxves.ellipse(N, 0.9, angle=jnp.pi / 2, length=length)
    result = jaxves.simulate(
        jaxves.make_scene(ellipse, field=FIELD), 2e-3, saves=2, march=MARCH,
        observables={"height": height, "energy": energy_at_end},
    )  # fmt: skip
    return result.diagnostics["height"][-1, 0], result


@pytest.fixture(scope="module")
def found():
    (_, result), (slope, _) = jax.jvp(run, (jnp.ones(()),), (jnp.ones(()),))
    return result, slope


def test_an_observable_is_computed_at_every_saved_time_and_differentiated(found):
    result, slope = found
    assert result.word == "complete"
    x = np.asarray(result.x)
    np.testing.assert_allclose(result.diagnostics["height"], np.ptp(x[..., 1], axis=-1), rtol=1e-14)
    energies = np.asarray(result.t) * np.asarray(result.diagnostics["bending_energy"][:, 0])
    np.testing.assert_allclose(result.diagnostics["energy"], energies, rtol=1e-14)
    h = 1e-4
    (after, _), (before, _) = run(jnp.asarray(1 + h)), run(jnp.asarray(1 - h))
    np.testing.assert_allclose(slope, (after - before) / (2 * h), rtol=1e-6)


def test_a_result_is_saved_and_loaded(found, tmp_path):
    result, _ = found
    path = tmp_path / "found.h5"
    result.save(path)
    record = jaxves.load(path)
    assert record.word == result.word and record.saved == 3
    for name in ("t", "x", "V_m", "tension"):
        np.testing.assert_array_equal(getattr(record, name), getattr(result, name))
    assert set(record.diagnostics) == set(result.diagnostics)
    for name, values in result.diagnostics.items():
        np.testing.assert_array_equal(record.diagnostics[name], values)
    assert record.to_xarray()["height"].dims == ("t", "vesicle")
    assert record.digits == pytest.approx(result.digits)
    record.to_csv(tmp_path / "found.csv")
    assert "height[0]," in (tmp_path / "found.csv").read_text()
    with pytest.raises(StoreError, match=r"exists already: replace it with force=True"):
        result.save(path)
    result.save(path, force=True)
    with pytest.raises(StoreError, match="has no scene"):
        reconstructed(record, 0.0)


@pytest.mark.parametrize(
    ("observables", "message"),
    [
        ({"area": height}, "observables = 'area', expected names of your own"),
        ({"my height": height}, "observables = 'my height', expected names of your own"),
        (
            {"nodes": lambda row: row.x},
            r"an array of shape \(1, 32, 2\), expected .* one number, or an array with one for each of 1",
        ),
    ],
)
def test_an_observable_that_cannot_be_used_is_refused(observables, message):
    scene = jaxves.make_scene(jaxves.ellipse(N, 0.9))
    with pytest.raises(ValueError, match=message) as caught:
        jaxves.simulate(scene, 2e-3, saves=2, march=MARCH, observables=observables)
    assert "\n" not in str(caught.value)


def test_a_run_writes_observables_to_its_file_and_is_resumed_only_with_them(tmp_path):
    path = tmp_path / "run.h5"
    tables = {"t_end": 2e-3, "saves": 2, "vesicle": [{"reduced_area": 0.9}], "numerics": {"nodes": N, "certify": False}}
    with pytest.raises(ValueError, match="observables = 'area', expected names of your own"):
        jaxves.run(tables, path, observables={"area": height})
    assert not path.exists()
    own = {"height": height, "energy": energy_at_end}
    assert jaxves.run(tables, path, observables=own) == "complete"
    longer = tables | {"t_end": 4e-3, "saves": 4}
    for others, named in ((None, "none"), ({"height": height}, "height")):
        with pytest.raises(StoreError, match=f"observables = {named}, expected .*: energy, height."):
            jaxves.run(longer, path, resume=True, observables=others)
    assert jaxves.run(longer, path, resume=True, observables=own) == "complete"
    record = jaxves.load(path)
    np.testing.assert_allclose(record.diagnostics["height"], np.ptp(record.x[..., 1], axis=-1), rtol=1e-14)
    np.testing.assert_allclose(record.diagnostics["energy"], record.t * record.diagnostics["bending_energy"][:, 0])
    assert len(record.t) == 5 and record.diagnostics["energy"].shape == (5,)
