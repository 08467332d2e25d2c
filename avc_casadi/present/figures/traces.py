"""Motion over time: simulated runs of a scene, an identified device beside its log, an oscillation and its spectrum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from avc_casadi._util.units import units_for
from avc_casadi.present.figures import style
from avc_casadi.simulation.scene import Run

if TYPE_CHECKING:
    from avc_casadi.diagnose.causes import Diagnosis
    from avc_casadi.identification.device import Identification

_RUNS: tuple[tuple[str, Any, float], ...] = (
    (style.BLUE, "-", 1.6),
    (style.ORANGE, style.DASHED, 1.4),
    (style.OLIVE, style.DASH_DOT, 1.4),
    (style.PURPLE, style.DOTTED, 1.6),
)
_LARGE_M = 2e-3
"""Motion, m, above which it is drawn in millimetres."""

_COHERENT = 0.3
"""Coherence above which a measured response is drawn."""

_CYCLES_SHOWN = 6
"""Cycles of an oscillation whose force is drawn against the position."""

_SHOWN_S = 0.2
"""Time, s, that is drawn instead where there is no oscillation."""


@style.styled
def draw_identification(identified: Identification) -> Figure:
    """Draw a model against its log over time, and their frequency responses."""
    titles = (
        "position, the model all but free",
        "measured less model",
        "velocity over force",
        "its phase, less that of a mass",
    )
    figure = style.panels(titles, 5.8, "ab;cd")
    position, left, size, phase = figure.axes
    grey: dict[str, Any] = {"color": "0.55", "linewidth": 2.6}
    points: dict[str, Any] = {"color": "0.55", "linestyle": "none", "marker": "o", "markersize": 2.4}
    blue: dict[str, Any] = {"color": style.BLUE, "linewidth": 1.2, "linestyle": style.DASHED}
    units = units_for(identified.motion)
    time, measured, simulated = identified.stretch
    position.plot(time, 1e3 * measured, label="measured", **grey)
    position.plot(time, 1e3 * simulated, label="model", **blue)
    difference = measured - simulated
    scale, unit = (1e3, "mm") if np.abs(difference).max(initial=0.0) > _LARGE_M else (1e6, "um")
    left.plot(time, scale * difference, color=style.BLUE, linewidth=0.8)
    for panel, label in ((position, f"position ({units.unit('mm')})"), (left, f"difference ({units.unit(unit)})")):
        panel.set(xlabel="time (s)", ylabel=label, xlim=(float(time[0]), float(time[-1])))
    response, frequency = identified.response, identified.response.frequency_hz
    use = response.excites & (response.coherence > _COHERENT)
    if not use.any():
        use = np.ones_like(use)
    band = frequency[use]
    span = (frequency >= band[0]) & (frequency <= band[-1])
    # A mass has -90 degrees; the rest is damping, delay, amplifier and resonance.
    turned = np.degrees(np.angle(1j * response.velocity_per_force[use]))
    model = np.degrees(np.unwrap(np.angle(1j * identified.model_response[span])))
    # Each measured phase is unwrapped to that of the model.
    turned += 360 * np.round((np.interp(band, frequency[span], model) - turned) / 360)
    size.plot(band, np.abs(response.velocity_per_force[use]), **points)
    size.plot(frequency[span], np.abs(identified.model_response[span]), **blue)
    phase.plot(band, turned, **points)
    phase.plot(frequency[span], model, **blue)
    size.set(yscale="log", ylabel=f"|v/F| ({units.unit('m/s')} per {units.unit('N')})")
    style.log_ticks(size.yaxis, *size.get_ylim())
    phase.set_ylabel("phase (degrees)")
    for panel in (size, phase):
        style.frequency_axis(panel, band)
    return style.with_legend(figure, 2)


@style.styled
def draw_diagnosis(diagnosis: Diagnosis) -> Figure:
    """Draw the oscillation of a log: position, envelope, cycles of the force, spectrum."""
    titles = ("position", "oscillation and envelope", "force against position", "spectrum")
    figure = style.panels(titles, 5.8, "ab;cd")
    position, oscillation, cycles, spectrum = figure.axes
    log = diagnosis.log
    swing = diagnosis.swing
    units = diagnosis.design.device.units
    time, inside = log.time_s, slice(swing.first, swing.last)
    size, unit = (1e3, units.unit("mm")) if swing.peak_to_peak_m > _LARGE_M else (1e6, units.unit("um"))
    position.plot(time, 1e3 * log.position_m, color=style.BLUE, linewidth=0.8)
    oscillation.plot(time, size * swing.fast_m, color=style.BLUE, linewidth=0.6, label="position without slow motion")
    for sign, label in ((1, "envelope"), (-1, "_")):
        oscillation.plot(time, sign * size * swing.envelope_m, color=style.ORANGE, linewidth=1.0, label=label)
    for panel, label in ((position, f"position ({units.unit('mm')})"), (oscillation, f"oscillation ({unit})")):
        panel.set(xlabel="time (s)", ylabel=label, xlim=(float(time[0]), float(time[-1])))
        if swing.kind != "none":
            panel.axvspan(float(time[swing.first]), float(time[swing.last - 1]), color="0.92", zorder=0)
    length = _CYCLES_SHOWN / swing.frequency_hz if math.isfinite(swing.frequency_hz) else _SHOWN_S
    middle = np.abs(time - (time[swing.first] + time[swing.last - 1]) / 2) <= length / 2
    cycles.plot(size * log.position_m[middle], -log.force_n[middle], color=style.BLUE, linewidth=0.8)
    cycles.set(xlabel=f"position ({unit})", ylabel=f"commanded {units.key('force')} ({units.unit('N')})")
    window = np.hanning(swing.fast_m[inside].size)
    amplitude = size * 2 * np.abs(np.fft.rfft(swing.fast_m[inside] * window)) / max(window.sum(), 1.0)
    hertz = np.fft.rfftfreq(window.size, log.period_s)
    top = max(float(amplitude[1:].max(initial=0.0)), 1e-9)
    spectrum.plot(hertz[1:], amplitude[1:], color=style.BLUE, linewidth=0.9)
    spectrum.set(yscale="log", ylabel=f"amplitude ({unit})", ylim=(1e-4 * top, 3 * top))
    style.log_ticks(spectrum.yaxis, *spectrum.get_ylim())
    style.frequency_axis(spectrum, hertz[1:])
    if log.encoder_m:
        half, place = size * log.encoder_m / 2, spectrum.get_yaxis_transform()
        spectrum.axhline(half, color="0.55", linewidth=0.9, linestyle=(0, (4, 2)))
        spectrum.text(0.02, 1.15 * half, "half an encoder step", transform=place, fontsize=7)
    return style.with_legend(figure, 2)


@style.styled
def draw_scene(runs: Sequence[Run], names: Sequence[str] | None = None) -> Figure:
    """Draw up to four runs of scenes with one motion in the same four panels."""
    units, aim = runs[0].units, runs[0].target_m
    force_word = units.key("force")
    mm, newton = units.unit("mm"), units.unit("N")
    titles = (
        "position; the wall begins at 0",
        f"{force_word} on the device",
        f"{force_word} against penetration",
        "energy taken in by the virtual side",
    )
    figure = style.panels(titles, 5.6, "ab;cd")
    position, force, loop, energy = figure.axes
    label = f"target of the hand, up to {1e3 * aim.max():.3g} {mm}"
    position.plot(runs[0].time_s, 1e3 * aim, color="0.65", linewidth=2.4, label=label, zorder=1)
    named = list(zip(runs, names or [run.coupling for run in runs], strict=True))
    deepest, some_rest = 0.0, any(run.stable for run in runs)
    stable_first = sorted(named, key=lambda pair: not pair[0].stable)
    for index, (run, name) in enumerate(stable_first):
        colour, dash, width = _RUNS[index % len(_RUNS)]
        line: dict[str, Any] = {"color": colour, "linestyle": dash, "linewidth": width, "zorder": 6 - index}
        if not run.stable:
            # Thousands of cycles: a thin line, and a grey veil behind the runs that settle, which keep their limits.
            line |= {"linestyle": "-", "linewidth": 0.35} | ({"color": "0.55", "zorder": 2} if some_rest else {})
            for panel in figure.axes if some_rest else ():
                panel.set(xlim=panel.get_xlim(), ylim=panel.get_ylim())
        outcome = {"asymptotic": "stable", "held-by-friction": "held by friction"}.get(run.claim, "unstable")
        label = f"{name}: {outcome}{', buzzes' if run.buzzing else ''}"
        traces = run.time_s, 1e3 * run.position_m, run.force_n, 1e3 * run.ledger.absorbed_j
        time, x, pushing, taken = (values[: run.samples_in_reach] for values in traces)
        position.plot(time, x, label=label, **line)
        force.plot(time, pushing, **line)
        loop.plot(x[pushing != 0], pushing[pushing != 0], **line)
        energy.plot(time, taken, **line)
        if run.stable or not some_rest:
            deepest = max(deepest, float(x[pushing != 0].max(initial=0.0)))
    if deepest > 0:  # the wall's surface and its inside, not the target of the hand
        position.set_ylim(-deepest, 1.3 * deepest)
    labels = ("position", mm), (force_word, newton), (force_word, newton), ("energy", "mJ")
    for panel, (word, unit) in zip(figure.axes, labels, strict=True):
        panel.set(xlabel="time (s)", ylabel=f"{word} ({unit})")
    loop.set_xlabel(f"penetration ({mm})")
    for panel in (position, energy):
        panel.axhline(0, color="0.4", linewidth=0.7, zorder=0)
    loop.axvline(0, color="0.4", linewidth=0.7, zorder=0)
    loop.locator_params(axis="x", nbins=5)
    return style.with_legend(figure, 2)
