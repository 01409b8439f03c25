"""The site: Sphinx over the pages that ``building/stage.py`` lays out; ``make docs``."""

import sys
from pathlib import Path

import ziamath

sys.path.insert(0, str(Path(__file__).parent / "building"))

import qlvbayes

project = "qlvbayes"
version = release = qlvbayes.__version__
project_copyright = "the authors of qlvbayes, MIT licence"
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "signatures"]

html_theme = "furo"
html_title = f"qlvbayes {release}"
html_static_path = ["assets", str(Path(ziamath.__file__).parent / "fonts")]  # its font for formulas
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
highlight_language = "none"  # most blocks are files and outputs; code says what it is

add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_class_signature = "mixed"
python_use_unqualified_type_names = True
napoleon_google_docstring = False
