"""Gains of a device of several axes as constants in C, and an example that applies them under CHAI3D."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

_EXAMPLE = Path(__file__).resolve().parent / "packaging" / "chai3d_arm.cpp"


def arm_gains_c(document: Mapping[str, Any]) -> dict[str, str]:
    """Return header and example by name.

    Args:
        document: JSON values of ``avc_casadi.arm.design.gains_document``.

    Returns:
        ``avc_arm_gains.h``, C99 and C++11, and for a device in space ``chai3d_arm.cpp``.
    """
    files = {"avc_arm_gains.h": _header(document)}
    if len(document["axes"]) == 3:
        files["chai3d_arm.cpp"] = _EXAMPLE.read_text(encoding="utf-8")
    return files


def _header(document: Mapping[str, Any]) -> str:
    regions, directions = document["regions"], document["directions"]
    claim = document["claim"]
    axes, limit = ", ".join(document["axes"]), document["max_force_n"]
    tables = {
        "stiffness_n_per_m": [region["stiffness_n_per_m"] for region in regions],
        "damping_ns_per_m": [region["damping_ns_per_m"] for region in regions],
    }
    along = {
        key: [region[key] for region in regions] for key in ("tangent_stiffness_n_per_m", "tangent_damping_ns_per_m")
    }
    size = "[AVC_ARM_REGIONS][AVC_ARM_DIRECTIONS]"
    return "\n".join(
        [
            f"/* Spring and damper of {document['arm']} by place of the tip and contact normal; axes {axes}.",
            " *",
            " * Force on the device along the normal: -K (x - proxy) - D (x - x_before)/T, once every sample time T;",
            " * along the surface, while a proxy holds the tip there, the same with the tangent's gains.",
            f" * Frozen loop in space: stable up to {claim['factor']:.4g} times these gains with all that a search",
            " * looked at; no proof. Within a contact keep the gains of the first touch: changes were not looked at.",
            " */",
            "#ifndef AVC_ARM_GAINS_H",
            "#define AVC_ARM_GAINS_H",
            "",
            f"#define AVC_ARM_AXES {len(document['axes'])}",
            f"#define AVC_ARM_REGIONS {len(regions)}",
            f"#define AVC_ARM_DIRECTIONS {len(directions)}",
            f"#define AVC_ARM_SAMPLE_TIME_S {document['sample_time_s']!r}",
            f"#define AVC_ARM_HOME_TIP_M {_values(document['home_tip_m'])}",
            *([] if limit is None else [f"#define AVC_ARM_MAX_FORCE_N {limit!r}"]),
            "",
            f"static const double avc_arm_low_m[AVC_ARM_AXES] = {_values(document['low_m'])};",
            f"static const double avc_arm_high_m[AVC_ARM_AXES] = {_values(document['high_m'])};",
            f"static const int avc_arm_region_counts[AVC_ARM_AXES] = {_values(document['region_counts'])};",
            f"static const double avc_arm_directions[AVC_ARM_DIRECTIONS][AVC_ARM_AXES] = {_values(directions)};",
            *(f"static const double avc_arm_{key}{size} = {_values(rows)};" for key, rows in tables.items()),
            *(f"static const double avc_arm_{key}[AVC_ARM_REGIONS] = {_values(row)};" for key, row in along.items()),
            "",
            _LOOK_UP,
        ]
    )


def _values(value: Any) -> str:
    if isinstance(value, list):
        return f"{{{', '.join(map(_values, value))}}}"
    return repr(value)


_LOOK_UP = """\
typedef struct {
    double stiffness_n_per_m, damping_ns_per_m, tangent_stiffness_n_per_m, tangent_damping_ns_per_m;
} avc_arm_gains_t;

/* tip_m: place of the tip in the arm's coordinates. normal: of the surface, of either sign. */
static inline avc_arm_gains_t avc_arm_gains(const double *tip_m, const double *normal)
{
    avc_arm_gains_t gains;
    int region = 0, nearest = 0, axis, direction;
    double most = -1.0;
    for (axis = 0; axis < AVC_ARM_AXES; axis++) {
        const double share = (tip_m[axis] - avc_arm_low_m[axis]) / (avc_arm_high_m[axis] - avc_arm_low_m[axis]);
        const int count = avc_arm_region_counts[axis];
        int cell = 0;
        while (cell < count - 1 && share * count >= cell + 1) {
            cell++;
        }
        region = region * count + cell;
    }
    for (direction = 0; direction < AVC_ARM_DIRECTIONS; direction++) {
        double along = 0.0;
        for (axis = 0; axis < AVC_ARM_AXES; axis++) {
            along += avc_arm_directions[direction][axis] * normal[axis];
        }
        along = along < 0.0 ? -along : along;
        if (along > most) {
            most = along;
            nearest = direction;
        }
    }
    gains.stiffness_n_per_m = avc_arm_stiffness_n_per_m[region][nearest];
    gains.damping_ns_per_m = avc_arm_damping_ns_per_m[region][nearest];
    gains.tangent_stiffness_n_per_m = avc_arm_tangent_stiffness_n_per_m[region];
    gains.tangent_damping_ns_per_m = avc_arm_tangent_damping_ns_per_m[region];
    return gains;
}

#endif
"""
