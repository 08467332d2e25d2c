"""Stable springs and dampers to a virtual tool: K against B, a curve for each engine rate."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps

from avc_casadi._util.text import quantity
from avc_casadi.present.figures.style import GivenAxes, Panels, entries_of, impedance_unit, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi.design.tool_region import ToolRegion


@styled
def draw_tool_region(region: ToolRegion, axes: GivenAxes = None) -> Figure:
    """Draw the K-B region of a coupling to a simulation; stable below each curve."""
    title = "couplings to the simulation: stable below each curve"
    title += ", with a critical damper in the device's loop" if region.local_damping_ratio else ""
    panels = Panels.of(axes, (title,), 4.2, lambda figure: [figure.subplots()])
    panel, damping = panels.axes[0], region.damping_ns_per_m[1:]
    colours = colormaps["viridis"](np.linspace(0.0, 0.85, len(region.curves)))
    for colour, curve in zip(colours, region.curves, strict=True):
        at, stiffness, peak = damping, curve.stiffness_n_per_m[1:], curve.stiffest
        if peak is not None and peak.local_damping_ns_per_m == region.local_damping_ratio == 0:
            # Between two dampers of the curve.
            place = int(np.searchsorted(at, peak.damping_ns_per_m))
            at = np.insert(at, place, peak.damping_ns_per_m)
            stiffness = np.insert(stiffness, place, peak.stiffness_n_per_m)
        label = quantity(1 / curve.step_s, "Hz")
        label += " (declared)" if curve.declared else ""
        label += "" if (stiffness > 0).any() else ": none"
        shown = np.where(stiffness > 0, stiffness, np.nan)
        panel.plot(at, shown, color=colour, linewidth=2.4 if curve.declared else 1.3, label=label)
        if curve.declared:
            panel.fill_between(at, 0, np.nan_to_num(shown), color=colour, alpha=0.12, linewidth=0)
    whole = np.concatenate([curve.stiffness_n_per_m for curve in region.curves])
    top = whole.max(initial=1.0) or 1.0
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_ylim(max(0.7 * whole[whole > 0].min(initial=top), 1e-4 * top), 2 * top)
    panel.set_xlim(damping[0], damping[-1])
    if region.chosen is not None:
        b, k = region.chosen.damping_ns_per_m, region.chosen.stiffness_n_per_m
        panel.plot(max(b, float(damping[0])), k, "k*", markersize=11, label="recommended")
    panel.set_xlabel(f"damper B ({impedance_unit(region)})")
    panel.set_ylabel(f"spring K ({region.units.unit('N/m')})")
    panels.legend(entries_of(panel), 5)
    return panels.figure
