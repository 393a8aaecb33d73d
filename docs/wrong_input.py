"""Writes the table of wrong inputs and the error message of jaxves for each.

    python docs/wrong_input.py     # writes docs/wrong-input.md, about half a minute

The inputs are those of the tests (`tests/wrong_arguments.py`, `tests/wrong_files.py`).
"""

import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "tests"), str(HERE.parent)]

import wrong_arguments  # noqa: E402
import wrong_files  # noqa: E402

from jaxves.inputs import scene_files, sweep_files  # noqa: E402

HEADER = """# Wrong inputs, and what jaxves says

Every input below is refused before anything is computed or written. The tests try all of them
(`tests/test_arguments.py`, `tests/test_wrong_files.py`); `python docs/wrong_input.py` makes this page.
"""


def said(call, folder: Path) -> str:
    """Returns the error message, without the name of the temporary folder."""
    _, message = wrong_arguments.complaint(call)
    return message.replace(f"{folder}/", "")


def of_file(name: str, text: str, folder: Path, load) -> str:
    """Returns the error message for a file with this text."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return said(lambda: load(path), folder)


def planned(path: Path):
    """A sweep file and its cases."""
    return sweep_files.plan(sweep_files.read_sweep_file(path), origin=path.name)


def tables() -> dict[str, dict[str, str]]:
    """The complaints by kind of input and name."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = {
            "Python calls": {name: said(call, folder) for name, (call, _) in wrong_arguments.WRONG.items()},
            "Scene files": {
                name: of_file("scene.toml", wrong_files.scene_text(name), folder, scene_files.read_scene)
                for name in (*wrong_files.OF_VESICLE, *wrong_files.OF_SCENE)
            },
            "Sweep files": {
                name: of_file("sweep.toml", text, folder, planned) for name, (text, _) in wrong_files.OF_SWEEP.items()
            },
        }
        outlines = {}
        for name, (text, _) in wrong_files.OUTLINES.items():
            (folder / "outline.csv").write_text(text, encoding="utf-8")
            outlines[name] = of_file("scene.toml", wrong_files.SCENE_OF_OUTLINE, folder, scene_files.read_scene)
        return found | {"Outlines": outlines}


def main() -> None:
    """Writes the page."""
    parts = [HEADER]
    for title, rows in tables().items():
        parts += [f"\n## {title} ({len(rows)})\n", "| input | answer |", "|---|---|"]
        parts += [f"| {name} | {text.replace('|', chr(92) + '|')} |" for name, text in rows.items()]
    (HERE / "wrong-input.md").write_text("\n".join(parts) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
