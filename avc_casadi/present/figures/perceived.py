"""The paper's figure 5: perceived impedance, damping, stiffness and Re Z_h."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.present.figures.style import (
    DESIRED,
    NO_COUPLING,
    PERCEIVED,
    GivenAxes,
    Panels,
    entries_of,
    frequency_axis,
    impedance_unit,
    method_lines,
    styled,
    value_axis,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.model.problem import Model
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.present.figures.style import Line


@styled
def draw_perceived(comparison: Comparison, axes: GivenAxes = None) -> Figure:
    """Draw the perceived impedance without coupling, by the closed form and by the delivered gains, and these gains."""
    damped = comparison.structure == "damped"
    titles = [
        "(a) perceived impedance",
        f"(b) real part, {comparison.model} model",
        "(c) damping b",
        "(d) stiffness k",
        *(["(e) contact damping"] if damped else []),
    ]
    layout, height = ("ab;cd;ee", 7.4) if damped else ("ab;cd", 5.4)
    drawn = Panels.of(axes, titles, height, lambda figure: figure.subplot_mosaic(layout).values())
    panels = dict(zip("abcde", drawn.axes, strict=False))
    shown = ("closed-form", comparison.delivered)
    _magnitude(panels["a"], comparison, shown)
    damping = impedance_unit(comparison)
    gains = [
        (panels["c"], "damping_ns_per_m", f"b ({damping})"),
        (panels["d"], "stiffness_n_per_m", f"k ({comparison.units.unit('N/m')})"),
    ]
    if damped:
        gains.append((panels["e"], "contact_damping_ns_per_m", f"b_p ({damping})"))
    for panel, key, label in gains:
        _gain(panel, comparison, shown, key)
        panel.set_ylabel(label)
    limit = comparison.passive_limit_n_per_m
    if np.isfinite(limit):
        panels["d"].axhline(
            limit, color="0.45", linestyle=(0, (2, 2)), linewidth=1.0, label="passive limit of DC stiffness"
        )
    _real_part(panels["b"], comparison, shown)
    drawn.legend(entries_of(*drawn.axes), 3)
    return drawn.figure


def _curves(comparison: Comparison, shown: tuple[str, ...]) -> list[tuple[Line, ComplexArray, BoolArray]]:
    """Return each curve with the frequencies at which it exists."""
    everywhere = np.ones(comparison.frequency_hz.shape, dtype=bool)
    lines = method_lines(comparison)
    return [
        (DESIRED, comparison.target, everywhere),
        (NO_COUPLING, comparison.without_coupling, everywhere),
        *((lines[name], comparison.methods[name].impedance, comparison.methods[name].usable) for name in shown),
    ]


def _magnitude(axes: Axes, comparison: Comparison, shown: tuple[str, ...]) -> None:
    lower, upper = np.abs(comparison.lower), np.abs(comparison.upper)
    axes.fill_between(comparison.frequency_hz, lower, upper, color="0.92", zorder=1, label="feels real")
    sizes = [lower, upper]
    for line, impedance, usable in _curves(comparison, shown):
        sizes.append(np.abs(impedance))
        line.draw_where(usable, axes, comparison.frequency_hz, sizes[-1])
    value_axis(axes, *sizes)
    frequency_axis(axes, comparison.frequency_hz)
    axes.set_ylabel(f"{PERCEIVED} ({impedance_unit(comparison)})")


def _gain(axes: Axes, comparison: Comparison, shown: tuple[str, ...], key: str) -> None:
    drawn: list[FloatArray] = []
    lines = method_lines(comparison)
    for name in shown:
        gains: GainSchedule = comparison.methods[name]
        value = getattr(gains, key)
        asked = getattr(gains, f"requested_{key}", np.full(gains.rows, np.nan))
        drawn.append(np.where(gains.usable, value, asked))
        lines[name].draw_where(gains.usable, axes, comparison.frequency_hz, drawn[-1])
    frequency_axis(axes, comparison.frequency_hz)
    value_axis(axes, *drawn, wide=1.2)
    if axes.get_yscale() != "log":  # 0 has no place here, and would move the limits
        axes.axhline(0, color="0.5", linewidth=0.8, zorder=1)


def _real_part(axes: Axes, comparison: Comparison, shown: tuple[str, ...]) -> None:
    drawn = []
    for line, impedance, usable in _curves(comparison, shown):
        line.draw_where(usable, axes, comparison.frequency_hz, impedance.real, markers=20)
        drawn.append(impedance.real)
    lines = method_lines(comparison)
    other: Model = "sampled-data" if comparison.model == "paper" else "paper"
    for name in shown:
        values = np.where(comparison.methods[name].usable, comparison.judged[name].real_part[other], np.nan)
        label = f"{lines[name].label}, {other} model"
        if np.isfinite(values).any():
            lines[name].draw(axes, comparison.frequency_hz, values, linewidth=0.9, marker="", alpha=0.6, label=label)
        drawn.append(values[np.isfinite(values)])
    frequency_axis(axes, comparison.frequency_hz)
    value_axis(axes, *drawn)
    lowest, highest = axes.get_ylim()
    margin = comparison.margin_ns_per_m
    if lowest < margin:
        axes.axhspan(lowest, margin, facecolor="0.96", edgecolor="0.8", hatch="////", linewidth=0, zorder=0)
        axes.set_ylim(lowest, highest)
    axes.axhline(margin, color="0.5", linewidth=0.8, zorder=1)
    axes.set_ylabel(f"Re Zₕ ({impedance_unit(comparison)})")
