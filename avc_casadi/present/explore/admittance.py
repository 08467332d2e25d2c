"""The page of an admittance device: sliders of its law, verdict and margins, masses over dampings, the effort."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, get_type_hints

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi.claims.admittance import certify_admittance
from avc_casadi.claims.mass_spans import LawScales
from avc_casadi.claims.mass_width import MassWidth, mass_width
from avc_casadi.coupling import Coupling
from avc_casadi.files.admittance_file import dump_admittance
from avc_casadi.model.admittance import AdmittanceProblem, Contact, VirtualImpedance
from avc_casadi.model.table import valid
from avc_casadi.present.explore.ends import (
    Extent,
    PageAnswer,
    chart,
    file_of,
    headline_of,
    line,
    page_answer,
    saved_coupling,
    six_digits,
)
from avc_casadi.present.explore.explorer import Explorer
from avc_casadi.present.explore.settings import (
    Field,
    Settings,
    adapt,
    document_of,
    gain_fields,
    of_value,
    read_document,
)
from avc_casadi.present.explore.verdict import Judged, of_admittance
from avc_casadi.present.row import Part
from avc_casadi.present.rows import admittance

_LAW = "law.admittance"
_LABELS = {
    "mass_kg": "virtual mass",
    "damping_ns_per_m": "damping",
    "stiffness_n_per_m": "spring",
    "cutoff_hz": "force below",
}
"""What the page calls the numbers of a law."""
_AXES = ("mass_kg", "damping_ns_per_m")
"""Numbers that are the axes of the region."""
_ENDS_HZ = (0.1, 50.0)
"""Frequencies of what a hand feels: of motions of a hand, and of what trembles."""
_POINTS = 120
"""Frequencies of that chart."""
_VIEW = 3.0
"""How far the masses of the region reach beyond those that are known, as a factor."""


def with_law(problem: AdmittanceProblem) -> AdmittanceProblem:
    """Return a problem with a law to begin with: its own, or the mass of handle and hand, and the damping k tau.

    k is the stiffest spring that the handle meets, tau the lag of drive, delay and half a sample.
    """
    if problem.law is not None:
        return problem
    scales = LawScales.of(problem, None)
    mass = problem.device.force_sensor.handle_mass_kg + problem.hands.mass_kg[1]
    damping = float(np.median(scales.dampings_ns_per_m))
    law = {"mass_kg": float(f"{mass:.2g}"), "damping_ns_per_m": float(f"{damping:.2g}")}
    return problem.changed(law={"admittance": law})


@document_of.register
def _document(end: Contact, problem: AdmittanceProblem) -> dict[str, Any]:  # noqa: ARG001
    return problem.model_dump(mode="json", exclude_none=True)


@read_document.register
def _read(end: Contact, tables: Mapping[str, Any]) -> AdmittanceProblem:  # noqa: ARG001
    values = {key: value for key, value in tables.items() if key != "name"}
    return valid(AdmittanceProblem, values, "", str(tables.get("name", "")))


@adapt.register
def _adapt(
    end: Contact,  # noqa: ARG001
    tables: dict[str, Any],
    base: AdmittanceProblem,  # noqa: ARG001
    settings: Settings,
    *,
    live: bool,  # noqa: ARG001
    to_save: bool,  # noqa: ARG001
) -> None:
    """Take the ranges of the sensor away whose value is typed: they have keys of their own."""
    for key in settings.values:
        tables["device"].get("range", {}).pop(key.replace("device.force_sensor.", "sensor_"), None)
        tables["device"].get("range", {}).pop(key.replace("device.force_sensor.", ""), None)


@gain_fields.register
def _law_fields(end: Contact, problem: AdmittanceProblem) -> tuple[Field, ...]:  # noqa: ARG001
    assert problem.law is not None  # noqa: S101 - a page begins with one
    law, hints = problem.law.admittance, get_type_hints(VirtualImpedance, include_extras=True)
    fields = []
    for name, label in _LABELS.items():
        (field,) = of_value(problem, f"{_LAW}.{name}", hints[name], getattr(law, name))
        fields.append(replace(field, group="Your law", label=label))
    return tuple(fields)


@page_answer.register
def _answer(
    end: Contact,  # noqa: ARG001
    explorer: Explorer,
    settings: Settings,
    problem: AdmittanceProblem,
    extent: Extent,
) -> PageAnswer:
    """Return the law of the sliders next to the recommended one; the region is there as soon as it is known."""
    assert problem.law is not None  # noqa: S101 - a page begins with one
    law, found = problem.law.admittance, explorer.found(settings)
    laws = {"own": law} | ({} if found is None or found.admittance is None else {"method": found.admittance})
    gains = {f"{_LAW}.{name}": getattr(law, name) for name in _LABELS}
    # Mass and damping are axes of the region, which does not depend on them.
    others = {key: value for key, value in settings.gains.items() if key.rpartition(".")[2] not in _AXES}
    key = f"region {settings.key()} {others}"
    region = explorer.known(key)
    if extent is Extent.WHOLE:
        region = explorer.cached(key, lambda: mass_width(problem))
    charts = [*([] if region is None else [_region(region, laws)]), _felt(problem, laws)]
    if extent is Extent.PICTURES:
        return PageAnswer(gains, charts)
    limits = extent is Extent.WHOLE
    stated = f"law {limits} {settings.key('gains')}"
    return PageAnswer(gains, charts, explorer.cached(stated, lambda: _judged(problem, limits=limits)))


def _judged(problem: AdmittanceProblem, *, limits: bool) -> Judged:
    certificate = certify_admittance(problem, remedies=False, limits=limits)
    rows = [shown for shown in admittance.certificate(certificate).rows if shown.rank == 0]
    return Judged(of_admittance(certificate), rows)


_NAMES = {"own": "your law", "method": "recommended"}


def _region(region: MassWidth, laws: Mapping[str, VirtualImpedance]) -> dict[str, Any]:
    """Return the chart of masses over dampings: stable ones between lines, sound ones as a band."""
    unit = region.units.unit
    damping = region.damping_ns_per_m
    points = [
        {"name": _NAMES[cls], "cls": cls, "x": max(law.damping_ns_per_m, float(damping[0])), "y": law.mass_kg}
        for cls, law in laws.items()
        if law.mass_kg
    ]
    edges = np.concatenate([region.least_kg, region.sound_least_kg, region.largest_kg, [p["y"] for p in points]])
    known = edges[np.isfinite(edges) & (edges > 0)]
    # Beyond the masses that were tried nothing is known.
    low, high = region.scanned_kg
    if known.size:
        low, high = max(known.min() / _VIEW, low), min(known.max() * _VIEW, high)
    lines = [
        line("lightest stable", "without", damping, np.maximum(region.least_kg, low)),
        line("heaviest stable", "desired", damping, np.where(region.largest_kg < high, region.largest_kg, np.nan)),
    ]
    sound = {
        "name": "disk margin of 0.2",
        "cls": "real",
        "x": six_digits(damping),
        "low": six_digits(np.clip(region.sound_least_kg, low, high)),
        "high": six_digits(np.clip(region.sound_largest_kg, low, high)),
    }
    x, y = (f"virtual damping, {unit('N.s/m')}", "log"), (f"virtual {region.units.key('mass')}, {unit('kg')}", "log")
    title = "What the device can render with every hand and contact"
    return chart("region", title, x, y, lines, bands=[sound], points=points)


def _felt(problem: AdmittanceProblem, laws: Mapping[str, VirtualImpedance]) -> dict[str, Any]:
    """Return the chart of what a hand feels: |j w (M + m_s) + B + K/(j w)|, with the mass m_s of the handle."""
    handle_kg = problem.device.force_sensor.handle_mass_kg
    hz = np.geomspace(_ENDS_HZ[0], min(_ENDS_HZ[1], 0.5 / problem.device.sample_time_s), _POINTS)
    omega = 2 * math.pi * hz
    lines = [
        line(
            _NAMES[cls],
            cls,
            hz,
            np.hypot(law.damping_ns_per_m, omega * (law.mass_kg + handle_kg) - law.stiffness_n_per_m / omega),
        )
        for cls, law in laws.items()
    ]
    force = problem.units.key("force").capitalize()
    title = f"{force} over speed that a hand feels, with the handle"
    return chart("felt", title, ("frequency, Hz", "log"), (problem.units.unit("N.s/m"), "log"), lines)


@saved_coupling.register
def _saved(
    end: Contact,  # noqa: ARG001
    explorer: Explorer,  # noqa: ARG001
    settings: Settings,  # noqa: ARG001
    problem: AdmittanceProblem,  # noqa: ARG001
) -> tuple[Coupling, str]:
    raise InputError.of("is a law in the problem; allowed: save the problem", key="method")


@headline_of.register
def _headline(end: Contact, problem: AdmittanceProblem) -> tuple[Part, ...]:  # noqa: ARG001
    return ("drive", *admittance.device_line(problem.device)[1:])


@file_of.register
def _file(end: Contact, problem: AdmittanceProblem) -> str:  # noqa: ARG001
    return dump_admittance(problem)
