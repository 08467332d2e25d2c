"""Every axis has a label with its unit, no text covers another, and lines differ without their colours."""

import itertools

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

import avc_casadi as avc
from avc_casadi.design.comparison.comparison import with_delivered
from avc_casadi.present.figures.paper import draw_comparison, draw_perceived

DRAWERS = (draw_perceived, draw_comparison)


def hands():
    return avc.load_problem("figure5").changed(stability={"scope": "hands"}, frequency={"points": 12})


PROBLEMS = {"figure5": None, "hands": hands}


@pytest.fixture(scope="module", params=PROBLEMS)
def comparison(request):
    make = PROBLEMS[request.param]
    problem = make() if make else avc.load_problem(request.param)
    found = avc.compare(problem, mine=(7000.0, 10.0))
    if problem.stability.scope != "pointwise":
        found = with_delivered(found, problem, avc.solve(problem, "schedule"))
    return found


@pytest.fixture(scope="module", params=DRAWERS, ids=lambda draw: draw.__name__)
def figure(request, comparison):
    return request.param(comparison)


@pytest.fixture(scope="module")
def texts(figure):
    """(text, box) of every text that is really drawn, in pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    found = list(figure.texts)
    for legend in figure.legends:
        found += legend.get_texts()
    for axes in figure.axes:
        found += [axes.title, axes._left_title, axes._right_title, axes.xaxis.label, axes.yaxis.label]
        for axis in (axes.xaxis, axes.yaxis):
            labels = [tick.label1 for tick in axis._update_ticks() if tick.label1.get_visible()]
            found += [axis.get_offset_text(), *labels]
    assert all(isinstance(text, Text) for text in found)
    return [(text.get_text(), text.get_window_extent(renderer)) for text in found if text.get_text().strip()]


@pytest.mark.slow
def test_no_text_covers_another(texts):
    assert len(texts) > 15
    for (first, a), (second, b) in itertools.combinations(texts, 2):
        wide = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        assert wide <= 1 or high <= 1, f"{first!r} and {second!r} overlap by {wide:.0f} x {high:.0f} pixels"


@pytest.mark.slow
def test_no_text_leaves_the_picture(figure, texts):
    width, height = figure.bbox.size
    for text, box in texts:
        assert box.x0 >= -1, text
        assert box.y0 >= -1, text
        assert box.x1 <= width + 1, text
        assert box.y1 <= height + 1, text
