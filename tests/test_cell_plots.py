"""Pictures of suspensions: the rectangle of a cell shows every vesicle once, in whichever image it is."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from shapely.geometry import Polygon, box

from jaxves.plots import suspension, suspension_film
from jaxves.plots.cell_plots import images_in_view, view_of

N = 40
ANGLE = 2 * np.pi * np.arange(N) / N
ELLIPSE = np.stack([1.2 * np.cos(ANGLE), 0.7 * np.sin(ANGLE)], axis=-1)


@pytest.mark.parametrize("lean", [0.0, 2.4, -3.1])
def test_the_picture_has_the_area_of_all_vesicles(lean):
    lattice = np.array([[7.0, 0.0], [lean, 6.0]])
    centers = np.random.default_rng(1).uniform(-40, 40, (5, 2))
    x = ELLIPSE + centers[:, None]
    view = view_of(lattice)
    nodes, vesicle = images_in_view(x, lattice, view)
    shown = box(view[0], view[2], view[1], view[3])
    areas = np.bincount(vesicle, [Polygon(image).intersection(shown).area for image in nodes], 5)
    np.testing.assert_allclose(areas, Polygon(ELLIPSE).area, rtol=1e-10)


def test_a_cell_that_is_turned_is_shown_whole():
    lattice = np.array([[3.0, 1.0], [-1.0, 3.0]])
    np.testing.assert_array_equal(view_of(lattice), [-1.0, 3.0, 0.0, 4.0])


def test_a_picture_and_a_film_are_made(tmp_path):
    lattice = np.array([[7.0, 0.0], [1.0, 6.0]])
    x = ELLIPSE + np.array([[[1.0, 1.0]], [[4.0, 3.0]]])
    figure = suspension(x, lattice, [0.5, -1.0], label="value")
    (drawn,) = figure.axes[0].collections
    assert set(drawn.get_array()) == {0.5, -1.0}
    axes = Figure().subplots()
    assert suspension(x, lattice, ax=axes) is axes.get_figure()
    leaning = np.stack([lattice, [lattice[0], [1.5, 6.0]]])
    suspension_film([0.0, 0.1], np.stack([x, x + 0.1]), leaning, tmp_path / "film.gif", [[0.0, 1.0], [1.0, 2.0]])
    assert (tmp_path / "film.gif").stat().st_size > 1000
    with pytest.raises(ValueError, match=r"as \.gif, \.html or \.mp4, not as 'film.avi'"):
        suspension_film([0.0], x[None], lattice, tmp_path / "film.avi")
    with pytest.raises(ValueError, match=r"t = .*, expected one time for each of 1 rows"):
        suspension_film([0.0, 1.0], x[None], lattice, tmp_path / "film.gif")
