"""The region of virtual masses and dampings that an admittance device can render: the M-width.

At each damping a scan of masses finds those that are stable, and those with a sound disk margin (`mass_spans`). Each
end and each line between two dampings is confirmed by searches of the ranges (`mass_edges`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray, Interval
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.admittance import HandleAnalysis
from avc_casadi.claims.mass_edges import MassEdges
from avc_casadi.claims.mass_spans import Spans
from avc_casadi.files.admittance_file import AnyAdmittance, as_admittance
from avc_casadi.model.admittance import AdmittanceProblem, VirtualImpedance

# Dampings whose ends of sound masses searches confirm, and that are printed.
_PRINTED = 6
_STAGES = _PRINTED + 4
"""Stages that are reported: each printed damping, then least damping, edges and the lines between."""


@dataclass(frozen=True, eq=False, repr=False)
class MassWidth(Tabular):
    """The virtual masses that a device can render at each damping, with every hand and contact and released.

    Masses are not a number where none holds, 0 and infinite where the scan met no end.

    Attributes:
        damping_ns_per_m: dampings, shape (n,).
        least_kg: the lightest stable mass, shape (n,).
        largest_kg: the heaviest stable mass.
        sound_least_kg: the lightest with a disk margin of 0.2.
        sound_largest_kg: the heaviest with a disk margin of 0.2.
        least_damping_ns_per_m: the least damping with a stable mass; not a number without any.
        least_sound_damping_ns_per_m: the least with a mass of a disk margin of 0.2; not a number without any.
        confirmed_rows: the dampings, by their place, whose masses searches of hands and contacts confirm.
        scanned_kg: the lightest and the heaviest mass that were tried.
        cutoff_hz: of the low pass of the force; None without one.
        problem: device, hands and contact.

    Example:
        >>> region = avc.mass_width("admittance/cobot")
        >>> bool((region.least_kg <= region.sound_least_kg).any())
        True
    """

    damping_ns_per_m: FloatArray
    least_kg: FloatArray
    largest_kg: FloatArray
    sound_least_kg: FloatArray
    sound_largest_kg: FloatArray
    least_damping_ns_per_m: float
    least_sound_damping_ns_per_m: float
    confirmed_rows: tuple[int, ...]
    scanned_kg: Interval
    cutoff_hz: float | None
    problem: AdmittanceProblem

    def to_dict(self) -> Columns:
        """Return the columns by name with unit, each of shape (n,)."""
        names = ("damping_ns_per_m", "least_kg", "largest_kg", "sound_least_kg", "sound_largest_kg")
        return {name: getattr(self, name) for name in names}

    def _summary(self) -> str:
        return f"{self.problem.name}: sound from {short(self.sound_least_kg, self.units.unit('kg'))}"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        law = self.problem.law
        own = {"problem": self.problem.name, "cutoff_hz": self.cutoff_hz, "law": law and law.model_dump()}
        least = {key: getattr(self, key) for key in ("least_damping_ns_per_m", "least_sound_damping_ns_per_m")}
        return self.problem.units.document(plain({**own, **least, **self.to_dict()}))


def mass_width(problem: AnyAdmittance, progress: Progress = SILENT) -> MassWidth:
    """Return which virtual masses an admittance device can render at each damping.

    Spring and low pass are those of the law of the problem, if it has one.

    Args:
        problem: an `AdmittanceProblem`, its file or name.
        progress: told how many searches and dampings are done.

    Raises:
        InputError: a value that is refused.

    Example:
        >>> region = avc.mass_width("admittance/cobot")
        >>> region.damping_ns_per_m.shape == region.least_kg.shape
        True
    """
    stated = as_admittance(problem)
    own = stated.law.admittance if stated.law else VirtualImpedance(mass_kg=1.0, damping_ns_per_m=1.0)
    analysis = HandleAnalysis(stated)
    progress.advance(0, _STAGES, "hands and contacts")
    edges = MassEdges(analysis, own)
    rows = np.arange(len(edges.dampings))
    printed = _spread(edges.span(rows, sound=True))
    for number, row in enumerate(printed, 1):
        progress.advance(number, _STAGES, "hands and contacts")
        edges.confirm_sound(row)
    progress.advance(_PRINTED + 1, _STAGES, "least damping")
    least, least_sound = edges.least_damping(sound=False), edges.least_damping(sound=True)
    progress.advance(_PRINTED + 2, _STAGES, "edges")
    edges.settle()
    progress.advance(_PRINTED + 3, _STAGES, "lines between")
    drawn = edges.edges()
    progress.advance(_STAGES, _STAGES, "lines between")
    shown = np.flatnonzero(np.isin(drawn.places, printed) & np.isfinite(drawn.sound.low))
    return MassWidth(
        damping_ns_per_m=edges.dampings_at(drawn.places),
        least_kg=drawn.stable.low,
        largest_kg=drawn.stable.high,
        sound_least_kg=drawn.sound.low,
        sound_largest_kg=drawn.sound.high,
        least_damping_ns_per_m=least,
        least_sound_damping_ns_per_m=least_sound,
        confirmed_rows=tuple(shown.tolist()),
        scanned_kg=(float(edges.masses[0]), float(edges.masses[-1])),
        cutoff_hz=own.cutoff_hz,
        problem=stated,
    )


def _spread(spans: Spans) -> list[int]:
    """Return rows of spans that are known: evenly among all, the first and the last too."""
    known = np.flatnonzero(np.isfinite(spans.low))
    places = np.linspace(0, len(known) - 1, min(len(known), _PRINTED)).astype(int)
    return [int(row) for row in known[places]]
