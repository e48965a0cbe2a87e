"""How the pages are built: `sphinx-build -W docs build/docs`."""

import logging
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_extensions"), str(HERE.parent)]

import lab  # noqa: E402  (the path has to be set first)

project = "Virtual calibration lab"
author = "The virtual calibration lab developers"
copyright = f"2026, {author}"
release = version = lab.__version__

extensions = [
    "myst_nb",  # reads Markdown, and executes notebooks
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "command_pages",
    "interface",
    "sidebar",
    "drawn",
    "gallery",
    "mathml",
    "stored_rows",
    "exercises",
    "search_terms",
]
exclude_patterns = ["_extensions", "_figures", "paper"]
html_extra_path = ["llms.txt"]
suppress_warnings: list[str] = []

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
logging.getLogger("traitlets").setLevel(logging.WARNING)  # not a line for each notebook

default_role = "code"  # docstrings write `name` for code
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"  # results are made by the lab
python_maximum_signature_line_length = 88
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True  # attributes that a class lists are in its own text
napoleon_attr_annotations = False

html_theme = "furo"
html_title = project
html_theme_options = {"navigation_with_keys": True}
html_static_path = ["_static"]
html_css_files = ["style.css", "reference.css"]
html_copy_source = html_show_sourcelink = False
html_math_renderer = "mathml"
html_show_sphinx = False
