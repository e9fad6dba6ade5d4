"""Sphinx's settings of the site. `make docs` stages the sources and runs it (build.py)."""

import sys
from pathlib import Path

import omnitrack_sim

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "omnitrack_sim"
author = "omnitrack_sim developers"
copyright = author
release = omnitrack_sim.__version__
language = "en"  # also of the stems that the search compares

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "mathml",
    "docstrings",
    "search_texts",
]
templates_path = [str(HERE / "templates")]
suppress_warnings = [
    "myst.header",  # pages that show files begin their headings at the second level
]

# Pages
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]  # as a code host writes equations
myst_heading_anchors = 4  # as a code host makes them, so that links work in both places
nb_execution_mode = "off"  # a notebook is shown with the results that it was saved with
nb_mime_priority_overrides = [("html", "application/vnd.jupyter.widget-view+json", None)]

# Reference
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
add_module_names = False
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # the signature has the types, the text shapes and units
toc_object_entries_show_parents = "hide"

# Appearance
html_theme = "pydata_sphinx_theme"
html_title = "omnitrack_sim"
html_static_path = [str(HERE / "static")]
html_css_files = ["site.css"]
html_search_scorer = str(HERE / "static" / "search_scorer.js")
html_copy_source = False
html_show_sourcelink = False
html_context = {"default_mode": "auto"}  # light or dark, as the reader's system has it
html_sidebars = {"**": ["contents.html"]}
html_theme_options = {
    "navbar_center": [],
    "navbar_end": ["theme-switcher"],
    "navbar_persistent": ["search-button-field"],
    "secondary_sidebar_items": ["page-toc"],
    "show_nav_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
    "article_header_start": [],
    "search_bar_text": "Search",
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
