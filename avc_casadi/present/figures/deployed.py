"""The deployed coupling: rendered against wanted, and its loop with gain and phase margin."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.text import quantity
from avc_casadi.coupling import Coupling
from avc_casadi.present.figures import style
from avc_casadi.recommendation.felt import STRUCK_M_PER_S, Deployed, RenderedBand, deployed

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
def draw_rendered(found: Deployed | Coupling, axes: style.GivenAxes = None) -> Figure:
    """Draw rendered against wanted: dynamic stiffness at the handle, and presses against time."""
    found = found if isinstance(found, Deployed) else deployed(found)
    titles = ("(a) stiffness by sinusoidal excitation", "(b) simulated hands press, approach cut")
    panels = style.Panels.of(axes, titles, 2.9, "ab")
    problem, response, (left, press) = found.coupling.problem, found.shaken, panels.axes
    wall, hz = problem.environment, found.shaken.frequency_hz
    wanted = np.abs(wall.stiffness_n_per_m + 2j * np.pi * hz * wall.damping_ns_per_m)
    left.plot(hz, response.stiffness_n_per_m, label="rendered", marker="o", markerfacecolor="white", **_LINES["worst"])
    _stiffness(left, hz, wanted, response.stiffness_n_per_m, problem.units.unit("N/m"))
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
    panels.legend(4)
    return panels.figure


@style.styled
def draw_rendered_impedance(band: RenderedBand, axes: style.GivenAxes = None) -> Figure:
    """Draw impedance in free motion against that of device and other end as one body, and stiffness against K."""
    hz = np.array([one.frequency_hz for one in band.felt])
    omega, moves = 2 * np.pi * hz, band.felt[0].mass_kg is not None
    titles = ("(a) impedance in free motion", "(b) stiffness on a rigid object")[0 if moves else 1 :]
    panels = style.Panels.of(axes, titles, 2.9, "ab"[: len(titles)])
    *free, stiff = panels.axes
    for panel in free:
        mass, drag = (np.array([getattr(one, key) for one in band.felt]) for key in ("mass_kg", "drag_ns_per_m"))
        panel.plot(hz, np.hypot(band.damping_ns_per_m, omega * band.mass_kg), **_LINES["wanted"])
        panel.plot(hz, np.hypot(drag, omega * mass), **_LINES["worst"])
        panel.set(yscale="log", ylabel=f"|Z| ({band.units.unit('N·s/m')})")
        style.log_ticks(panel.yaxis, *panel.get_ylim())
        style.frequency_axis(panel, hz)
    rendered = np.array([one.stiffness_n_per_m for one in band.felt])
    stiff.plot(hz, rendered, label="rendered", **_LINES["worst"])
    _stiffness(stiff, hz, np.full(len(hz), band.stiffness_n_per_m), rendered, band.units.unit("N/m"))
    panels.legend(2)
    return panels.figure


def _stiffness(axes: Axes, hz: FloatArray, wanted: FloatArray, rendered: FloatArray, unit: str) -> None:
    """Draw the wanted stiffness; logarithmic where the rendered one goes far beyond most of it."""
    axes.plot(hz, wanted, label="wanted", **_LINES["wanted"])
    every = np.concatenate([wanted, rendered])
    every = every[np.isfinite(every) & (every > 0)]
    if every.size and every.max() > 3 * np.median(every):
        axes.set_yscale("log")
        style.log_ticks(axes.yaxis, *axes.get_ylim())
    else:
        axes.set_ylim(0, 1.1 * float(every.max(initial=1.0)))
    axes.set_ylabel(f"stiffness ({unit})")
    style.frequency_axis(axes, hz)


@style.styled
def draw_loop(found: Deployed | Coupling, axes: style.GivenAxes = None) -> Figure:
    """Draw the loop opened at the actuator, Bode and Nyquist with gain and phase margin, and the impact on the wall."""
    found = found if isinstance(found, Deployed) else deployed(found)
    titles = ("(a) loop gain |L|", "(b) Nyquist plot of L", "(c) phase of L", "(d) impact on the wall, linear")
    panels = style.Panels.of(axes, titles, 5.6, "ab;cd")
    size, circle, phase, struck = panels.axes
    others = [(row, "others", "_") for row in range(len(found.gain) - 1) if row != found.worst]
    for row, kind, label in [(found.worst, "worst", "least damped hand"), (-1, "released", "released"), *others]:
        curve, look = found.gain[row], _LINES[kind]
        size.plot(found.frequency_hz, np.abs(curve), label=label, **look)
        phase.plot(found.frequency_hz, _degrees(curve), label=label, **look)
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
    speed = quantity(STRUCK_M_PER_S / device.metres_per_unit, units.unit("m/s"))
    label = f"position ({units.unit('mm')}), impact at {speed}"
    struck.set(xlim=(0, found.struck_s[-1]), xlabel="time (s)", ylabel=label)
    panels.legend(3)
    return panels.figure


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


def _degrees(curve: ComplexArray) -> FloatArray:
    """Return the phase, unwrapped from a start between -360 and 0."""
    degrees = np.degrees(np.unwrap(np.angle(curve)))
    return np.asarray(degrees - 360 * np.ceil(degrees[0] / 360))
