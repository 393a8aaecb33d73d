"""The commented scene file that `jaxves init` writes."""

TEMPLATE = """\
# A scene for `jaxves run`. Lengths are in a = perimeter / 2π, times in t_κ = μa³/κ_B, angles in degrees.
# A missing table means that the thing is absent; a `#` before a key shows its default or an example.

t_end = 1.0
saves = 200                  # equally spaced, besides t = 0
# average = [0.5, 1.0]       # window of the time averages

[[vesicle]]                  # one or more
shape = "ellipse"            # or "circle", or "points" with file = "shape.csv", an outline, for which there are
                             # modes (Fourier modes kept of noisy points) and flip_y = true (y points down)
reduced_area = 0.9           # Δ = 4π area / perimeter², in (0, 1]
angle = 90.0                 # of the major axis, from x
center = [0.0, 0.0]
length = 1.0                 # perimeter / 2π
bending = 1.0                # κ_B relative to the reference
relaxed = false              # true: let it relax to equilibrium first, without field or flow
# disturbance = 1e-6         # of the shape, in a: ends its symmetry, which is kept else; shows what is unstable
# conductivity_ratio, membrane_conductance, chi, permittivity_ratio: its own, else those of [field]

# [pair]                     # two copies of the one vesicle
# separation = 2.6           # of the centres
# offset_angle = 20.0        # of the line of centres, from x

[field]                      # electric
beta = 3.2                   # strength
conductivity_ratio = 0.1     # Λ, inside over outside; inf for a perfect conductor inside
membrane_conductance = 0.0   # G
chi = 0.08                   # charging time / t_κ
permittivity_ratio = 1.0     # inside over outside
direction = [0.0, 1.0]

# [field.time]               # a factor on the field: constant, pulse, sine or table
# kind = "pulse"             # from `start`, for `duration`, with flanks of `rise`
# start = 0.1
# duration = 0.5
# rise = 1e-3

# [flow]
# kind = "shear"             # v = Ca (y, 0); "extension": Ca (x, -y); "linear" with gradient = [[0, 1], [0, 0]]
# capillary_number = 10.0

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
