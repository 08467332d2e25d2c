"""Sphinx settings of the site; `build.py` beside this file builds it."""

project = "avc-casadi"
author = "The avc-casadi developers"
extensions = ["myst_nb"]
root_doc = "index"
html_theme = "alabaster"
html_theme_options = {"description": "Adaptive virtual couplings for haptic devices", "page_width": "64em"}
html_show_sphinx = False
myst_heading_anchors = 4
suppress_warnings = ["myst.header", "misc.highlighting_failure"]
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600
nb_merge_streams = True
