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
from avc_casadi.model.problem import Model
from avc_casadi.present.figures import style

# Smaller errors, in per cent, are drawn on this line: they are rounding, imperceptible to a hand.
_ROUNDING, _UNNOTICED = 1e-9, 1e-2


def _lines(comparison: Comparison) -> dict[str, style.Line]:
    """Return the line of each method, of the gains of the problem's own scope, and of one's own pair."""
    chosen = style.Line(comparison.delivered, style.GREEN, (0, (2, 1.2)), "P", 1.1, 6, 0.75)
    mine = style.Line("mine", style.PURPLE, (0, (3, 1, 1, 1)), "D", 1.2, 5, 0.6)
    causal = style.Line("causal, every hand", "#17818c", (0, (3, 1.2)), "d", 1.3, 6, 0.75)
    return {comparison.delivered: chosen, **style.METHODS, "mine": mine, "causal": causal}


@style.styled
def draw_perceived(comparison: Comparison) -> Figure:
    """Draw the perceived impedance without coupling, by the closed form and by the delivered gains, and these gains."""
    stated, hz, lines = comparison.definition, comparison.frequency_hz, _lines(comparison)
    damping, model = comparison.units.unit("N·s/m"), stated.stability.model
    titles = ["(a) perceived impedance", f"(b) real part, {model} model", "(c) damping b", "(d) stiffness k"]
    gains = [("damping_ns_per_m", f"b ({damping})"), ("stiffness_n_per_m", f"k ({comparison.units.unit('N/m')})")]
    layout, height = "ab;cd", 5.4
    if stated.coupling.structure == "damped":
        layout, height = "ab;cd;ee", 7.4
        titles.append("(e) contact damping")
        gains.append(("contact_damping_ns_per_m", f"b_p ({damping})"))
    figure = style.panels(titles, height, layout)
    perceived, real, *others = figure.axes
    everywhere = np.ones(hz.shape, dtype=bool)
    shown = {name: comparison.methods[name] for name in ("closed-form", comparison.delivered)}
    curves: list[tuple[style.Line, ComplexArray, BoolArray]] = [
        (style.Line("desired", "0.78", "-", "", 4.5, 2, 0.0), comparison.target, everywhere),
        (style.Line("no coupling", "0.35", style.DOTTED, "", 1.4, 3, 0.0), comparison.without_coupling, everywhere),
        *((lines[name], one.impedance, one.usable) for name, one in shown.items()),
    ]
    if (causal := comparison.causal) is not None:
        curves.append((lines["causal"], causal.impedance, everywhere))
    sizes = [np.abs(comparison.lower), np.abs(comparison.upper), *(np.abs(one) for _, one, _ in curves)]
    perceived.fill_between(hz, sizes[0], sizes[1], color="0.92", zorder=1, label="feels real")
    for (line, impedance, usable), size in zip(curves, sizes[2:], strict=True):
        line.draw_where(usable, perceived, hz, size)
        line.draw_where(usable, real, hz, impedance.real, markers=20)
    style.value_axis(perceived, *sizes)
    perceived.set_ylabel(f"{style.PERCEIVED} ({damping})")
    _real_part(real, comparison, [impedance.real for _, impedance, _ in curves], {one: lines[one] for one in shown})
    for panel, (key, label) in zip(others, gains, strict=True):
        drawn = []
        for name, one in shown.items():
            wanted = getattr(one, f"requested_{key}", np.full(one.rows, np.nan))
            drawn.append(np.where(one.usable, getattr(one, key), wanted))
            lines[name].draw_where(one.usable, panel, hz, drawn[-1])
        if causal is not None and hasattr(causal, key):
            drawn.append(np.where(causal.usable, getattr(causal, key), np.nan))
            lines["causal"].draw(panel, hz, drawn[-1])
        style.value_axis(panel, *drawn, wide=1.2)
        panel.set_ylabel(label)
        if panel.get_yscale() != "log":  # 0 has no place here, and would move the limits
            panel.axhline(0, color="0.5", linewidth=0.8, zorder=1)
    if np.isfinite(limit := passive_limit_n_per_m(stated.device)):
        look: dict[str, Any] = {"color": "0.45", "linestyle": (0, (2, 2)), "linewidth": 1.0}
        others[1].axhline(limit, label="passive limit of DC stiffness", **look)
    for panel in figure.axes:
        style.frequency_axis(panel, hz)
    return style.with_legend(figure, 3)


def _real_part(axes: Axes, comparison: Comparison, drawn: list[np.ndarray], lines: dict[str, style.Line]) -> None:
    """Draw Re Z in the model that is not the problem's too, and the part that (12) forbids."""
    other: Model = "sampled-data" if comparison.definition.stability.model == "paper" else "paper"
    for name, line in lines.items():
        values = np.where(comparison.methods[name].usable, comparison.judged[name].real_part[other], np.nan)
        label = f"{line.label}, {other} model"
        if np.isfinite(values).any():
            line.draw(axes, comparison.frequency_hz, values, linewidth=0.9, marker="", alpha=0.6, label=label)
        drawn.append(values)
    style.value_axis(axes, *drawn)
    (lowest, highest), margin = axes.get_ylim(), comparison.definition.stability.margin_ns_per_m
    if lowest < margin:
        axes.axhspan(lowest, margin, facecolor="0.96", edgecolor="0.8", hatch="////", linewidth=0, zorder=0)
        axes.set_ylim(lowest, highest)
    axes.axhline(margin, color="0.5", linewidth=0.8, zorder=1)
    axes.set_ylabel(f"Re Zₕ ({comparison.units.unit('N·s/m')})")


@style.styled
def draw_comparison(comparison: Comparison) -> Figure:
    """Draw the magnitude error and the impedance error at each frequency."""
    titles = (
        "(a) the goal (11); 1e-9 % and less is rounding",
        f"(b) magnitude and phase; {_UNNOTICED:g} % and less drawn as such",
    )
    figure = style.panels(titles, 5.8, "a;b")
    magnitude, complex_ = figure.axes
    hz, lines, size = comparison.frequency_hz, _lines(comparison), np.abs(comparison.target)
    errors = {name: (one.magnitude_error, one.complex_error, one.usable) for name, one in comparison.methods.items()}
    if (causal := comparison.causal) is not None:
        errors["causal"] = causal.magnitude_error, causal.complex_error, np.ones(hz.shape, dtype=bool)
    for name, (of_magnitude, of_impedance, usable) in errors.items():
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
    return style.with_legend(figure, 3)


@style.styled
def draw_accuracy(costs: Sequence[SolverCost]) -> Figure:
    """Draw time against error; open markers where some frequency is not at the optimum."""
    figure = style.panels(("",), 4.8)
    (work,) = figure.axes
    looks: dict[str, tuple[Any, str]] = {name: (one.colour, one.marker) for name, one in style.METHODS.items()}
    groups: dict[str, list[SolverCost]] = {"closed-form": [], "exact": []}
    for one in costs:
        groups.setdefault(one.method if one.solver is None else f"direct, {one.solver}", []).append(one)
    for place, (label, group) in enumerate(groups.items()):
        colour, marker = looks.get(label, (colormaps["tab10"](place % 10), "ov<>DPXsh"[place % 9]))
        known = sorted(group, key=lambda one: -(one.tolerance or 0.0))
        for name, some, look in (
            (label, known, {"linewidth": 1.0}),
            ("_", [one for one in known if one.optimal_share < 1], {"linestyle": "none", "markerfacecolor": "white"}),
        ):
            work.plot(*_points(some), color=colour, marker=marker, label=name, **look)
    front = [one for one, best in zip(costs, fastest(costs), strict=True) if best]
    front.sort(key=lambda one: one.seconds_per_frequency)
    work.plot(*_points(front), color="0.2", linestyle=(0, (2, 2)), linewidth=0.9, label="nearest to the optimum")
    work.plot([], [], "o", color="0.2", markerfacecolor="white", label="not everywhere")
    work.set(xscale="log", yscale="log", ylabel="time a frequency (µs)")
    work.set_xlabel(f"largest error of {style.PERCEIVED} beyond the optimum's, relative")
    for axis, ends in ((work.xaxis, work.get_xlim()), (work.yaxis, work.get_ylim())):
        style.log_ticks(axis, *ends)
    return style.with_legend(figure, 3)


def _points(costs: Sequence[SolverCost]) -> tuple[list[float], list[float]]:
    known = [one for one in costs if one.largest_excess_error is not None]
    errors = [max(one.largest_excess_error or 0.0, 1e-16) for one in known]
    return errors, [1e6 * one.seconds_per_frequency for one in known]
