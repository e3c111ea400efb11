"""Sphinx's configuration of the site; ``python docs/build.py`` draws its pictures and builds it."""

from __future__ import annotations

import sys
from importlib.metadata import files
from pathlib import Path

from lcpimpact import __version__, explore

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # for the modules beside this file

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
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.bibtex",
    "docstrings",
    "notebooks",
    "pages",
]
root_doc = "index"
default_role = "py:obj"
smartquotes_action = "qe"  # not of dashes: --option is no dash
templates_path = ["_templates"]
exclude_patterns = [".jupyter_cache", "paper", "_templates", "images", "pictures", "gallery", "examples/*.[!r]*"]
exclude_patterns += ["mathjax/*mml-*", "mathjax/*svg*", "mathjax/*full*"]  # bundles of MathJax that no page loads

highlight_language = "none"  # of literal blocks without a language: the drawings in docstrings

html_theme = "furo"
html_title = "lcpimpact"
html_show_sourcelink = False
html_extra_path = ["extra"]
MATHJAX = next(file for file in files("sphinx-mathjax-offline") or () if file.name == "tex-chtml.js")
html_css_files = ["site.css"]
html_static_path = ["_static", str(Path(str(MATHJAX.locate())).parents[1])]  # the folder that holds mathjax/
mathjax_path = "mathjax/tex-chtml.js"
html_theme_options = {"navigation_with_keys": True}

myst_enable_extensions = ["amsmath", "attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True

nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / ".jupyter_cache")
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

autosummary_generate = True
numpydoc_show_class_members = False
autodoc_default_options = {"members": True, "exclude-members": "maketrans, set"}  # of str and of Matplotlib
autodoc_typehints = "none"  # the docstrings state the types

bibtex_bibfiles = ["../lcpimpact/references.bib"]
bibtex_default_style = "alpha"


def write_generated(*_: object) -> None:
    """Write the page of the command line, from its help, and the explorer that the site embeds."""
    from commands_page import page

    (HERE / "reference" / "command-line.md").write_text(page(), encoding="utf-8")
    (HERE / "extra").mkdir(exist_ok=True)
    explore(path=HERE / "extra" / "explorer-page.html")


def as_slides(app: object, page: str, *_: object) -> str | None:
    """Return the template that shows the sections of the page of slides one by one, and none for other pages."""
    return "slides.html" if page == "course/slides" else None


def setup(app: object) -> None:
    """Connect what the build writes itself."""
    app.connect("config-inited", write_generated, priority=0)  # type: ignore[attr-defined]
    app.connect("html-page-context", as_slides)  # type: ignore[attr-defined]
