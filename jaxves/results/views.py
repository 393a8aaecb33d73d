"""What results have in common, whether they come from `simulate` or from a file: a card, figures, tables, files.

The figures are drawn by `jaxves.plots`, which is asked for by its public name only when it is needed.
"""

import base64
import html
import io
import os
from pathlib import Path
from typing import Any

import numpy as np

import jaxves

from ..observables import certificate
from ..observables.certificate import Link
from . import exports, labelled

_CARD = ("deformation", "inclination", "max_V_m", "min_gap", "effective_viscosity")
_STYLE = "text-align:left;font-family:sans-serif;font-size:13px"


class Viewed:
    """The methods of a result of one run. Outside compiled code only.

    The class that has it gives `word`, the arrays `t` (T,), `x` (T, M, N, 2), `V_m`, `tension`, and `diagnostics` by
    name. Rows after an early end may be NaN.
    """

    word: Any
    t: Any
    x: Any
    V_m: Any
    tension: Any
    diagnostics: Any

    @property
    def saved(self) -> int:
        """The number of saved times that were reached."""
        return int(np.sum(~np.isnan(np.asarray(self.t))))

    @property
    def certificate(self) -> dict[str, Link]:
        """The error estimates by name, each the largest over the saved times.

        The error of the whole run is among them only for the file of a run that made a second one to estimate it.
        """
        attributes = getattr(self, "attributes", {})
        found = {name: np.asarray(value)[: self.saved] for name, value in self.diagnostics.items()}
        return certificate.certificate(found, attributes.get("error"))

    @property
    def digits(self) -> float:
        """The number of correct digits by the weakest link of the certificate."""
        links = self.certificate
        return links[certificate.weakest(links)].digits

    def summary(self) -> str:
        """Returns one line: how the run ended, its size, and how accurate it is."""
        T, (M, N) = self.saved, np.shape(self.x)[1:3]
        size = f"{M} vesicle{'s' * (M > 1)} with {N} nodes, {T} saved time{'s' * (T > 1)}"
        if T < 2:
            return f"{self.word} at the start; {size}"
        links = self.certificate
        weak = certificate.weakest(links)
        accuracy = f"about {max(links[weak].digits, 0):.1f} correct digits, limited by {links[weak].long_name}"
        return f"{self.word} at t = {float(self.t[T - 1]):.6g}; {size}; {accuracy}"

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.summary()}>"

    def _repr_html_(self) -> str:
        """Returns the card that a notebook shows: the summary, some diagnostics, and the shapes."""
        names = [name for name in _CARD if name in self.diagnostics]
        rows = [_row(name, np.asarray(self.diagnostics[name])[: self.saved]) for name in names]
        head = "<tr><th>diagnostic</th><th>first</th><th>last</th><th>least</th><th>greatest</th></tr>"
        table = f'<table style="{_STYLE}">{head}{"".join(rows)}</table>'
        return card(type(self).__name__, self.summary(), table, self.plot())

    def plot(self, what: str = "snapshots", **how: Any) -> Any:
        """Draws a figure and returns it.

        Args:
            what: "snapshots", "history", "streamlines" or "field-lines".
            how: the options of the function of that name in `jaxves.plots`; `t` is the time of lines. `ax` is an axes
                of matplotlib, or several, to draw into.
        """
        return jaxves.plots.draw(self, what, **how)

    def animate(self, **how: Any) -> Any:
        """Returns a film that a notebook plays; `.save(path)` writes it. `how` is as in `jaxves.plots.film`."""
        return jaxves.plots.film(self, **how)

    def to_xarray(self) -> Any:
        """Returns an `xarray.Dataset` of all arrays, with units, and times, vesicles and nodes as coordinates."""
        return labelled.dataset_of_run(self)

    def to_csv(self, path: str | os.PathLike) -> None:
        """Writes the diagnostics as a table with one row for each saved time."""
        exports.run_to_csv(self, Path(path))

    def to_vtk(self, path: str | os.PathLike) -> None:
        """Writes the membranes for ParaView: PATH.pvd, and one .vtu file for each saved time beside it."""
        exports.run_to_vtk(self, Path(path))


def _row(name: str, values: np.ndarray) -> str:
    columns = values.reshape(len(values), -1)[:, :2].T
    cells = [(c[0], c[-1], np.nanmin(c), np.nanmax(c)) for c in columns if len(c) and not np.all(np.isnan(c))]
    labels = [name] if len(columns) == 1 else [f"{name}[{m}]" for m in range(len(columns))]
    return "".join(
        f"<tr><td>{html.escape(label)}</td>{''.join(f'<td>{value:.4g}</td>' for value in row)}</tr>"
        for label, row in zip(labels, cells, strict=False)
    )


def card(name: str, summary: str, table: str, figure: Any) -> str:
    """Returns the HTML of a card: a line, a table in HTML, and a figure."""
    line = f"<b>{name}</b>: {html.escape(summary)}"
    return f'<div style="{_STYLE}">{line}{table}{_picture(figure)}</div>'


def _picture(figure: Any) -> str:
    """Returns a figure as an image within HTML."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=100)
    return f'<img src="data:image/png;base64,{base64.b64encode(drawn.getvalue()).decode()}"/>'
