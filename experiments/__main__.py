"""Lists and runs the experiments.

    python -m experiments                      # lists the questions, with minutes
    python -m experiments --quick [NAMES]      # runs each `run` at toy size, several at a time
    python -m experiments --all [NAMES]        # runs each `main`, one after the other: tables, figures, stored numbers

Experiments are the modules in this folder whose names begin with a letter. The question is the first line of the
docstring. The minutes are in README.md. `QUICK` in a module has the arguments of a toy run.
"""

import ast
import os
import pkgutil
import re
import time
from pathlib import Path
from typing import Annotated

# Small LAPACK calls are slower on two threads than on one; set before NumPy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import typer
from rich.console import Console
from rich.table import Table

from ._running import outcomes

HERE = Path(__file__).parent
out = Console(highlight=False)


def names() -> list[str]:
    """Returns the names of the modules of all experiments."""
    return sorted(module.name for module in pkgutil.iter_modules([str(HERE)]) if module.name[0].isalpha())


def question(name: str) -> str:
    """Returns the first line of a module's docstring, without importing the module."""
    return (ast.get_docstring(ast.parse((HERE / f"{name}.py").read_text())) or "").partition("\n")[0]


def minutes() -> dict[str, str]:
    """Returns the minutes by experiment, from the table in README.md; those without a row are missing."""
    rows = re.findall(r"^\|[^|]*\|[^|`]*`(\w+)`[^|]*\| *([\d.]+) *\|", (HERE / "README.md").read_text(), re.MULTILINE)
    return dict(reversed(rows))  # the first row of an experiment counts


def show(chosen: list[str]) -> None:
    """Prints the list of experiments."""
    known = minutes()
    table = Table(box=None)
    for heading in ("python -m experiments.…", "minutes", "question"):
        table.add_column(heading, justify="right" if heading == "minutes" else "left", overflow="fold")
    for name in chosen:
        table.add_row(name, known.get(name, "?"), question(name))
    out.print(table)
    out.print("All of them: --quick at toy size (minutes), --all in full; both take names.")


def main(
    chosen: Annotated[list[str] | None, typer.Argument(metavar="[NAMES]", help="Only these experiments.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Every run() at toy size.")] = False,
    everything: Annotated[bool, typer.Option("--all", help="Every main(), one after the other.")] = False,
) -> None:
    """Lists the experiments, or runs them."""
    for name in chosen or []:
        if name not in names():
            raise typer.BadParameter(f"{name}, expected one of {', '.join(names())}", param_hint="NAMES")
    if quick and everything:
        raise typer.BadParameter("--quick and --all exclude each other")
    if not quick and not everything:
        show(chosen or names())
        return
    start, ended = time.perf_counter(), []
    for outcome in outcomes(chosen or names(), quick):
        ended.append(outcome)
        out.print(f"{outcome.name}: {outcome.word}, {outcome.seconds:.0f} s", markup=False)
    failed = [outcome for outcome in ended if outcome.word not in {"done", "no QUICK"}]
    lacking = [outcome.name for outcome in ended if outcome.word == "no QUICK"]
    done = len(ended) - len(failed) - len(lacking)
    out.rule(align="left")
    out.print(f"{done} done in {(time.perf_counter() - start) / 60:.1f} minutes")
    if lacking:
        out.print(f"not run, having no QUICK: {', '.join(lacking)}")
    for outcome in failed:
        out.print(f"failed: {outcome.name}: {outcome.word}", markup=False)
    raise typer.Exit(1 if failed else 0)


if __name__ == "__main__":
    typer.run(main)
