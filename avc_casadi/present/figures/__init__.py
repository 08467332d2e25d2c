"""Figures: drawn from results that are computed elsewhere.

Each ``draw_*`` takes a result, or a list of runs, and returns a Matplotlib figure; `save_figure` writes it:

    figure = avc.figures.draw_zwidth(avc.zwidth("figure5"))
    avc.figures.save_figure(figure, Path("walls.pdf"))    # or .png, .svg
"""

from avc_casadi.present.figures.admittance import draw_mass_width as draw_mass_width
from avc_casadi.present.figures.deployed import draw_loop as draw_loop
from avc_casadi.present.figures.deployed import draw_rendered as draw_rendered
from avc_casadi.present.figures.deployed import draw_tool_region as draw_tool_region
from avc_casadi.present.figures.deployed import draw_zwidth as draw_zwidth
from avc_casadi.present.figures.law_region import draw_law_region as draw_law_region
from avc_casadi.present.figures.paper import draw_accuracy as draw_accuracy
from avc_casadi.present.figures.paper import draw_comparison as draw_comparison
from avc_casadi.present.figures.paper import draw_perceived as draw_perceived
from avc_casadi.present.figures.style import save_figure as save_figure
from avc_casadi.present.figures.traces import draw_diagnosis as draw_diagnosis
from avc_casadi.present.figures.traces import draw_identification as draw_identification
from avc_casadi.present.figures.traces import draw_scene as draw_scene
