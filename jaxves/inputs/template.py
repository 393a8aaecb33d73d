"""The commented scene file that `jaxves init` writes.

A line `{field.beta}` below is replaced by the key of this physical number, with its example and its meaning.
"""

import re

from ..base.physical_numbers import PER_VESICLE, declared

_COMMENT = 29  # column in which comments begin

_TEXT = """\
# A scene for `jaxves run`. Lengths are in a = perimeter / 2π, times in t_κ = μa³/κ_B, angles in degrees.
# A field, flow or pair whose table is missing is absent. A `#` before a key shows its default or an example.

t_end = 1.0
saves = 200                  # number of saved times besides t = 0, equally spaced
# average = [0.5, 1.0]       # window of the time averages

[[vesicle]]                  # one or more
shape = "ellipse"            # or "circle", or "points" with file = "shape.csv" for an outline; then also
                             # modes (number of Fourier modes for noisy points) and flip_y = true (y points down)
{vesicle.reduced_area}
{vesicle.angle}
center = [0.0, 0.0]
{vesicle.length}
{vesicle.bending}
relaxed = false              # true: relax to equilibrium before the run, without field or flow
# {vesicle.disturbance}
## [vesicle.disturbance]     # instead of the number: random thermal undulations
## {vesicle.disturbance.temperature}
## {vesicle.disturbance.tension}
## seed = 1                 # of the random numbers
## modes = 24                # the highest mode
# {own}: optional; default: those of [field]
# viscosity_ratio: optional; default: that of [fluid]

# [pair]                     # two copies of the one vesicle
# {pair.separation}
# {pair.offset_angle}

# [fluid]                    # without it both viscosities are equal
# {fluid.viscosity_ratio}

[field]                      # electric
{field.beta}
{field.conductivity_ratio}
{field.membrane_conductance}
{field.chi}
{field.permittivity_ratio}
# {field.charge_relaxation}
direction = [0.0, 1.0]

# [field.time]               # a factor on the field: constant, pulse, sine, ac or table
# kind = "pulse"             # with linear flanks; or "sine" or "ac" (a cosine) with the keys after ## instead;
                             # with "ac" also averaged = true: the force is averaged over the period
# {field.time.start}
# {field.time.duration}
# {field.time.rise}
## {field.time.frequency}
## {field.time.amplitude}
## {field.time.offset}
## {field.time.phase}

# [flow]
# kind = "shear"             # v = Ca (y, 0); "extension": Ca (x, -y); "linear" with gradient = [[0, 1], [0, 0]];
                             # "poiseuille": Ca (1 - (y/half_width)², 0). [flow.time] has the keys of [field.time]
# {flow.capillary_number}
## {flow.half_width}

## [cell]                    # doubly periodic; with a flow it must be a shear, which carries the lattice along
## lattice = [[8.0, 0.0], [0.0, 8.0]]  # the two vectors, the second to the left of the first

## [suspension]              # instead of [pair]: copies of the vesicles in a [cell], without overlap
## area_fraction = 0.3       # or count = 6
## seed = 1
## arrangement = "random"    # or "lattice"
## size_spread = 0.0         # standard deviation of the length, relative
## reduced_area_spread = 0.0 # standard deviation of the reduced area

# [stop]                     # ends the run early,
# steady = 1e-6              # if no shape changes faster than this,
# class = "POP"              # or if all vesicles are in this class (P, O or POP)

[numerics]
# nodes = "auto"             # per vesicle; "auto": adapted during the run, from 64 to 2048; sweeps and fits have 64
tolerance = 1e-4             # bounds the error of each time step
# time_step = 1e-3           # fixed step, instead of a tolerance
method = "auto"              # "ark4", or "ark5" for a tight tolerance; or one of these; or "euler" with a time_step
# solver = "auto"            # solver for several vesicles: "dense", "matrix-free", or "auto" (by size)
# neighbours = 8             # matrix-free only: room for close neighbours, per vesicle on average
# certify = true             # second run with other nodes and steps, to estimate the error of the whole run
"""


def _line(found: re.Match) -> str:
    """The line for one number: key and example, then letter, meaning and note."""
    number = declared(found[2])
    example = number.default if number.example is None else number.example
    start = f"{found[1]}{number.key} = {example!r}"
    return f"{start:{_COMMENT}}# {number.description()}{f'; {number.note}' if number.note else ''}"


TEMPLATE = re.sub(r"^(#* ?)\{(\w+\.[\w.]+)\}$", _line, _TEXT, flags=re.MULTILINE).replace(
    "{own}", ", ".join(number.key for number in PER_VESICLE)
)
