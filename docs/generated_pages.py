"""Writes the pages of the website that follow from the code: references, one page for each experiment.

    python docs/generated_pages.py     # writes docs/reference/*.md and docs/validation/experiments/*.md

`website.py` does this before every build. The repository keeps the references of files (scenes, sweeps, results), and
none of the other pages.
"""

import ast
import importlib
import re
import sys
import typing
from pathlib import Path

import typer
import typer.main

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT)] if str(ROOT) not in sys.path else []

import jaxves  # noqa: E402
from jaxves.base import physical_numbers  # noqa: E402
from jaxves.cli import commands  # noqa: E402
from jaxves.inputs import scene_tables, sweep_tables  # noqa: E402
from jaxves.inputs.checking import Expect, Table  # noqa: E402
from jaxves.inputs.template import TEMPLATE  # noqa: E402
from jaxves.observables.quantities import QUANTITIES  # noqa: E402
from jaxves.results.run_store import HISTORY  # noqa: E402

# The folders of the package from the lowest layer up, except the command line.
FOLDERS = (
    *("base", "numerics", "geometry", "inputs", "potentials", "physics", "operators", "equation", "observables"),
    *("results", "stepping", "runs", "analysis", "sweeps", "plots"),
)
_NOTE = "*This page is generated from the code.*\n"
# Keys whose meaning neither a declaration nor the commented scene file states.
_MEANINGS = {
    "t_end": "end of the run, in t_κ",
    "center": "position of the centroid, in a",
    "shape": "kind of the outline",
    "kind": "which of the kinds of this table",
    "file": "file of the outline, relative to the scene file",
    "points": "the outline itself, instead of a file",
    "modes": "number of Fourier modes that are kept",
    "flip_y": "true if y points down in the file, as in images",
    "relaxed": "relax to equilibrium before the run, without field or flow",
    "direction": "direction of the field; it is normalised",
    "times": "times of the table, in t_κ",
    "values": "the factor at these times",
    "gradient": "∂v_a/∂x_b, in 1/t_κ",
    "steady": "end the run when no shape changes faster than this",
    "class": "end the run when all vesicles are in this class",
    "time_step": "a fixed step, instead of a tolerance",
    "stop": "last value",
    "num": "number of values or cases",
    "spacing": "equal differences or equal ratios",
    "sequence": "the low-discrepancy sequence",
    "seed": "seed of the random numbers",
    "count": "number of vesicles",
    "area_fraction": "area of all vesicles over that of the cell",
    "arrangement": "how the vesicles are placed",
    "lattice": "the two vectors of the periodic cell, in a",
    "averaged": "average the alternating field over its period",
    "ranges": "least and greatest value of each number",
    "levels": "how many times cells are halved",
    "along": "the axes along which they are halved; all by default",
}


def cell(text: str) -> str:
    """Returns a text for the cell of a table."""
    return " ".join(str(text).split()).replace("|", "\\|")


def table(headings: typing.Sequence[str], rows: typing.Iterable[typing.Sequence[str]]) -> str:
    """Returns a table in Markdown."""
    lines = [headings, ["---"] * len(headings), *([cell(part) for part in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _inside(annotation: typing.Any) -> list[typing.Any]:
    """Returns an annotation and everything in it."""
    found = [annotation]
    for part in typing.get_args(annotation):
        found += _inside(part)
    return found


def tables_in(annotation: typing.Any) -> list[type[Table]]:
    """Returns the tables of a scene file that a key may hold."""
    parts = [part for part in _inside(annotation) if isinstance(part, type) and issubclass(part, Table)]
    return list(dict.fromkeys(parts))


def expected(field) -> str:
    """Returns what a key must be, in the words of the complaint about a wrong value."""
    for part in (*reversed(field.metadata), *_inside(field.annotation)):
        if isinstance(part, Expect):
            return part.text
        for metadata in getattr(part, "__metadata__", ()):
            if isinstance(metadata, Expect):
                return metadata.text
    literals = [repr(word) for part in _inside(field.annotation) if isinstance(part, str) for word in [part]]
    return " or ".join(literals).replace("'", '"')


def meaning(path: str, key: str) -> str:
    """Returns the meaning of a key: its declaration, else its comment in the commented scene file."""
    declared = physical_numbers.declared(f"{path}.{key}")
    if path == "axes" and key == "start":
        return "first value"
    if path == "vesicle.disturbance" and key == "modes":
        return "the highest mode of the undulations"
    if declared is not None:
        unit = f", in {declared.unit}" if declared.unit else ""
        return f"{declared.description()}{unit}"
    if key in _MEANINGS:
        return _MEANINGS[key]
    commented = re.search(rf"^#* ?{key} = [^#]*# ?(.*)$", TEMPLATE, re.MULTILINE)
    return commented[1] if commented else ""


def _default(field) -> str:
    if field.default is None:
        return "absent" if type(None) in typing.get_args(field.annotation) else "required"
    if isinstance(field.default, Table):
        return "a table with its defaults"
    value = list(field.default) if isinstance(field.default, tuple) else field.default
    return "`" + (str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')) + "`"


def _documented(model: type[Table]) -> str:
    text = re.sub(r"(?m)^    ", "", model.__doc__ or "").strip()
    return f"{text}\n"


def of_table(model: type[Table], heading: str, path: str, level: int = 2) -> str:
    """Returns the section for a table, and those for the tables in it."""
    rows, below = [], []
    for name, field in model.model_fields.items():
        key = field.alias or name
        inner = tables_in(field.annotation)
        if not inner or float in _inside(field.annotation):  # a number, or a table
            rows.append((f"`{key}`", meaning(path, key), expected(field), _default(field)))
        for kind in inner:
            inside = f"{path}.{key}".removeprefix(".") if path != "scene" else key
            by = kind.told_apart_by
            chosen = f', {by} = "{kind.model_fields[by].default}"' if by and len(inner) > 1 else ""
            brackets = f"[[{inside}]]" if key in ("vesicle", "cases") else f"[{inside}]"
            below.append(of_table(kind, f"`{brackets}`{chosen}", inside, min(level + 1, 3)))
    listed = table(("key", "meaning", "allowed", "default"), rows) if rows else ""
    return "\n".join([f"{'#' * level} {heading}\n", _documented(model), listed, *below])


def scene_file() -> str:
    """Returns the reference of scene files."""
    numbers = [
        (f"`{n.name}`", n.letter, n.meaning, n.unit or "1", n.bounds.expected, n.in_laboratory_units)
        for n in physical_numbers.NUMBERS
    ]
    heads = ("name", "letter", "meaning", "unit", "allowed", "from SI quantities")
    return "\n".join(
        [
            "# Scene files\n",
            _NOTE,
            "A scene file is TOML. A missing table means that the thing is absent. `jaxves init` writes a file with",
            "comments. Lengths are in a, times in t_κ = μa³/κ_B, and angles in degrees.\n",
            of_table(scene_tables.SceneFile, "The top of the file", "scene"),
            "## Physical numbers\n",
            "The names are those of sweeps, fits and sensitivities.\n",
            table(heads, numbers),
            "## The commented scene file\n",
            f"```toml\n{TEMPLATE}```\n",
        ]
    )


def sweep_file() -> str:
    """Returns the reference of sweep files."""
    rows, below = [], []
    for name, field in sweep_tables.SweepFile.model_fields.items():
        rows.append((f"`{field.alias or name}`", _SWEEP.get(name, ""), _default(field)))
        for kind in tables_in(field.annotation):
            if kind not in (scene_tables.SceneFile, sweep_tables.SweepFile) and kind.__module__.endswith(
                "sweep_tables"
            ):
                below.append(of_table(kind, f"`{name}`: {kind.__name__}", name))
    return "\n".join(
        [
            "# Sweep files\n",
            _NOTE,
            _documented(sweep_tables.SweepFile),
            table(("key", "meaning", "default"), rows),
            *dict.fromkeys(below),
        ]
    )


_SWEEP = {
    "scene": "the scene: the name of a built-in one, a file, or tables",
    "axes": "a grid: for each number a list of values, or start, stop, num and spacing",
    "cases": "a list of cases, each with values for the same numbers",
    "sample": "a sample of a box: num, ranges, sequence, seed",
    "keep": '"history" keeps diagnostics over time, "shapes" keeps nodes over time',
    "refine": "halve the cells of a grid in which the class changes",
    "max_steps": "limits on the number of steps in the first and the second pass",
}


def result_file() -> str:
    """Returns the reference of result files."""
    history = [(f"`/{name}`", d.long_name, d.units, ", ".join(d.dims)) for name, d in HISTORY.items()]
    found = [(f"`/diagnostics/{name}`", q.long_name, q.units, ", ".join(q.dims)) for name, q in QUANTITIES.items()]
    heads = ("dataset", "meaning", "unit", "axes")
    return "\n".join(
        [
            "# Result files\n",
            _NOTE,
            "Results are HDF5 files. h5py, xarray and HDFView open them. Every dataset has the attributes `units` and",
            "`long_name` and named axes. A dataset is absent if the scene does not have it: `/V_m` needs a field.\n",
            "## Saved times\n",
            table(heads, history),
            'With `nodes = "auto"`, the default, all rows are stored with the largest number of nodes that the run may',
            "use: 256, unless wrinkles need more or memory allows less. `/nodes` says how many were used.\n",
            "## Diagnostics\n",
            table(heads, found),
            "## Averages\n",
            "With the key `average` of the scene, `/averages` has time averages of `stress`, `tank_treading_speed`,",
            "`deformation`, `inclination` and, in a flow, `effective_viscosity`.\n",
            "## Attributes of the file\n",
            table(("attribute", "meaning"), _ATTRIBUTES),
            "`/restart` holds what a continuation needs that agrees bit for bit. It is not meant to be read.\n",
        ]
    )


_ATTRIBUTES = (
    ("`scene`", "the scene as TOML, complete with defaults"),
    ("`status`", "how the run ended, see [status words](../howto/status-words.md)"),
    ("`advice`", "one line that says what to change, or nothing"),
    ("`saved`", "the number of valid rows"),
    ("`schema_version`", "the version of this layout"),
    ("`version`", "the version of jaxves, with those of the libraries in further attributes"),
    ("`wall_time`", "the time of the computation in seconds, of all parts of a run that was continued"),
)


_STATUSES = "Exit status: 0 done, 2 wrong input, 3 broke down, 130 interrupted by Ctrl-C or --max-time, 143 by SIGTERM."


def command_line() -> str:
    """Returns the reference of the command line."""
    parts = ["# Command line\n", _NOTE, f"{_STATUSES}\n"]
    group = typer.main.get_command(commands.app)
    for name, command in group.commands.items():
        rows = [
            (
                ", ".join(f"`{option}`" for option in parameter.opts) if parameter.param_type_name == "option"
                else f"`{(parameter.metavar or parameter.name).upper()}`",
                getattr(parameter, "help", "") or "",
            )
            for parameter in command.params
            if parameter.name != "help"
        ]  # fmt: skip
        usage = command.get_usage(typer.Context(command, info_name=f"jaxves {name}")).replace("Usage: ", "")
        usage = re.sub(r"\{(\w+)\}", lambda found: found[1].upper(), usage)
        described = re.sub(r"(?m)^ +", "", command.help or "").replace("\x08", "").strip()
        parts += [f"## `jaxves {name}`\n", f"```text\n{usage}\n```\n", f"{described}\n"]
        parts += [table(("argument or option", "meaning"), rows)] if rows else []
    return "\n".join(parts)


def python_names() -> str:
    """Returns the reference of the public names, in the order of the layers."""
    parts = [
        "# Python\n",
        _NOTE,
        "These names are kept stable. All of them are available as `jaxves.NAME`. Figures are in",
        "[`jaxves.plots`](plots.md), and [all modules](modules.md) have their own pages.\n",
    ]
    stub = ast.parse(Path(jaxves.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    listed = [node for node in stub.body if isinstance(node, ast.ImportFrom) and node.module]
    for folder in FOLDERS:
        names = [alias.name for node in listed if node.module.partition(".")[0] == folder for alias in node.names]
        if not names:
            continue
        summary = (importlib.import_module(f"jaxves.{folder}").__doc__ or folder).partition("\n")[0]
        parts += [f"## {folder}\n", f"{summary}\n"]
        for name in names:
            found = getattr(jaxves, name)
            kind = "class" if isinstance(found, type) else "function" if callable(found) else "module"
            how = "\n   :members:" if kind == "class" and not issubclass(found, Exception) else ""
            parts += [f"### {name}\n", f"```{{eval-rst}}\n.. auto{kind}:: jaxves.{name}{how}\n```\n"]
    return "\n".join(parts)


def plots() -> str:
    """Returns the reference of the figures."""
    functions = [name for name in jaxves.plots.__all__ if callable(getattr(jaxves.plots, name))]
    body = "\n".join(f".. autofunction:: jaxves.plots.{name}\n" for name in functions)
    return f"# Figures: jaxves.plots\n\n{_NOTE}\n```{{eval-rst}}\n{body}```\n"


def experiments() -> dict[str, str]:
    """Returns a page for each experiment by name, from the sections of experiments/README.md, and an index."""
    text = (ROOT / "experiments" / "README.md").read_text(encoding="utf-8")
    links = re.sub(r"\]\((?=figures/|data/|_)", "](../../../experiments/", text)
    links = re.sub(r"\]\(\.\./(?!\.\.)", "](../../../", links)
    listed = re.findall(r"^\| ([^|]+?) \| `(\w+)[^`]*` \| *([\d.]+) *\| ([^|]+?) \|", links, re.MULTILINE)
    questions, minutes, results = ({row[1]: row[i] for row in listed} for i in (0, 2, 3))
    pages = {}
    for name, body in re.findall(r"(?ms)^\*\*`(\w+)`\.\*\*(.*?)(?=^\*\*`\w+`\.\*\*|^## |\Z)", links):
        question = questions.get(name, name)
        took = f" It takes {minutes[name]} minutes on two busy CPU cores." if name in minutes else ""
        answer = f" Answer: {results[name]}." if name in results else ""
        head = f"# {name}\n\n**{question}**{answer}\n\nRun it with `python -m experiments.{name}`.{took}\n\n"
        pages[name] = head + body.strip()
    columns = questions, results, minutes
    rows = [(f"[`{name}`]({name}.md)", *(column.get(name, "") for column in columns)) for name in pages]
    toc = "\n".join(["```{toctree}", ":hidden:", "", *pages, "```"])
    paper = links.partition("## The paper, statement by statement")[2].partition("\n## ")[0]
    pages["index"] = "\n".join(
        [
            "# Experiments\n",
            "Each experiment asks one question and has a page with its result, its figure and its command.",
            "`python -m experiments` lists them, and `--quick` runs each at toy size.\n",
            table(("experiment", "question", "answer", "minutes"), rows),
            toc,
        ]
    )
    pages["paper"] = "# The paper, statement by statement\n" + paper
    return pages


def modules() -> str:
    """Returns the reference of all modules, with one section for each folder."""
    package = ROOT / "jaxves"
    parts = ["# All modules\n", _NOTE, "Only the [public names](python.md) are kept stable. The others may move.\n"]
    for folder in FOLDERS:
        doc = (importlib.import_module(f"jaxves.{folder}").__doc__ or "").strip()
        parts += [f"## {folder}\n", f"```text\n{doc}\n```\n"]
        for file in sorted((package / folder).glob("[a-z]*.py")):
            name = f"jaxves.{folder}.{file.stem}"
            parts += [f"### {folder}.{file.stem}\n", f"```{{eval-rst}}\n.. automodule:: {name}\n   :members:\n```\n"]
    return "\n".join(parts)


def pages() -> dict[str, str]:
    """Returns all generated pages by their paths below docs/."""
    found = {
        "reference/scene-file.md": scene_file(),
        "reference/sweep-file.md": sweep_file(),
        "reference/result-file.md": result_file(),
        "reference/command-line.md": command_line(),
        "reference/python.md": python_names(),
        "reference/plots.md": plots(),
        "reference/modules.md": modules(),
    }
    return found | {f"validation/experiments/{name}.md": text for name, text in experiments().items()}


def write() -> None:
    """Writes all pages. A page that has not changed is left alone, so that it is not built again."""
    for name, text in pages().items():
        path = HERE / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write()
