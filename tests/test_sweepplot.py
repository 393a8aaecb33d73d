"""Pictures and summaries of sweeps, made of records that no simulation is needed for."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PathCollection, QuadMesh

from jaxves.cli.sweep_summary import summary
from jaxves.plots.sweep_plots import axis_label, curves, phase_diagram, quantity_map
from jaxves.results.sweep_store import SweepRecord

BETA, CONDUCTANCE, AREA = "field.beta", "field.membrane_conductance", "vesicle.reduced_area"


def record(*names, sizes=(5, 4), sample=False, **changed):
    """Class P where β < 3, else O; the deformation is β."""
    axes = {name: np.linspace(1.0, 5.0, n) for name, n in zip(names, sizes, strict=False)}
    if sample:
        coordinates = {name: (("case",), values) for name, values in axes.items()}
        shape, dims = (sizes[0],), ("case",)
        beta = axes[BETA]
    else:
        coordinates = {name: ((name,), values) for name, values in axes.items()}
        shape, dims = tuple(map(len, axes.values())), tuple(names)
        beta = np.meshgrid(*axes.values(), indexing="ij")[names.index(BETA)]
    found = {
        "dims": dims,
        "coordinates": coordinates,
        "status": np.full(shape, "complete", "<U16"),
        "classes": np.where(beta < 3, "P", "O").astype("<U16"),
        "passes": np.ones(shape, int),
        "reasons": np.full(shape, "", object),
        "data": {"deformation_final": beta[..., None], "steps": np.full(shape, 9)},
        "labels": {},
        "attributes": {"status": "complete", "wall_time": 1.0, "nodes": 64},
    }
    return SweepRecord(**(found | changed))


def codes_shown(ax):
    (mesh,) = [item for item in ax.collections if isinstance(item, QuadMesh)]
    return np.asarray(mesh.get_array()).reshape(4, 5).T


def test_a_phase_diagram_shows_each_class_and_the_line_between_them():
    ax = phase_diagram(record(BETA, CONDUCTANCE)).axes[0]
    np.testing.assert_array_equal(codes_shown(ax)[:, 0], [0, 0, 1, 1, 1])
    lines = [path.vertices for item in ax.collections if not isinstance(item, QuadMesh) for path in item.get_paths()]
    assert lines and all(np.allclose(line[:, 0], 2.5) for line in lines)
    assert (ax.get_xlabel(), ax.get_ylabel()) == (axis_label(BETA), axis_label(CONDUCTANCE))
    legend = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert legend == ["P", "O"] and not ax.texts


def hatched(ax):
    """The corners of all hatched cells."""
    return [path.vertices for item in ax.collections if item.get_hatch() for path in item.get_paths()]


def test_what_refinement_left_out_has_the_colour_of_its_surroundings_and_what_failed_is_hatched():
    base = record(BETA, CONDUCTANCE)
    status, classes = base.status.copy(), base.classes.copy()
    status[1, 1], classes[1, 1] = "skipped", ""
    status[4, 3], classes[4, 3] = "collision", ""
    ax = phase_diagram(record(BETA, CONDUCTANCE, status=status, classes=classes)).axes[0]
    expected = codes_shown(phase_diagram(base).axes[0]).astype(float)
    expected[4, 3] = np.nan
    np.testing.assert_array_equal(codes_shown(ax), expected)
    (cell,) = hatched(ax)
    assert cell.min(axis=0) == pytest.approx([4.5, 13 / 3]) and cell.max(axis=0) == pytest.approx([5.5, 17 / 3])
    assert [text.get_text() for text in ax.figure.legends[0].get_texts()] == ["P", "O", "no result"]


def test_a_case_that_is_still_changing_at_the_end_has_a_diamond():
    trend = np.zeros((5, 4, 1))
    trend[2, 1] = -0.02
    found = record(BETA, CONDUCTANCE, data={"deformation_trend": trend})
    figure = phase_diagram(found)
    (diamonds,) = [line for line in figure.axes[0].lines if line.get_marker() == "D"]
    np.testing.assert_allclose(diamonds.get_xydata(), [[3.0, 7 / 3]])
    assert "still changing" in [text.get_text() for text in figure.legends[0].get_texts()]
    assert (
        "1 of the complete cases is still changing at t_end (field.beta = 3, field.membrane_conductance = 2.33333):"
        in (told := " ".join(map(str, summary(found, Path("a")))))
    )
    assert "and its class may" in told
    found.status[2, 1] = "steady"
    assert not found.changing.any()
    trend[:4, 0] = -0.02
    told = " ".join(map(str, summary(found, Path("a"))))
    assert "4 of the complete cases are still" in told and "field.membrane_conductance = 1; and 1 more): in" in told


def test_an_axis_without_negative_values_does_not_run_below_zero():
    base = record(BETA, CONDUCTANCE)
    base.coordinates[BETA][1][:] = [0.0, 1.0, 2.0, 3.0, 4.0]
    base.coordinates[CONDUCTANCE][1][:] = [-1.0, 0.0, 1.0, 2.0]
    for figure in (phase_diagram(base), quantity_map(base, "deformation_final")):
        assert figure.axes[0].get_xlim() == (0.0, 4.5) and figure.axes[0].get_ylim() == (-1.5, 2.5)
    base.coordinates[BETA][1][:] = [0.01, 0.1, 1.0, 10.0, 100.0]
    ax = phase_diagram(base).axes[0]
    assert ax.get_xscale() == "log" and ax.get_xlim() == pytest.approx((10**-2.5, 10**2.5))


def test_a_grid_of_three_axes_has_a_panel_for_each_value_of_the_first():
    figure = phase_diagram(record(AREA, BETA, CONDUCTANCE, sizes=(3, 5, 4)))
    assert [ax.get_title() for ax in figure.axes] == [rf"$\Delta$ = {value:g}" for value in (1, 3, 5)]


def test_a_sample_is_drawn_as_points_at_its_numbers():
    ax = phase_diagram(record(BETA, CONDUCTANCE, sizes=(6, 6), sample=True)).axes[0]
    (points,) = [item for item in ax.collections if isinstance(item, PathCollection)]
    np.testing.assert_array_equal(points.get_offsets(), np.stack([np.linspace(1, 5, 6)] * 2, axis=1))


def test_a_map_shows_the_values_and_leaves_out_failed_cases():
    base = record(BETA, CONDUCTANCE)
    status = base.status.copy()
    status[0, 0] = "collision"
    figure = quantity_map(record(BETA, CONDUCTANCE, status=status), "deformation_final")
    shown, expected = codes_shown(figure.axes[0]), base.data["deformation_final"][..., 0].copy()
    expected[0, 0] = np.nan
    np.testing.assert_allclose(shown, expected)
    assert len(hatched(figure.axes[0])) == 1
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["no value"]


@pytest.mark.parametrize("names", [(BETA,), (BETA, CONDUCTANCE)])
def test_curves_have_the_longest_axis_below_and_one_line_for_each_value_of_the_other(names):
    ax = curves(record(*names)).axes[0]
    assert ax.get_xlabel() == axis_label(BETA) and len(ax.lines) == (1 if len(names) == 1 else 4)
    for line in ax.lines:
        np.testing.assert_allclose(line.get_ydata(), line.get_xdata())


@pytest.mark.parametrize(
    ("draw", "changed", "words"),
    [
        (phase_diagram, {"classes": None}, "needs classes"),
        (lambda r: quantity_map(r, "colour"), {}, r"colour is no quantity .* steps; or .* exists: deformation\.$"),
        (lambda r: quantity_map(r, "deformation"), {}, r"no quantity of this sweep: did you mean deformation_final\?$"),
        (lambda r: quantity_map(r, "deformation_final", (1, 2)), {}, "component"),
    ],
)
def test_what_cannot_be_drawn_is_refused(draw, changed, words):
    with pytest.raises(ValueError, match=words):
        draw(record(BETA, CONDUCTANCE, **changed))


def test_maps_need_two_axes_and_curves_a_grid():
    with pytest.raises(ValueError, match=r"only field\.beta"):
        quantity_map(record(BETA))
    with pytest.raises(ValueError, match="one or two axes"):
        curves(record(BETA, CONDUCTANCE, sizes=(6, 6), sample=True))


def test_a_summary_counts_and_names_what_failed_with_its_numbers_and_reason():
    base = record(BETA, CONDUCTANCE)
    status, reasons = base.status.copy(), base.reasons.copy()
    status[4, 3], reasons[4, 3] = "collision", "Two membranes have crossed."
    lines = [
        part for part in summary(record(BETA, CONDUCTANCE, status=status, reasons=reasons), Path("my.h5"))
        if isinstance(part, str)
    ]  # fmt: skip
    assert "my.h5: sweep complete" in lines[0] and "5 field.beta × 4 field.membrane_conductance" in lines[0]
    assert lines[1] == "cases: 19 complete, 1 collision"
    assert lines[3] == "field.beta = 5, field.membrane_conductance = 5: collision. Two membranes have crossed."
