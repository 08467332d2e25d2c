"""The frontier figure shows what the kept results say."""

import json
from pathlib import Path

import numpy as np
import pytest
from studies.table1.frontier_figure import draw_frontier

from avc_casadi.present.figures.layout import save_figure

RESULTS = Path(__file__).parent / "benchmarks" / "results"


@pytest.fixture(scope="module")
def document():
    return json.loads((RESULTS / "frontier.json").read_text(encoding="utf-8"))


def axes_of(figure):
    return {axes.get_title(loc="left")[:3]: axes for part in figure.subfigs for axes in part.axes}


@pytest.mark.thorough
def test_panels_hold_the_numbers(document, tmp_path):
    figure = draw_frontier(document)
    panels = axes_of(figure)
    assert set(panels) == {"(a)", "(b)", "(c)", "(d)"}
    cells = document["cells"]
    drawn = {line.get_label(): line for line in panels["(a)"].get_lines()}
    for margin, x, y in zip((-4, -2, 0, 1, 2, 4, 6), *drawn["schedule, contact damper"].get_data(), strict=True):
        cell = cells[f"schedule, damped, margin {margin}"]
        assert y == pytest.approx(100 * cell["stable"] / cell["people"])
        assert x == pytest.approx(100 * cell["stiffness_share"]["median"])
    curves = {line.get_label(): line for line in panels["(b)"].get_lines()}
    constant = curves["constant, contact damper"].get_ydata()
    assert constant == pytest.approx(100 * np.array(cells["static-tuned, damped, margin 6"]["physical_error"]))
    low, high = panels["(b)"].get_ylim()
    assert all(low < np.min(curve.get_ydata()) and np.max(curve.get_ydata()) < high for curve in curves.values())
    bars = [patch.get_width() for patch in panels["(d)"].patches]
    ablations = [cell for name, cell in cells.items() if name.startswith("ablation") and "stable" in cell]
    assert sorted(bars) == sorted(cell["error_within_hz"]["physical"] for cell in ablations)
    save_figure(figure, tmp_path / "frontier.png")
    assert (tmp_path / "frontier.png").stat().st_size > 10_000


def test_an_unfinished_study_is_drawn_as_far_as_it_goes(document):
    few = {name: cell for name, cell in document["cells"].items() if name in {"none", "limit, set A"}}
    panels = axes_of(draw_frontier({"about": document["about"], "cells": few}))
    assert len(panels["(d)"].patches) == 0


def test_the_schedule_is_never_worse_than_constant_gains(document):
    cells = document["cells"]
    for structure in ("damped", "series"):
        for margin in (0, 1, 2, 4, 6):
            constant, schedule = (
                cells[f"{name}, {structure}, margin {margin}"] for name in ("static-tuned", "schedule")
            )
            assert schedule["stable"] >= constant["stable"]
            assert schedule["stiffness_share"]["median"] >= constant["stiffness_share"]["median"] - 1e-3
            assert schedule["error_within_hz"]["physical"] >= constant["error_within_hz"]["physical"]
