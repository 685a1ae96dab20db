"""How Sphinx builds the documentation."""

from importlib.metadata import version as version_of

project = "struck"
author = "The struck developers"
project_copyright = "2026, The struck developers"
release = version_of("struck")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say shapes and units, which types cannot
napoleon_google_docstring = False

html_theme = "furo"
html_static_path = ["static"]  # sounds that the pages play
html_title = f"struck {release}"
