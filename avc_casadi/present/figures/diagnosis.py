"""An oscillating log: onset, oscillation, frequency, and force against position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.present.figures.style import GivenAxes, Panels, entries_of, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.diagnose.causes import Diagnosis

_BLUE, _ORANGE, _GREY = "#08306b", "#d1600a", "0.55"
_TITLES = ("(a) position", "(b) oscillation and envelope", "(c) force against position", "(d) spectrum")


@styled
def draw_diagnosis(found: Diagnosis, axes: GivenAxes = None) -> Figure:
    """Draw the oscillation of a log, in four panels.

    Args:
        found: the diagnosis.
        axes: one axes a panel to draw in; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    panels = Panels.of(axes, _TITLES, 5.8, lambda figure: figure.subplots(2, 2).ravel())
    position, swing, cycles, spectrum = panels.axes
    log, one, units = found.log, found.swing, found.declared.device.units
    small = not one.peak_to_peak_m > 2e-3
    size, unit = (1e6, units.unit("um")) if small else (1e3, units.unit("mm"))
    time = log.time_s
    position.plot(time, 1e3 * log.position_m, color=_BLUE, linewidth=0.8)
    position.set_ylabel(f"position ({units.unit('mm')})")
    swing.plot(time, size * one.fast_m, color=_BLUE, linewidth=0.6, label="position without slow motion")
    for sign in (1, -1):
        label = "envelope" if sign > 0 else "_"
        swing.plot(time, sign * size * one.envelope_m, color=_ORANGE, linewidth=1.0, label=label)
    swing.set_ylabel(f"oscillation ({unit})")
    ends = float(time[one.first]), float(time[one.last - 1])
    for each in (position, swing):
        each.set_xlabel("time (s)")
        each.set_xlim(float(time[0]), float(time[-1]))
        if one.kind != "none":
            each.axvspan(*ends, color="0.92", zorder=0)
    length = 6 / one.frequency_hz if math.isfinite(one.frequency_hz) else 0.2
    inside = (time >= sum(ends) / 2 - length / 2) & (time <= sum(ends) / 2 + length / 2)
    cycles.plot(size * log.position_m[inside], -log.force_n[inside], color=_BLUE, linewidth=0.8)
    cycles.set_xlabel(f"position ({unit})")
    cycles.set_ylabel(f"commanded {units.key('force')} ({units.unit('N')})")
    _spectrum(spectrum, found, size, unit)
    panels.legend(entries_of(swing), 2)
    return panels.figure


def _spectrum(axes: Axes, found: Diagnosis, size: float, unit: str) -> None:
    """Draw the amplitudes of the oscillation, and half an encoder step."""
    one, period = found.swing, found.log.period_s
    part = one.fast_m[one.first : one.last]
    window = np.hanning(part.size)
    amplitude = size * 2 * np.abs(np.fft.rfft(part * window)) / max(window.sum(), 1.0)
    hertz = np.fft.rfftfreq(part.size, period)
    axes.plot(hertz[1:], amplitude[1:], color=_BLUE, linewidth=0.9)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    top = max(float(amplitude[1:].max(initial=0.0)), 1e-9)
    axes.set_ylim(1e-4 * top, 3 * top)
    if found.log.encoder_m:
        axes.axhline(size * found.log.encoder_m / 2, color=_GREY, linewidth=0.9, linestyle=(0, (4, 2)))
        place = axes.get_yaxis_transform()
        axes.text(0.02, 1.15 * size * found.log.encoder_m / 2, "half an encoder step", transform=place, fontsize=7)
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel(f"amplitude ({unit})")
