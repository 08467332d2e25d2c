"""Keys given in another unit: the key meant, and the value in its unit."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

# Unit of a key's ending: other usual units, with their factors.
_SCALES = {
    "ns_per_m": {"ns_per_mm": 1e3, "nms_per_mm": 1.0, "kns_per_m": 1e3, "mns_per_m": 1e-3},
    "n_per_m": {"n_per_mm": 1e3, "n_per_cm": 1e2, "n_per_um": 1e6, "kn_per_m": 1e3, "mn_per_m": 1e-3},
    "m_per_s": {"mm_per_s": 1e-3, "cm_per_s": 1e-2},
    "nms_per_rad": {"mnms_per_rad": 1e-3, "nms_per_deg": 180 / math.pi},
    "nm_per_rad": {"mnm_per_rad": 1e-3, "nm_per_deg": 180 / math.pi},
    "kgm2": {"gm2": 1e-3, "gcm2": 1e-7, "kgcm2": 1e-4, "gmm2": 1e-9, "kgmm2": 1e-6},
    "kg": {"g": 1e-3, "mg": 1e-6},
    "rad": {"mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180},
    "nm": {"mnm": 1e-3, "knm": 1e3, "ncm": 1e-2},
    "hz": {"khz": 1e3},
    "n": {"mn": 1e-3, "kn": 1e3},
    "m": {"mm": 1e-3, "cm": 1e-2, "um": 1e-6, "nm": 1e-9},
    "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}


def in_another_unit(key: str, value: Any, known: Collection[str]) -> tuple[str, str] | None:
    """Return the key meant and the text to write, ``mass_kg = 0.12`` for 120 in ``mass_g``; None where none was.

    Args:
        key: the unknown key.
        value: a number, or a list of them.
        known: keys of its table.
    """
    if key == "sample_rate_hz" and "sample_time_s" in known and _is_number(value) and value > 0:
        return "sample_time_s", f"sample_time_s = {1 / value:.12g}"
    values = value if isinstance(value, list) else [value]
    if not values or len(values) > 2 or not all(map(_is_number, values)):
        return None
    for unit, others in _SCALES.items():
        for other, scale in others.items():
            meant = f"{key.removesuffix(other)}{unit}"
            if key.endswith(f"_{other}") and meant in known:
                right = [f"{one * scale:.12g}" for one in values]
                return meant, f"{meant} = {'[' + ', '.join(right) + ']' if isinstance(value, list) else right[0]}"
    return None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e100
