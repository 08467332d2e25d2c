"""The region of an admittance device: virtual mass over damping."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from avc_casadi._util.text import quantity
from avc_casadi.claims.mass_width import MassWidth
from avc_casadi.present.figures import style

_VIEW = 1.6
"""How far the axes reach beyond what the region needs, as a factor."""


@style.styled
def draw_mass_width(region: MassWidth) -> Figure:
    """Draw which virtual masses are stable, and which have a sound disk margin, over the damping."""
    figure = style.panels(("virtual mass and damping: what the device can render",), 4.4)
    (plane,) = figure.axes
    unit = region.units.unit
    damping = region.damping_ns_per_m
    low, high = _view(region)
    # Beyond the masses that were tried nothing is known.
    lightest, heaviest = max(low, region.scanned_kg[0]), min(high, region.scanned_kg[1])
    for least, largest, label, colour, alpha in (
        (region.least_kg, region.largest_kg, "stable with every hand and contact", style.ORANGE, 0.16),
        (region.sound_least_kg, region.sound_largest_kg, "with a disk margin of 0.2", style.BLUE, 0.30),
    ):
        bottom, top = np.clip(least, lightest, heaviest), np.clip(largest, lightest, heaviest)
        inside = np.isfinite(least)
        plane.fill_between(damping, bottom, top, where=inside, color=colour, alpha=alpha, label=label, linewidth=0)
        plane.plot(damping, np.where(least > lightest, least, np.nan), color=colour, linewidth=1.6)
        plane.plot(damping, np.where(largest < heaviest, largest, np.nan), color=colour, linewidth=1.6)
    law = region.problem.law.admittance if region.problem.law else None
    if law is not None:
        name = f"law: {quantity(law.mass_kg, unit('kg'))}, {quantity(law.damping_ns_per_m, unit('N.s/m'))}"
        place = max(law.damping_ns_per_m, float(damping[0])), max(law.mass_kg, low)
        plane.plot(*place, "*", label=name, markersize=11, color="#b2182b", markeredgecolor="white", clip_on=False)
    known = damping[np.isfinite(region.least_kg)]
    first = known[0] / _VIEW if len(known) else damping[0]
    left = min(first, law.damping_ns_per_m or first) / _VIEW if law is not None else first / _VIEW
    plane.set(xscale="log", yscale="log", ylim=(low, high), xlim=(max(left, damping[0]), damping[-1]))
    plane.set(xlabel=f"virtual damping B ({unit('N·s/m')})", ylabel=f"virtual mass M ({unit('kg')})")
    return style.with_legend(figure, 3)


def _view(region: MassWidth) -> tuple[float, float]:
    """Return the masses between which the region and the law are seen."""
    edges = np.concatenate([region.least_kg, region.sound_least_kg, region.largest_kg])
    shown = edges[np.isfinite(edges) & (edges > 0)]
    law = region.problem.law
    if law is not None and law.admittance.mass_kg:
        shown = np.append(shown, law.admittance.mass_kg)
    if not shown.size:
        return 0.1, 10.0
    return float(shown.min()) / _VIEW, float(shown.max()) * _VIEW
