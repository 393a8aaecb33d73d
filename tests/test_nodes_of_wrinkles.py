"""`nodes = "auto"` under compression: enough nodes at the start, fewer when it relaxes, a rule at every step."""

import math
import tomllib
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base import resolution, status
from jaxves.equation import norms
from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.inputs.checking import SceneError
from jaxves.inputs.scene_files import parse
from jaxves.observables.rows import Row
from jaxves.physics.flow import Extension
from jaxves.physics.scene import make_scene
from jaxves.runs import adapt_nodes, first_nodes, problem
from jaxves.runs.case import Case


def across(flow="", vesicle=""):
    """A vesicle across a stretching flow, which compresses it."""
    text = f"t_end = 0.06\nsaves = 6\n[[vesicle]]\nreduced_area = 0.95\nangle = 90.0\n{vesicle}"
    text += f"[flow]\nkind = 'extension'\ncapillary_number = 12.0\n{flow}"
    return parse(tomllib.loads(text + "[numerics]\nnodes = 'auto'\ncertify = false\n"))


@pytest.fixture
def small_sizes(monkeypatch):
    """Numbers of nodes that compile and run quickly."""
    monkeypatch.setattr(resolution, "AUTO_NODES", (16, 32, 48, 96))
    monkeypatch.setattr(resolution, "USUAL_NODES", 32)


def test_the_numbers_of_nodes_reach_twice_the_usual_ones_only_where_they_are_asked_for():
    assert resolution.sizes_up_to(0) == (64, 96, 128, 192, 256)
    assert resolution.sizes_up_to(300)[-1] == 384
    assert resolution.sizes_up_to(1e9)[-1] == 2048
    assert resolution.nodes_for_modes(0) == 64
    for N in (96, 512):
        assert resolution.nodes_for_modes(resolution.kept_modes(N)) == N
    # the fastest of the waves k that grow at (|λ| - k²) k/4 has k² = |λ|/3
    assert resolution.nodes_for_waves(math.sqrt(1e4 / 3)) == pytest.approx(3 * math.sqrt(1e4))


def test_a_run_begins_with_the_nodes_that_its_tension_asks_for_and_may_use_twice_as_many(small_sizes):
    file = across()
    scene, found, state, row = first_nodes.first_row(Case(file), problem.starting_scene(file))
    wanted = 3 * np.sqrt(-row.diagnostics["tension_min"][0, 0])
    assert 32 < wanted < 48  # the curve alone takes 32
    assert scene.x.shape[1] == state.y.x.shape[1] == row.x.shape[2] == 48
    assert found.sizes == (16, 32, 48, 96)
    assert found.wanted(row) == pytest.approx(wanted, rel=1e-9)


def nodes_with(limit):
    """The numbers of nodes of a run with this limit of spectra, without its programs."""
    nodes = adapt_nodes.Resolution.__new__(adapt_nodes.Resolution)
    nodes.sizes, nodes.limit = resolution.sizes_up_to(96), limit
    nodes.first = SimpleNamespace(equation=SimpleNamespace(scene=SimpleNamespace(bending=np.ones(1))))
    return nodes


def row_of(asked, ripple=0.0):
    """A saved row on 48 nodes whose tension asks for so many, with a wave at the top of the spectrum of x."""
    x = np.asarray(shapes.ellipse(48, 0.99))[None, None]
    x = x + ripple * np.cos(20 * 2 * np.pi * np.arange(48) / 48)[:, None]
    found = {"length": np.full((1, 1), 2 * np.pi), "self_gap": np.full((1, 1), np.inf)}
    return Row(np.zeros(1), x, 0 * x[..., 0], found | {"tension_min": np.full((1, 1), -((asked / 3) ** 2))})


def test_nodes_follow_the_tension_up_and_down(small_sizes):
    """A smooth shape under a tension of -λ asks for 3 √λ nodes, and for a fifth more before it has fewer."""
    nodes = nodes_with(1e-5)
    assert nodes.wanted(row_of(40)) == pytest.approx(40)
    assert not nodes._wants_more(status.RUNNING, row_of(47), 48)
    assert nodes._wants_more(status.RUNNING, row_of(49), 48)
    assert nodes._is_enough(row_of(39), 48)
    assert not nodes._is_enough(row_of(41), 48)


def test_spectra_of_wrinkled_membranes_may_end_ten_times_higher(small_sizes):
    """A wave of 3e-5 at the top of the spectrum is too much for a smooth shape, not for wrinkles; 3e-4 always is."""
    nodes = nodes_with(1e-5)
    assert nodes._wants_more(status.RUNNING, row_of(12, 3e-5), 48)  # 16 nodes are the fewest here
    assert not nodes._wants_more(status.RUNNING, row_of(20, 3e-5), 48)
    assert nodes._wants_more(status.RUNNING, row_of(20, 3e-4), 48)


def test_a_flow_that_is_switched_on_later_finds_room_for_its_wrinkles(small_sizes):
    file = across("time = { kind = 'table', times = [0.01, 0.02], values = [0.0, 1.0] }\n")
    scene, found, state, row = first_nodes.first_row(Case(file), problem.starting_scene(file))
    assert scene.x.shape[1] == state.y.x.shape[1] == 32 and found.wanted(row) < 16
    assert found.sizes == (16, 32, 48, 96)


@eqx.filter_jit
def begun(equation):
    y = equation.start()
    return y, equation.freeze(jnp.zeros(()), y)


def test_the_rule_holds_at_every_step():
    equation = equation_for(make_scene(shapes.ellipse(32, 0.95, angle=jnp.pi / 2), flow=Extension(12.0)))
    y, frozen = begun(equation)
    assert int(norms.step_status(equation, frozen, y, norms.ROUGH)) == status.RUNNING
    for share, code in ((0.9, status.RUNNING), (1.1, status.UNRESOLVED)):
        least = float(jnp.min(frozen.motion.sigma + 1.5 * frozen.motion.surfaces.curves.curvature**2))
        per_wave = share * 32 / math.sqrt(-least / 3)
        assert int(norms.step_status(equation, frozen, y, norms.ROUGH, per_wave)) == code


def test_undulations_may_have_as_many_modes_as_the_largest_number_of_nodes_keeps(small_sizes):
    thermal = "disturbance = {{ temperature = 1e-3, modes = {} }}\n"
    start = problem.starting_scene(across(vesicle=thermal.format(12))).x
    assert resolution.kept_modes(start.shape[1]) >= 12
    with pytest.raises(SceneError, match="at most 42 modes for 96 nodes"):
        across(vesicle=thermal.format(43))
