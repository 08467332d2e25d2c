"""Of two couplings the one that is stable with more is better, however near the other comes to the wall."""

import itertools

import pytest

import avc_casadi as avc
from avc_casadi.design.comparison.judged import Safety, safer, safety_reason

PROBLEM = avc.load_problem("figure5")
METHODS = ("closed-form", "direct")


@pytest.fixture(scope="module")
def soft():
    """2 kN/m and 7 N.s/m hold every hand of figure 5; `direct` is nearer to the wall and does not."""
    return avc.compare(PROBLEM, METHODS, mine=(2000.0, 7.0))


@pytest.mark.thorough
def test_a_stable_pair_beats_a_nearer_one_that_is_not(soft):
    mine, levels = soft.mine, soft.judged["direct"].certificate.levels
    assert levels["L5"].passed is False
    assert soft.judged["mine"].certificate.levels["L5"].passed
    assert mine.share_schedule_better == 1.0
    assert (mine.safer, mine.better) == ("mine", "mine")
    failed = f"L5 fails at {levels['L5'].rows_failed} of 200 rows"
    assert mine.safety_reason == f"mine is stable with every hand, direct is not ({failed}): do not deploy direct"


def table(hands, let_go, passive):
    levels = dict.fromkeys(("L0", "L1", "L2", "L4"), passive) | {"L3": passive, "L5": hands}
    failed = {level: 0 if passed else 7 for level, passed in levels.items()}
    return Safety(levels, hands, let_go, passive, failed, 20)


ALL = [table(*flags) for flags in itertools.product((True, False), repeat=3)]


@pytest.mark.parametrize(("one", "other"), list(itertools.product(ALL, ALL)))
def test_every_hand_weighs_more_than_let_go_and_that_more_than_passive(one, other):
    expected = "equal" if one.rank == other.rank else "mine" if ALL.index(one) < ALL.index(other) else "direct"
    assert safer(one, other, "direct") == expected
    reason = safety_reason(one, other, "direct")
    for name, safety in (("mine", one), ("direct", other)):
        warned = f"do not deploy {name}" in reason or f"nor {name}" in reason or f"neither {name}" in reason
        assert warned == (not safety.deployable), reason
