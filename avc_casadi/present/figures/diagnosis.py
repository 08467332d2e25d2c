"""An oscillating log: onset, oscillation, frequency, and force against position."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.present.figures.layout import GivenAxes, Panels
from avc_casadi.present.figures.style import styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.identification.diagnosis.model import Diagnosis

_BLUE, _ORANGE, _GREY = "#08306b", "#d1600a", "0.55"
_TITLES = (
    "(a) position",
    "(b) what swings, and its envelope",
    "(c) force against position, some cycles",
    "(d) amplitudes while it swings",
)
_LOWEST_HZ = 2.0
_CYCLES = 6.0
_EDGE_CYCLES = 2.0
_STILL_S = 0.2


@styled
def draw_diagnosis(found: Diagnosis, axes: GivenAxes = None) -> Figure:
    """Draw the oscillation of a log, in four panels."""
    panels = Panels.of(axes, [*map(str, _TITLES)], 5.8, lambda figure: figure.subplots(2, 2).ravel())
    position, swing, cycles, spectrum = panels.axes
    _whole(position, swing, found)
    _some_cycles(cycles, found)
    _spectrum(spectrum, found)
    panels.legend(*swing.get_legend_handles_labels(), 2)
    return panels.figure


def _whole(position: Axes, swing: Axes, found: Diagnosis) -> None:
    trace, size, unit = found.trace, *_unit(found)
    position.plot(trace.time_s, 1e3 * trace.position_m, color=_BLUE, linewidth=0.8)
    position.set_ylabel("position (mm)")
    swing.plot(trace.time_s, size * trace.fast_m, color=_BLUE, linewidth=0.6, label="position above 4 Hz")
    begins, ends = found.oscillation.begins_s, found.oscillation.ends_s
    if math.isfinite(begins):
        inside = (trace.time_s >= begins) & (trace.time_s <= ends)
        # At the ends of a log the envelope is estimated from half its cycles.
        edge = _EDGE_CYCLES / found.oscillation.frequency_hz
        whole = inside & (trace.time_s > trace.time_s[0] + edge) & (trace.time_s < trace.time_s[-1] - edge)
        for sign in (1, -1):
            envelope = sign * size * trace.envelope_m[whole]
            swing.plot(
                trace.time_s[whole], envelope, color=_ORANGE, linewidth=1.2, label="envelope" if sign > 0 else "_"
            )
        top = 1.3 * size * float(np.abs(trace.fast_m[inside]).max(initial=1e-12))
        swing.set_ylim(-top, top)
        for one in (position, swing):
            one.axvspan(begins, ends, color="0.92", zorder=0)
    swing.set_ylabel(f"above 4 Hz ({unit})")
    for one in (position, swing):
        one.set_xlabel("time (s)")
        one.set_xlim(float(trace.time_s[0]), float(trace.time_s[-1]))


def _some_cycles(axes: Axes, found: Diagnosis) -> None:
    trace, size, unit = found.trace, *_unit(found)
    hertz, ends = found.oscillation.frequency_hz, found.oscillation.ends_s
    end = 0.5 * (found.oscillation.begins_s + ends) if math.isfinite(ends) else float(trace.time_s[-1])
    length = _CYCLES / hertz if math.isfinite(hertz) else _STILL_S
    inside = (trace.time_s >= end - length) & (trace.time_s <= end)
    axes.plot(size * trace.position_m[inside], trace.force_n[inside], color=_BLUE, linewidth=0.8)
    axes.set_xlabel(f"position ({unit})")
    axes.set_ylabel("commanded force (N)")


def _spectrum(axes: Axes, found: Diagnosis) -> None:
    trace, size, unit = found.trace, *_unit(found)
    use = trace.frequency_hz >= _LOWEST_HZ
    axes.plot(trace.frequency_hz[use], size * trace.spectrum_m[use], color=_BLUE, linewidth=0.9)
    axes.set_yscale("log")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    top = size * float(trace.spectrum_m[use].max(initial=1e-12))
    axes.set_ylim(1e-4 * top, 3 * top)
    if found.encoder_m:
        axes.axhline(size * found.encoder_m / 2, color=_GREY, linewidth=0.9, linestyle=(0, (4, 2)))
        # On the side of the axis without an oscillation, above the line.
        swings_left = not found.oscillation.frequency_hz > math.sqrt(_LOWEST_HZ * float(trace.frequency_hz[-1]))
        axes.text(
            0.98 if swings_left else 0.02,
            1.15 * size * found.encoder_m / 2,
            "half an encoder step",
            transform=axes.get_yaxis_transform(),
            fontsize=7,
            ha="right" if swings_left else "left",
        )
    measured = found.measured
    if measured is not None and math.isfinite(measured.frequency_hz) and measured.frequency_hz > 2:
        axes.axvline(measured.frequency_hz, color=_ORANGE, linewidth=1.0)
        axes.text(
            measured.frequency_hz,
            0.95,
            " model, in contact",
            transform=axes.get_xaxis_transform(),
            fontsize=7,
            va="top",
        )
    axes.set_xlabel("frequency (Hz)")
    axes.set_ylabel(f"amplitude ({unit})")


def _unit(found: Diagnosis) -> tuple[float, str]:
    travel = found.oscillation.peak_to_peak_m
    return (1e3, "mm") if math.isfinite(travel) and travel > 2e-3 else (1e6, "\N{MICRO SIGN}m")
