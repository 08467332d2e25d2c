"""The JSON document of a comparison."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi._util.arrays import ComplexArray
from avc_casadi._util.json_values import plain
from avc_casadi.files.gain_file import gain_document

if TYPE_CHECKING:
    from avc_casadi.design.comparison.comparison import Comparison


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """Return the `compare` document: JSON values only, null where a number is undefined."""
    return {
        "problem": comparison.problem,
        "title": comparison.title,
        "model": comparison.model,
        "structure": comparison.structure,
        "scope": "pointwise",
        "problem_scope": comparison.scope,
        "margin_ns_per_m": comparison.margin_ns_per_m,
        "frequency_hz": plain(comparison.frequency_hz),
        "methods": {
            name: gain_document(gains) | comparison.judged[name].document()
            for name, gains in comparison.methods.items()
        },
        "optimum": comparison.optimum,
        "delivered": comparison.delivered,
        "verdict": [verdict.value for verdict in comparison.verdict],
        "reason": list(comparison.reason),
        "counts": comparison.counts(),
        **_parts("without_coupling", comparison.without_coupling),
        **_parts("target", comparison.target),
        **_parts("upper", comparison.upper),
        **_parts("lower", comparison.lower),
        "damping_injection": plain(vars(comparison.injection)),
        "safety": {name: judged.safety.document() for name, judged in comparison.judged.items()},
        "cross_check": None if comparison.cross_check is None else comparison.cross_check.document(),
        "mine": _mine(comparison),
        "passive_limit_n_per_m": plain(comparison.passive_limit_n_per_m),
    }


def _parts(name: str, impedance: ComplexArray) -> dict[str, Any]:
    return {f"{name}_re": plain(impedance.real), f"{name}_im": plain(impedance.imag)}


def _mine(comparison: Comparison) -> dict[str, Any] | None:
    mine = comparison.mine
    if mine is None:
        return None
    values = {name: value for name, value in vars(mine).items() if name != "impedance"}
    return {
        **plain(values),
        "better": mine.better,
        **_parts("impedance", mine.impedance),
        **comparison.judged["mine"].document(),
    }
