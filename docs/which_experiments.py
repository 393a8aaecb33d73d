"""Prints the table of which-experiments.md: laboratory vesicles, their numbers, and the limits that they exceed.

    python docs/which_experiments.py

If a number changes, replace the table of the page by this output.
"""

from collections.abc import Iterator

from jaxves.physics.regime import limits, regime
from jaxves.physics.units import LabQuantities

# a in m, E in V/m, σ_i and σ_e in S/m, reduced area: typical values, not those of one publication.
VESICLES = {
    "giant, weak field": (10e-6, 8e3, 0.5e-3, 1e-3, 0.97),
    "giant, moderate field": (20e-6, 2e4, 2.5e-3, 5e-3, 0.9),
    "giant and deflated, clean water": (10e-6, 3.8e4, 1e-5, 1e-4, 0.9),
    "giant, usual pulse": (10e-6, 1e5, 1e-3, 10e-3, 0.9),
    "giant, strong pulse, salt inside": (10e-6, 1.5e5, 20e-3, 1e-3, 0.98),
    "giant, strong pulse, salt outside": (15e-6, 2e5, 0.6e-3, 12e-3, 0.98),
    "1 µm in nearly pure water": (1e-6, 6.7e4, 1e-6, 1e-5, 0.9),
    "large unilamellar (LUV), 50 nm": (50e-9, 6.7e6, 0.5e-3, 5e-3, 0.9),
}
_HEADINGS = ("vesicle", "a (µm)", "E (kV/cm)", "Λ", "β", "χ", "B = β/χ", "Re", "1.5 E a (V)", "k*", "nodes", "passes")


def rows() -> Iterator[tuple[str, ...]]:
    """The cells of the table, below the headings."""
    for name, (a, E, sigma_i, sigma_e, reduced_area) in VESICLES.items():
        physical = LabQuantities(
            a=a, E=E, sigma_i=sigma_i, sigma_e=sigma_e, epsilon=7.1e-10, C_m=1e-2, kappa_B=1e-19, mu=1e-3
        )
        numbers, found = physical.numbers(), regime(physical, reduced_area)
        values = (1e6 * a, 1e-5 * E, numbers.conductivity_ratio, numbers.beta, numbers.chi, numbers.beta / numbers.chi)
        passed = [sentence.split(":")[0].lower() for sentence in limits(found)]
        estimates = (found.reynolds, found.voltage, found.wrinkles)
        cells = [f"{float(value):.2g}" for value in (*values, *estimates)]
        yield (name, *cells, str(found.nodes), ", ".join(passed) or "nothing")


def table() -> str:
    """The table in Markdown."""
    lines = [_HEADINGS, ("---",) * len(_HEADINGS), *rows()]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    print(table())
