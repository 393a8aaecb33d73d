"""What results offer in Python: a line, a card, figures, films, tables, and files for other programs."""

import csv
import re
import xml.etree.ElementTree as ET

import jax
import jax.numpy as jnp
import meshio
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxves
from jaxves.cli.commands import answer
from jaxves.results.sweep_store import SweepRecord


@pytest.fixture(scope="module")
def result():
    field = jaxves.dc_field(beta=3.2, conductivity_ratio=0.1)
    scene = jaxves.make_scene(jaxves.ellipse(32, 0.95, angle=jnp.pi / 2), field=field, flow=jaxves.Shear(1.0))
    return jaxves.simulate(scene, 0.02, saves=3)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    tables = {
        "t_end": 0.02,
        "saves": 3,
        "vesicle": [{"reduced_area": 0.95, "angle": 90.0}],
        "field": {"beta": 3.2, "conductivity_ratio": 0.1},
        "numerics": {"nodes": 32, "certify": False},
    }
    path = tmp_path_factory.mktemp("views") / "run.h5"
    jaxves.run(tables, path)
    return path


@pytest.fixture
def record(file):
    return jaxves.load(file)


@pytest.fixture(params=["result", "record"])
def viewed(request):
    return request.getfixturevalue(request.param)


def grid():
    """Two axes, three values each; one case has failed."""
    status = np.full((3, 3), "complete", dtype="U20")
    status[2, 1] = "unresolved"
    values = np.arange(9.0).reshape(3, 3, 1)
    return SweepRecord(
        dims=("field.beta", "field.chi"),
        coordinates={n: ((n,), np.array([1.0, 2.0, 3.0])) for n in ("field.beta", "field.chi")},
        status=status,
        classes=np.array([["P", "P", "O"]] * 3),
        passes=np.ones((3, 3), int),
        reasons=np.full((3, 3), "", dtype=object),
        data={"deformation_final": values, "steps": values[..., 0]},
        labels={"deformation_final": ("1", "deformation"), "steps": ("1", "steps")},
        attributes={},
    )


def test_a_result_says_in_one_line_how_it_ended_and_how_accurate_it_is(viewed):
    line = repr(viewed)
    assert "\n" not in line and len(line) < 220
    assert re.match(
        r"<(Result|Record): \w+ at t = 0.02; 1 vesicle with 32 nodes, 4 saved times; about \d+\.\d cor", line
    )


def test_a_traced_or_batched_result_is_shown_as_a_pytree(result):
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), result)
    assert "f64[2,4" in repr(batch)


def test_the_card_has_the_line_a_table_and_a_picture(viewed):
    card = viewed._repr_html_()
    assert viewed.summary() in card and "<td>deformation</td>" in card
    assert len(re.findall(r'src="data:image/png;base64,[\w+/=]{1000,}"', card)) == 1


def test_the_scene_is_kept_in_the_result_and_costs_the_compiled_program_nothing(result):
    assert float(result.scene.field.beta) == 3.2
    again = jaxves.simulate(result.scene, 0.02, saves=3)
    np.testing.assert_array_equal(again.x, result.x)
    assert [ax.get_title() for ax in result.plot().axes].count("") == 2  # a sketch of field and flow, a colour bar


def test_figures_are_drawn_into_axes_of_the_caller(viewed):
    axes = Figure().subplots(1, 2)
    assert viewed.plot("history", names=["deformation", "max_V_m"], ax=axes) is axes[0].figure
    assert all(len(ax.lines) == 1 for ax in axes)
    three = Figure().subplots(1, 3)
    viewed.plot(times=[0.0, 0.01, 0.02], ax=three)
    assert all(len(ax.collections) == 1 for ax in three)
    one = Figure().add_subplot()
    viewed.plot("field-lines", t=0.013, resolution=20, ax=one)
    assert "0.0133" in one.get_title()
    with pytest.raises(ValueError, match="ax must have 1 axes"):
        viewed.plot("history", names="deformation", ax=axes)


def test_an_unknown_figure_is_refused_with_those_that_exist(viewed):
    with pytest.raises(ValueError, match="what = map, expected one of snapshots, history, streamlines, field-lines"):
        viewed.plot("map")


def test_a_film_is_a_player_and_can_be_saved(viewed, tmp_path):
    film = viewed.animate(frames=2)
    assert "<script" in film._repr_html_()
    film.save(tmp_path / "film.gif")
    assert (tmp_path / "film.gif").read_bytes()[:4] == b"GIF8"


def test_a_result_is_a_labelled_dataset(viewed):
    found = viewed.to_xarray()
    assert found["x"].dims == ("t", "vesicle", "node", "xy") and found["deformation"].attrs["units"] == "1"
    np.testing.assert_array_equal(found["deformation"].sel(vesicle=0), viewed.diagnostics["deformation"][:, 0])
    np.testing.assert_allclose(found["t"], [0, 0.02 / 3, 0.04 / 3, 0.02])


def test_diagnostics_are_a_table(viewed, tmp_path):
    viewed.to_csv(tmp_path / "table.csv")
    rows = list(csv.DictReader((tmp_path / "table.csv").read_text().splitlines()))
    assert [float(row["deformation[0]"]) for row in rows] == list(np.asarray(viewed.diagnostics["deformation"])[:, 0])
    assert "max_V_m[0] (E_inf a)" in rows[0]


def test_shapes_are_files_for_paraview(viewed, tmp_path):
    viewed.to_vtk(tmp_path / "shapes.pvd")
    listed = ET.parse(tmp_path / "shapes.pvd").getroot().iter("DataSet")
    times, files = zip(*((float(one.get("timestep")), one.get("file")) for one in listed), strict=True)
    np.testing.assert_allclose(times, np.asarray(viewed.t), rtol=1e-11)
    last = meshio.read(tmp_path / files[-1])
    np.testing.assert_allclose(last.points[:, :2], np.asarray(viewed.x)[-1, 0])
    np.testing.assert_allclose(last.point_data["V_m"], np.asarray(viewed.V_m)[-1, 0])
    assert len(last.cells[0].data) == 32 and set(last.cells[0].data.ravel()) == set(range(32))


def test_a_sweep_has_a_line_a_figure_a_dataset_and_a_table(tmp_path):
    record = grid()
    assert repr(record) == "<SweepRecord: 3 × 3 cases of field.beta, field.chi: 8 complete, 1 unresolved>"
    ax = Figure().add_subplot()
    assert record.plot("map", name="steps", ax=ax) is ax.figure
    assert "<img" in record._repr_html_()
    found = record.to_xarray()
    assert found["deformation_final"].dims == ("field.beta", "field.chi", "vesicle")
    assert str(found["status"].sel({"field.beta": 3.0, "field.chi": 2.0}).item()) == "unresolved"
    record.to_csv(tmp_path / "cases.csv")
    row = list(csv.DictReader((tmp_path / "cases.csv").read_text().splitlines()))[7]
    assert row["field.beta"] == "3.0" and row["field.chi"] == "2.0" and row["status"] == "unresolved"
    assert row["deformation_final[0]"] == "7.0"


def test_the_command_exports_what_it_can_and_refuses_the_rest(file, tmp_path, capsys):
    assert answer(["export", str(file), "--out", str(tmp_path / "a.csv")]) == 0
    assert (tmp_path / "a.csv").read_text().startswith("t (t_kappa),")
    assert answer(["export", str(file), "--out", str(tmp_path / "a.csv")]) == 2
    assert answer(["export", str(file), "--out", str(tmp_path / "a.vtk")]) == 2
    assert "expected a name that ends in .csv or .pvd" in capsys.readouterr().err
