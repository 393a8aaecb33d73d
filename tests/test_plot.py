"""Figures: made without a display, with the artists, labels and scales they promise."""

import sys
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Annotation

from jaxves import plots
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.observables.angles import only_jumps, turns
from jaxves.observables.fields import fields_at
from jaxves.physics.scene import dc_field, make_scene
from jaxves.plots import films, moments, run_plots

T, N = 7, 32
DEFORMATION = "deformation $D$\n$> 0$: long in $y$"
FIELD = "[field]\ndirection = [0.0, 1.0]\n"
SHEAR = '[flow]\nkind = "shear"\ncapillary_number = 10.0\n'


@pytest.fixture(autouse=True)
def _no_pyplot(monkeypatch):
    """No figure needs pyplot, with its display and its global state: importing it is an error here."""
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)


def record(M=1, text=FIELD, electric=True):
    """M breathing ellipses, charged more and more."""
    t = np.linspace(0.0, 0.6, T)
    theta = 2 * np.pi * np.arange(N) / N
    x = np.stack([(1 + t)[:, None] * np.cos(theta), (1 - 0.5 * t)[:, None] * np.sin(theta)], axis=-1)
    x = x[:, None] + 3.0 * np.arange(M)[:, None, None]
    V_m = (t[:, None, None] + 0.1) * np.broadcast_to(np.sin(theta), (T, M, N))
    tension = 2.0 + np.broadcast_to(np.cos(2 * theta), (T, M, N))
    each = np.linspace(0, 1, T)[:, None] * np.ones(M)
    diagnostics = {"deformation": each, "inclination": each, "stress": np.ones((T, 2, 2))}
    V_m = V_m if electric else None
    return SimpleNamespace(t=t, x=x, V_m=V_m, tension=tension, diagnostics=diagnostics, scene=text)


def curves(ax):
    return [artist for artist in ax.collections if isinstance(artist, LineCollection)]


def segments_of(lines):
    """Two-point pieces (K, 2, 2) of polylines."""
    pairs = [np.stack([line[:-1], line[1:]], axis=1) for line in lines.get_segments() if len(line) > 1]
    return np.concatenate(pairs)


def labels(figure):
    figure.draw_without_rendering()
    return [text.get_text() for text in figure.findobj(Annotation)]


def test_a_membrane_is_closed_and_passes_through_its_nodes():
    ax = Figure().add_subplot()
    x = record(2).x[3]
    segments = np.array(run_plots.membranes(ax, x).get_segments())
    assert len(segments) == 2 * 512
    for m in range(2):
        own = segments[512 * m : 512 * (m + 1)]
        np.testing.assert_allclose(own[:, 1], np.roll(own[:, 0], -1, axis=0))
        np.testing.assert_allclose(own[:: 512 // N, 0], x[m], atol=1e-12)
    assert ax.get_aspect() == 1


def test_a_membrane_is_coloured_by_the_values_at_its_nodes():
    ax = Figure().add_subplot()
    V_m = record().V_m[-1]
    drawn = run_plots.membranes(ax, record().x[-1], V_m)
    # The value of a segment lies half of 1/512 of the way past the node: an error of π/512 times the slope.
    np.testing.assert_allclose(drawn.get_array()[:: 512 // N], V_m[0], atol=1.1 * np.pi / 512 * np.abs(V_m).max())
    assert drawn.get_clim()[0] == -drawn.get_clim()[1]
    drawn.update_scalarmappable()
    assert len(np.unique(drawn.get_edgecolor(), axis=0)) > 100
    # dark where V_m vanishes, so that no part of a membrane fades into the page
    assert max(drawn.cmap(0.5)[:3]) < 0.2


def test_values_of_one_sign_are_scaled_from_least_to_greatest():
    assert run_plots.scale(np.array([2.0, 5.0, np.nan])).get_clim() == (2.0, 5.0)
    assert run_plots.scale(np.array([-2.0, 5.0])).get_clim() == (-5.0, 5.0)


def test_snapshots_share_window_and_colours():
    figure = run_plots.snapshots(record(2), times=[0.0, 0.29, 0.6])
    panels = [ax for ax in figure.axes if ax.get_title()]
    assert [ax.get_title() for ax in panels] == [rf"$t = {t}\,t_\kappa$" for t in ("0", "0.3", "0.6")]
    assert len({(*ax.get_xlim(), *ax.get_ylim()) for ax in panels}) == 1
    assert len({curves(ax)[0].get_clim() for ax in panels}) == 1
    assert sum("V_m" in ax.get_ylabel() for ax in figure.axes) == 1


def flipping(rest=0.5):
    """At rest until `rest`, then an ellipse that becomes a circle and an ellipse across, within a fifth of the time."""
    t = np.linspace(0.0, 1.0, 201)
    r = np.exp(0.3 * np.cos(np.pi * np.clip((t - rest) / 0.2, 0, 1)))
    theta = 2 * np.pi * np.arange(N) / N
    x = np.stack([np.cos(theta) / r[:, None], np.sin(theta) * r[:, None]], axis=-1)[:, None]
    angle = np.where(r > 1, np.pi / 2, np.pi)[:, None]  # as followed in time, through the circle
    diagnostics = {"deformation": np.tanh(np.log(r))[:, None], "inclination_unwrapped": angle}
    return SimpleNamespace(t=t, x=x, V_m=None, tension=np.ones((201, 1, N)) + theta, diagnostics=diagnostics, scene="")


def test_snapshots_show_the_instants_at_which_the_shape_changes():
    """The circle in the middle of a fast change, which no equally spaced times meet; the ends in any case."""
    fast = flipping()
    rows = moments.instants(fast.t, fast.x, 5)
    assert (rows[0], rows[-1]) == (0, 200)
    assert abs(fast.diagnostics["deformation"][rows[2], 0]) < 0.05
    assert fast.diagnostics["deformation"][rows[1], 0] > 0.1 > -0.1 > fast.diagnostics["deformation"][rows[3], 0]
    panels = [ax.get_title() for ax in run_plots.snapshots(fast).axes if ax.get_title()]
    assert len(panels) == 5


def test_snapshots_are_spread_along_the_length_of_a_shape_and_not_crowded_in_time():
    """Second moments grow with the square of the length, so they alone would crowd the instants where it is long."""
    t = np.linspace(0.0, 1.0, 401)
    theta = 2 * np.pi * np.arange(N) / N

    def gaps(logarithm):
        r = np.exp(logarithm)[:, None]
        x = np.stack([np.cos(theta) / r, np.sin(theta) * r], axis=-1)[:, None]
        return np.diff(t[moments.instants(t, x, 5)])

    assert len(gaps(t)) == 4 and gaps(t).max() < 0.35
    assert gaps(t**4).min() > 0.05


def test_snapshots_explain_the_dot_and_name_the_status_of_a_run_that_ended_early():
    broken = record()
    broken.word = "unresolved"
    figure = run_plots.snapshots(broken, times=[0.0, 0.6])
    assert "material points" in figure.get_supxlabel()
    titles = [ax.get_title() for ax in figure.axes if ax.get_title()]
    assert titles[-1].startswith("unresolved\n") and "unresolved" not in titles[0]
    broken.word = "complete"
    assert "\n" not in "".join(ax.get_title() for ax in run_plots.snapshots(broken).axes)


def test_the_sketch_of_a_flow_that_changes_says_when_it_is_drawn():
    scene = make_scene(shapes.circle(N), flow=lambda x, t: jnp.sin(jnp.pi * t) * x[::-1] * jnp.array([1.0, -1.0]))
    changing, steady = record(electric=False), record(electric=False)
    changing.scene = scene
    assert "$\\mathbf{v}_\\infty$\nat $t = 0.525\\,t_\\kappa$" in labels(run_plots.snapshots(changing))
    steady.scene = make_scene(shapes.circle(N), flow=lambda x, t: x[::-1] * jnp.array([1.0, -1.0]))
    assert "$\\mathbf{v}_\\infty$" in labels(run_plots.snapshots(steady))
    text = SHEAR + "[flow.time]\nkind = 'cosine'\nangular_frequency = 1.0\n"
    assert "$\\mathbf{v}_\\infty$$(t)$" in labels(run_plots.snapshots(record(text=text)))


def test_snapshots_of_what_hardly_changes_are_spread_evenly_in_time():
    treading = record()
    treading.x[:] = treading.x[0]
    assert moments.instants(treading.t, treading.x, 4).tolist() == [0, 2, 4, 6]


def test_snapshots_leave_out_what_broke_down():
    broken = flipping()
    broken.x[150:] = np.nan
    assert moments.instants(broken.t, broken.x, 5).tolist()[-1] == 149
    broken.x[:] = np.nan
    assert moments.instants(broken.t, broken.x, 5).tolist() == [0]


def test_snapshots_follow_two_vesicles_that_move_apart_without_changing_shape():
    t = np.linspace(0, 1, 11)
    x = np.repeat(record(2).x[:1], 11, axis=0)
    x[:, 1] += 3 * np.minimum(t, 0.5)[:, None, None]
    assert moments.instants(t, x, 3).tolist() in ([0, 2, 10], [0, 3, 10])


def test_a_history_shows_the_inclination_in_degrees_and_only_where_there_is_one():
    """A jump by a right angle through a circle is no motion: no panel by default, a gap when asked for."""
    jumping = flipping()
    assert [ax.get_ylabel() for ax in run_plots.history(jumping).axes] == [DEFORMATION]
    asked = run_plots.history(jumping, ["inclination_unwrapped"]).axes[0]
    drawn = asked.lines[0].get_ydata()
    assert asked.get_ylabel() == r"$\theta$ (degrees)"
    assert set(drawn[np.isfinite(drawn)]) == {90.0, 180.0} and np.isnan(drawn[120])

    # Where no saved shape is round, the line is broken between the two directions and has all points.
    coarse = SimpleNamespace(t=jumping.t[20::40], x=jumping.x[20::40], diagnostics={})
    coarse.diagnostics["inclination_unwrapped"] = jumping.diagnostics["inclination_unwrapped"][20::40]
    (line,) = run_plots.history(coarse, "inclination_unwrapped").axes[0].lines
    t, drawn = line.get_data()
    assert np.isnan(drawn).sum() == 1 and line.get_marker() == "None"
    np.testing.assert_array_equal(t[np.isfinite(t)], coarse.t)
    angle = np.degrees(coarse.diagnostics["inclination_unwrapped"])
    assert turns(angle) is False and only_jumps(angle) is True

    turning = flipping(rest=2.0)
    turning.diagnostics["inclination_unwrapped"] = np.linspace(0, 1.5 * np.pi, 201)[:, None]
    angle = run_plots.history(turning).axes[1].lines[0].get_ydata()
    np.testing.assert_allclose(angle, np.linspace(0, 270, 201))


def test_a_point_between_two_jumps_of_the_angle_is_a_dot():
    ellipse = record(1)
    ellipse.x[..., 1] *= 0.5
    angle = np.resize([23.0, -32.0], len(ellipse.t))
    ellipse.diagnostics["inclination"] = np.radians(angle)[:, None]
    (line,) = run_plots.history(ellipse, "inclination").axes[0].lines
    np.testing.assert_allclose(line.get_ydata()[line.get_markevery()], angle)
    assert line.get_marker() == "o"


def test_snapshots_show_the_imposed_field_and_flow_that_are_there():
    assert r"$\mathbf{E}_\infty$" in labels(run_plots.snapshots(record()))
    both = labels(run_plots.snapshots(record(text=FIELD + SHEAR)))
    assert {r"$\mathbf{E}_\infty$", r"$\mathbf{v}_\infty$"} <= set(both)
    neither = record(text="", electric=False)
    assert labels(run_plots.snapshots(neither)) == ["$a$"]
    del neither.scene
    assert labels(run_plots.snapshots(neither)) == ["$a$"]


def test_no_labels_of_snapshots_overlap():
    figure = run_plots.snapshots(record(2, FIELD + SHEAR), count=T)
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer() if hasattr(figure.canvas, "get_renderer") else figure._get_renderer()
    words = [ax.title for ax in figure.axes if ax.get_title()] + [
        text for text in figure.findobj(Annotation) if text.get_text()
    ]
    boxes = [text.get_window_extent(renderer) for text in words]
    assert len(boxes) == T + 3
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_the_color_must_be_one_that_the_record_has():
    bare = record(electric=False, text=SHEAR)
    assert any("lambda" in ax.get_ylabel() for ax in run_plots.snapshots(bare).axes)
    with pytest.raises(ValueError, match="'tension'"):
        run_plots.snapshots(bare, color="V_m")
    with pytest.raises(ValueError, match="'V_m' or 'tension'"):
        run_plots.snapshots(record(), color="charge")


def test_an_uncharged_and_a_broken_off_run_are_drawn_too():
    uncharged = record()
    uncharged.V_m[:] = 0
    uncharged.x[-1] = np.nan
    run_plots.snapshots(uncharged).draw_without_rendering()


def test_a_history_has_one_line_per_vesicle_and_component():
    figure = run_plots.history(record(2), ["deformation", "stress"])
    first, second = figure.axes
    assert [line.get_label() for line in first.lines] == ["1 ", "2 "]
    assert [line.get_label() for line in second.lines] == ["xx", "xy", "yx", "yy"]
    assert second.get_ylabel() == r"stress ($\kappa_B/a^3$)"
    assert second.get_xlabel() == r"$t/t_\kappa$"
    assert first.get_legend() is not None
    assert run_plots.history(record(1), ["deformation"]).axes[0].get_legend() is None


def test_a_history_by_default_shows_what_is_there():
    assert [ax.get_ylabel() for ax in run_plots.history(record()).axes] == [DEFORMATION]
    with pytest.raises(ValueError, match="deformation, inclination, stress"):
        run_plots.history(record(), ["min_gap"])


@pytest.fixture(scope="module")
def charged():
    x = shapes.circle(N)
    equation = equation_for(make_scene(x, field=dc_field(3.0, conductivity_ratio=0.1)))
    return equation, Unknowns.of(x[None], 0.5 * x[None, :, 1])


def test_field_lines_reach_the_membrane_from_both_sides(charged):
    equation, y = charged
    figure = plots.field_lines(equation, 0.1, y, resolution=60)
    lines, membrane = curves(figure.axes[0])
    radius = np.hypot(*segments_of(lines).reshape(-1, 2).T)
    assert ((radius < 0.8).sum() > 100) and ((radius > 1.2).sum() > 100)
    for side in (radius - 1, 1 - radius):
        assert (side[side > 0] < 0.03).sum() > 10
    np.testing.assert_allclose(membrane.get_clim(), (-0.5, 0.5), rtol=1e-3)


def test_stream_lines_follow_the_fluid_and_show_the_tension():
    x = shapes.ellipse(N, 0.9, angle=0.4)  # a circle would hold still, and all velocities be round-off
    equation = equation_for(make_scene(x, field=dc_field(3.0, conductivity_ratio=0.1)))
    y = Unknowns.of(x[None], 0.5 * x[None, :, 1])
    figure = plots.streamlines(equation, 0.1, y, resolution=60, window=(-2, 2, -2, 2))
    ax = figure.axes[0]
    assert ax.get_xlim() == (-2, 2) and ax.get_ylim() == (-2, 2)
    assert any("lambda" in other.get_ylabel() for other in figure.axes)
    segments = segments_of(curves(ax)[0])
    segments = segments[np.hypot(*(segments[:, 1] - segments[:, 0]).T) > 1e-3]
    step = segments[:, 1] - segments[:, 0]
    middle = jnp.asarray(segments.mean(axis=1))
    velocity = np.asarray(jax.jit(lambda: fields_at(equation, 0.1, y, middle).velocity)())
    cosine = np.sum(step * velocity, axis=1) / np.hypot(*step.T) / np.hypot(*velocity.T)
    assert np.nanmedian(cosine) > 0.999


def test_field_lines_need_a_field():
    x = shapes.circle(N)
    with pytest.raises(ValueError, match="field"):
        plots.field_lines(equation_for(make_scene(x)), 0.0, Unknowns.of(x[None]))


def test_a_film_has_the_frames_asked_for(tmp_path):
    from PIL import Image

    films.animation(record(), tmp_path / "film.gif", frames=4)
    with Image.open(tmp_path / "film.gif") as film:
        assert film.n_frames == 4


def test_a_film_that_cannot_be_written_is_refused(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"\.gif, \.html or \.mp4"):
        films.animation(record(), tmp_path / "film.avi")
    monkeypatch.setattr(films.FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(RuntimeError, match="ffmpeg"):
        films.animation(record(), tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())
