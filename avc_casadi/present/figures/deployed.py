"""The deployed coupling: rendered against wanted, its loop with its margins, and the region of stable ones."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import quantity
from avc_casadi.claims.zwidth import ZWidth
from avc_casadi.coupling import Coupling
from avc_casadi.design.tool_region import ToolRegion
from avc_casadi.present.figures import style
from avc_casadi.recommendation.felt import STRIKES_M_PER_S, Deployed, deployed

_LINES: dict[str, dict[str, Any]] = {
    "wanted": {"color": "0.72", "linewidth": 4.0, "zorder": 2},
    "worst": {"color": style.BLUE, "linewidth": 1.5, "zorder": 5},
    "released": {"color": style.ORANGE, "linewidth": 1.4, "linestyle": style.DASHED, "zorder": 6},
    "others": {"color": "0.6", "linewidth": 0.6, "zorder": 3},
    "zero": {"color": "0.5", "linewidth": 0.8, "zorder": 1},
    "gain": {"color": style.PURPLE, "linewidth": 2.2, "zorder": 7},
    "phase": {"color": style.GREEN, "linewidth": 2.2, "zorder": 7, "markersize": 3.5},
}


@style.styled
def draw_rendered(found: Deployed | Coupling) -> Figure:
    """Draw rendered against wanted: dynamic stiffness at the handle, and presses against time."""
    found = found if isinstance(found, Deployed) else deployed(found)
    titles = ("(a) stiffness by sinusoidal excitation", "(b) simulated hands press, approach cut")
    figure = style.panels(titles, 2.9, "ab")
    problem, response, (left, press) = found.coupling.problem, found.shaken, figure.axes
    wall, hz = problem.environment, found.shaken.frequency_hz
    wanted = np.abs(wall.stiffness_n_per_m + 2j * np.pi * hz * wall.damping_ns_per_m)
    left.plot(hz, response.stiffness_n_per_m, label="rendered", marker="o", markerfacecolor="white", **_LINES["worst"])
    left.plot(hz, wanted, label="wanted", **_LINES["wanted"])
    every = np.concatenate([wanted, response.stiffness_n_per_m])
    every = every[np.isfinite(every) & (every > 0)]
    if every.size and every.max() > 3 * np.median(every):  # rendered far beyond most of what is wanted
        left.set_yscale("log")
        style.log_ticks(left.yaxis, *left.get_ylim())
    else:
        left.set_ylim(0, 1.1 * float(every.max(initial=1.0)))
    left.set_ylabel(f"stiffness ({problem.units.unit('N/m')})")
    style.frequency_axis(left, hz)
    press.plot(found.press_s, 1e3 * np.delete(found.press_m, found.worst, axis=0).T, label="_", **_LINES["others"])
    press.plot([], [], label="other hands of the box", **_LINES["others"])
    press.plot(found.press_s, 1e3 * found.press_m[found.worst], label="least damped hand", **_LINES["worst"])
    spring = float(np.atleast_1d(found.hands.stiffness_n_per_m)[found.worst])
    if wall.stiffness_n_per_m > 0:
        aim_mm = 10.0 / problem.device.metres_per_unit
        press.axhline(aim_mm * spring / (wall.stiffness_n_per_m + spring), label="wanted", **_LINES["wanted"])
    press.axhline(0, **_LINES["zero"])
    deepest = float(np.max(1e3 * found.press_m, initial=0.0))
    if np.isfinite(deepest) and deepest > 0:
        press.set_ylim(-0.6 * deepest, 1.15 * deepest)
    unit = problem.units.unit("mm")
    press.set(xlim=(0, found.press_s[-1]), xlabel="time (s)", ylabel=f"depth in the wall ({unit})")
    return style.with_legend(figure, 4)


@style.styled
def draw_loop(found: Deployed | Coupling) -> Figure:
    """Draw the loop opened at the actuator, Bode and Nyquist with gain and phase margin, and the impact on the wall."""
    found = found if isinstance(found, Deployed) else deployed(found)
    titles = ("(a) |L|, 0.01 to 100", "(b) Nyquist plot, near -1", "(c) phase of L", "(d) impact on the wall, linear")
    figure = style.panels(titles, 5.6, "ab;cd")
    size, circle, phase, struck = figure.axes
    others = [(row, "others", "_") for row in range(len(found.gain) - 1) if row != found.worst]
    for row, kind, label in [(found.worst, "worst", "least damped hand"), (-1, "released", "released"), *others]:
        curve, look = found.gain[row], _LINES[kind]
        size.plot(found.frequency_hz, np.abs(curve), label=label, **look)
        degrees = np.degrees(np.unwrap(np.angle(curve)))
        phase.plot(found.frequency_hz, degrees - 360 * np.ceil(degrees[0] / 360), label=label, **look)
        circle.plot(curve.real, curve.imag, label=label, **look)
    _margins(size, circle, phase, found)
    shown = found.frequency_hz[found.frequency_hz >= min(1.0, found.frequency_hz[-1] / 100)]
    for panel in (size, phase):
        style.frequency_axis(panel, shown)
    size.set(yscale="log", ylim=(0.01, 100), ylabel="|L|")
    style.log_ticks(size.yaxis, *size.get_ylim())
    size.axhline(1, **_LINES["zero"])
    phase.set(ylim=(-360, 0), yticks=range(-360, 1, 90), ylabel="phase (deg)")
    phase.axhline(-180, **_LINES["zero"])
    around = np.linspace(0, 2 * np.pi, 200)
    circle.plot(np.cos(around), np.sin(around), **_LINES["zero"])
    circle.plot([-1], [0], marker="+", markersize=9, color="black", zorder=8)
    # In a panel of this shape the circle is round.
    circle.set(xlim=(-3.2, 2.0), ylim=(-1.7, 1.7), xlabel="Re L", ylabel="Im L")
    device, units = found.coupling.problem.device, found.coupling.problem.units
    for row, look in ((found.worst, _LINES["worst"]), (-1, _LINES["released"])):
        struck.plot(found.struck_s, 1e3 * found.struck_m[row], **look)
    struck.plot([], [], label="other hands of the box", **_LINES["others"])
    struck.axhline(0, **_LINES["zero"])
    speed = quantity(STRIKES_M_PER_S[0] / device.metres_per_unit, units.unit("m/s"))
    label = f"position ({units.unit('mm')}), impact at {speed}"
    struck.set(xlim=(0, found.struck_s[-1]), xlabel="time (s)", ylabel=label)
    return style.with_legend(figure, 3)


def _margins(size: Axes, circle: Axes, phase: Axes, found: Deployed) -> None:
    """Draw the smallest gain and phase margin of all loops."""
    released, worst = found.loop.margins()
    gain, gain_hz = min((released.gain, released.gain_hz), (worst.gain, worst.gain_hz))
    turn, turn_hz = min((released.phase_deg, released.phase_hz), (worst.phase_deg, worst.phase_hz))
    if np.isfinite(gain) and gain > 1:
        label = f"gain margin {gain:.3g} ({20 * np.log10(gain):.1f} dB)"
        size.plot([gain_hz] * 2, [1 / gain, 1], label=label, **_LINES["gain"])
        circle.plot([-1, -1 / gain], [0, 0], **_LINES["gain"])
    if np.isfinite(turn) and turn > 0:
        # The side of -180 on which the curve lies whose magnitude is nearest to 1.
        there = found.gain[:, int(np.argmin(np.abs(found.frequency_hz - turn_hz)))]
        nearest = there[int(np.argmin(np.abs(np.log(np.abs(there)))))]
        end = -180 + (turn if np.degrees(np.angle(nearest)) % 360 > 180 else -turn)
        phase.plot([turn_hz] * 2, [-180, end], "o-", label=f"phase margin {turn:.3g} deg", **_LINES["phase"])
        arc = np.radians(np.linspace(-180, end, 30))
        circle.plot(np.cos(arc), np.sin(arc), **_LINES["phase"])


_CURVES: dict[str, tuple[str, Any, float]] = {
    "passive-paper": (style.ORANGE, style.DASHED, 1.4),
    "passive-sampled-data": (style.BLUE, "-", 2.0),
    "passive-delayed": ("#5a9bd4", style.DOTTED, 1.6),
    "stable-released": (style.OLIVE, style.DASH_DOT, 1.3),
    "stable-hands": ("#1b7837", "-", 1.3),
}
_THIN: dict[str, Any] = {"color": "0.45", "linewidth": 1.0}


@style.styled
def draw_zwidth(region: ZWidth) -> Figure:
    """Draw the K-B region of walls, and the bounds of the literature."""
    figure = style.panels(("walls without coupling: stiffness below each curve",), 4.4)
    (plane,), damping, unit = figure.axes, region.damping_ns_per_m[1:], region.units.unit
    shown = [np.array([region.encoder_limit_n_per_m or 0.0])]
    for curve in region.curves:
        colour, dash, width = _CURVES[curve.key]
        label = f"{curve.claim} (of {region.hands})" if curve.key == "stable-hands" else curve.claim
        shown.append(curve.stiffness_n_per_m[1:])
        fill = curve.key == "passive-sampled-data"
        _curve(plane, damping, shown[-1], label, fill=fill, color=colour, linestyle=dash, linewidth=width)
    if np.isfinite(region.rule_n_per_m).any():
        rule = "linear rule (b + b_h + B)/(T/2 + t_d), Gil, Hulin et al. 2009"
        plane.plot(region.damping_ns_per_m, region.rule_n_per_m, **_THIN, linestyle=(0, (1, 1)), label=rule)
    for limit, name, dash in (
        (region.passive_spring_n_per_m, "passive spring 2b/((1 + 2d) T), Diolaiti et al. 2006", (6, 1.5, 1, 1.5)),
        (region.encoder_limit_n_per_m, "encoder and friction 2f_c/Δ, Abbott and Okamura 2005", (2, 2)),
    ):
        if limit:
            plane.axhline(limit, **_THIN, linestyle=(0, dash), label=name)
    widest = [region.target_damping_ns_per_m, *(damping[np.nan_to_num(k) > 0].max(initial=0.0) for k in shown[1:])]
    if (wanted := region.target_stiffness_n_per_m) > 0:
        # A wall without damping has no place on a logarithmic axis: the left edge.
        place = max(region.target_damping_ns_per_m, float(damping[0]))
        name = f"wall wanted: {quantity(wanted, unit('N/m'))}, {quantity(widest[0], unit('N.s/m'))}"
        look: dict[str, Any] = {"markersize": 11, "color": "#b2182b", "markeredgecolor": "white", "clip_on": False}
        plane.plot(place, wanted, "*", label=name, zorder=6, **look)
        shown.append(np.array([wanted]))
    right = 1.5 * max(widest) or float(damping[-1])
    _plane(plane, shown, (float(damping[0]), right))
    plane.set(xlabel=f"wall damping B ({region.units.unit('N·s/m')})", ylabel=f"wall stiffness K ({unit('N/m')})")
    return style.with_legend(figure, 2)


@style.styled
def draw_tool_region(region: ToolRegion) -> Figure:
    """Draw the K-B region of a coupling to a simulation, a curve for each engine rate."""
    title = "couplings to the simulation: stable below each curve"
    title += ", with a critical damper in the device's loop" if region.local_damping_ratio else ""
    figure = style.panels((title,), 4.2)
    (plane,), damping = figure.axes, region.damping_ns_per_m[1:]
    colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(region.curves)))
    shown = [one.stiffness_n_per_m[1:] for one in region.curves]
    for colour, one, stiffness in zip(colours, region.curves, shown, strict=True):
        label = f"{quantity(1 / one.step_s, 'Hz')}{' (declared)' if one.declared else ''}"
        stable = np.where(stiffness > 0, stiffness, np.nan)
        _curve(plane, damping, stable, label, fill=one.declared, color=colour, linewidth=2.4 if one.declared else 1.3)
    _plane(plane, shown, (float(damping[0]), float(damping[-1])))
    plane.set(xlabel=f"damper B ({region.units.unit('N·s/m')})", ylabel=f"spring K ({region.units.unit('N/m')})")
    return style.with_legend(figure, 5)


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
