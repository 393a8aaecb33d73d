"""`nodes = "auto"`: what the monitor sees, and a run that takes more and fewer nodes on its way."""

import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
from conftest import Stops, star, stored

from jaxves.base import resolution
from jaxves.equation.projection import Filter
from jaxves.inputs.scene_files import parse
from jaxves.numerics import fourier
from jaxves.observables.rows import Row
from jaxves.results import run_store
from jaxves.runs import adapt_nodes, runner


def pop(nodes):
    text = "t_end = 0.8\nsaves = 16\n[[vesicle]]\nreduced_area = 0.9\nangle = 90.0\n"
    text += "[field]\nbeta = 3.2\nconductivity_ratio = 0.1\n"
    return parse(tomllib.loads(text + f"[numerics]\ntolerance = 1e-4\nnodes = {nodes}\n"))


def row(N, **changed):
    """One saved instant of a star whose tension and potential are smooth."""
    x = np.asarray(star(N))[None, None]
    found = {"length": np.array([[7.0]]), "self_gap": np.array([[np.inf]])}
    return Row(np.zeros(1), x, x[..., 0], found, x[..., 1])._replace(**changed)


def test_the_monitor_is_the_spectral_tail_of_a_resampled_curve():
    x = star(96)
    for N in (32, 48, 96):
        cut = Filter.for_nodes(N).x
        tail = fourier.spectral_tail(fourier.resample(x, N, axis=0), cut)
        np.testing.assert_allclose(adapt_nodes._tail(np.asarray(x)[None], N, cut), tail, rtol=1e-6, atol=1e-15)


def test_the_monitor_asks_for_what_shape_potential_or_tension_lack():
    k = 22
    ripple = 1e-3 * np.cos(k * np.asarray(fourier.grid(64)))
    smooth = row(64)
    assert adapt_nodes.demand(smooth, 64) < 1e-12
    for name, factor in (("V_m", 1.0), ("tension", 1e-3)):
        rough = row(64, **{name: getattr(smooth, name) + ripple})
        assert 1e-4 < adapt_nodes.demand(rough, 48) / factor < 1e-2  # the mode is among the last of 48 nodes,
        assert adapt_nodes.demand(rough, 64) < 1e-12  # and far from the last of 64
    assert adapt_nodes.necks_hold(smooth, 32)
    assert not adapt_nodes.necks_hold(row(64, diagnostics=smooth.diagnostics | {"self_gap": np.array([[0.3]])}), 64)


def test_a_small_potential_is_resolved_relative_to_what_matters():
    """A rough potential below 0.01 a E_inf, as of a conducting membrane, hardly moves it: it needs no further nodes."""
    alpha, cut = np.asarray(fourier.grid(64)), Filter.for_nodes(64).surface
    rough = np.cos(alpha) + 0.1 * np.cos((32 - cut) * alpha)
    for size, expected in ((10.0, 0.1), (0.01, 0.1), (1e-5, 1e-4), (0.0, 0.0)):
        tail = fourier.spectral_tail(jnp.asarray(size * rough), cut, resolution.SMALL_POTENTIAL)
        assert float(tail) == pytest.approx(expected, rel=1e-6)
        wanted = adapt_nodes.demand(row(64, V_m=(size * rough)[None, None]), 64)
        assert wanted == pytest.approx(expected, rel=1e-6, abs=1e-12)


@pytest.mark.slow
def test_a_run_takes_the_nodes_that_it_needs(tmp_path, monkeypatch):
    """Squaring wants 64, on the way back too; between 48 do. Same answer as with 64, and the same bits when resumed."""
    monkeypatch.setattr(resolution, "AUTO_NODES", (48, 64))
    monkeypatch.setattr(resolution, "USUAL_NODES", 64)
    auto, fixed, parts = (tmp_path / name for name in ("auto.h5", "fixed.h5", "parts.h5"))
    said = []
    assert runner.run(pop('"auto"'), auto, progress=lambda t, t_end, text: said.append(text)) == "complete"
    assert said.count("compiling with 48 nodes") == 1 and "compiling with 64 nodes" not in said  # 64 are compiled first
    found = run_store.read_result(auto)
    assert found.x.shape == (17, 1, 64, 2)
    used = found.nodes[:, 0]
    assert set(used) == {48, 64} and used[0] == 64
    assert np.any(np.diff(used) > 0)  # and more again, when it came back
    assert found.diagnostics["metric_error"].max() < 1e-4
    assert runner.run(pop(64), fixed) == "complete"
    right = run_store.read_result(fixed)
    # Changing nodes may cost what goes to space, a hundredth of the tolerance. What one Newton step of the projection
    # leaves of the longest steps is more than that, and the same in both.
    for name in ("area", "length"):
        drifts = [run.diagnostics[name] / run.diagnostics[name][0] - 1 for run in (found, right)]
        assert np.max(np.abs(drifts[0] - drifts[1])) < 1e-6
    assert np.max(np.abs(found.x - right.x)) < 1e-4 and np.max(np.abs(found.V_m - right.V_m)) < 1e-3
    assert runner.run(pop('"auto"'), parts, progress=Stops(9)) == "interrupted"
    assert runner.run(pop('"auto"'), parts, resume=True) == "complete"
    assert stored(parts) == stored(auto)
