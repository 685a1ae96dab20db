"""How Sphinx builds the documentation: without a network, a sound device or a display."""

import shutil
import sys
from importlib.metadata import version as version_of
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))
from docs.media import SOUNDS, TUTORIAL, tutorial  # noqa: E402 - found by the line above

project = "struck"
author = "The struck developers"
project_copyright = "2026, The struck developers"
release = version_of("struck")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build"]

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say shapes and units, which types cannot
napoleon_google_docstring = False

# Scripts run in the folder where they lie, and leave files there: in a copy.
SCRIPTS = DOCS / "_build/scripts"
shutil.rmtree(SCRIPTS, ignore_errors=True)
shutil.copytree(DOCS.parent / "examples/gallery", SCRIPTS)
sphinx_gallery_conf = {
    "examples_dirs": [str(SCRIPTS)],
    "gallery_dirs": ["gallery"],
    "within_subsection_order": "FileNameSortKey",
    "filename_pattern": "",  # all of them run
    "abort_on_example_error": True,
    "image_scrapers": ("docs.media.figures",),
    "capture_repr": ("_repr_html_",),
    "reset_modules": (),
    "download_all_examples": False,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "show_signature": False,
    "remove_config_comments": True,
}

# Sounds that the pages play, made by the code of the tutorial.
made = min((path.stat().st_mtime for path in SOUNDS.glob("*.wav")), default=0.0)
if made < TUTORIAL.stat().st_mtime:
    tutorial(pictures=False)

html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_title = f"struck {release}"
