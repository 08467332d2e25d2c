"""The trade-off study: what a guarantee costs in realism, and what adaptive gains win over constant ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.ticker import FuncFormatter

from avc_casadi._util import units
from avc_casadi.claims.registry import CLAIMS
from avc_casadi.present.figures.layout import GivenAxes, Panels
from avc_casadi.present.figures.style import IMPEDANCE_UNIT, styled

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from avc_casadi.design.comparison.pareto import Pareto, Point, Study

_ADAPTIVE: dict[str, Any] = {"color": "#08306b", "linestyle": "-", "marker": "o", "label": "adaptive"}
_CONSTANT: dict[str, Any] = {"color": "#d1600a", "linestyle": (0, (5, 1.6)), "marker": "s", "label": "constant"}
_PHASE = {"markerfacecolor": "white", "linewidth": 0.9}
_UNNOTICED = 1e-2
"""Errors below this, in per cent, are drawn on this line."""
_COMPLEX, _MAGNITUDE = "impedance error", "magnitude error"
_SHORT = {"own frequency": "own\nfreq.", "all frequencies": "all\nfreq.", "no limit": "none", "constant": "const."}


@styled
def draw_pareto(study: Pareto, axes: GivenAxes = None) -> Figure:
    """Draw errors and DC stiffness against scope, errors against slope limit, both against contact damping.

    Args:
        study: what is drawn.
        axes: 6 axes to draw in, row by row; None makes a figure.

    Raises:
        InputError: another number of axes.
    """
    layout: tuple[tuple[str, Study, Callable[[Axes, Pareto, Study], None], str], ...] = (
        ("a", "scope", _errors, "(a) errors against the guarantee, and levels met"),
        ("b", "scope", _stiffness, "(b) DC stiffness against the guarantee"),
        ("c", "slope", _errors, "(c) errors against the slope limit"),
        ("d", "slope", _stiffness, "(d) DC stiffness against the slope limit"),
        ("e", "contact", _errors, "(e) errors against contact damping"),
        ("f", "contact", _stiffness, "(f) DC stiffness against contact damping"),
    )
    panels = Panels.of(
        axes,
        [title for _, _, _, title in layout],
        7.6,
        lambda figure: figure.subplots(3, 2, height_ratios=[1.25, 1, 1]).ravel(),
    )
    by_letter = dict(zip("abcdef", panels.axes, strict=True))
    for panel, study_name, draw, _ in layout:
        draw(by_letter[panel], study, study_name)
    for name in ("c", "d"):
        by_letter[name].set_xlabel("slope limit |d ln gain / d ln f|")
    for name in ("e", "f"):
        by_letter[name].set_xlabel(rf"largest $b_\mathrm{{p}}$ ({IMPEDANCE_UNIT}); stable with every hand")
    _certificates(by_letter["a"], study.of("scope", constant=False))
    handles: dict[str, Any] = {}
    for one in panels.axes:
        handles |= dict(zip(*reversed(one.get_legend_handles_labels()), strict=True))
    panels.legend(handles.values(), handles.keys(), 3)
    return panels.figure


def _errors(axes: Axes, study: Pareto, name: Study) -> None:
    _curves(axes, study, name, lambda point: _per_cent(point.complex_error), f", {_COMPLEX}", _PHASE)
    _curves(axes, study, name, lambda point: _per_cent(point.magnitude_error), f", {_MAGNITUDE}", {})
    if any(np.isfinite(point.complex_error) for point in study.of(name)):
        axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(FuncFormatter(_some))
    low, high = study.band_hz
    axes.set_ylabel(f"error, {low:.3g} to {high:.3g} Hz (%)")


def _per_cent(error: float) -> float:
    return float(np.maximum(100 * error, _UNNOTICED))


def _some(value: float, _position: int) -> str:
    """Label 2 and 5 of each decade."""
    return f"{value:g}" if f"{value:.0e}"[0] in "25" else ""


def _stiffness(axes: Axes, study: Pareto, name: Study) -> None:
    _curves(axes, study, name, lambda point: point.dc_stiffness_n_per_m / 1e3, None, {})
    desired, limit = study.desired_stiffness_n_per_m / 1e3, study.passive_limit_n_per_m / 1e3
    axes.axhline(desired, color="0.6", linewidth=2.5, zorder=1, label="desired stiffness")
    if np.isfinite(limit):
        axes.axhline(limit, color="0.35", linestyle=(0, (1, 1.4)), zorder=1, label="limit of passive linear rendering")
    axes.set_ylim(0, 1.12 * (desired or limit or 1.0))
    axes.set_ylabel(f"at {study.dc_frequency_hz:.3g} Hz ({units.KN_PER_M})")


def _curves(
    axes: Axes,
    study: Pareto,
    name: Study,
    value: Callable[[Point], float],
    kind: str | None,
    look: dict[str, Any],
) -> None:
    labels = list(dict.fromkeys(point.label for point in study.of(name)))
    for style, constant in ((_ADAPTIVE, False), (_CONSTANT, True)):
        points = study.of(name, constant=constant)
        if not points:
            continue
        drawn = style | look | {"label": "_" if kind is None else style["label"] + kind}
        axes.plot([labels.index(point.label) for point in points], [value(point) for point in points], **drawn)
    _categories(axes, labels)


def _categories(axes: Axes, labels: Sequence[str]) -> None:
    short = [_SHORT.get(label, label.replace(f" {units.NS_PER_M}", "").replace(" ", "\n")) for label in labels]
    axes.set_xticks(range(len(labels)), short)
    axes.set_xlim(-0.4, len(labels) - 0.6)


def _certificates(axes: Axes, points: list[Point]) -> None:
    """Write under each adaptive design which levels of the certificate it passes."""
    axes.margins(y=0.25)
    for position, point in enumerate(points):
        # Levels that a scope asks for; the others are about other walls.
        passed = [name for name, claim in CLAIMS.items() if claim.scope is not None and point.passed[name]]
        axes.annotate(
            "\n".join(passed) or "none",
            (position, 0.02),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="bottom",
            fontsize=7,
            color="0.3",
        )
    finite = [_per_cent(p.magnitude_error) for p in points if np.isfinite(p.magnitude_error)]
    if finite:
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, 0.1 * min(finite)), high)
