"""Sphinx's configuration of the site: ``python -m sphinx -W docs site`` builds it, without a network."""

from __future__ import annotations

import os

from lcpimpact import __version__

os.environ.setdefault("LCPIMPACT_COMPILE", "later")

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
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.bibtex",
]
root_doc = "index"
exclude_patterns = ["images/problems/*.md", "site", "paper", "gallery", "examples/*.[!r]*"]

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

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "within_subsection_order": "ExampleTitleSortKey",
    "image_scrapers": ("matplotlib",),
    "image_srcset": ["2x"],
    "min_reported_time": 1e9,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "abort_on_example_error": True,
    "plot_gallery": True,
    "download_all_examples": False,
}

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "alpha"
