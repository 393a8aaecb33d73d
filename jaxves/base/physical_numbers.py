"""The physical numbers of a scene, each declared once: bounds, default, symbol, unit and meaning.

All other parts of the package take these properties from here: the tables of scene files, the checks of `Field` and
`Scene`, the commented scene file, the table of `jaxves units`, gradient checks and the labels of plots. The page
`docs/adding-a-number.md` describes how a number is added. Vectors (`center`, `direction`, `gradient`) and tabulated
signals are not declared here. Nothing here imports JAX.
"""

import re
from dataclasses import dataclass

from . import bounds


@dataclass(frozen=True)
class Number:
    """One number of a scene file.

    Attributes:
        table: the table of the scene file, such as "field".
        key: its key in that table.
        bounds: the allowed values.
        meaning: its meaning, in a few words.
        letter: its letter in the literature, or "" if it has none.
        symbol: its symbol in plots: a letter in TeX, or a word.
        unit: "" for a pure number, "degrees", or a scale: "a" for lengths and "t_κ" or "1/t_κ" for times and rates.
        default: the value where the key is absent. None means that the key must be given, or that it may be absent.
        example: the value in the commented scene file; the default if None.
        note: a further comment in the commented scene file.
        in_laboratory_units: the formula from quantities in SI units, if the meaning does not give it.
        per_vesicle: the name of the array of `Field` or `Scene`, for a number of [field] or [fluid] that may differ
            between vesicles.
        size: the scale of the number in gradient checks, if its value is smaller.
    """

    table: str
    key: str
    bounds: bounds.Bounds
    meaning: str
    letter: str = ""
    symbol: str = ""
    unit: str = ""
    default: float | None = None
    example: float | None = None
    note: str = ""
    in_laboratory_units: str = ""
    per_vesicle: str | None = None
    size: float = 0.3

    @property
    def name(self) -> str:
        """The name of the number in sweeps, fits and sensitivities, such as "field.beta"."""
        return f"{self.table}.{self.key}"

    @property
    def lowest(self) -> float | None:
        """The least value that the bounds allow, at which only one-sided differences exist; None if there is none."""
        return self.bounds.ge

    def description(self) -> str:
        """Returns letter and meaning, such as "β, field strength"."""
        return f"{self.letter}, {self.meaning}" if self.letter else self.meaning

    def label(self) -> str:
        """Returns symbol and unit for the axis of a plot."""
        units = {"": "", "a": " ($a$)", "degrees": " (degrees)", "t_κ": r" ($t_\kappa$)", "1/t_κ": r" ($1/t_\kappa$)"}
        return self.symbol + units[self.unit]


ANGLE = Number(
    "vesicle", "angle", bounds.FINITE, "angle of the shape, for an ellipse of its major axis, from x",
    letter="θ", symbol=r"$\theta$", unit="degrees", default=0.0, example=90.0, size=10.0,
)  # fmt: skip
LENGTH = Number("vesicle", "length", bounds.POSITIVE, "perimeter / 2π", symbol="length", unit="a", default=1.0)
BENDING = Number(
    "vesicle", "bending", bounds.POSITIVE, "bending stiffness over that of the reference",
    letter="κ_B", symbol=r"$\kappa_B$", default=1.0,
)  # fmt: skip
DISTURBANCE = Number(
    "vesicle", "disturbance", bounds.FINITE, "disturbance of the shape",
    symbol="disturbance", unit="a", example=1e-6, note="breaks its symmetry; shows whether the motion is unstable",
)  # fmt: skip
TEMPERATURE = Number(
    "vesicle.disturbance", "temperature", bounds.POSITIVE, "thermal energy / bending stiffness",
    letter="θ", symbol=r"$k_B T/\kappa_B$", example=0.04, in_laboratory_units="k_B T/κ_B", size=0.01,
)  # fmt: skip
TENSION = Number(
    "vesicle.disturbance", "tension", bounds.NOT_NEGATIVE, "tension of the undulating membrane before the run",
    symbol="tension", default=0.0, example=100.0, size=1.0,
)  # fmt: skip
REDUCED_AREA = Number(
    "vesicle", "reduced_area", bounds.REDUCED_AREA, "reduced area 4π area / perimeter²",
    letter="Δ", symbol=r"$\Delta$", example=0.9, note="in (0, 1]",
)  # fmt: skip

VISCOSITY_RATIO = Number(
    "fluid", "viscosity_ratio", bounds.VISCOSITY_RATIO, "viscosity inside / outside",
    letter="ν", symbol=r"$\nu$", example=10.0, per_vesicle="viscosity_ratio", size=1.0,
)  # fmt: skip

SEPARATION = Number(
    "pair", "separation", bounds.POSITIVE, "distance of the centres", symbol="separation", unit="a", example=2.6
)
OFFSET_ANGLE = Number(
    "pair", "offset_angle", bounds.FINITE, "angle of the line of centres, from x",
    letter="θ_0", symbol=r"$\theta_0$", unit="degrees", default=0.0, example=20.0, size=10.0,
)  # fmt: skip

BETA = Number(
    "field", "beta", bounds.NOT_NEGATIVE, "field strength",
    letter="β", symbol=r"$\beta$", example=3.2, in_laboratory_units="ε E² a C_m/(μ σ_e)",
)  # fmt: skip
CONDUCTIVITY_RATIO = Number(
    "field", "conductivity_ratio", bounds.RATIO, "conductivity inside / outside",
    letter="Λ", symbol=r"$\Lambda$", example=0.1, note="inf for a perfect conductor inside",
    per_vesicle="conductivity_ratio",
)  # fmt: skip
MEMBRANE_CONDUCTANCE = Number(
    "field", "membrane_conductance", bounds.NOT_NEGATIVE, "membrane conductance",
    letter="G", symbol="$G$", default=0.0, in_laboratory_units="a G_m/σ_e", per_vesicle="membrane_conductance",
)  # fmt: skip
CHI = Number(
    "field", "chi", bounds.POSITIVE, "charging time / t_κ",
    letter="χ", symbol=r"$\chi$", default=0.08, in_laboratory_units="C_m κ_B/(σ_e μ a²)", per_vesicle="membrane_chi",
)  # fmt: skip
PERMITTIVITY_RATIO = Number(
    "field", "permittivity_ratio", bounds.POSITIVE, "permittivity inside / outside",
    letter="ε_i/ε_e", symbol=r"$\varepsilon_i/\varepsilon_e$", default=1.0, per_vesicle="permittivity_ratio",
)  # fmt: skip
CHARGE_RELAXATION = Number(
    "field", "charge_relaxation", bounds.POSITIVE, "charge relaxation time / charging time",
    letter="δ", symbol=r"$\delta$", example=0.007, note="without it, charge relaxes at once",
    in_laboratory_units="ε/(a C_m)", size=0.01,
)  # fmt: skip

START = Number("field.time", "start", bounds.FINITE, "start of the pulse", symbol="start", unit="t_κ", example=0.1)
DURATION = Number("field.time", "duration", bounds.POSITIVE, "its duration", symbol="duration", unit="t_κ", example=0.5)
RISE = Number("field.time", "rise", bounds.POSITIVE, "length of its flanks", symbol="rise", unit="t_κ", default=1e-3)
FREQUENCY = Number(
    "field.time", "frequency", bounds.POSITIVE, "frequency of the sine", symbol="frequency", unit="1/t_κ", example=10.0
)
AMPLITUDE = Number("field.time", "amplitude", bounds.FINITE, "its amplitude", symbol="amplitude", default=1.0)
OFFSET = Number("field.time", "offset", bounds.FINITE, "its mean", symbol="offset", default=0.0)
PHASE = Number(
    "field.time", "phase", bounds.FINITE, "its phase at t = 0", symbol="phase", unit="degrees", default=0.0, size=10.0
)

CAPILLARY_NUMBER = Number(
    "flow", "capillary_number", bounds.NONZERO, "shear rate · t_κ", letter="Ca", symbol=r"$\mathit{Ca}$", example=10.0
)

HALF_WIDTH = Number(
    "flow", "half_width", bounds.POSITIVE, "distance of the plates from the axis of Poiseuille flow",
    symbol="half width", unit="a", default=5.0,
)  # fmt: skip

NUMBERS = tuple(value for value in list(globals().values()) if isinstance(value, Number))
# Numbers of [field] that a vesicle may have of its own.
PER_VESICLE = tuple(number for number in NUMBERS if number.per_vesicle is not None and number.table == "field")


def declared(name: str) -> Number | None:
    """Returns the declaration of a number by its name, or None for an entry of a vector or of a list.

    A number of [field] or [fluid] that is given for a vesicle, such as "vesicle[1].chi", has the declaration of that
    table.
    """
    table, _, key = re.sub(r"^vesicle\[\d+\]", "vesicle", name).rpartition(".")
    table = "field.time" if table == "flow.time" else table  # both have the same keys
    for number in NUMBERS:
        if number.key == key and (number.table == table or (table == "vesicle" and number.per_vesicle is not None)):
            return number
    return None
