"""The rows of the study beside what others published hold: formulas, a second way, and the file that its page shows."""

from functools import cache

import published
import pytest
from quick import first


@cache
def rows(part):
    return getattr(published, part)()


@pytest.mark.parametrize("part", first(["passive", "quantised"]))
def test_ours_is_the_published_condition(part):
    assert rows(part)
    for row in rows(part):
        ours, told = (row.get(key, row.get(f"{key}_n_per_m")) for key in ("ours", "published"))
        assert ours == pytest.approx(told, rel=1e-6)


@pytest.mark.slow
def test_a_hand_gets_no_energy_of_a_passive_wall_and_some_beyond():
    for row in rows("passive"):
        assert row["damping_by_energy_ns_per_m"] == pytest.approx(published.LOSSY, rel=1e-4)
    assert published.energy_asks(1.1 * 4000.0, 0.0, 0.0, 0) == pytest.approx(1.1 * published.LOSSY, rel=1e-9)
    for row in rows("quantised"):
        assert 1 <= row["tapping_n_per_m"] / row["ours_n_per_m"] < 1.001


def test_the_linear_rule_is_one_of_little_damping():
    for row in rows("rule"):
        late, ours = row["late_damper"], row["ours_n_per_m"]
        if ours is None:
            assert late > 1.5
        else:
            assert 1 - late - 1e-3 < ours / row["published_n_per_m"] < 1.06
