"""Settings of Sphinx for the website. `python docs/website.py` builds it."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import generated_pages

import jaxves

project = "jaxves"
author = "The jaxves developers"
version = release = jaxves.__version__

extensions = [
    "myst_nb",  # pages in Markdown, and the notebooks with the outputs that are stored in them
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
# The source is the repository itself, so that links between files work on the website and in a copy of the repository.
root_doc = "docs/index"
include_patterns = [
    "docs/**.md",
    "notebooks/*.ipynb",
    "benchmarks/README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "CODE_OF_CONDUCT.md",
]
exclude_patterns = ["**/.ipynb_checkpoints"]

nb_execution_mode = "off"  # the tests run the notebooks
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 4
# A public name has two targets: jaxves.NAME, and its place in its module. Either is right.
suppress_warnings = ["mystnb.unknown_mime_type", "ref.python"]

html_theme = "furo"
html_title = f"jaxves {release}"
html_copy_source = False
copybutton_exclude = ".linenos, .gp, .go"

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
default_role = "code"  # docstrings have names in single backticks
napoleon_google_docstring = True
napoleon_numpy_docstring = False
toc_object_entries = False  # thousands of entries in the sidebar of every page would make the build slow


def _as_restructured_text(app, what, name, obj, options, lines):
    """Shows module docstrings as they are, and escapes |V_m|, x* and names that end in an underscore elsewhere."""
    if what == "module" and lines:
        lines[:] = ["::", "", *(f"    {line}" for line in lines), ""]
        return
    for i, line in enumerate(lines):
        parts = re.split(r"(`[^`]*`)", line)
        lines[i] = "".join(
            part if k % 2 else re.sub(r"(?<![*\\])([|*])|(?<=\w)_(?=\W|$)", lambda m: "\\" + m[0], part)
            for k, part in enumerate(parts)
        )


def setup(app):
    """Writes the generated pages before the pages are read."""
    generated_pages.write()
    app.connect("autodoc-process-docstring", _as_restructured_text, priority=100)
