"""Sphinx configuration of the manual: ``make docs`` builds it without the network, a warning ends the build."""

import os
import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS.parent), str(DOCS)]
# Functions keep their signatures and docstrings where numba does not compile them.
os.environ["NUMBA_DISABLE_JIT"] = "1"

project = "mbpam_ros"
author = "mbpam_ros maintainers"
copyright = "mbpam_ros maintainers, Apache-2.0"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "reference_from_code"]
# References into this package must lead somewhere; types of other packages have no page here.
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!mbpam_ros\.).*|.*\._\w+")]
suppress_warnings = ["ref.python"]  # two classes of one name: either page will do

highlight_language = "text"  # of the docstrings' formulas; fences name theirs
python_maximum_signature_line_length = 100

html_theme = "furo"
html_theme_options = {"light_css_variables": {"code-font-size": "0.75rem"}}
html_static_path = ["static"]
html_css_files = ["wide.css"]
html_title = "mbpam_ros"
html_show_sphinx = False
html_copy_source = False

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3

# Optional packages that few installations have; what is documented needs none of them to be run.
autodoc_mock_imports = ["elastica", "felupe", "matplotlib", "mujoco", "psutil", "pymoo", "pypardiso", "distributed"]
toc_object_entries = False  # a page of the API lists its modules; members would double its length and the time
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
napoleon_numpy_docstring = False
napoleon_use_rtype = False
