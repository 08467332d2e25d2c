"""Regions in the plane of spring and damper: walls without coupling, and couplings to a simulation."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import quantity
from avc_casadi.claims.zwidth import ZWidth
from avc_casadi.design.tool_region import ToolRegion
from avc_casadi.present.figures import style

_LINES: dict[str, tuple[str, Any, float]] = {
    "passive-paper": (style.ORANGE, style.DASHED, 1.4),
    "passive-sampled-data": (style.BLUE, "-", 2.0),
    "passive-delayed": ("#5a9bd4", style.DOTTED, 1.6),
    "stable-released": (style.OLIVE, style.DASH_DOT, 1.3),
    "stable-hands": ("#1b7837", "-", 1.3),
}
_THIN: dict[str, Any] = {"color": "0.45", "linewidth": 1.0}


@style.styled
def draw_zwidth(
    region: ZWidth, rendered: dict[str, tuple[FloatArray, FloatArray]] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Draw the K-B region of walls, the bounds of the literature, and the walls that gains render."""
    panels = style.Panels.of(axes, ("walls without coupling: stiffness below each curve",), 4.4)
    (plane,), damping, unit = panels.axes, region.damping_ns_per_m[1:], region.units.unit
    shown = [np.array([region.encoder_limit_n_per_m or 0.0])]
    for curve in region.curves:
        colour, dash, width = _LINES[curve.key]
        label = f"{curve.claim} (of {region.hands})" if curve.key == "stable-hands" else curve.claim
        shown.append(curve.stiffness_n_per_m[1:])
        fill = curve.key == "passive-sampled-data"
        _curve(plane, damping, shown[-1], label, fill=fill, color=colour, linestyle=dash, linewidth=width)
    if np.isfinite(region.rule_n_per_m).any():
        rule = "linear rule (b + b_h + B)/(T/2 + t_d), Gil, Hulin et al. 2009"
        plane.plot(region.damping_ns_per_m, region.rule_n_per_m, **_THIN, linestyle=(0, (1, 1)), label=rule)
    if region.passive_spring_n_per_m > 0:
        name = "passive spring 2b/((1 + 2d) T), Diolaiti et al. 2006"
        plane.axhline(region.passive_spring_n_per_m, **_THIN, linestyle=(0, (6, 1.5, 1, 1.5)), label=name)
    if region.encoder_limit_n_per_m is not None:
        name = "encoder and friction 2f_c/Δ, Abbott and Okamura 2005"
        plane.axhline(region.encoder_limit_n_per_m, **_THIN, linestyle=(0, (2, 2)), label=name)
    widest = [region.wanted_damping_ns_per_m, *(damping[np.nan_to_num(k) > 0].max(initial=0.0) for k in shown[1:])]
    if (wanted := region.wanted_stiffness_n_per_m) > 0:
        # A wall without damping has no place on a logarithmic axis: the left edge.
        place = max(region.wanted_damping_ns_per_m, float(damping[0]))
        name = f"wall wanted: {quantity(wanted, unit('N/m'))}, {quantity(widest[0], unit('N.s/m'))}"
        look: dict[str, Any] = {"markersize": 11, "color": "#b2182b", "markeredgecolor": "white", "clip_on": False}
        plane.plot(place, wanted, "*", label=name, zorder=6, **look)
        shown.append(np.array([wanted]))
    for (name, (b, k)), marker in zip((rendered or {}).items(), "o^sDv", strict=False):
        some = (b > 0) & (k > 0)
        label, white = f"walls rendered by {name}, each at its frequency", "white"
        plane.plot(b[some], k[some], marker, color="0.15", markerfacecolor=white, markersize=3.4, label=label, zorder=5)
        shown.append(k[some])
        widest.append(b[some].max(initial=0.0))
    right = 1.5 * max(widest) or float(damping[-1])
    _plane(plane, shown, (float(damping[0]), right))
    plane.set(xlabel=f"wall damping B ({region.units.unit('N·s/m')})", ylabel=f"wall stiffness K ({unit('N/m')})")
    panels.legend(2)
    return panels.figure


@style.styled
def draw_tool_region(region: ToolRegion, axes: style.GivenAxes = None) -> Figure:
    """Draw the K-B region of a coupling to a simulation, a curve for each engine rate."""
    title = "couplings to the simulation: stable below each curve"
    title += ", with a critical damper in the device's loop" if region.local_damping_ratio else ""
    panels = style.Panels.of(axes, (title,), 4.2)
    (plane,), damping = panels.axes, region.damping_ns_per_m[1:]
    colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(region.curves)))
    shown = [one.stiffness_n_per_m[1:] for one in region.curves]
    for colour, one, stiffness in zip(colours, region.curves, shown, strict=True):
        label = f"{quantity(1 / one.step_s, 'Hz')}{' (declared)' if one.declared else ''}"
        stable = np.where(stiffness > 0, stiffness, np.nan)
        _curve(plane, damping, stable, label, fill=one.declared, color=colour, linewidth=2.4 if one.declared else 1.3)
    if region.chosen is not None:
        b, k = region.chosen.damping_ns_per_m, region.chosen.stiffness_n_per_m
        plane.plot(max(b, float(damping[0])), k, "k*", markersize=11, label="recommended")
    _plane(plane, shown, (float(damping[0]), float(damping[-1])))
    plane.set(xlabel=f"damper B ({region.units.unit('N·s/m')})", ylabel=f"spring K ({region.units.unit('N/m')})")
    panels.legend(5)
    return panels.figure


def _curve(axes: Axes, b: FloatArray, k: FloatArray, label: str, *, fill: bool, **look: Any) -> None:
    """Draw the upper end of a region, which ends at the largest damping that has a stiffness."""
    ends = np.flatnonzero(np.isfinite(k[:-1]) & np.isnan(k[1:])) + 1
    x, y = np.insert(b, ends, b[ends - 1]), np.insert(k, ends, 0.0)
    axes.plot(x, y, label=label if (np.nan_to_num(k) > 0).any() else f"{label}: none", **look)
    if fill:
        axes.fill_between(b, 0, np.nan_to_num(k), color=look["color"], alpha=0.12, linewidth=0)


def _plane(axes: Axes, shown: list[FloatArray], damping: tuple[float, float]) -> None:
    """Make both axes logarithmic, from below the lowest of the curves' summits to above the highest."""
    summits = [float(one) for one in (np.nanmax(values, initial=0.0) for values in shown) if one > 0] or [1.0]
    top = 2.5 * max(summits)
    bottom = max(0.2 * min(summits), 1e-4 * top)
    axes.set(xscale="log", yscale="log", xlim=damping, ylim=(bottom, top))
    style.log_ticks(axes.xaxis, *damping)
    style.log_ticks(axes.yaxis, bottom, top)
