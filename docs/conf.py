"""Sphinx's configuration of the site: ``python -m sphinx -W docs site`` builds it, without a network."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from lcpimpact import __version__

os.environ.setdefault("LCPIMPACT_COMPILE", "later")
sys.path.insert(0, str(Path(__file__).parent))  # for notebooks.py

project = "lcpimpact"
author = "The lcpimpact developers"
copyright = "The lcpimpact developers"
version = release = __version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinxcontrib.bibtex",
    "notebooks",
]
root_doc = "index"
exclude_patterns = ["images/problems/*.md", "site", "paper"]

html_theme = "furo"
html_title = "lcpimpact"
html_show_sourcelink = False

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath", "attrs_block"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

nb_execution_mode = "auto"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "alpha"
