"""Every axis has a label with its unit, no text covers another, and lines differ without their colours."""

import itertools

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

import avc_casadi as avc
from avc_casadi.design.comparison.comparison import with_delivered
from avc_casadi.model.gains import Gains
from avc_casadi.present.figures.deployed import opened_loop, rendered
from avc_casadi.present.figures.paper import draw_comparison, draw_perceived, errors, perceived
from avc_casadi.recommendation.rendered import deployed

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


def texts_of(figure):
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


def covering(texts):
    """Pairs of texts that cover each other by more than a pixel."""
    for (first, a), (second, b) in itertools.combinations(texts, 2):
        wide = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        if wide > 1 and high > 1:
            yield f"{first!r} and {second!r} overlap by {wide:.0f} x {high:.0f} pixels"


def leaving(figure, texts):
    """Texts that leave their picture by more than a pixel."""
    width, height = figure.bbox.size
    return [text for text, box in texts if box.x0 < -1 or box.y0 < -1 or box.x1 > width + 1 or box.y1 > height + 1]


@pytest.fixture(scope="module")
def texts(figure):
    return texts_of(figure)


@pytest.mark.slow
def test_no_text_covers_another(texts):
    assert len(texts) > 15
    assert list(covering(texts)) == []


@pytest.mark.slow
def test_no_text_leaves_the_picture(figure, texts):
    assert leaving(figure, texts) == []


@pytest.mark.slow
def test_a_panel_alone_is_legible(comparison):
    names = []
    for panel in (*perceived(comparison).panels(), *errors(comparison).panels()):
        texts = texts_of(panel.figure)
        names.append(panel.title)
        assert list(covering(texts)) == [], panel.title
        assert leaving(panel.figure, texts) == [], panel.title
    assert len(set(names)) >= 6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["reference-r1", "knob"])
def test_a_panel_of_a_deployed_coupling_alone_is_legible(name):
    problem = avc.load_problem(name)
    stiffness = 0.2 * problem.environment.stiffness_n_per_m
    responses = deployed(avc.Coupling.constant(problem, Gains(0.0, stiffness, stiffness / 100), "plain"))
    for panel in (*rendered(responses).panels(), *opened_loop(responses).panels()):
        texts = texts_of(panel.figure)
        assert list(covering(texts)) == [], panel.title
        assert leaving(panel.figure, texts) == [], panel.title
        # A curve that a legend names lies within the axes.
        (axes,) = panel.figure.axes
        for line in axes.lines:
            x, y = line.get_data()
            if len(x) > 1 and not line.get_label().startswith("_"):
                (low, high), (left, right) = sorted(axes.get_ylim()), sorted(axes.get_xlim())
                assert ((y >= low) & (y <= high) & (x >= left) & (x <= right)).any(), (panel.title, line.get_label())
