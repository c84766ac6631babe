"""Sphinx's settings for the site. scripts/docs builds it; docs/reference/generated is written first, from the code."""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PROJECT = DOCS.parent
sys.path[:0] = [str(PROJECT), str(PROJECT / "scripts")]

from documentation.reference import write_reference  # noqa: E402

write_reference(DOCS / "reference" / "generated")

project = "CMR"
author = "the CMR authors"
project_copyright = "the CMR authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_design"]
exclude_patterns = ["_build"]
suppress_warnings = ["myst.header"]  # a section that is included may begin below the first level

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4

default_role = "code"  # `name` in a docstring is code, as in Markdown
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "mixed"

linkcheck_ignore = [r"http://127\.0\.0\.1"]  # the page that cmr-view serves

html_theme = "pydata_sphinx_theme"
html_title = "CMR: Calibrated Mixed Reality"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "CMR"},
    "navbar_persistent": ["search-button"],
    "navbar_end": ["theme-switcher"],
    "header_links_before_dropdown": 7,
    "show_toc_level": 2,
    "navigation_with_keys": True,
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars = {"index": [], "gallery": []}
