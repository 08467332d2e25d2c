"""What a recommendation assumes and does not use is worded with the keys of the problem's motion."""

import re

from avc_casadi.files.problem_file import load_any
from avc_casadi.recommendation.preconditions import assumed, not_used

RANGES = {
    "inertia_kgm2": [0.9e-3, 1.1e-3],
    "damping_nms_per_rad": [1e-3, 3e-3],
    "coulomb_friction_nm": [1e-3, 2e-3],
    "backlash_rad": [0.0, 1e-3],
}
WHEEL = {
    "device": {
        "motion": "rotary",
        "handle_radius_m": 0.05,
        "inertia_kgm2": 1e-3,
        "damping_nms_per_rad": 2e-3,
        "coulomb_friction_nm": 1e-3,
        "backlash_rad": 1e-3,
        "encoder_at": "handle",
        "resonance": {"frequency_hz": 150.0, "damping_ratio": 0.05, "inertia_ratio": 0.4},
        "range": RANGES,
    },
    "environment": {"stiffness_nm_per_rad": 1.0, "damping_nms_per_rad": 1e-3},
}
LINEAR_KEY = re.compile(r"_(kg|ns_per_m|n_per_m|n|m)\b")


def test_keys_of_a_device_that_turns_are_rotary():
    problem = load_any(WHEEL)
    texts = [*map(str, assumed(problem)), *map(str, not_used(problem))]
    assert any("device.range.inertia_kgm2" in text for text in texts)
    assert any("device.backlash_rad" in text for text in texts)
    assert [text for text in texts if LINEAR_KEY.search(text)] == []
