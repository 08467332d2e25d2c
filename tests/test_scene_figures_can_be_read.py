"""Figures of runs: units on every axis, runs told apart without colour, and no run that flattens the others."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scene_reference import scene_problem

from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import NO_COUPLING, Gains
from avc_casadi.present.figures.scene import draw_scene

EFFECTS = ('kind = "hand"', 'kind = "wall"')


@pytest.fixture(scope="module")
def runs():
    problem = scene_problem(EFFECTS)
    return [simulate(problem, gains) for gains in (Gains(10.0, 7e3), Gains(200.0, 1e5), NO_COUPLING)]


@pytest.fixture(scope="module")
def figure(runs):
    return draw_scene(runs, ["soft", "stiff", "bare"])


def test_every_axis_names_its_unit(figure):
    assert len(figure.axes) == 4
    for axes in figure.axes:
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert label.endswith((" (s)", " (mm)", " (N)", " (mJ)"))
        assert axes.get_title("left")


def test_runs_differ_without_their_colours(figure):
    force = figure.axes[1]
    looks = {
        (str(line.get_linestyle()), line._unscaled_dash_pattern, line.get_linewidth()) for line in force.get_lines()
    }
    assert len(looks) == 3


def test_an_unstable_run_does_not_flatten_the_others(figure, runs):
    _, force, loop, energy = figure.axes
    strongest = max(run.force_n.max() for run in runs[:2])
    assert runs[2].force_n.max() > 3 * strongest
    for axes in (force, loop):
        assert strongest < axes.get_ylim()[1] < 2 * strongest
    assert energy.get_ylim()[1] < 3e3 * max(run.ledger.absorbed_j.max() for run in runs[:2])


@pytest.mark.thorough
def test_no_text_covers_another(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = [figure.legends[0].get_window_extent(renderer)]
    for axes in figure.axes:
        boxes += [text.get_window_extent(renderer) for text in (axes._left_title, axes.xaxis.label, axes.yaxis.label)]
    for index, one in enumerate(boxes):
        assert not any(one.overlaps(other) for other in boxes[index + 1 :])


@pytest.mark.thorough
@pytest.mark.parametrize("scene", ["duration_s = 1e-3\n", "duration_s = 0.05\n"])
def test_runs_without_contact_or_length_are_drawn(scene):
    figure = draw_scene([simulate(scene_problem(EFFECTS, scene=scene), Gains(10.0, 7e3))])
    FigureCanvasAgg(figure).draw()
    assert all(np.isfinite(axes.get_ylim()).all() for axes in figure.axes)


def test_a_run_that_flies_off_is_drawn():
    effects = ('kind = "hand"', 'kind = "environment"')
    run = simulate(scene_problem(effects, k_e=1e7), NO_COUPLING)
    assert run.judgement.diverged
    FigureCanvasAgg(draw_scene([run])).draw()
