"""The paper's question: perceived impedance and gains of figure 5, errors of the methods, what accuracy costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from avc_casadi._util.arrays import BoolArray, ComplexArray
from avc_casadi.design.comparison.accuracy import SolverCost, fastest
from avc_casadi.design.comparison.comparison import Comparison
from avc_casadi.loops.wall import passive_limit_n_per_m
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Model
from avc_casadi.present.figures import style

_ROUNDING = 1e-9
"""Magnitude error, per cent, on whose line smaller ones are drawn: they are rounding."""

_UNNOTICED = 1e-2
"""Impedance error, per cent, on whose line smaller ones are drawn: they are imperceptible to a hand."""

_LEAST_ERROR = 1e-16
"""Relative error on which smaller ones are drawn."""


def _lines(comparison: Comparison) -> dict[str, style.Line]:
    """Return the line of each method, of the gains of the problem's own scope, and of one's own pair."""
    chosen = style.Line(comparison.delivered, style.GREEN, (0, (2, 1.2)), "P", 1.1, 6, 0.75)
    own_pair = style.Line("mine", style.PURPLE, (0, (3, 1, 1, 1)), "D", 1.2, 5, 0.6)
    causal = style.Line("causal, every hand", "#17818c", (0, (3, 1.2)), "d", 1.3, 6, 0.75)
    return {comparison.delivered: chosen, **style.METHODS, "mine": own_pair, "causal": causal}


def draw_perceived(comparison: Comparison) -> Figure:
    """Draw the perceived impedance without coupling, by the closed form and by the delivered gains, and these gains."""
    return perceived(comparison).figure()


def perceived(comparison: Comparison) -> style.Drawing:
    """Return the panels of the perceived impedance and of the gains."""
    problem, hz = comparison.definition, comparison.frequency_hz
    damping, model = comparison.units.unit("N·s/m"), problem.stability.model
    titles = ["perceived impedance", f"real part, {model} model", "damping b", "stiffness k"]
    gains = [("damping_ns_per_m", f"b ({damping})"), ("stiffness_n_per_m", f"k ({comparison.units.unit('N/m')})")]
    layout, height = "ab;cd", 5.4
    if problem.coupling.structure == "damped":
        layout, height = "ab;cd;ee", 7.4
        titles.append("contact damping")
        gains.append(("contact_damping_ns_per_m", f"b_p ({damping})"))
    limit = passive_limit_n_per_m(problem.device)

    def paint(panels: Sequence[Axes]) -> None:
        magnitude, real, *gain_panels = panels
        _impedances(magnitude, real, comparison)
        for panel, (key, label) in zip(gain_panels, gains, strict=True):
            _gains(panel, comparison, key, label)
        if np.isfinite(limit):
            look: dict[str, Any] = {"color": "0.45", "linestyle": (0, (2, 2)), "linewidth": 1.0}
            gain_panels[1].axhline(limit, label="passive limit of DC stiffness", **look)
        for panel in panels:
            style.frequency_axis(panel, hz)

    return style.Drawing(titles, height, layout, 3, paint)


def _shown(comparison: Comparison) -> dict[str, GainSchedule]:
    """Return the methods that are drawn: the closed form and the delivered gains."""
    return {name: comparison.methods[name] for name in ("closed-form", comparison.delivered)}


def _impedances(perceived: Axes, real: Axes, comparison: Comparison) -> None:
    """Draw magnitude and real part of the perceived impedance, and the band that feels real."""
    hz = comparison.frequency_hz
    lines = _lines(comparison)
    shown = _shown(comparison)
    everywhere = np.ones(hz.shape, dtype=bool)
    curves: list[tuple[style.Line, ComplexArray, BoolArray]] = [
        (style.Line("desired", "0.78", "-", "", 4.5, 2, 0.0), comparison.target, everywhere),
        (style.Line("no coupling", "0.35", style.DOTTED, "", 1.4, 3, 0.0), comparison.without_coupling, everywhere),
        *((lines[name], method.impedance, method.usable) for name, method in shown.items()),
    ]
    if comparison.causal is not None:
        curves.append((lines["causal"], comparison.causal.impedance, everywhere))
    lower, upper = np.abs(comparison.lower), np.abs(comparison.upper)
    perceived.fill_between(hz, lower, upper, color="0.92", zorder=1, label="feels real")
    sizes = [np.abs(impedance) for _, impedance, _ in curves]
    for (line, impedance, usable), size in zip(curves, sizes, strict=True):
        line.draw_where(usable, perceived, hz, size)
        line.draw_where(usable, real, hz, impedance.real, markers=20)
    style.value_axis(perceived, lower, upper, *sizes)
    perceived.set_ylabel(f"{style.PERCEIVED} ({comparison.units.unit('N·s/m')})")
    real_parts = [impedance.real for _, impedance, _ in curves]
    _real_part(real, comparison, real_parts, {name: lines[name] for name in shown})


def _gains(panel: Axes, comparison: Comparison, key: str, label: str) -> None:
    """Draw one gain of the closed form, of the delivered gains, and of the causal coupling where it has it."""
    hz = comparison.frequency_hz
    lines = _lines(comparison)
    causal = comparison.causal
    drawn = []
    for name, method in _shown(comparison).items():
        requested = getattr(method, f"requested_{key}", np.full(method.rows, np.nan))
        values = np.where(method.usable, getattr(method, key), requested)
        lines[name].draw_where(method.usable, panel, hz, values)
        drawn.append(values)
    if causal is not None and hasattr(causal, key):
        values = np.where(causal.usable, getattr(causal, key), np.nan)
        lines["causal"].draw(panel, hz, values)
        drawn.append(values)
    style.value_axis(panel, *drawn, wide=1.2)
    panel.set_ylabel(label)
    if panel.get_yscale() != "log":  # 0 has no place here, and would move the limits
        panel.axhline(0, color="0.5", linewidth=0.8, zorder=1)


def _real_part(axes: Axes, comparison: Comparison, drawn: list[np.ndarray], lines: dict[str, style.Line]) -> None:
    """Draw Re Z in the model that is not the problem's too, and the part that (12) forbids."""
    second_model: Model = "sampled-data" if comparison.definition.stability.model == "paper" else "paper"
    for name, line in lines.items():
        values = np.where(comparison.methods[name].usable, comparison.judged[name].real_part[second_model], np.nan)
        label = f"{line.label}, {second_model} model"
        if np.isfinite(values).any():
            line.draw(axes, comparison.frequency_hz, values, linewidth=0.9, marker="", alpha=0.6, label=label)
        drawn.append(values)
    style.value_axis(axes, *drawn)
    lowest, highest = axes.get_ylim()
    margin = comparison.definition.stability.margin_ns_per_m
    if lowest < margin:
        axes.axhspan(lowest, margin, facecolor="0.96", edgecolor="0.8", hatch="////", linewidth=0, zorder=0)
        axes.set_ylim(lowest, highest)
    axes.axhline(margin, color="0.5", linewidth=0.8, zorder=1)
    axes.set_ylabel(f"Re Zₕ ({comparison.units.unit('N·s/m')})")


def draw_comparison(comparison: Comparison) -> Figure:
    """Draw the magnitude error and the impedance error at each frequency."""
    return errors(comparison).figure()


def errors(comparison: Comparison) -> style.Drawing:
    """Return the panels of the magnitude error and of the impedance error."""
    titles = (
        "the goal (11); 1e-9 % and less is rounding",
        f"magnitude and phase; {_UNNOTICED:g} % and less drawn as such",
    )
    return style.Drawing(titles, 5.8, "a;b", 3, lambda panels: _errors(panels[0], panels[1], comparison))


def _errors(magnitude: Axes, complex_: Axes, comparison: Comparison) -> None:
    """Draw the magnitude error and the impedance error of each method over frequency."""
    hz, lines = comparison.frequency_hz, _lines(comparison)
    size = np.abs(comparison.target)
    by_method = {
        name: (method.magnitude_error, method.complex_error, method.usable)
        for name, method in comparison.methods.items()
    }
    causal = comparison.causal
    if causal is not None:
        by_method["causal"] = causal.magnitude_error, causal.complex_error, np.ones(hz.shape, dtype=bool)
    for name, (of_magnitude, of_impedance, usable) in by_method.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 100 * of_magnitude / size
        lines[name].draw_where(usable, magnitude, hz, np.maximum(share, _ROUNDING))
        lines[name].draw_where(usable, complex_, hz, np.maximum(100 * of_impedance, _UNNOTICED))
    for panel, floor, label in (
        (magnitude, _ROUNDING, f"error of {style.PERCEIVED} (%)"),
        (complex_, _UNNOTICED, "impedance error (%)"),
    ):
        panel.set(yscale="log", ylabel=label)
        panel.set_ylim(floor / 3, max(panel.get_ylim()[1], 1.0))
        style.log_ticks(panel.yaxis, *panel.get_ylim())
        style.frequency_axis(panel, hz)


@style.styled
def draw_accuracy(costs: Sequence[SolverCost]) -> Figure:
    """Draw time against error; open markers where some frequency is not at the optimum."""
    figure = style.panels(("",), 4.8)
    (work,) = figure.axes
    looks: dict[str, tuple[Any, str]] = {name: (line.colour, line.marker) for name, line in style.METHODS.items()}
    groups: dict[str, list[SolverCost]] = {"closed-form": [], "exact": []}
    for cost in costs:
        groups.setdefault(cost.method if cost.solver is None else f"direct, {cost.solver}", []).append(cost)
    for place, (label, group) in enumerate(groups.items()):
        colour, marker = looks.get(label, (colormaps["tab10"](place % 10), "ov<>DPXsh"[place % 9]))
        by_tolerance = sorted(group, key=lambda cost: -(cost.tolerance or 0.0))
        not_everywhere = [cost for cost in by_tolerance if cost.optimal_share < 1]
        work.plot(*_points(by_tolerance), color=colour, marker=marker, label=label, linewidth=1.0)
        look: dict[str, Any] = {"linestyle": "none", "markerfacecolor": "white"}
        work.plot(*_points(not_everywhere), color=colour, marker=marker, label="_", **look)
    front = [cost for cost, best in zip(costs, fastest(costs), strict=True) if best]
    front.sort(key=lambda cost: cost.seconds_per_frequency)
    work.plot(*_points(front), color="0.2", linestyle=(0, (2, 2)), linewidth=0.9, label="nearest to the optimum")
    work.plot([], [], "o", color="0.2", markerfacecolor="white", label="not everywhere")
    work.set(xscale="log", yscale="log", ylabel="time a frequency (µs)")
    work.set_xlabel(f"largest error of {style.PERCEIVED} beyond the optimum's, relative")
    for axis, ends in ((work.xaxis, work.get_xlim()), (work.yaxis, work.get_ylim())):
        style.log_ticks(axis, *ends)
    return style.with_legend(figure, 3)


def _points(costs: Sequence[SolverCost]) -> tuple[list[float], list[float]]:
    """Return error and time, us, of each cost whose error is known."""
    known = [cost for cost in costs if cost.largest_excess_error is not None]
    errors = [max(cost.largest_excess_error or 0.0, _LEAST_ERROR) for cost in known]
    return errors, [1e6 * cost.seconds_per_frequency for cost in known]
