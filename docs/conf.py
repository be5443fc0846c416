"""How Sphinx builds the manual: pages in MyST, whose cells are executed and kept in a cache."""

import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
# Cells and commands on the pages are those of this clone, whatever else is installed.
sys.path[:0] = [str(HERE / "extensions"), str(HERE.parent)]
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(HERE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
)
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
# Tables of the command line are as wide as a page.
os.environ.update(COLUMNS="92", TERM="dumb", NO_COLOR="1")

# Kernels begin with what lies there: cells of the shell print once, when they have ended.
os.environ["IPYTHONDIR"] = str(HERE / "_build" / "ipython")
startup = HERE / "_build" / "ipython" / "profile_default" / "startup"
startup.mkdir(parents=True, exist_ok=True)
shutil.copy(HERE / "extensions" / "shell_cells.py", startup)

import jaxrender  # noqa: E402

project = "jaxrender"
author = "the authors of jaxrender"
copyright = "the authors of jaxrender, Apache-2.0"
version = release = jaxrender.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "manual",
    "mathml",
]
exclude_patterns = ["_build", "extensions", "build"]
html_theme = "furo"
html_title = f"jaxrender {release}"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["manual.css"]
html_show_sphinx = False

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist", "attrs_inline"]
myst_heading_anchors = 3

nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE / "_build" / "cells")
nb_execution_raise_on_error = True
nb_execution_timeout = 1200
nb_execution_in_temp = True
# What libraries say of the machine is no part of a page.
nb_output_stderr = "remove"

autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_typehints = "signature"

copybutton_exclude = ".linenos, .gp, .go"
