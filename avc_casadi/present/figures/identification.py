"""An identified device: log and model, residual, frequency response, intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter

from avc_casadi._util.units import units_for
from avc_casadi.present.figures.style import GivenAxes, Panels, entries_of, frequency_axis, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.identification.device import Identification

_MEASURED: dict[str, Any] = {"color": "0.55", "linewidth": 2.6, "label": "measured"}
_MODEL: dict[str, Any] = {"color": "#08306b", "linewidth": 1.2, "linestyle": (0, (5, 1.6)), "label": "model"}
_LARGE_M = 2e-3
_TITLES = (
    "(a) position, the model all but free",
    "(b) measured less model",
    "(c) velocity over force",
    "(d) its phase, less that of a mass",
    "(e) 95 % intervals about the values",
    "(f) prediction error against its past",
)


@styled
def draw_identification(found: Identification, axes: GivenAxes = None) -> Figure:
    """Draw a model against its log, in six panels."""
    panels = Panels.of(axes, _TITLES, 8.6, lambda figure: figure.subplots(3, 2).ravel())
    position, left, size, phase, intervals, past = panels.axes
    _stretch(position, left, found)
    _response(size, phase, found)
    _intervals(intervals, found)
    _past(past, found)
    panels.legend(entries_of(position), 2)
    return panels.figure


def _stretch(position: Axes, left: Axes, found: Identification) -> None:
    time, measured, simulated = found.stretch
    position.plot(time, 1e3 * measured, **_MEASURED)
    position.plot(time, 1e3 * simulated, **_MODEL)
    length = units_for(found.motion).unit("m")
    position.set_ylabel(f"position (m{length})")
    difference = measured - simulated
    size, prefix = (1e3, "m") if np.abs(difference).max(initial=0.0) > _LARGE_M else (1e6, "u")
    left.plot(time, size * difference, color="#08306b", linewidth=0.8)
    left.set_ylabel(f"difference ({prefix}{length})")
    for one in (position, left):
        one.set_xlabel("time (s)")
        one.set_xlim(float(time[0]), float(time[-1]))


def _response(size: Axes, phase: Axes, found: Identification) -> None:
    response = found.response
    use = response.driven & (response.coherence > 0.3)
    if not use.any():
        use = np.ones_like(use)
    frequency = response.frequency_hz
    band = frequency[use]
    span = (frequency >= band[0]) & (frequency <= band[-1])
    size.plot(band, np.abs(response.velocity_per_force[use]), "o", markersize=2.4, color="0.55")
    size.plot(frequency[span], np.abs(found.modelled[span]), **{**_MODEL, "label": "_"})
    size.set_yscale("log")
    units = units_for(found.motion)
    size.set_ylabel(f"|v/F| ({units.unit('m/s')}/({units.unit('N')}))")
    # A mass has -90 degrees; the rest is damping, delay, amplifier and resonance.
    turned = 1j
    measured = np.degrees(np.angle(response.velocity_per_force[use] * turned))
    model = np.degrees(np.unwrap(np.angle(found.modelled[span] * turned)))
    # Each measured phase is unwrapped to that of the model.
    near = np.interp(band, frequency[span], model)
    phase.plot(band, measured + 360 * np.round((near - measured) / 360), "o", markersize=2.4, color="0.55")
    phase.plot(frequency[span], model, **{**_MODEL, "label": "_"})
    phase.set_ylabel("phase (degrees)")
    for one in (size, phase):
        if band[-1] > band[0]:
            frequency_axis(one, band)
        one.set_xlabel("frequency (Hz)")


def _intervals(axes: Axes, found: Identification) -> None:
    known = [one for one in found.estimates.values() if one.value != 0 and one.low < one.high]
    some = [one for one in known if not one.key.startswith("offset")]
    at = np.arange(len(some))[::-1]
    ends = np.array([[(one.value - one.low) / abs(one.value), (one.high - one.value) / abs(one.value)] for one in some])
    ends = 100 * np.clip(ends.reshape(-1, 2).T, 1e-4, 1e3)
    axes.hlines(at, -ends[0], ends[1], color="#08306b", linewidth=2.2)
    axes.plot(np.zeros(len(some)), at, "|", color="0.1", markersize=8)
    axes.set_yticks(at, [units_for(found.motion).key(one.key).rpartition(".")[2] for one in some])
    widest = float(ends.max(initial=1.0))
    straight = 10.0 ** np.floor(np.log10(max(1.0, widest) / 50))
    axes.set_xscale("symlog", linthresh=straight)
    axes.xaxis.set_major_locator(FixedLocator(straight * np.array([-100.0, -1.0, 0.0, 1.0, 100.0])))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.3g}".replace("e+0", "e")))
    axes.set_xlim(-1.6 * widest, 1.6 * widest)
    axes.set_xlabel("from the value (%)")


def _past(axes: Axes, found: Identification) -> None:
    lags = np.arange(1, found.lags.size + 1)
    axes.vlines(lags, 0, found.lags, color="#08306b", linewidth=1.6)
    white = 2 / np.sqrt(max(found.error_m.size, 1))
    axes.axhspan(-white, white, color="0.85", zorder=0)
    reach = max(0.1, 1.15 * float(np.abs(found.lags).max(initial=0.0)))
    axes.set_ylim(-reach, reach)
    axes.set_xlim(0, lags[-1] + 1)
    axes.set_xlabel("samples back")
    axes.set_ylabel("correlation")
