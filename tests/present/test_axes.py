"""Drawn into somebody else's axes a result shows the same curves, and nothing else of that figure changes."""

import functools
import inspect
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from studies.estimators.figure import draw_estimators
from studies.estimators.study import EstimatorTraces

import avc_casadi as avc
from avc_casadi.claims.zwidth import llewellyn_table
from avc_casadi.design.comparison.accuracy import SolverCost
from avc_casadi.diagnose.causes import diagnose
from avc_casadi.identification.identify import identify
from avc_casadi.identification.log import Columns, Record
from avc_casadi.model.gains import Gains
from avc_casadi.present import figures
from avc_casadi.present.figures.accuracy import draw_accuracy

RESULTS = Path(__file__).parents[1] / "benchmarks" / "results"
PROBLEM = avc.load_problem("figure5").changed(frequency={"points": 12})
DAMPED = avc.load_problem("damped").changed(stability={"scope": "pointwise"}, frequency={"points": 8})
COMPARISON = avc.compare(PROBLEM, ("closed-form", "exact"), mine=(7000.0, 10.0))
REGION = avc.zwidth(PROBLEM)
OF_DAMPED = avc.compare(DAMPED, ("closed-form", "exact"))
COUPLING = avc.Coupling.constant(DAMPED, Gains(0.0, 8e3, 10.0), "by hand")
RUNS = [avc.simulate("scenes/stiff-wall-pressed"), avc.simulate("scenes/free-motion")]


def _estimates():
    time = np.linspace(0.0, 6.0, 50)
    names = ("zero-crossing", "spectral-peak", "adaptive-notch", "fused")
    return EstimatorTraces(time, 3.0 + 0 * time, dict.fromkeys(names, 3.0 + 0 * time))


def _accuracy():
    return tuple(
        SolverCost(method, solver, tolerance, 9, 1.0, seconds, error, error, share, 1.0, default)
        for method, solver, tolerance, seconds, error, share, default in (
            ("exact", None, None, 1e-5, 1e-15, 1.0, False),
            ("direct", "sqpmethod-qrqp", 1e-12, 1e-4, 1e-16, 1.0, True),
            ("direct", "ipopt", 1e-4, 1e-3, 1e-5, 0.5, False),
            ("direct", "ipopt", 1e-8, 2e-3, 1e-9, 1.0, False),
        )
    )


@functools.cache
def _identified():
    random = np.random.default_rng(0)
    force = random.standard_normal(2500)
    speed = np.cumsum(force) * 1e-2
    position = np.round(np.cumsum(speed - speed.mean()) * 1e-3 / 1e-6) * 1e-6
    return identify([Record("drawn", 1e-3, position, force)])


@functools.cache
def _diagnosed():
    time = np.arange(800) * 1e-3
    position = np.round((1e-3 + 2e-4 * np.sin(2 * np.pi * 30 * time)) / 1e-5) * 1e-5
    return diagnose(Columns("still", time, position, np.zeros(800)))


CALLS = {
    "draw_accuracy": (1, lambda axes: draw_accuracy(_accuracy(), axes)),
    "draw_comparison": (3, lambda axes: figures.draw_comparison(COMPARISON, axes)),
    "draw_diagnosis": (4, lambda axes: figures.draw_diagnosis(_diagnosed(), axes)),
    "draw_estimators": (4, lambda axes: draw_estimators(_estimates(), axes)),
    "draw_identification": (6, lambda axes: figures.draw_identification(_identified(), axes)),
    "draw_loop": (4, lambda axes: figures.draw_loop(COUPLING, axes)),
    "draw_rendered": (2, lambda axes: figures.draw_rendered(COUPLING, axes)),
    "draw_perceived": (4, lambda axes: figures.draw_perceived(COMPARISON, axes)),
    "draw_perceived, damped": (5, lambda axes: figures.draw_perceived(OF_DAMPED, axes)),
    "draw_scene": (4, lambda axes: figures.draw_scene(RUNS, axes=axes)),
    "draw_zwidth": (2, lambda axes: figures.draw_zwidth(REGION, llewellyn_table(PROBLEM), axes=axes)),
    "draw_zwidth, one panel": (1, lambda axes: figures.draw_zwidth(REGION, axes=axes)),
}


def curves(axes):
    return [
        (line.get_label(), np.asarray(line.get_xdata()).tolist(), np.asarray(line.get_ydata()).tolist())
        for line in axes.lines
    ]


def look(axes):
    return (
        axes.get_title(),
        axes.get_title(loc="left"),
        axes.get_xlim(),
        axes.get_ylim(),
        axes.get_xscale(),
        axes.get_xlabel(),
        len(axes.get_children()),
        axes.get_position().bounds,
    )


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("part", [False, True], ids=["figure", "part of a figure"])
def test_the_same_curves_appear_and_nothing_else_changes(name, part):
    count, draw = CALLS[name]
    own = draw(None)
    mine = Figure(figsize=(11, 13))
    mine.suptitle("my title")
    holder = mine.subfigures(1, 2)[0] if part else mine
    *panels, other = holder.subplots(count + 1, 1)
    other.plot([0, 1], [2, 3])
    for axes in panels:
        axes.set_title("my panel")
    before = (dict(mpl.rcParams), mine.get_size_inches().tolist(), mine.get_suptitle(), look(other))
    titles = [(axes.get_title(), axes.get_title(loc="left")) for axes in panels]
    places = [axes.get_position().bounds for axes in panels]
    returned = draw(panels[0] if count == 1 else panels)
    assert returned is mine
    assert (dict(mpl.rcParams), mine.get_size_inches().tolist(), mine.get_suptitle(), look(other)) == before
    assert [(axes.get_title(), axes.get_title(loc="left")) for axes in panels] == titles
    assert [axes.get_position().bounds for axes in panels] == places
    assert not mine.legends
    assert not holder.legends
    for here, there in zip(panels, own.axes, strict=True):
        assert str(curves(here)) == str(curves(there))  # as text, where not a number is like itself
        assert (here.get_xlabel(), here.get_ylabel()) == (there.get_xlabel(), there.get_ylabel())
        assert (here.get_xscale(), here.get_yscale()) == (there.get_xscale(), there.get_yscale())
        assert len(here.patches) == len(there.patches)
        assert len(here.collections) == len(there.collections)
        np.testing.assert_allclose(here.get_xlim(), there.get_xlim())
        np.testing.assert_allclose(here.get_ylim(), there.get_ylim())
    FigureCanvasAgg(mine).draw()


@pytest.mark.thorough
@pytest.mark.parametrize("name", CALLS)
def test_another_number_of_axes_is_refused_by_the_panels(name):
    count, draw = CALLS[name]
    for wrong in {count + 1, count + 2} | ({count - 1} if count > 1 else set()):
        with pytest.raises(avc.InputError, match=f"axes: are {wrong}; allowed: {count}, one a panel"):
            draw(Figure().subplots(wrong, 1, squeeze=False))


def test_what_is_no_axes_is_refused():
    with pytest.raises(avc.InputError, match="axes: holds Figure; allowed: matplotlib Axes"):
        figures.draw_comparison(COMPARISON, Figure())
    with pytest.raises(avc.InputError, match="axes: holds int, str"):
        figures.draw_comparison(COMPARISON, [1, "a"])


def test_axes_are_taken_row_by_row_from_an_array():
    grid = Figure().subplots(2, 2)
    figures.draw_scene(RUNS, axes=grid)
    assert [axes.get_ylabel() for axes in grid.ravel()] == ["position (mm)", "force (N)", "force (N)", "energy (mJ)"]


def test_every_drawing_function_takes_axes_and_is_tried_here():
    of_studies = {draw.__name__: draw for draw in (draw_accuracy, draw_estimators)}
    drawn = of_studies | {name: getattr(figures, name) for name in dir(figures) if name.startswith("draw_")}
    assert {name.partition(",")[0] for name in CALLS} == set(drawn)
    for draw in drawn.values():
        assert "axes" in inspect.signature(draw).parameters
