"""Does a sweep or a run lose anything when it is killed?

    python -m experiments.kills          # a table, about nine minutes

`kill -9` is sent at ten random moments of `jaxves sweep` and ten of `jaxves run`. Each time the same command follows
with `--resume`. When a command has finished, it starts again. The moments are uniform over the undisturbed duration of
the command, so some come before there is a file, and some between two writes.

What to expect: after every kill the file opens, and what it contains agrees bit for bit with the undisturbed one.
Every finished file agrees completely, with its restart state. The last command computes what was not in the file
before. A run continues from its last row.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
import tomli_w

from jaxves.results.hdf5 import datasets_below, histories
from jaxves.results.restart import leaves_in, slots
from jaxves.results.sweep_store import DUE

from ._common import store

QUICK = dict(kills=1, cases=4, rows=40)
_CACHE = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0", "OPENBLAS_NUM_THREADS": "1"}


def scene(t_end, saves) -> dict:
    """POP with few nodes."""
    return {
        "t_end": t_end,
        "saves": saves,
        "vesicle": [{"reduced_area": 0.9, "angle": 90.0}],
        "field": {"beta": 3.2, "conductivity_ratio": 0.1},
        "numerics": {"nodes": 32},
    }


def acknowledged(file: h5py.File) -> np.ndarray:
    """Returns which cases of a sweep, or rows of a run, are valid in the file."""
    if "status" in file:
        return ~np.isin(file["status"][...].astype(str), DUE).ravel()
    return np.arange(file.attrs["saves"]) < file.attrs["saved"]


def parts(file: h5py.File, which: np.ndarray) -> dict[str, bytes]:
    """Returns everything that the file has of these cases or rows."""
    if "status" in file:
        found = {name: data for name, data in datasets_below(file).items() if data.attrs.get("per_case")}
        return {name: np.reshape(data[...], (len(which), -1))[which].tobytes() for name, data in found.items()}
    return {name: data[...][which[: len(data)]].tobytes() for name, data in histories(file).items()}


def everything(path: Path) -> dict[str, bytes | list]:
    """Returns all datasets of a finished file, with the valid one of the two restart states."""
    with h5py.File(path) as file:
        found = {name: data for name, data in datasets_below(file).items() if not name.startswith("restart/")}
        if "restart" in file:
            found |= leaves_in(slots(file)[0])
        return {name: list(np.ravel(d[()])) if d.dtype == object else d[()].tobytes() for name, d in found.items()}


def kept(broken: Path, whole: Path) -> tuple[int, bool]:
    """Returns how much an interrupted file has, whether it has the right bits, and whether a run continues from it."""
    if not broken.exists():
        return 0, True
    with h5py.File(broken) as file, h5py.File(whole) as undisturbed:
        done = acknowledged(file)
        same = parts(file, done) == parts(undisturbed, done)
        if "restart" in file:
            same &= bool(leaves_in(slots(file)[0])["t"] == file["t"][file.attrs["saved"] - 1])
        return int(done.sum()), same


class Command:
    """The command `jaxves WORD` on these tables, in its own folder with its compiled programs."""

    def __init__(self, word: str, tables: dict, folder: Path):
        self.word, self.folder = word, folder
        (folder / "in.toml").write_text(tomli_w.dumps(tables))

    def __call__(self, out: Path, *options: str, seconds: float | None = None) -> str | None:
        """Runs the command; returns its first line of output, or None if it was killed after so many seconds."""
        command = [sys.executable, "-m", "jaxves", self.word, "in.toml", "--out", str(out), *options]
        env = os.environ | _CACHE | {"JAX_COMPILATION_CACHE_DIR": str(self.folder / "cache")}
        try:
            done = subprocess.run(  # on time-out it kills with SIGKILL
                command, check=True, capture_output=True, timeout=seconds, cwd=self.folder, env=env, text=True
            )
        except subprocess.TimeoutExpired:
            return None
        return done.stdout.partition("\n")[0]


def disturbed(command: Command, kills: int, rng: np.random.Generator) -> dict:
    """Returns the undisturbed seconds; for each call the contents before and after, and whether they were right."""
    whole, broken = command.folder / "whole.h5", command.folder / "broken.h5"
    command(whole)  # compiles
    began = time.perf_counter()
    command(whole, "--force")
    seconds = time.perf_counter() - began
    reference = everything(whole)
    with h5py.File(whole) as file:
        size = len(acknowledged(file))
    sittings, before = [], 0
    while (left := kills - sum(row["killed"] for row in sittings)) or broken.exists():
        options = ["--resume"] if broken.exists() else []
        moment = rng.uniform(0, seconds) if left else None
        said = command(broken, *options, seconds=moment)
        if said is None:
            after, held = kept(broken, whole)
            held &= after >= before
        else:
            after, held = size, everything(broken) == reference
            if command.word == "sweep":
                held &= said == f"{size - before} cases computed now, {before} were there"
            broken.unlink()
        sittings.append({"killed": said is None, "seconds": moment, "before": before, "after": after, "held": held})
        before = after if broken.exists() else 0
    return {"seconds": seconds, "size": size, "sittings": sittings}


def run(kills=10, cases=1500, rows=6000, seed=None):
    """Returns, by command, its undisturbed seconds, its number of cases or rows, and its calls."""
    rng = np.random.default_rng(seed)
    axes = {"field.beta": {"start": 0.5, "stop": 6.0, "num": cases // 2}, "field.membrane_conductance": [0.0, 1.0]}
    tables = {
        "sweep": {"scene": scene(0.1, 4), "keep": ["history", "shapes"], "axes": axes},
        "run": scene(0.5, rows - 1),
    }
    found = {}
    for word, table in tables.items():
        with tempfile.TemporaryDirectory() as folder:
            found[word] = disturbed(Command(word, table, Path(folder)), kills, rng)
    return found


def main():
    found = run()
    store("kills", found)
    for word, row in found.items():
        print(f"jaxves {word}: {row['seconds']:.1f} s undisturbed; {row['size']} cases or rows")
        for sitting in row["sittings"]:
            end = f"killed after {sitting['seconds']:4.1f} s" if sitting["killed"] else "done             "
            print(f"   {sitting['before']:5} there, {end}: {sitting['after']:5}, held: {sitting['held']}")
    assert all(sitting["held"] for row in found.values() for sitting in row["sittings"])


if __name__ == "__main__":
    main()
