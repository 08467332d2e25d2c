"""The summary of a run, as numbers and as ten lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.text import rows_text
from avc_casadi._util.units import KG, MASS, N_PER_M, NS_PER_M
from avc_casadi.model.schedule import GainSchedule

if TYPE_CHECKING:
    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.model.problem import Problem

# Fields of a level in the summary.
_OF_A_LEVEL = ("pass", "title", "margin_ns_per_m", "frequency_hz", "model", "claim", "refused")


def summarise(
    problem: Problem,
    comparison: Comparison,
    best: GainSchedule,
    certificate: Mapping[str, Any],
    push: Mapping[str, Any],
) -> dict[str, Any]:
    """Return the numbers of the summary as JSON values.

    Args:
        problem: the problem.
        comparison: its comparison, which is of the pointwise problem.
        best: gains for the device: those of the problem's own scope.
        certificate: the `certify` document of these gains.
        push: the `push` document, or ``{"skipped": why}``, or ``{"refused": why}``.
    """
    injection = comparison.injection
    worst = int(np.argmax(injection.injected_damping_ns_per_m))
    with np.errstate(divide="ignore", invalid="ignore"):
        magnitude = best.magnitude_error / np.abs(best.target)
    device, environment = problem.device, problem.environment
    check = comparison.cross_check
    summary = {
        "problem": problem.name,
        "title": problem.title,
        "structure": comparison.structure,
        "model": comparison.model,
        "scope": comparison.scope,
        "environment": environment.model_dump(),
        "device": device.model_dump(),
        "passive_limit_n_per_m": plain(comparison.passive_limit_n_per_m),
        "method": best.method,
        "solver": best.solver,
        "rows": best.rows,
        "rows_with_gains": int(best.usable.sum()),
        "lowest_hz": float(best.frequency_hz.min()),
        "highest_hz": float(best.frequency_hz.max()),
        "seconds": {"build": best.build_seconds, "solve": best.solve_seconds},
        "damping_ns_per_m": _range(best, best.damping_ns_per_m),
        "stiffness_n_per_m": _range(best, best.stiffness_n_per_m),
        "magnitude_error": _spread(best, magnitude),
        "complex_error": _spread(best, best.complex_error),
        "cross_check": None if check is None else check.document(),
        "counts": comparison.counts(),
        "closed_form": comparison.methods["closed-form"].counts(),
        "injected_damping_ns_per_m": injection.injected_damping_ns_per_m[worst],
        "virtual_mass_kg": injection.virtual_mass_kg[worst],
        "certificate": {
            level: {key: found[key] for key in _OF_A_LEVEL} for level, found in certificate["levels"].items()
        },
        "push": dict(push),
    }
    found: dict[str, Any] = plain(summary)
    return found


def _range(gains: GainSchedule, values: FloatArray) -> list[float] | None:
    known = values[gains.usable]
    return [float(known.min()), float(known.max())] if known.size else None


def _spread(gains: GainSchedule, share: FloatArray) -> dict[str, float] | None:
    known = np.where(gains.usable & np.isfinite(share), share, -np.inf)
    if not np.isfinite(known).any():
        return None
    worst = int(np.argmax(known))
    return {
        "median": float(np.median(known[np.isfinite(known)])),
        "worst": float(known[worst]),
        "worst_hz": float(gains.frequency_hz[worst]),
    }


def summary_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return the summary as nine lines; the command adds where the files are."""
    delivered = summary["method"] + _scope(summary)
    device, wall, seconds = summary["device"], summary["environment"], summary["seconds"]
    counts, closed, rows = summary["counts"], summary["closed_form"], summary["rows"]
    realisable = closed.get("solved", 0) + closed.get("active-bound", 0)
    limit = summary["passive_limit_n_per_m"]
    limit = "not known" if limit is None else f"{limit:.4g} {N_PER_M}"
    return [
        (
            f"{': '.join(filter(None, (summary['problem'], summary['title'])))} (structure {summary['structure']}, "
            f"model {summary['model']}, scope {summary['scope']})"
        ),
        (
            f"wall {wall['stiffness_n_per_m']:g} {N_PER_M}, {wall['damping_ns_per_m']:g} {NS_PER_M}; device "
            f"{device['mass_kg']:g} {KG}, {device['damping_ns_per_m']:g} {NS_PER_M}, T "
            f"{1e3 * device['sample_time_s']:g} ms, delay {device['delay_samples']:g}; passive limit at DC {limit}"
        ),
        (
            f"{delivered}: {summary['rows_with_gains']} of {rows} frequencies have gains ({summary['lowest_hz']:g} to "
            f"{summary['highest_hz']:g} Hz; {seconds['solve']:.2g} s); b {_span(summary['damping_ns_per_m'])} "
            f"{NS_PER_M}, k {_span(summary['stiffness_n_per_m'])} {N_PER_M}"
        ),
        f"error of |Z|: {_percent(summary['magnitude_error'])}; impedance error: {_percent(summary['complex_error'])}",
        _cross_check(summary["cross_check"]),
        f"closed form: realisable at {realisable} of {rows} frequencies; {injection_line(summary)}",
        "verdicts, pointwise: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count),
        f"certificate of {summary['method']}{_scope(summary)}: {_levels(summary['certificate'])}",
        device_line(summary["push"]),
    ]


def _scope(summary: Mapping[str, Any]) -> str:
    return "" if summary["scope"] == "pointwise" else f", scope {summary['scope']}"


def scope_line(summary: Mapping[str, Any]) -> str:
    """Return the compared scope, and that of the device's gains where it differs."""
    line = "Verdicts and cross-check are pointwise: each frequency on its own, as (12) is in the paper."
    if summary["scope"] == "pointwise":
        return line
    return (
        f"{line} The gains drawn and told are those of {summary['method']}{_scope(summary)}; "
        "the pointwise gains stand here for reference."
    )


def injection_line(summary: Mapping[str, Any]) -> str:
    """Return the nature of the closed form."""
    if summary["injected_damping_ns_per_m"] == 0:
        return "the desired wall meets (12) everywhere, so that nothing is projected"
    return (
        f"it is the desired wall with a damper of up to {summary['injected_damping_ns_per_m']:.4g} {NS_PER_M} and a "
        f"virtual {MASS} of {summary['virtual_mass_kg']:.3g} {KG}"
    )


def _span(ends: list[float] | None) -> str:
    return "-" if ends is None else f"{ends[0]:.4g} to {ends[1]:.4g}"


def _percent(spread: Mapping[str, float] | None) -> str:
    if spread is None:
        return "undefined"
    return f"median {100 * spread['median']:.2g} %, worst {100 * spread['worst']:.3g} % at {spread['worst_hz']:.4g} Hz"


def _cross_check(check: Mapping[str, Any] | None) -> str:
    if check is None:
        return "direct was not checked against exact"
    word = "agree" if check["agree"] else "DISAGREE"
    said = f"direct and exact {word}, pointwise: magnitude errors within {check['magnitude_error']:.1g} of |Z|"
    if not check["partings"]:
        return said
    first = check["partings"][0]
    return f"{said}; they part at {len(check['partings'])}, first at {first['frequency_hz']:.4g} Hz: {first['reason']}"


def _levels(levels: Mapping[str, Mapping[str, Any]]) -> str:
    passed = [f"{level} ({found['title']})" for level, found in levels.items() if found["pass"]]
    failed = [
        level if found["margin_ns_per_m"] is None else f"{level} by {-found['margin_ns_per_m']:.2g} {NS_PER_M}"
        for level, found in levels.items()
        if not (found["pass"] or found["refused"])
    ]
    refused = [level for level, found in levels.items() if found["refused"]]
    parts = ["passes " + ", ".join(passed) if passed else "passes no level"]
    if failed:
        parts.append("fails " + ", ".join(failed))
    if refused:
        parts.append("refused on this device, not judged: " + ", ".join(refused))
    return "; ".join(parts)


def device_line(push: Mapping[str, Any]) -> str:
    """Return the result of the push in one line."""
    if "skipped" in push:
        return f"device: push skipped; {push['skipped']}"
    if push.get("deployable") is False:  # the reason stands in the conclusion
        return "device: push refused, as the coupling is not deployable; avc push coupling.json --unsafe overrides"
    if "refused" in push:
        return f"device: push refused; {push['refused']}"
    equal = "equal" if push["readback_equal"] else "NOT EQUAL"
    tried = push.get("in_the_loop")
    beside = ""
    if tried is not None:
        what = tried["sentence"] if "sentence" in tried else f"not tried; {tried['skipped']}"
        beside = f"; firmware and plant in the loop: {what}"
    return (
        f"device: coupling {push['coupling_id']}, {rows_text(push['rows'])} on {push['port']}, "
        f"table {push['table_id']}, read back {equal}, rounding {push['rounding_max']:.1g} relative{beside}"
    )
