"""Builds the API reference from the docstrings.

    python docs/api.py [FOLDER]          # default: api; begin reading at FOLDER/index.html

Needs `pip install ".[dev]"`.
"""

import sys
from pathlib import Path

import pdoc

import jaxves


def build(folder: Path) -> None:
    """Writes a page of the public names, and one for each module."""
    for name in jaxves.__all__:
        getattr(jaxves, name)  # names are imported when first asked for, and pdoc does not ask
    pdoc.render.configure(docformat="google", math=True, footer_text=f"jaxves {jaxves.__version__}")
    package = Path(jaxves.__file__).parent
    # `plots` has a list of its names, which hides its files from pdoc; all other folders are followed.
    folders = [f"jaxves.{file.parent.name}" for file in sorted(package.glob("*/__init__.py"))]
    hidden = [f"jaxves.plots.{file.stem}" for file in sorted((package / "plots").glob("[a-z]*.py"))]
    pdoc.pdoc("jaxves", *set(folders) - {"jaxves.plots"}, *hidden, output_directory=folder)


if __name__ == "__main__":
    build(Path(sys.argv[1] if len(sys.argv) > 1 else "api"))
