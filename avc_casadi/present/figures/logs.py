"""Measured logs: an identified device beside its log, and an oscillation with its envelope and spectrum."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.units import units_for
from avc_casadi.present.figures.style import GivenAxes, Panels, frequency_axis, log_ticks, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi.diagnose.causes import Diagnosis
    from avc_casadi.identification.device import Identification

_BLUE = "#08306b"
_MEASURED: dict[str, Any] = {"color": "0.55", "linewidth": 2.6, "label": "measured"}
_MODEL: dict[str, Any] = {"color": _BLUE, "linewidth": 1.2, "linestyle": (0, (5, 1.6)), "label": "model"}
_POINTS: dict[str, Any] = {"marker": "o", "markersize": 2.4, "color": "0.55", "linestyle": "none"}
# Motion from which on it is drawn in millimetres.
_LARGE_M = 2e-3
# Coherence from which on a measured response is drawn.
_COHERENT = 0.3


@styled
def draw_identification(found: Identification, axes: GivenAxes = None) -> Figure:
    """Draw a model against its log over time, and their frequency responses."""
    titles = (
        "(a) position, the model all but free",
        "(b) measured less model",
        "(c) velocity over force",
        "(d) its phase, less that of a mass",
    )
    panels = Panels.of(axes, titles, 5.8, "ab;cd")
    position, left, size, phase = panels.axes
    units, (time, measured, simulated) = units_for(found.motion), found.stretch
    position.plot(time, 1e3 * measured, **_MEASURED)
    position.plot(time, 1e3 * simulated, **_MODEL)
    difference = measured - simulated
    scale, unit = (1e3, "mm") if np.abs(difference).max(initial=0.0) > _LARGE_M else (1e6, "um")
    left.plot(time, scale * difference, color=_BLUE, linewidth=0.8)
    for panel, label in ((position, f"position ({units.unit('mm')})"), (left, f"difference ({units.unit(unit)})")):
        panel.set(xlabel="time (s)", ylabel=label, xlim=(float(time[0]), float(time[-1])))
    response, frequency = found.response, found.response.frequency_hz
    use = response.driven & (response.coherence > _COHERENT)
    if not use.any():
        use = np.ones_like(use)
    band = frequency[use]
    span = (frequency >= band[0]) & (frequency <= band[-1])
    # A mass has -90 degrees; the rest is damping, delay, amplifier and resonance.
    turned = np.degrees(np.angle(1j * response.velocity_per_force[use]))
    model = np.degrees(np.unwrap(np.angle(1j * found.modelled[span])))
    # Each measured phase is unwrapped to that of the model.
    turned += 360 * np.round((np.interp(band, frequency[span], model) - turned) / 360)
    size.plot(band, np.abs(response.velocity_per_force[use]), **_POINTS)
    size.plot(frequency[span], np.abs(found.modelled[span]), **(_MODEL | {"label": "_"}))
    phase.plot(band, turned, **_POINTS)
    phase.plot(frequency[span], model, **(_MODEL | {"label": "_"}))
    size.set(yscale="log", ylabel=f"|v/F| ({units.unit('m/s')}/({units.unit('N')}))")
    log_ticks(size.yaxis, *size.get_ylim())
    phase.set_ylabel("phase (degrees)")
    for panel in (size, phase):
        frequency_axis(panel, band)
    panels.legend(2)
    return panels.figure


@styled
def draw_diagnosis(found: Diagnosis, axes: GivenAxes = None) -> Figure:
    """Draw the oscillation of a log: position, envelope, cycles of the force, spectrum."""
    titles = ("(a) position", "(b) oscillation and envelope", "(c) force against position", "(d) spectrum")
    panels = Panels.of(axes, titles, 5.8, "ab;cd")
    position, swing, cycles, spectrum = panels.axes
    log, one, units = found.log, found.swing, found.declared.device.units
    time, inside = log.time_s, slice(one.first, one.last)
    size, unit = (1e3, units.unit("mm")) if one.peak_to_peak_m > _LARGE_M else (1e6, units.unit("um"))
    position.plot(time, 1e3 * log.position_m, color=_BLUE, linewidth=0.8)
    swing.plot(time, size * one.fast_m, color=_BLUE, linewidth=0.6, label="position without slow motion")
    for sign, label in ((1, "envelope"), (-1, "_")):
        swing.plot(time, sign * size * one.envelope_m, color="#d1600a", linewidth=1.0, label=label)
    for panel, label in ((position, f"position ({units.unit('mm')})"), (swing, f"oscillation ({unit})")):
        panel.set(xlabel="time (s)", ylabel=label, xlim=(float(time[0]), float(time[-1])))
        if one.kind != "none":
            panel.axvspan(float(time[one.first]), float(time[one.last - 1]), color="0.92", zorder=0)
    length = 6 / one.frequency_hz if math.isfinite(one.frequency_hz) else 0.2
    middle = np.abs(time - (time[one.first] + time[one.last - 1]) / 2) <= length / 2
    cycles.plot(size * log.position_m[middle], -log.force_n[middle], color=_BLUE, linewidth=0.8)
    cycles.set(xlabel=f"position ({unit})", ylabel=f"commanded {units.key('force')} ({units.unit('N')})")
    window = np.hanning(one.fast_m[inside].size)
    amplitude = size * 2 * np.abs(np.fft.rfft(one.fast_m[inside] * window)) / max(window.sum(), 1.0)
    hertz = np.fft.rfftfreq(window.size, log.period_s)
    top = max(float(amplitude[1:].max(initial=0.0)), 1e-9)
    spectrum.plot(hertz[1:], amplitude[1:], color=_BLUE, linewidth=0.9)
    spectrum.set(yscale="log", ylabel=f"amplitude ({unit})", ylim=(1e-4 * top, 3 * top))
    log_ticks(spectrum.yaxis, *spectrum.get_ylim())
    frequency_axis(spectrum, hertz[1:])
    if log.encoder_m:
        half, place = size * log.encoder_m / 2, spectrum.get_yaxis_transform()
        spectrum.axhline(half, color="0.55", linewidth=0.9, linestyle=(0, (4, 2)))
        spectrum.text(0.02, 1.15 * half, "half an encoder step", transform=place, fontsize=7)
    panels.legend(2)
    return panels.figure
