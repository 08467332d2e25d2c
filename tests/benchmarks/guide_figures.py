"""The figures of the guide that are computed in seconds: closed form, phase, constant couplings, what certificates say.

python tests/benchmarks/guide_figures.py

Overwrites results/guide_figures.json beside this file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about

import avc_casadi as avc
from avc_casadi.claims.thinning import reduce_rows
from avc_casadi.coupling import Coupling
from avc_casadi.design.constant.static import static_coupling
from avc_casadi.model.gains import GainTable
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.realism import bound_magnitudes, judge_realism

RESULTS = Path(__file__).parent / "results" / "guide_figures.json"


def figure5() -> dict[str, Any]:
    problem = avc.load_problem("figure5")
    direct, closed = avc.solve(problem, "direct"), avc.solve(problem, "closed-form")
    lower, upper = bound_magnitudes(problem, loop_at(problem, direct.frequency_hz))
    size = np.abs(direct.target)
    realism = judge_realism(problem, direct.impedance)
    return {
        "rows": len(direct.frequency_hz),
        "closed_form_realisable": int(sum(np.isfinite(closed.damping_ns_per_m))),
        "direct_complex_error": float(direct.complex_error.max()),
        "direct_phase_deg": float(np.degrees(np.abs(np.angle(direct.impedance / direct.target))).max()),
        "direct_inside_bounds": realism.share_inside_bounds,
        "direct_inside_jnd": realism.share_inside_jnd,
        "targets_outside_their_bounds": int(np.count_nonzero((size < lower) | (size > upper))),
        "dc_limit_n_per_m": avc.certify(problem, direct).document()["passive_limit_n_per_m"],
    }


def constant() -> dict[str, Any]:
    problem = avc.load_problem("figure5")
    found = {}
    for condition in ("llewellyn", "all"):
        for model in ("paper", "sampled-data"):
            one = static_coupling(problem, condition, model)
            found[f"{condition} | {model}"] = {
                "damping_ns_per_m": one.damping_ns_per_m,
                "stiffness_n_per_m": one.stiffness_n_per_m,
                "error": one.error,
            }
    return found


def levels(certificate: avc.Certificate) -> dict[str, Any]:
    document = certificate.document()
    kept = ("title", "pass", "margin_ns_per_m", "frequency_hz", "rows_failed", "model")
    told = {level: {key: of[key] for key in kept} for level, of in document["levels"].items()}
    return {"levels": told}


def closed_form() -> dict[str, Any]:
    return levels(avc.certify("figure5", avc.solve("figure5", "closed-form"), requested=True))


def diverging() -> dict[str, Any]:
    gains = avc.solve("diverging", "exact")
    claims = avc.deployable(Coupling.of(avc.load_problem("diverging"), gains)).claims
    let_go = next(claim.radius for claim in claims if claim.name == "let-go")
    return levels(avc.certify("diverging", gains)) | {"radius_let_go": let_go}


def thinned() -> dict[str, Any]:
    problem = avc.load_problem("figure5").changed(stability={"scope": "band", "band_factor": 2.0})
    kept = reduce_rows(GainTable.of(avc.solve(problem, "schedule")), problem, tolerance=0.01)
    return {"rows": len(kept.table.frequency_hz), "slack_ns_per_m": kept.scope_slack}


def main() -> None:
    script_arguments(__doc__)
    parts = (figure5, constant, closed_form, diverging, thinned)
    document = {"about": about("python tests/benchmarks/guide_figures.py", 0)}
    document |= {part.__name__: part() for part in parts}
    RESULTS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
