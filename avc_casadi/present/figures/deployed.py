"""The deployed coupling: rendered against wanted stiffness, and its loop with gain and phase margin."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.text import quantity
from avc_casadi.present.figures.style import GivenAxes, Panels, entries_of, frequency_axis, log_ticks, styled
from avc_casadi.recommendation.deployed import STRUCK_M_PER_S, Deployed, deployed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.coupling import Coupling

_WANTED: dict[str, Any] = {"color": "0.72", "linewidth": 4.0, "zorder": 2}
_WORST: dict[str, Any] = {"color": "#08306b", "linewidth": 1.5, "zorder": 5}
_RELEASED: dict[str, Any] = {"color": "#d1600a", "linewidth": 1.4, "linestyle": (0, (5, 1.6)), "zorder": 6}
_OTHERS: dict[str, Any] = {"color": "0.6", "linewidth": 0.6, "zorder": 3}
_MARGIN: dict[str, Any] = {"color": "#8a0f5c", "linewidth": 2.2, "zorder": 7}
_TURNED: dict[str, Any] = {**_MARGIN, "color": "#2f7d32", "marker": "o", "markersize": 3.5}
# Ranges of Bode and Nyquist: decades about a gain of 1, and Re and Im about the point -1, so that the circle is round
# in panels of this figure's shape.
_DECADES, _NEAR = 2.0, ((-3.2, 2.0), (-1.7, 1.7))


@styled
def draw_rendered(found: Deployed | Coupling, axes: GivenAxes = None) -> Figure:
    """Draw rendered against wanted: dynamic stiffness at the handle, and presses against time."""
    found = found if isinstance(found, Deployed) else deployed(found)
    titles = ("(a) stiffness by sinusoidal excitation", "(b) simulated hands press, approach cut")
    panels = Panels.of(axes, titles, 2.9, lambda figure: figure.subplots(1, 2).ravel())
    wall, shaken = found.coupling.problem.environment, found.shaken
    left, right = panels.axes
    hz = shaken.frequency_hz
    wanted = np.abs(wall.stiffness_n_per_m + 2j * np.pi * hz * wall.damping_ns_per_m)
    left.plot(hz, wanted, label="wanted", **_WANTED)
    left.plot(hz, shaken.stiffness_n_per_m, label="rendered", marker="o", markerfacecolor="white", **_WORST)
    frequency_axis(left, hz)
    left.set_xlabel("frequency (Hz)")
    every = np.concatenate([wanted, shaken.stiffness_n_per_m])
    every = every[np.isfinite(every) & (every > 0)]
    if every.size and every.max() > 3 * np.median(every):
        left.set_yscale("log")
    else:
        left.set_ylim(0, 1.1 * float(every.max(initial=1.0)))
    left.set_ylabel(f"stiffness ({found.coupling.problem.units.unit('N/m')})")
    _pressed(right, found)
    panels.legend(entries_of(left, right), 4)
    return panels.figure


def _pressed(axes: Axes, found: Deployed) -> None:
    """Draw the positions of pressing hands, and the equilibrium of the worst of them in the wall itself."""
    others = np.delete(found.press_m, found.worst, axis=0)
    axes.plot(found.press_s, 1e3 * others.T, label="_", **_OTHERS)
    axes.plot([], [], label="other hands of the box", **_OTHERS)
    worst = 1e3 * found.press_m[found.worst]
    axes.plot(found.press_s, worst, label="least damped hand", **_WORST)
    wall = found.coupling.problem.environment.stiffness_n_per_m
    spring = float(np.atleast_1d(found.hands.stiffness_n_per_m)[found.worst])
    aim = 10.0 / found.coupling.problem.device.metres_per_unit
    if wall > 0:
        axes.axhline(aim * spring / (wall + spring), label="wanted", **_WANTED)
    axes.axhline(0, color="0.5", linewidth=0.8, zorder=1)
    deepest = float(np.max(1e3 * found.press_m, initial=0.0))
    if np.isfinite(deepest) and deepest > 0:
        axes.set_ylim(-0.6 * deepest, 1.15 * deepest)
    axes.set_xlim(0, found.press_s[-1])
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"depth in the wall ({found.coupling.problem.units.unit('mm')})")


@styled
def draw_loop(found: Deployed | Coupling, axes: GivenAxes = None) -> Figure:
    """Draw the loop opened at the actuator, Bode and Nyquist with gain and phase margin, and the impact on the wall."""
    found = found if isinstance(found, Deployed) else deployed(found)
    titles = ("(a) loop gain |L|", "(b) Nyquist plot of L", "(c) phase of L", "(d) impact on the wall, linear")
    panels = Panels.of(axes, titles, 5.6, lambda figure: figure.subplots(2, 2).ravel())
    size, circle, phase, struck = panels.axes
    released, held = found.loop.margins()
    gain = min((released.gain, released.gain_hz), (held.gain, held.gain_hz))
    turn = min((released.phase_deg, released.phase_hz), (held.phase_deg, held.phase_hz))
    curves = [(found.gain[found.worst], _WORST, "least damped hand"), (found.gain[-1], _RELEASED, "released")]
    curves += [(one, _OTHERS, "_") for row, one in enumerate(found.gain[:-1]) if row != found.worst]
    for curve, style, label in curves:
        size.plot(found.frequency_hz, np.abs(curve), label=label, **style)
        phase.plot(found.frequency_hz, _degrees(curve), label=label, **style)
        circle.plot(curve.real, curve.imag, label=label, **style)
    size.set_yscale("log")
    size.set_ylim(10**-_DECADES, 10**_DECADES)
    log_ticks(size.yaxis, *size.get_ylim())
    size.axhline(1, color="0.5", linewidth=0.8, zorder=1)
    phase.axhline(-180, color="0.5", linewidth=0.8, zorder=1)
    if np.isfinite(gain[0]) and gain[0] > 1:
        told = f"gain margin {gain[0]:.3g} ({20 * np.log10(gain[0]):.1f} dB)"
        size.plot([gain[1]] * 2, [1 / gain[0], 1], label=told, **_MARGIN)
        circle.plot([-1, -1 / gain[0]], [0, 0], **_MARGIN)
    if np.isfinite(turn[0]) and turn[0] > 0:
        sign = _side(found, turn[1])
        told = f"phase margin {turn[0]:.3g} deg"
        phase.plot([turn[1]] * 2, [-180, -180 + sign * turn[0]], label=told, **_TURNED)
        arc = np.radians(np.linspace(-180, -180 + sign * turn[0], 30))
        circle.plot(np.cos(arc), np.sin(arc), **(_TURNED | {"marker": ""}))
    _bode(size, phase, found)
    _nyquist(circle)
    _struck(struck, found)
    struck.plot([], [], label="other hands of the box", **_OTHERS)
    panels.legend(entries_of(size, phase, struck), 3)
    return panels.figure


def _bode(size: Axes, phase: Axes, found: Deployed) -> None:
    shown = found.frequency_hz[found.frequency_hz >= min(1.0, found.frequency_hz[-1] / 100)]
    for axes in (size, phase):
        frequency_axis(axes, shown)
        axes.set_xlabel("frequency (Hz)")
    size.set_ylabel("|L|")
    phase.set_ylabel("phase (deg)")
    phase.set_ylim(-360, 0)
    phase.set_yticks(range(-360, 1, 90))


def _nyquist(axes: Axes) -> None:
    around = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(around), np.sin(around), color="0.5", linewidth=0.8, zorder=1)
    axes.plot([-1], [0], marker="+", markersize=9, color="black", zorder=8)
    axes.set_xlim(*_NEAR[0])
    axes.set_ylim(*_NEAR[1])
    axes.set_xlabel("Re L")
    axes.set_ylabel("Im L")


def _struck(axes: Axes, found: Deployed) -> None:
    """Draw the position after an impact on the wall, with the least damped hand and with the device released."""
    for row, style in ((found.worst, _WORST), (-1, _RELEASED)):
        axes.plot(found.struck_s, 1e3 * found.struck_m[row], **style)
    axes.axhline(0, color="0.5", linewidth=0.8, zorder=1)
    axes.set_xlim(0, found.struck_s[-1])
    axes.set_xlabel("time (s)")
    device, units = found.coupling.problem.device, found.coupling.problem.units
    speed = quantity(STRUCK_M_PER_S / device.metres_per_unit, units.unit("m/s"))
    axes.set_ylabel(f"position ({units.unit('mm')}), impact at {speed}")


def _degrees(curve: ComplexArray) -> FloatArray:
    """Return the phase, unwrapped from a start between -360 and 0."""
    degrees = np.degrees(np.unwrap(np.angle(curve)))
    return np.asarray(degrees - 360 * np.ceil(degrees[0] / 360))


def _side(found: Deployed, hz: float) -> int:
    """Return the side of -180 on which the phase of the curve lies whose magnitude is nearest to 1."""
    place = int(np.argmin(np.abs(found.frequency_hz - hz)))
    row = int(np.argmin(np.abs(np.log(np.abs(found.gain[:, place])))))
    return 1 if (np.degrees(np.angle(found.gain[row, place])) % 360) > 180 else -1
