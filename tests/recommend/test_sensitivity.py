"""What would help: one property of the device changed, with the range within which it is known; the most first."""

import pytest

import avc_casadi as avc
from avc_casadi.recommendation.sensitivity import linear_changes

RANGES = {"mass_kg": (0.05, 0.2), "damping_ns_per_m": (1.0, 4.0)}
PROBLEM = avc.load_problem("reference-r1").changed(device={"range": RANGES})


@pytest.mark.parametrize(
    ("change", "key", "share"),
    [
        ("twice the mass of the device", "mass_kg", 2.0),
        ("twice the damping of the device", "damping_ns_per_m", 2.0),
    ],
)
def test_a_property_changes_with_its_range_and_alone(change, key, share):
    changed = linear_changes(PROBLEM)[change].device
    before, after = (one.model_dump(exclude={"range"}) for one in (PROBLEM.device, changed))
    assert after[key] == pytest.approx(share * before[key])
    assert {name for name in before if before[name] != after[name]} == {key}
    for name, ends in RANGES.items():
        assert getattr(changed.range, name) == pytest.approx([(share if name == key else 1.0) * end for end in ends])
