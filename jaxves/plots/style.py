"""The style of figures: fonts, widths, colours, and axis labels.

Lengths are in a, times in t_κ, potentials in a|E_∞|, tensions in κ_B/a². Quantities that change sign have a symmetric
colour scale: blue below zero, dark at zero, orange above. A scale with a light centre would not be visible on paper.
Quantities of one sign have the colour map viridis.
"""

import re

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize

from ..observables.quantities import QUANTITIES

STYLE = {
    "font.size": 8,
    "axes.titlesize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "mathtext.fontset": "cm",
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "axes.prop_cycle": "cycler('color', ['0072B2', 'D55E00', '009E73', 'CC79A7', 'E69F00', '56B4E9'])",
    "figure.dpi": 200,
    "figure.constrained_layout.use": True,
}
COLUMN, PAGE = 3.4, 7.0  # widths in inches
INK = "0.15"
_SIGNED = LinearSegmentedColormap.from_list("blue_dark_orange", ["#35b1f0", "#1b6ca8", "#262626", "#b3560d", "#ffa62b"])
_UNSIGNED = ListedColormap(colormaps["viridis"](np.linspace(0, 0.9, 256)))  # its yellow end is too faint for a line
SYMBOLS = {
    "V_m": r"$V_m\ (E_\infty a)$",
    "tension": r"$\lambda\ (\kappa_B/a^2)$",
    "deformation": r"deformation $D$",
    "deformation_along_field": r"deformation $D_E$",
    "inclination": r"$\theta$",
    "inclination_unwrapped": r"$\theta$",
    "effective_viscosity": r"$[\mu]$",
    "max_V_m": r"$\max|V_m|$",
    "tension_min": r"$\min\lambda$",
    "tension_max": r"$\max\lambda$",
    "min_gap": r"$d_{\min}$",
}


def scale(values: np.ndarray) -> ScalarMappable:
    """Returns a colour scale for all finite `values`. It is symmetric about 0 if they change sign."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if low < 0 < high:
        low, high = min(low, -high), max(-low, high)
        return ScalarMappable(Normalize(low, high), _SIGNED)
    return ScalarMappable(Normalize(low, high), _UNSIGNED)


def time_label(t: float) -> str:
    """Returns the label t = … t_κ."""
    return rf"$t = {float(t):.3g}\,t_\kappa$"


def quantity_label(name: str) -> str:
    """Returns the symbol and unit of a diagnostic."""
    units = QUANTITIES[name].units if name in QUANTITIES else "1"
    for word, letter in (
        ("t_kappa", r"t_\\kappa"),
        ("kappa_B", r"\\kappa_B"),
        ("eps", r"\\varepsilon"),
        ("inf", r"\\infty"),
    ):
        units = re.sub(rf"\b{word}|(?<=_){word}", letter, units)
    symbol = SYMBOLS.get(name, name.replace("_", " "))
    return {"1": symbol, "rad": f"{symbol} (rad)"}.get(units, f"{symbol} (${units}$)")


def component_label(name: str, shape: tuple[int, ...], index: tuple[int, ...]) -> str:
    """Returns the label of one curve: vesicles are numbered from 1, components are x and y."""
    dims = QUANTITIES[name].dims[1:] if name in QUANTITIES else ("vesicle",) * len(index)
    return "".join(
        (f"{i + 1} " if dim == "vesicle" else "xy"[i])
        for dim, i, size in zip(dims, index, shape[1:], strict=True)
        if size > 1
    )
