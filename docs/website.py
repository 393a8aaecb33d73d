"""Builds the website: every page, the notebooks with their stored outputs, and the references from the code.

    python docs/website.py [FOLDER]       # default: site; begin reading at FOLDER/index.html

Warnings are errors: a link to nowhere, a page that is in no list, a docstring that is not well formed. Needs
`pip install ".[docs]"`. Nothing is simulated and no notebook is run.
"""

import sys
from pathlib import Path

from sphinx.cmd.build import build_main

HERE = Path(__file__).parent
_FIRST = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url=docs/index.html">\n'


def build(folder: Path) -> int:
    """Writes the website into a folder; returns 0 if there is no warning."""
    options = ["--fail-on-warning", "--keep-going", "--quiet", "-b", "html", "-c", str(HERE)]
    code = build_main([*options, "-d", str(folder / ".doctrees"), str(HERE.parent), str(folder)])
    (folder / "index.html").write_text(_FIRST, encoding="utf-8")
    return code


if __name__ == "__main__":
    raise SystemExit(build(Path(sys.argv[1] if len(sys.argv) > 1 else "site")))
