"""Builds the API reference from the docstrings.

    python docs/api.py [FOLDER]          # default: api; begin reading at FOLDER/index.html

Needs `pip install ".[dev]"`.
"""

import sys
from pathlib import Path

import pdoc

import jaxves


def build(folder: Path) -> None:
    """Writes one page for each module."""
    for name in jaxves.__all__:
        getattr(jaxves, name)  # names are imported when first asked for, and pdoc does not ask
    pdoc.render.configure(docformat="google", math=True, footer_text=f"jaxves {jaxves.__version__}")
    pdoc.pdoc("jaxves", output_directory=folder)


if __name__ == "__main__":
    build(Path(sys.argv[1] if len(sys.argv) > 1 else "api"))
