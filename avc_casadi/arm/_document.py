"""Gains of an arm as JSON values and as TOML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from avc_casadi.arm._design import RESERVE, SHARE
from avc_casadi.support import plain

if TYPE_CHECKING:
    from avc_casadi.arm._arm import Arm
    from avc_casadi.arm._design import ArmDesign

SCHEMA = "avc-arm-gains/1"
_DIGITS = 6


def gains_document(arm: Arm, design: ArmDesign) -> dict[str, Any]:
    """Return the gains with what is claimed of them, as JSON values.

    Args:
        arm: what they are for.
        design: the gains.
    """
    gains, certificate = design.gains, design.certificate
    regions = [
        {
            "low_m": low,
            "high_m": high,
            "tangent_stiffness_n_per_m": gains.tangent_stiffness_n_per_m[index],
            "tangent_damping_ns_per_m": gains.tangent_damping_ns_per_m[index],
            "stiffness_n_per_m": gains.stiffness_n_per_m[index],
            "damping_ns_per_m": gains.damping_ns_per_m[index],
            "lightest_kg": design.lightest_kg[index],
            "heaviest_kg": design.heaviest_kg[index],
        }
        for index, (low, high) in enumerate(gains.boxes())
    ]
    document: dict[str, Any] = _rounded(
        plain(
            {
                "schema": SCHEMA,
                "arm": arm.file.name,
                "axes": list(arm.axes),
                "sample_time_s": arm.file.device.sample_time_s,
                "max_force_n": arm.file.device.max_force_n,
                "home_tip_m": arm.home_tip_m,
                "low_m": gains.low_m,
                "high_m": gains.high_m,
                "region_counts": list(gains.regions),
                "directions": gains.directions,
                "regions": regions,
                "claim": {
                    "sentence": (
                        "the frozen loop in space is stable with every pose, normal, hand and corner of the device "
                        "that a search looked at, up to this factor of all gains; found by a search, not proved"
                    ),
                    "stable": certificate.stable,
                    "factor": certificate.worst.factor,
                    "reserve": RESERVE,
                    "share_of_the_stiffest_wall_along_one_axis": SHARE,
                    "factor_of_one_axis_designs": design.per_axis_factor,
                    "drawn": certificate.looked_at,
                    "worst": certificate.worst.document(),
                },
            }
        )
    )
    return document


def gains_toml(document: Mapping[str, Any]) -> str:
    """Return `gains_document` as TOML."""
    plain_keys = {key: value for key, value in document.items() if key not in {"regions", "claim"}}
    claim = {key: value for key, value in document["claim"].items() if key != "worst"}
    worst = _lines(document["claim"]["worst"])
    lines = [*_lines(plain_keys), "", "[claim]", *_lines(claim), "", "[claim.worst]", *worst]
    for region in document["regions"]:
        lines += ["", "[[regions]]", *_lines(region)]
    return "\n".join(lines) + "\n"


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in table.items() if value is not None]


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
