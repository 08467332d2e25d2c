"""Rendered impedance of a simulation or a follower against the wanted one: free motion, and a rigid object."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.present.figures.style import (
    GivenAxes,
    Panels,
    entries_of,
    frequency_axis,
    impedance_unit,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi.recommendation.tool_impedance import RenderedBand

_WANTED: dict[str, Any] = {"color": "0.72", "linewidth": 4.0, "label": "wanted"}
_FELT: dict[str, Any] = {"color": "#08306b", "label": "rendered"}


@styled
def draw_rendered_impedance(band: RenderedBand, axes: GivenAxes = None) -> Figure:
    """Draw impedance in free motion against that of device and other end as one body, and stiffness against K."""
    hz = np.array([one.frequency_hz for one in band.felt])
    moved = [one for one in band.felt if one.mass_kg is not None and one.drag_ns_per_m is not None]
    titles = ["(a) impedance in free motion", "(b) stiffness on a rigid object"]
    if not moved:
        titles = ["stiffness on a rigid object"]
    panels = Panels.of(axes, titles, 2.9, lambda figure: figure.subplots(1, len(titles), squeeze=False).ravel())
    *free, stiff = panels.axes
    for panel in free:
        omega = 2 * np.pi * hz
        felt = [
            np.hypot(one.drag_ns_per_m or 0.0, w * (one.mass_kg or 0.0)) for one, w in zip(moved, omega, strict=True)
        ]
        panel.plot(hz, np.hypot(band.damping_ns_per_m, omega * band.mass_kg), **_WANTED)
        panel.plot(hz, felt, **_FELT)
        panel.set_yscale("log")
        panel.set_ylabel(f"|Z| ({impedance_unit(band)})")
    rendered = np.array([one.stiffness_n_per_m for one in band.felt])
    stiff.plot(hz, np.full(len(hz), band.stiffness_n_per_m), **_WANTED)
    stiff.plot(hz, rendered, **_FELT)
    if rendered.max() > 3 * band.stiffness_n_per_m:
        stiff.set_yscale("log")
    else:
        stiff.set_ylim(0, 1.1 * max(band.stiffness_n_per_m, float(rendered.max())))
    stiff.set_ylabel(f"stiffness ({band.units.unit('N/m')})")
    for panel in panels.axes:
        frequency_axis(panel, hz)
        panel.set_xlabel("frequency (Hz)")
    panels.legend(entries_of(stiff), 2)
    return panels.figure
