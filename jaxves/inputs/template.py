"""The commented scene file that `jaxves init` writes.

A line `{field.beta}` below stands for the key of that physical number, with its example and its meaning.
"""

import re

from ..base.physical_numbers import PER_VESICLE, declared

_COMMENT = 29  # column in which comments begin

_TEXT = """\
# A scene for `jaxves run`. Lengths are in a = perimeter / 2π, times in t_κ = μa³/κ_B, angles in degrees.
# A missing table means that the thing is absent; a `#` before a key shows its default or an example.

t_end = 1.0
saves = 200                  # equally spaced, besides t = 0
# average = [0.5, 1.0]       # window of the time averages

[[vesicle]]                  # one or more
shape = "ellipse"            # or "circle", or "points" with file = "shape.csv", an outline, for which there are
                             # modes (Fourier modes kept of noisy points) and flip_y = true (y points down)
{vesicle.reduced_area}
{vesicle.angle}
center = [0.0, 0.0]
{vesicle.length}
{vesicle.bending}
relaxed = false              # true: let it relax to equilibrium first, without field or flow
# {vesicle.disturbance}
# {own}: its own, else those of [field]

# [pair]                     # two copies of the one vesicle
# {pair.separation}
# {pair.offset_angle}

[field]                      # electric
{field.beta}
{field.conductivity_ratio}
{field.membrane_conductance}
{field.chi}
{field.permittivity_ratio}
direction = [0.0, 1.0]

# [field.time]               # a factor on the field: constant, pulse, sine or table
# kind = "pulse"             # linear flanks; or "sine", which has the keys behind ## instead
# {field.time.start}
# {field.time.duration}
# {field.time.rise}
## {field.time.frequency}
## {field.time.amplitude}
## {field.time.offset}
## {field.time.phase}

# [flow]
# kind = "shear"             # v = Ca (y, 0); "extension": Ca (x, -y); "linear" with gradient = [[0, 1], [0, 0]]
# {flow.capillary_number}

# [stop]                     # end early,
# steady = 1e-6              # when nothing moves faster,
# class = "POP"              # or when the history of all vesicles has become P, O or POP

[numerics]
nodes = 64                   # of each vesicle; "auto": the fewest of 64 … 256 that resolve the starting curves
tolerance = 1e-4             # of the error in time
# time_step = 1e-3           # a fixed step instead
method = "auto"              # "ark4" or, for a tight tolerance, "ark5"; or one of these, or "euler" with a time_step
# solver = "auto"            # of what couples vesicles: "dense", "matrix-free", or by size
# neighbours = 8             # room for near pairs where no matrices are kept, per vesicle
# certify = true             # run once more with other nodes and steps, to estimate the error of the whole run
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
