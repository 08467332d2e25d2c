"""Z-width: walls that a device renders passively or stably, the solved gains, and Llewellyn's limit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import quantity
from avc_casadi.present.figures.style import GivenAxes, Panels, entries_of, impedance_unit, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.claims.zwidth import LlewellynTable, ZWidth

_LINES: dict[str, tuple[str, Any, float]] = {
    "passive-paper": ("#d1600a", (0, (5, 1.6)), 1.4),
    "passive-sampled-data": ("#08306b", "-", 2.0),
    "passive-delayed": ("#5a9bd4", (0, (1, 1.4)), 1.6),
    "stable-released": ("#5a5a00", (0, (4, 1.5, 1, 1.5)), 1.3),
    "stable-hands": ("#1b7837", "-", 1.3),
}


@styled
def draw_zwidth(
    region: ZWidth,
    llewellyn: LlewellynTable | None = None,
    rendered: dict[str, tuple[FloatArray, FloatArray]] | None = None,
    axes: GivenAxes = None,
) -> Figure:
    """Draw the K-B region with the walls that gains render, and the largest coupling that Llewellyn allows."""
    count = 1 if llewellyn is None else 2
    panels = Panels.of(
        axes,
        ("(a) walls without coupling: stiffness below each curve", "(b) coupling for any passive wall")[:count],
        4.4,
        lambda figure: figure.subplots(1, count, squeeze=False, width_ratios=[1.7, 1][:count])[0],
    )
    _region(panels.axes[0], region, rendered or {})
    if llewellyn is not None:
        _llewellyn(panels.axes[1], llewellyn)
    panels.legend(entries_of(panels.axes[0]), 2)
    return panels.figure


def _region(axes: Axes, region: ZWidth, rendered: dict[str, tuple[FloatArray, FloatArray]]) -> None:
    damping, unit = region.damping_ns_per_m[1:], region.units.unit
    for curve in region.curves:
        colour, style, width = _LINES[curve.key]
        stiffness = curve.stiffness_n_per_m[1:]
        label = f"{curve.claim} (of {region.hands})" if curve.key == "stable-hands" else curve.claim
        if not (stiffness > 0).any():
            label = f"{label}: no wall"
        # A region ends at the largest damping that has a wall.
        ends = np.flatnonzero(np.isfinite(stiffness[:-1]) & np.isnan(stiffness[1:])) + 1
        x, y = np.insert(damping, ends, damping[ends - 1]), np.insert(stiffness, ends, 0.0)
        axes.plot(x, y, color=colour, linestyle=style, linewidth=width, label=label)
        if curve.key == "passive-sampled-data":
            axes.fill_between(damping, 0, np.nan_to_num(stiffness), color=colour, alpha=0.12, linewidth=0)
    _bounds(axes, region)
    wanted = region.wanted_stiffness_n_per_m
    lowest, highest = [], []
    if wanted > 0:
        # A wall without damping has no place on a logarithmic axis: the left edge.
        place = max(region.wanted_damping_ns_per_m, float(damping[0]))
        name = (
            f"wall wanted: {quantity(wanted, unit('N/m'))}, {quantity(region.wanted_damping_ns_per_m, unit('N.s/m'))}"
        )
        axes.plot(
            [place], [wanted], linestyle="none", marker="*", markersize=11, color="#b2182b", markeredgecolor="white",
            markeredgewidth=0.6, label=name, zorder=6, clip_on=False,
        )  # fmt: skip
        lowest, highest = [wanted], [wanted]
    for (name, (b, k)), marker in zip(rendered.items(), "o^sDv", strict=False):
        shown = (b > 0) & (k > 0)
        axes.plot(
            b[shown], k[shown], linestyle="none", marker=marker, markersize=3.4, color="0.15",
            markerfacecolor="white", markeredgewidth=0.8, label=f"walls rendered by {name}, each at its frequency",
            zorder=5,
        )  # fmt: skip
        lowest += [k[shown].min(initial=np.inf)]
        highest += [k[shown].max(initial=0.0)]
    axes.set_xscale("log")
    axes.set_yscale("log")
    curves = np.concatenate([curve.stiffness_n_per_m for curve in region.curves])
    stable = np.concatenate([c.stiffness_n_per_m for c in region.curves if c.key.startswith("stable")])
    passive = np.nan_to_num(region.passive_limit_n_per_m)
    top = max(np.nanmax(stable, initial=1.0), passive, *highest, 0.0)
    # Where no passive limit is known in closed form, that of the least region.
    summits = [top, *(np.nanmax(curve.stiffness_n_per_m, initial=0.0) for curve in region.curves)]
    bottom = min(0.3 * (passive or min(one for one in summits if one > 0)), *lowest, top)
    bottom = max(bottom, 1e-4 * top, 0.5 * np.nanmin(curves, initial=top))
    axes.set_ylim(0.7 * bottom, 2.5 * max(top, region.encoder_limit_n_per_m or 0.0))
    for line in axes.get_lines():
        highest_drawn = np.max(np.nan_to_num(np.asarray(line.get_ydata(), dtype=np.float64)), initial=0.0)
        if 0 < highest_drawn < 0.7 * bottom:
            line.set_label(f"{line.get_label()}: below, at most {quantity(highest_drawn, unit('N/m'))}")
    shown_to = [region.wanted_damping_ns_per_m, *(b[(b > 0) & (k > 0)].max(initial=0.0) for b, k in rendered.values())]
    for curve in region.curves:
        shown_to += [damping[np.nan_to_num(curve.stiffness_n_per_m[1:]) > 0].max(initial=0.0)]
    axes.set_xlim(damping[0], 1.5 * max(shown_to, default=0.0) or damping[-1])
    axes.set_xlabel(f"wall damping B ({impedance_unit(region)})")
    axes.set_ylabel(f"wall stiffness K ({unit('N/m')})")
    plain = FuncFormatter(lambda value, _: quantity(value, "", 1).strip())
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        axis.set_major_formatter(plain)
        axis.set_minor_formatter(NullFormatter())
        if high < 100 * low:
            # A scale with one label alone cannot be read.
            axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
            axis.set_minor_formatter(plain)


def _bounds(axes: Axes, region: ZWidth) -> None:
    """Draw the bounds of the literature, with their sources."""
    thin: dict[str, Any] = {"color": "0.45", "linewidth": 1.0}
    if np.isfinite(region.rule_n_per_m).any():
        rule = "linear rule (b + b_h + B)/(T/2 + t_d), Gil, Hulin et al. 2009"
        axes.plot(region.damping_ns_per_m, region.rule_n_per_m, **thin, linestyle=(0, (1, 1)), label=rule)
    spring, limit = region.passive_spring_n_per_m, region.encoder_limit_n_per_m
    if spring > 0:
        name = "passive spring 2b/((1 + 2d) T), Diolaiti et al. 2006"
        axes.axhline(spring, **thin, linestyle=(0, (6, 1.5, 1, 1.5)), label=name)
    if limit is not None:
        name = "encoder and friction 2f_c/\u0394, Abbott and Okamura 2005"
        axes.axhline(limit, **thin, linestyle=(0, (2, 2)), label=name)


def _llewellyn(axes: Axes, table: LlewellynTable) -> None:
    for values, name, key in (
        (table.paper, "paper's hold", "passive-paper"),
        (table.sampled_data, "sampled-data hold", "passive-sampled-data"),
    ):
        colour, style, width = _LINES[key]
        axes.plot(table.damping_ratio, values, color=colour, linestyle=style, linewidth=width, label=name)
        if np.isfinite(values).any():
            best = int(np.nanargmax(values))
            place = (table.damping_ratio[best], values[best])
            axes.annotate(
                f"{values[best]:.4g}", place, xytext=(3, 3), textcoords="offset points", fontsize=7.5, color=colour
            )
    # Room for the legend above the largest value and its label.
    axes.set_ylim(0, 1.6 * max(np.nanmax([table.paper, table.sampled_data], initial=0.0), 1e-3))
    some = [np.nan_to_num(values) > 0 for values in (table.paper, table.sampled_data)]
    widest = float(table.damping_ratio[some[0] | some[1]].max(initial=0.0))
    axes.set_xlim(0, min(1.3 * widest, table.damping_ratio[-1]) or table.damping_ratio[-1])
    axes.legend(loc="upper right")
    axes.set_xlabel("b_c/b_d")
    axes.set_ylabel("largest k_c T/b_d")
