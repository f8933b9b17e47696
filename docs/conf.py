"""The site: `python -m sphinx -W docs build/site`; with `-b doctest` its examples run."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))   # for hook

import hook

import clfur

project = "clfur"
author = copyright = "clfur contributors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.doctest"]

smartquotes_action = "D"   # dashes alone: quotes are code as often as not
default_role = "code"   # of single backticks in docstrings
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3

# What is imported from clfur is called so, wherever it is defined: in signatures, and for links to it.
for name in clfur.__all__:
    if hasattr(getattr(clfur, name), "__module__"):
        getattr(clfur, name).__module__ = "clfur"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
maximum_signature_line_length = 90

# Each page of examples begins in a folder of its own, with this scene; docs/reference/index.rst tells.
doctest_global_setup = """
import os, tempfile
import numpy as np
import clfur
there, folder = os.getcwd(), tempfile.TemporaryDirectory()
os.chdir(folder.name)
mesh = clfur.load_mesh("sphere")
fur = clfur.Strands(roots=500)
scene = clfur.Scene(mesh, fur, clfur.Camera(size=(32, 24)))
"""
doctest_global_cleanup = """
os.chdir(there)
folder.cleanup()
"""

html_theme = "pydata_sphinx_theme"
html_title = "clfur"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_sidebars = {"index": [], "gallery": []}   # pages with none beside or below them
html_theme_options = {
    "show_nav_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": {"**": ["page-toc"], "index": []},
    "footer_start": ["copyright"],
    "footer_end": [],
}


def setup(app):
    app.connect("autodoc-process-docstring", hook.fields)
    app.connect("autodoc-process-signature", hook.shorter)
    app.connect("source-read", hook.commands)
    app.connect("source-read", hook.plain_links)
