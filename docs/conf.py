"""Sphinx configuration. Everything comes from the package and these pages; nothing is fetched while building."""

from importlib import metadata

project = "dense-vs"
author = "The dense-vs authors"
copyright = "The dense-vs authors"
release = metadata.version("dense-vs")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]

autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = "dense-vs"
html_static_path = []
html_show_copyright = False


def _keep_colons(app, what, name, obj, options, lines):
    """Napoleon takes the words before a colon in a property's first line for its type; an empty line prevents that."""
    if what == "property" and lines:
        lines.insert(0, "")


def _leave_out_imports(app, what, name, obj, options, lines):
    """Which rooms a room may import concerns those who change it, not those who use it."""
    start = next((number for number, line in enumerate(lines) if line.startswith("May import:")), None)
    if what == "module" and start is not None:
        end = next((number for number in range(start, len(lines)) if not lines[number]), len(lines))
        del lines[start:end]


def setup(app):
    """Run before napoleon, whose priority is 500."""
    app.connect("autodoc-process-docstring", _leave_out_imports, priority=400)
    app.connect("autodoc-process-docstring", _keep_colons, priority=400)
