"""What would help: one property of the device changed, with the range within which it is known; the most first."""

import pytest

import avc_casadi as avc
from avc_casadi.recommendation import stiffest
from avc_casadi.recommendation.sensitivity import linear_changes, simulated_changes

RANGES = {"mass_kg": (0.05, 0.2), "damping_ns_per_m": (1.0, 4.0), "max_force_n": (6.0, 9.0)}
PROBLEM = avc.load_problem("reference-r1").changed(device={"range": RANGES})


@pytest.mark.parametrize(
    ("change", "key", "share"),
    [
        ("twice the mass of the device", "mass_kg", 2.0),
        ("twice the damping of the device", "damping_ns_per_m", 2.0),
        ("twice the force", "max_force_n", 2.0),
        ("half the step of the encoder", "encoder_resolution_m", 0.5),
    ],
)
def test_a_property_changes_with_its_range_and_alone(change, key, share):
    changed = (linear_changes(PROBLEM) | simulated_changes(PROBLEM))[change].device
    before, after = (one.model_dump(exclude={"range"}) for one in (PROBLEM.device, changed))
    assert after[key] == pytest.approx(share * before[key])
    assert {name for name in before if before[name] != after[name]} == {key}
    for name, ends in RANGES.items():
        assert getattr(changed.range, name) == pytest.approx([(share if name == key else 1.0) * end for end in ends])


def test_what_everybody_rests_with_comes_first_and_of_these_the_stiffest():
    def told(wall, free, rests):
        return {"stiffest_wall_n_per_m": wall, "hands": 10, "at_rest_without_friction": free, "at_rest": rests}

    found = [told(3e3, 10, 10), told(9e3, 9, 10), told(5e3, 10, 10), told(2e4, 9, 9)]
    walls = [one["stiffest_wall_n_per_m"] for one in sorted(found, key=stiffest._safest_then_stiffest)]
    assert walls == [5e3, 3e3, 9e3, 2e4]
