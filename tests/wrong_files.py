"""Wrong scene files, sweep files and outlines, each with what its complaint must say, for `test_wrong_files`.

A scene is written as what it has beside a right vesicle and field, or as a whole text where it begins with `#`. An
outline is the text of a file that a scene reads.
"""

import math

VESICLE = "t_end = 1.0\n[[vesicle]]\nreduced_area = 0.9\n"
FIELD = "[field]\nbeta = 3.2\nconductivity_ratio = 0.1\n"
SWEEP = 'scene = "pop"\n[axes]\n'

# name: (text below a right vesicle, what the complaint says); of the vesicle first, then of other tables.
OF_VESICLE = {
    "a word for the angle": ('angle = "up"', r'vesicle\[0\].angle = "up"'),
    "an infinite angle": ("angle = inf", r"vesicle\[0\].angle = inf"),
    "a center of one number": ("center = 0.0", r"vesicle\[0\].center = 0.0"),
    "a center of three": ("center = [0.0, 0.0, 0.0]", r"vesicle\[0\].center"),
    "a center with a word": ('center = [0.0, "left"]', r"vesicle\[0\].center"),
    "a length of zero": ("length = 0.0", r"vesicle\[0\].length = 0.0"),
    "a negative length": ("length = -1", r"vesicle\[0\].length = -1"),
    "a negative bending": ("bending = -1.0", r"vesicle\[0\].bending = -1.0"),
    "bending that is NaN": ("bending = nan", r"vesicle\[0\].bending = nan"),
    "relaxed in words": ('relaxed = "yes"', r'vesicle\[0\].relaxed = "yes"'),
    "relaxed as one": ("relaxed = 1", r"vesicle\[0\].relaxed = 1"),
    "relaxed and disturbed": ("relaxed = true\ndisturbance = 1e-6", r"vesicle\[0\].disturbance = 1e-06"),
    "a shape that is none": ('shape = "square"', r'vesicle\[0\].shape = "square"'),
    "a shape that is a number": ("shape = 3", r"vesicle\[0\].shape = 3"),
    "a misspelt key": ("anlge = 3.0", r"vesicle\[0\].anlge = 3.0.*angle"),
    "an unknown key": ("colour = 3.0", r"vesicle\[0\].colour"),
    "conductivity without a field": ("conductivity_ratio = 0.1", r"vesicle\[0\].conductivity_ratio = 0.1.*\[field\]"),
    "a viscosity ratio of zero": ("viscosity_ratio = 0", r"vesicle\[0\].viscosity_ratio = 0"),
    "chi without a field": ("chi = 0.1", r"vesicle\[0\].chi = 0.1.*\[field\]"),
    "a circle with an area": ('shape = "circle"', r"vesicle\[0\].reduced_area"),
    "points without any": ('shape = "points"', r"vesicle\[0\]"),
    "a disturbance in words": ('disturbance = "small"', r"vesicle\[0\].disturbance"),
    "an infinite disturbance": ("disturbance = inf", r"vesicle\[0\].disturbance = inf"),
    "a conductivity ratio below zero": ("conductivity_ratio = -1\n" + FIELD, r"vesicle\[0\].conductivity_ratio = -1"),
    "chi of zero": ("chi = 0.0\n" + FIELD, r"vesicle\[0\].chi = 0.0"),
    "a permittivity of zero": ("permittivity_ratio = 0\n" + FIELD, r"vesicle\[0\].permittivity_ratio = 0"),
    "a conductance that is NaN": ("membrane_conductance = nan\n" + FIELD, r"vesicle\[0\].membrane_conductance = nan"),
}
OF_SCENE = {
    "a field of no strength": ("[field]\nconductivity_ratio = 0.1", "field.beta is missing"),
    "a field without a ratio": ("[field]\nbeta = 3.2", "field.conductivity_ratio is missing"),
    "a negative field": ("[field]\nbeta = -3.2\nconductivity_ratio = 0.1", "field.beta = -3.2"),
    "an infinite field": ("[field]\nbeta = inf\nconductivity_ratio = 0.1", "field.beta = inf"),
    "a field in words": ('[field]\nbeta = "strong"\nconductivity_ratio = 0.1', 'field.beta = "strong"'),
    "a field that is true": ("[field]\nbeta = true\nconductivity_ratio = 0.1", "field.beta = true"),
    "a ratio that is NaN": ("[field]\nbeta = 3.2\nconductivity_ratio = nan", "field.conductivity_ratio = nan"),
    "a negative conductance": (FIELD + "membrane_conductance = -1.0", "field.membrane_conductance = -1.0"),
    "a charging time of zero": (FIELD + "chi = 0.0", "field.chi = 0.0"),
    "a negative permittivity": (FIELD + "permittivity_ratio = -1.0", "field.permittivity_ratio = -1.0"),
    "no direction": (FIELD + "direction = [0.0, 0.0]", "field.direction"),
    "a direction of one": (FIELD + "direction = [1.0]", "field.direction"),
    "a direction in words": (FIELD + 'direction = "up"', 'field.direction = "up"'),
    "a misspelt field": (FIELD + "betta = 3.2", "field.betta = 3.2.*beta"),
    "two fields": (FIELD + FIELD, "expected a TOML file"),
    "a time of no kind": (FIELD + "[field.time]\nstart = 0.0", "field.time.kind"),
    "a time of another kind": (FIELD + '[field.time]\nkind = "ramp"', 'field.time.kind = "ramp"'),
    "a pulse without a start": (FIELD + '[field.time]\nkind = "pulse"\nduration = 1.0', "field.time.start is missing"),
    "a pulse that goes back": (
        FIELD + '[field.time]\nkind = "pulse"\nstart = 0.0\nduration = -1.0',
        "field.time.duration = -1.0",
    ),
    "a pulse without flanks": (
        FIELD + '[field.time]\nkind = "pulse"\nstart = 0.0\nduration = 1.0\nrise = 0.0',
        "field.time.rise = 0.0",
    ),
    "a sine without a frequency": (FIELD + '[field.time]\nkind = "sine"', "field.time.frequency is missing"),
    "a sine that stands": (FIELD + '[field.time]\nkind = "sine"\nfrequency = 0.0', "field.time.frequency = 0.0"),
    "a sine with a pulse's key": (
        FIELD + '[field.time]\nkind = "sine"\nfrequency = 1.0\nrise = 1.0',
        "field.time.rise = 1.0",
    ),
    "a table that goes back": (
        FIELD + '[field.time]\nkind = "table"\ntimes = [1.0, 0.0]\nvalues = [0.0, 1.0]',
        "field.time.times",
    ),
    "a table of one time": (FIELD + '[field.time]\nkind = "table"\ntimes = [1.0]\nvalues = [0.0]', "field.time.times"),
    "a table with a value too many": (
        FIELD + '[field.time]\nkind = "table"\ntimes = [0.0, 1.0]\nvalues = [0.0, 1.0, 2.0]',
        "field.time.values",
    ),
    "a table with a word": (
        FIELD + '[field.time]\nkind = "table"\ntimes = [0.0, 1.0]\nvalues = [0.0, "on"]',
        "field.time.values",
    ),
    "a flow of no kind": ("[flow]\ncapillary_number = 1.0", "flow.kind"),
    "a flow of another kind": ('[flow]\nkind = "vortex"', 'flow.kind = "vortex"'),
    "a shear without a strength": ('[flow]\nkind = "shear"', "flow.capillary_number is missing"),
    "a shear of zero": ('[flow]\nkind = "shear"\ncapillary_number = 0.0', "flow.capillary_number = 0.0"),
    "a shear that is NaN": ('[flow]\nkind = "shear"\ncapillary_number = nan', "flow.capillary_number = nan"),
    "a shear with a gradient": (
        '[flow]\nkind = "shear"\ncapillary_number = 1.0\ngradient = [[0, 1], [0, 0]]',
        "flow.gradient",
    ),
    "a flow with a source": ('[flow]\nkind = "linear"\ngradient = [[1.0, 0.0], [0.0, 1.0]]', "flow.gradient"),
    "a gradient of three": ('[flow]\nkind = "linear"\ngradient = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]', "flow.gradient"),
    "a cell of one vector": ("[cell]\nlattice = [[8.0, 0.0]]", "cell.lattice"),
    "a cell that is flat": ("[cell]\nlattice = [[8.0, 0.0], [4.0, 0.0]]", "cell.lattice.*expected two vectors"),
    "a cell the other way round": ("[cell]\nlattice = [[0.0, 8.0], [8.0, 0.0]]", "cell.lattice"),
    "a cell that is too small": ("[cell]\nlattice = [[2.0, 0.0], [0.0, 2.0]]", r"vesicle\[0\].length.*own image"),
    "an extension in a cell": (
        '[cell]\nlattice = [[8.0, 0.0], [0.0, 8.0]]\n[flow]\nkind = "extension"\ncapillary_number = 1.0',
        'flow.kind = "extension".*shear',
    ),
    "a shear of a turned cell": (
        '[cell]\nlattice = [[8.0, 1.0], [0.0, 8.0]]\n[flow]\nkind = "shear"\ncapillary_number = 1.0',
        "cell.lattice.*along x",
    ),
    "a field that is averaged in a cell": (
        "[cell]\nlattice = [[8.0, 0.0], [0.0, 8.0]]\n"
        + FIELD
        + '[field.time]\nkind = "ac"\nfrequency = 9.0\naveraged = true',
        "field.time.averaged = true",
    ),
    "matrices of pairs in a cell": (
        '[cell]\nlattice = [[8.0, 0.0], [0.0, 8.0]]\n[numerics]\nsolver = "dense"',
        'numerics.solver = "dense"',
    ),
    "a pair that overlaps": ("[pair]\nseparation = 1.0", "pair.separation = 1.0.*overlap"),
    "a pair in one place": ("[pair]\nseparation = 0.0", "pair.separation = 0.0"),
    "a pair without a distance": ("[pair]\noffset_angle = 3.0", "pair.separation is missing"),
    "a pair of two vesicles": (
        "[[vesicle]]\nreduced_area = 0.9\ncenter = [9.0, 0.0]\n[pair]\nseparation = 3.0",
        "pair.*exactly one",
    ),
    "two vesicles in one place": ("[[vesicle]]\nreduced_area = 0.8", r"vesicle\[1\].center.*vesicle\[0\]"),
    "a vesicle inside of another": ("[[vesicle]]\nreduced_area = 0.8\nlength = 0.3", r"vesicle\[1\].center"),
    "a stop without a reason": ("[stop]", "stop.*steady, class"),
    "a stop at zero": ("[stop]\nsteady = 0.0", "stop.steady = 0.0"),
    "a class without a field": ('[stop]\nclass = "POP"', 'stop.class = "POP".*field'),
    "an unknown class": (FIELD + '[stop]\nclass = "square"', 'stop.class = "square"'),
    "nodes in words": ('[numerics]\nnodes = "many"', 'numerics.nodes = "many"'),
    "an odd number of nodes": ("[numerics]\nnodes = 65", "numerics.nodes = 65"),
    "few nodes": ("[numerics]\nnodes = 8", "numerics.nodes = 8"),
    "nodes with a point": ("[numerics]\nnodes = 64.0", "numerics.nodes = 64.0"),
    "negative nodes": ("[numerics]\nnodes = -64", "numerics.nodes = -64"),
    "a tolerance of zero": ("[numerics]\ntolerance = 0.0", "numerics.tolerance = 0.0"),
    "a tolerance of one": ("[numerics]\ntolerance = 1.0", "numerics.tolerance = 1.0"),
    "a tolerance out of reach": ("[numerics]\ntolerance = 1e-15", "numerics.tolerance = 1e-15"),
    "a step of zero": ("[numerics]\ntime_step = 0.0", "numerics.time_step = 0.0"),
    "a step and a tolerance": ("[numerics]\ntime_step = 0.1\ntolerance = 1e-4", "numerics.time_step = 0.1"),
    "the first-order scheme without a step": ('[numerics]\nmethod = "euler"', 'numerics.method = "euler"'),
    "an unknown scheme": ('[numerics]\nmethod = "rk4"', 'numerics.method = "rk4"'),
    "an unknown solver": ('[numerics]\nsolver = "fast"', 'numerics.solver = "fast"'),
    "no neighbours": ("[numerics]\nneighbours = 0", "numerics.neighbours = 0"),
    "certify in words": ('[numerics]\ncertify = "yes"', 'numerics.certify = "yes"'),
    "a table that is none": ("[electrodes]\nvoltage = 1.0", "electrodes"),
    "a key in the wrong table": (FIELD + "capillary_number = 1.0", "field.capillary_number"),
    "no time at all": ("#[[vesicle]]\nreduced_area = 0.9", "t_end is missing"),
    "an end before the start": ("#t_end = -1.0\n[[vesicle]]\nreduced_area = 0.9", "t_end = -1.0"),
    "an end that is NaN": ("#t_end = nan\n[[vesicle]]\nreduced_area = 0.9", "t_end = nan"),
    "an end in words": ('#t_end = "late"\n[[vesicle]]\nreduced_area = 0.9', 't_end = "late"'),
    "no saves": ("#t_end = 1.0\nsaves = 0\n[[vesicle]]\nreduced_area = 0.9", "saves = 0"),
    "half a save": ("#t_end = 1.0\nsaves = 0.5\n[[vesicle]]\nreduced_area = 0.9", "saves = 0.5"),
    "a window beyond the end": (
        "#t_end = 1.0\naverage = [0.5, 2.0]\n[[vesicle]]\nreduced_area = 0.9",
        "average = .*t_end = 1.0",
    ),
    "a window that goes back": ("#t_end = 1.0\naverage = [0.5, 0.2]\n[[vesicle]]\nreduced_area = 0.9", "average"),
    "no vesicle": ("#t_end = 1.0", "vesicle is missing"),
    "a vesicle that is one table": ("#t_end = 1.0\n[vesicle]\nreduced_area = 0.9", r"vesicle.*\[\[vesicle\]\]"),
    "no text": ("#", "t_end is missing"),
    "a number for an outline": ('#t_end = 1.0\n[[vesicle]]\nshape = "points"\nfile = 3', r"vesicle\[0\].file = 3"),
    "half a table": ("#t_end = 1.0\n[[vesicle]", "expected a TOML file"),
    "no value": ("#t_end =", "expected a TOML file"),
    "a comma for a point": ("#t_end = 1,5\n[[vesicle]]\nreduced_area = 0.9", "expected a TOML file"),
    "one key twice": ("#t_end = 1.0\nt_end = 2.0", "expected a TOML file"),
}
OF_SWEEP = {
    "a sweep without a scene": ('[axes]\n"field.beta" = [1.0]', "scene is missing"),
    "a scene that is none": ('scene = "popp"\n[axes]\n"field.beta" = [1.0]', "popp.*did you mean pop"),
    "a sweep without cases": ('scene = "pop"', "axes"),
    "a grid and a list": (
        SWEEP + '"field.beta" = [1.0]\n[[cases]]\n"field.beta" = 1.0', "axes.*not axes and cases",
    ),
    "a number that is none": (SWEEP + '"field.betta" = [1.0]', "field.betta"),
    "a number of an absent table": (SWEEP + '"flow.capillary_number" = [1.0]', "flow.capillary_number"),
    "an axis without values": (SWEEP + '"field.beta" = []', "field.beta"),
    "an axis of words": (SWEEP + '"field.beta" = ["weak"]', "field.beta"),
    "an axis of one number": (SWEEP + '"field.beta" = 1.0', "field.beta"),
    "a value out of its bounds": (SWEEP + '"field.beta" = [-1.0, 1.0]', "field.beta = -1.0"),
    "a span of one": (SWEEP + '"field.beta" = { start = 0.0, stop = 1.0, num = 1 }', "num = 1"),
    "a span that stays": (SWEEP + '"field.beta" = { start = 1.0, stop = 1.0, num = 3 }', "stop = 1.0"),
    "a span in ratios from zero": (
        SWEEP + '"field.beta" = { start = 0.0, stop = 1.0, num = 3, spacing = "log" }', "spacing",
    ),
    "a span with a step": (SWEEP + '"field.beta" = { start = 0.0, stop = 1.0, step = 0.1 }', "step"),
    "cases of other numbers": (
        'scene = "pop"\n[[cases]]\n"field.beta" = 1.0\n[[cases]]\n"field.chi" = 1.0', r"cases\[1\]",
    ),
    "a sample of no cases": ('scene = "pop"\n[sample]\nnum = 0\nranges = { "field.beta" = [1, 2] }', "sample.num = 0"),
    "a sequence of five": (
        'scene = "pop"\n[sample]\nnum = 5\nsequence = "sobol"\nranges = { "field.beta" = [1, 2] }', "sample.num = 5",
    ),
    "something to keep that is none": ('scene = "pop"\nkeep = ["films"]\n[axes]\n"field.beta" = [1.0]', "keep"),
    "no steps": ('scene = "pop"\nmax_steps = [0, 0]\n[axes]\n"field.beta" = [1.0]', "max_steps"),
    "refined without a grid": (
        'scene = "pop"\n[refine]\nlevels = 1\n[[cases]]\n"field.beta" = 1.0', "refine.*axes",
    ),
    "refined along nothing": (
        SWEEP + '"field.beta" = [1.0, 2.0]\n[refine]\nlevels = 1\nalong = ["field.chi"]', "refine.along",
    ),
    "refined nine times": (SWEEP + '"field.beta" = [1.0, 2.0]\n[refine]\nlevels = 9', "refine.levels = 9"),
    "a sweep with adaptive nodes": (
        'scene = { t_end = 1.0, vesicle = [{ reduced_area = 0.9 }], numerics = { nodes = "auto" } }\n'
        '[axes]\n"vesicle.reduced_area" = [0.8]', 'numerics.nodes = "auto"',
    ),
    "a sweep that certifies": (
        "scene = { t_end = 1.0, vesicle = [{ reduced_area = 0.9 }], numerics = { certify = true } }\n"
        '[axes]\n"vesicle.reduced_area" = [0.8]', "numerics.certify = true",
    ),
}  # fmt: skip


def ellipse(count=40, a=2.0, b=1.0) -> list[tuple[float, float]]:
    """Points of an ellipse, in order."""
    angles = [2 * math.pi * k / count for k in range(count)]
    return [(a * math.cos(t), b * math.sin(t)) for t in angles]


def lines(points, form="{:.6f},{:.6f}") -> str:
    """One line for each point."""
    return "\n".join(form.format(*point) for point in points) + "\n"


OUTLINES = {
    "an empty outline": ("", "file"),
    "an outline of seven points": (lines(ellipse(7)), "at least 8"),
    "an outline of words": (lines(ellipse()) + "the end\n", "41"),
    "an outline of one column": (lines(ellipse(), "{:.6f}"), "file"),
    "an outline that crosses itself": (
        lines([(math.sin(t), math.sin(2 * t)) for t in [2 * math.pi * (k + 0.3) / 40 for k in range(40)]]), "cross",
    ),
    "an outline with a point that is NaN": (lines(ellipse()) + "nan,1.0\n", "finite"),
}  # fmt: skip


SCENE_OF_OUTLINE = 't_end = 1.0\n[[vesicle]]\nshape = "points"\nfile = "outline.csv"\n'


def scene_text(name: str) -> str:
    """The whole text of a wrong scene."""
    text = OF_VESICLE[name][0] if name in OF_VESICLE else OF_SCENE[name][0]
    return text[1:] if text.startswith("#") else VESICLE + text + "\n"
