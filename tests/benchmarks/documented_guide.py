"""The measured figures of the guide, from results/guide_figures.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from studied import percent, table

Document = Mapping[str, Any]


def closed_form(found: Document) -> str:
    part = found["figure5"]
    return (
        f"On `figure5`, with b <= 10⁴ N.s/m, it is realisable at {part['closed_form_realisable']} of {part['rows']} "
        "frequencies (`avc compare figure5` says where, and why)."
    )


def phase(found: Document) -> str:
    part = found["figure5"]
    return (
        f"On `figure5` the impedance error |Z_h_avc - Z_h_ds| of `direct` reaches "
        f"{100 * part['direct_complex_error']:.0f} % of |Z_h_ds|: the two point up to "
        f"{part['direct_phase_deg']:.0f} degrees apart."
    )


def targets_outside(found: Document) -> str:
    part = found["figure5"]
    count = part["targets_outside_their_bounds"]
    return f"On `figure5` the goal leaves its own range at {count} of {part['rows']} frequencies."


def realism(found: Document) -> str:
    part = found["figure5"]
    return (
        f"`direct` on `figure5`: between the bounds at {percent(part['direct_inside_bounds'])} %, within the "
        f"just-noticeable difference at {percent(part['direct_inside_jnd'])} % of the frequencies."
    )


def constant_couplings(found: Document) -> str:
    names = {"llewellyn": "Llewellyn, any passive wall", "all": "passive with this wall"}

    def told(one: Document) -> str:
        gains = f"{one['stiffness_n_per_m']:.0f} N/m, {one['damping_ns_per_m']:.3g} N.s/m"
        return f"{gains}: {percent(one['error'])} %"

    rows = [
        (name, *(told(found["constant"][f"{condition} | {model}"]) for model in ("paper", "sampled-data")))
        for condition, name in names.items()
    ]
    return table(("condition", "paper's hold", "sampled-data hold"), rows)


def certificate_levels(found: Document) -> str:
    rows = [
        (
            level,
            one["title"],
            "pass" if one["pass"] else "fail",
            f"{one['margin_ns_per_m']:.3g}",
            f"{one['frequency_hz']:.3g}",
            one["rows_failed"],
        )
        for level, one in found["closed_form"]["levels"].items()
    ]
    head = ("level", "claim", "result", "worst margin, N.s/m", "at, Hz", "rows that do not pass")
    return f"Of the closed form on `figure5`, with the gains that it asks for:\n\n{table(head, rows)}"


def diverging(found: Document) -> str:
    part = found["diverging"]
    levels, radius = part["levels"], part["radius_let_go"]
    passed = [level for level, one in levels.items() if one["pass"]]
    l3 = levels["L3"]
    return (
        f"{', '.join(passed)} pass with the paper's hold. The device let go has a spectral radius of {radius:.4f}: the "
        f"oscillation at {levels['L5']['frequency_hz']:.0f} Hz grows by {100 * (radius - 1):.1f} % a millisecond. "
        f"L3 ({l3['margin_ns_per_m']:.3g} N.s/m at {l3['frequency_hz']:.0f} Hz) and L5 say so."
    )


def thinned(found: Document) -> str:
    part = found["thinned"]
    return (
        f"For figure 5 with band 2 in the paper's model, {part['rows']} of {found['figure5']['rows']} rows hold Z_h "
        f"to 1 % and miss the band by {-part['slack_ns_per_m']:.1g} N.s/m at worst."
    )
