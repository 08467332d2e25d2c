"""The deployed coupling: rendered against required, its loop with its margins, and the region of stable ones."""

from __future__ import annotations

from collections.abc import Sequence
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
from avc_casadi.recommendation.rendered import STRIKES_M_PER_S, Deployed, deployed

_PRESS_MM = 10.0
"""How far behind the wall's surface a hand that presses aims, mm at the handle."""

_WORST_HAND = "least damped hand"
_OTHER_HANDS = "other hands of the range"
_REQUIRED: dict[str, Any] = {"color": "0.72", "linewidth": 4.0, "zorder": 2}
_WORST: dict[str, Any] = {"color": style.BLUE, "linewidth": 1.5, "zorder": 5}
_RELEASED: dict[str, Any] = {"color": style.ORANGE, "linewidth": 1.4, "linestyle": style.DASHED, "zorder": 6}
_OTHERS: dict[str, Any] = {"color": "0.6", "linewidth": 0.6, "zorder": 3}
_ZERO: dict[str, Any] = {"color": "0.5", "linewidth": 0.8, "zorder": 1}
_GAIN: dict[str, Any] = {"color": style.PURPLE, "linewidth": 2.2, "zorder": 7}
_PHASE: dict[str, Any] = {"color": style.GREEN, "linewidth": 2.2, "zorder": 7, "markersize": 3.5}


def draw_rendered(coupling: Deployed | Coupling) -> Figure:
    """Draw rendered against required: dynamic stiffness at the handle, and presses against time."""
    return rendered(coupling if isinstance(coupling, Deployed) else deployed(coupling)).figure()


def rendered(shown: Deployed) -> style.Drawing:
    """Return the panels of rendered against required."""

    def paint(panels: Sequence[Axes]) -> None:
        stiffness, press = panels
        _stiffness(stiffness, shown)
        _presses(press, shown)

    titles = ("stiffness by sinusoidal excitation", "simulated hands press, approach cut")
    return style.Drawing(titles, 2.9, "ab", 4, paint)


def _stiffness(axes: Axes, shown: Deployed) -> None:
    """Draw the dynamic stiffness at the handle, |K + j omega B| where it is required, over frequency."""
    problem, response = shown.coupling.problem, shown.frequency_sweep
    wall = problem.environment
    hz = response.frequency_hz
    rendered = response.stiffness_n_per_m
    required = np.abs(wall.stiffness_n_per_m + 2j * np.pi * hz * wall.damping_ns_per_m)
    axes.plot(hz, rendered, label="rendered", marker="o", markerfacecolor="white", **_WORST)
    axes.plot(hz, required, label="required", **_REQUIRED)
    values = np.concatenate([required, rendered])
    values = values[np.isfinite(values) & (values > 0)]
    if values.size and values.max() > 3 * np.median(values):  # rendered far beyond most of what is required
        axes.set_yscale("log")
        style.log_ticks(axes.yaxis, *axes.get_ylim())
    else:
        axes.set_ylim(0, 1.1 * float(values.max(initial=1.0)))
    axes.set_ylabel(f"stiffness ({problem.units.unit('N/m')})")
    style.frequency_axis(axes, hz)


def _presses(axes: Axes, shown: Deployed) -> None:
    """Draw the depth of presses over time: all hands of the range, the least damped, and how deep it should come."""
    problem, worst = shown.coupling.problem, shown.worst
    wall_n_per_m = problem.environment.stiffness_n_per_m
    axes.plot(shown.press_s, 1e3 * np.delete(shown.press_m, worst, axis=0).T, label="_", **_OTHERS)
    axes.plot([], [], label=_OTHER_HANDS, **_OTHERS)
    axes.plot(shown.press_s, 1e3 * shown.press_m[worst], label=_WORST_HAND, **_WORST)
    hand_n_per_m = float(np.atleast_1d(shown.hands.stiffness_n_per_m)[worst])
    if wall_n_per_m > 0:
        aim_mm = _PRESS_MM / problem.device.metres_per_unit
        axes.axhline(aim_mm * hand_n_per_m / (wall_n_per_m + hand_n_per_m), label="required", **_REQUIRED)
    axes.axhline(0, **_ZERO)
    deepest = float(np.max(1e3 * shown.press_m, initial=0.0))
    if np.isfinite(deepest) and deepest > 0:
        axes.set_ylim(-0.6 * deepest, 1.15 * deepest)
    unit = problem.units.unit("mm")
    axes.set(xlim=(0, shown.press_s[-1]), xlabel="time (s)", ylabel=f"depth in the wall ({unit})")


def draw_loop(coupling: Deployed | Coupling) -> Figure:
    """Draw the loop opened at the actuator, Bode and Nyquist with gain and phase margin, and the impact on the wall."""
    return opened_loop(coupling if isinstance(coupling, Deployed) else deployed(coupling)).figure()


def opened_loop(shown: Deployed) -> style.Drawing:
    """Return the panels of the loop opened at the actuator, and of the impact on the wall."""

    def paint(panels: Sequence[Axes]) -> None:
        size, circle, phase, struck = panels
        _loop(size, circle, phase, shown)
        _impact(struck, shown)

    device, units = shown.coupling.problem.device, shown.coupling.problem.units
    speed = quantity(STRIKES_M_PER_S[0] / device.metres_per_unit, units.unit("m/s"))
    titles = ("|L|, 0.01 to 100", "Nyquist plot, near -1", "phase of L", f"impact at {speed}, linear loop")
    return style.Drawing(titles, 5.6, "ab;cd", 3, paint)


def _loop(size: Axes, circle: Axes, phase: Axes, shown: Deployed) -> None:
    """Draw magnitude, Nyquist plot and phase of the loop with each hand and released."""
    other_hands = [(row, _OTHERS, "_") for row in range(len(shown.gain) - 1) if row != shown.worst]
    hands = [(shown.worst, _WORST, _WORST_HAND), (-1, _RELEASED, "released"), *other_hands]
    for row, look, label in hands:
        curve = shown.gain[row]
        size.plot(shown.frequency_hz, np.abs(curve), label=label, **look)
        degrees = np.degrees(np.unwrap(np.angle(curve)))
        # From -360 to 0 where |L| is nearest to 1: a margin is read there, not at the lowest frequency.
        crossing = degrees[int(np.argmin(np.abs(np.log(np.abs(curve)))))]
        phase.plot(shown.frequency_hz, degrees - 360 * np.ceil(crossing / 360), label=label, **look)
        circle.plot(curve.real, curve.imag, label=label, **look)
    _margins(size, circle, phase, shown)
    frequencies = shown.frequency_hz[shown.frequency_hz >= min(1.0, shown.frequency_hz[-1] / 100)]
    for panel in (size, phase):
        style.frequency_axis(panel, frequencies)
    size.set(yscale="log", ylim=(0.01, 100), ylabel="|L|")
    style.log_ticks(size.yaxis, *size.get_ylim())
    size.axhline(1, **_ZERO)
    phase.set(ylim=(-360, 0), yticks=range(-360, 1, 90), ylabel="phase (deg)")
    phase.axhline(-180, **_ZERO)
    angles = np.linspace(0, 2 * np.pi, 200)
    circle.plot(np.cos(angles), np.sin(angles), **_ZERO)
    circle.plot([-1], [0], marker="+", markersize=9, color="black", zorder=8)
    # In a panel of this shape the circle is round.
    circle.set(xlim=(-3.2, 2.0), ylim=(-1.7, 1.7), xlabel="Re L", ylabel="Im L")
    for panel in (size, circle, phase):
        panel.plot([], [], label=_OTHER_HANDS, **_OTHERS)


def _impact(axes: Axes, shown: Deployed) -> None:
    """Draw the impact on the wall over time, held by the least damped hand and released."""
    units = shown.coupling.problem.units
    for row, look, label in ((shown.worst, _WORST, _WORST_HAND), (-1, _RELEASED, "released")):
        axes.plot(shown.struck_s, 1e3 * shown.struck_m[row], label=label, **look)
    axes.axhline(0, **_ZERO)
    axes.set(xlim=(0, shown.struck_s[-1]), xlabel="time (s)", ylabel=f"position ({units.unit('mm')})")


def _margins(size: Axes, circle: Axes, phase: Axes, shown: Deployed) -> None:
    """Draw the smallest gain and phase margin of all loops."""
    released, worst = shown.loop.margins()
    gain, gain_hz = min((released.gain, released.gain_hz), (worst.gain, worst.gain_hz))
    phase_deg, phase_hz = min((released.phase_deg, released.phase_hz), (worst.phase_deg, worst.phase_hz))
    if np.isfinite(gain) and gain > 1:
        label = f"gain margin {gain:.3g} ({20 * np.log10(gain):.1f} dB)"
        size.plot([gain_hz] * 2, [1 / gain, 1], label=label, **_GAIN)
        circle.plot([-1, -1 / gain], [0, 0], **_GAIN)
    if np.isfinite(phase_deg) and phase_deg > 0:
        # The side of -180 on which the curve lies whose magnitude is nearest to 1.
        at_margin = shown.gain[:, int(np.argmin(np.abs(shown.frequency_hz - phase_hz)))]
        nearest = at_margin[int(np.argmin(np.abs(np.log(np.abs(at_margin)))))]
        end = -180 + (phase_deg if np.degrees(np.angle(nearest)) % 360 > 180 else -phase_deg)
        label = f"phase margin {phase_deg:.3g} deg"
        phase.plot([phase_hz] * 2, [-180, end], "o-", label=label, **_PHASE)
        arc = np.radians(np.linspace(-180, end, 30))
        circle.plot(np.cos(arc), np.sin(arc), **_PHASE)


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
    (plane,) = figure.axes
    damping, unit = region.damping_ns_per_m[1:], region.units.unit
    stiffnesses = []
    for curve in region.curves:
        colour, dash, width = _CURVES[curve.key]
        label = f"{curve.claim} (of {region.hands})" if curve.key == "stable-hands" else str(curve.claim)
        stiffness = curve.stiffness_n_per_m[1:]
        stiffnesses.append(stiffness)
        fill = curve.key == "passive-sampled-data"
        _curve(plane, damping, stiffness, label, fill=fill, color=colour, linestyle=dash, linewidth=width)
    _literature(plane, region)
    required_n_per_m, required_ns_per_m = region.target_stiffness_n_per_m, region.target_damping_ns_per_m
    in_view = [np.array([region.encoder_limit_n_per_m or 0.0]), *stiffnesses]
    if required_n_per_m > 0:
        # A wall without damping has no place on a logarithmic axis: the left edge.
        place = max(required_ns_per_m, float(damping[0]))
        name = f"required wall: {quantity(required_n_per_m, unit('N/m'))}, {quantity(required_ns_per_m, unit('N.s/m'))}"
        look: dict[str, Any] = {"markersize": 11, "color": "#b2182b", "markeredgecolor": "white", "clip_on": False}
        plane.plot(place, required_n_per_m, "*", label=name, zorder=6, **look)
        in_view.append(np.array([required_n_per_m]))
    reached = [damping[np.nan_to_num(stiffness) > 0].max(initial=0.0) for stiffness in stiffnesses]
    widest = max([required_ns_per_m, *reached])
    _plane(plane, in_view, (float(damping[0]), 1.5 * widest or float(damping[-1])))
    plane.set(xlabel=f"wall damping B ({unit('N·s/m')})", ylabel=f"wall stiffness K ({unit('N/m')})")
    return style.with_legend(figure, 2)


def _literature(axes: Axes, region: ZWidth) -> None:
    """Draw the bounds of the literature: a rule over the damping, and limits of the stiffness."""
    if np.isfinite(region.rule_n_per_m).any():
        rule = "linear rule (b + b_h + B)/(T/2 + t_d), Gil, Hulin et al. 2009"
        axes.plot(region.damping_ns_per_m, region.rule_n_per_m, **_THIN, linestyle=(0, (1, 1)), label=rule)
    if region.passive_spring_n_per_m:
        name = "passive spring 2b/((1 + 2d) T), Diolaiti et al. 2006"
        axes.axhline(region.passive_spring_n_per_m, **_THIN, linestyle=(0, (6, 1.5, 1, 1.5)), label=name)
    if region.encoder_limit_n_per_m:
        name = "encoder and friction 2f_c/Δ, Abbott and Okamura 2005"
        axes.axhline(region.encoder_limit_n_per_m, **_THIN, linestyle=(0, (2, 2)), label=name)


@style.styled
def draw_tool_region(region: ToolRegion) -> Figure:
    """Draw the K-B region of a coupling to a simulation, a curve for each engine rate."""
    title = "couplings to the simulation: stable below each curve"
    title += ", with a critical damper in the device's loop" if region.local_damping_ratio else ""
    figure = style.panels((title,), 4.2)
    (plane,) = figure.axes
    damping = region.damping_ns_per_m[1:]
    colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(region.curves)))
    stiffnesses = [curve.stiffness_n_per_m[1:] for curve in region.curves]
    for colour, curve, stiffness in zip(colours, region.curves, stiffnesses, strict=True):
        label = f"{quantity(1 / curve.step_s, 'Hz')}{' (declared)' if curve.declared else ''}"
        stable = np.where(stiffness > 0, stiffness, np.nan)
        width = 2.4 if curve.declared else 1.3
        _curve(plane, damping, stable, label, fill=curve.declared, color=colour, linewidth=width)
    _plane(plane, stiffnesses, (float(damping[0]), float(damping[-1])))
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
    summits = [float(np.nanmax(values, initial=0.0)) for values in shown]
    summits = [summit for summit in summits if summit > 0] or [1.0]
    top = 2.5 * max(summits)
    bottom = max(0.2 * min(summits), 1e-4 * top)
    axes.set(xscale="log", yscale="log", xlim=damping, ylim=(bottom, top))
    style.log_ticks(axes.xaxis, *damping)
    style.log_ticks(axes.yaxis, bottom, top)
