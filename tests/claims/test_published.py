"""The rows of the study beside what others published hold: formulas, a second way, and the file that its page shows."""

from functools import cache

import published
import pytest


@cache
def rows(part):
    return getattr(published, part)()


@pytest.mark.parametrize("part", ["undamped", "passive", "quantised"])
def test_ours_is_the_published_condition(part):
    assert rows(part)
    for row in rows(part):
        ours, told = (row.get(key, row.get(f"{key}_n_per_m")) for key in ("ours", "published"))
        assert ours == pytest.approx(told, rel=1e-6)


def test_a_hand_gets_no_energy_of_a_passive_wall_and_some_beyond():
    for row in rows("passive"):
        assert row["damping_by_energy_ns_per_m"] == pytest.approx(published.LOSSY, rel=1e-4)
    assert published.energy_asks(1.1 * 4000.0, 0.0, 0.0, 0) == pytest.approx(1.1 * published.LOSSY, rel=1e-9)
    for row in rows("quantised"):
        assert 1 <= row["tapping_n_per_m"] / row["ours_n_per_m"] < 1.001


def test_roots_to_thirty_digits_cross_one_at_our_wall():
    crossed = [row["radius_below_and_above"] for row in rows("rule") if "radius_below_and_above" in row]
    assert len(crossed) == len(published.ROOTS_AT) * len(published.HANDS)
    assert all(below < 0 < above for below, above in crossed)


def test_the_linear_rule_is_one_of_little_damping():
    for row in rows("rule"):
        late, ours = row["late_damper"], row["ours_n_per_m"]
        if ours is None:
            assert late > 1.5
        else:
            assert 1 - late - 1e-3 < ours / row["published_n_per_m"] < 1.06


def test_regions_of_friction_are_those_of_diolaiti():
    for row in rows("regions"):
        viscous, coulomb = row["below_viscous_and_coulomb"]
        large = row["start_steps"] > 100
        ends = {(True, True): "rests", (True, False): "swings on"}.get((viscous, coulomb), "grows")
        assert row["ends"] == (ends if large else "rests")


def test_least_passive_mass_is_where_the_real_part_turns_on_the_unit_circle():
    found = rows("least_mass")
    assert {row["least_kg"] is None for row in found} == {True, False}
    for row in found:
        enough = row["damping_ns_per_m"] >= row["needed_coupling_ns_per_m"]
        assert (row["least_kg"] is not None) == enough
        if enough:
            assert row["below"] < 0 < row["above"]
            assert row["least_kg"] >= row["nyquist_kg"] * (1 - 1e-12)
            assert row["pole"] < 1
            assert row["stable"]
        else:
            assert row["best_of_heavier"] < 0
    assert any(row["least_kg"] and row["least_kg"] > 1.5 * row["nyquist_kg"] for row in found)
