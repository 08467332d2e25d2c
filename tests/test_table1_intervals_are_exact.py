"""The intervals of the study are those of Clopper and Pearson."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp

from avc_casadi.simulation.population.settled import exact_interval


@given(
    st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.sampled_from([0.9, 0.95, 0.99])
)
def test_at_its_ends_as_much_is_as_unlikely_as_stated(counted, confidence):
    """By sums of binomial terms in 50 digits: P(X >= count) at the lower end, P(X <= count) at the upper one."""
    count, trials = counted
    low, high = exact_interval(count, trials, confidence)

    def probability(of, at):
        with mp.workdps(50):
            at = mp.mpf(at)
            return float(mp.fsum(mp.binomial(trials, k) * at**k * (1 - at) ** (trials - k) for k in of))

    rest = (1 - confidence) / 2
    assert (low == 0) if count == 0 else probability(range(count, trials + 1), low) == pytest.approx(rest, rel=1e-9)
    assert (high == 1) if count == trials else probability(range(count + 1), high) == pytest.approx(rest, rel=1e-9)


def test_all_of_ten_thousand():
    low, high = exact_interval(10_000, 10_000)
    assert low == pytest.approx(0.025 ** (1 / 10_000), rel=1e-12)
    assert low > 0.9996
    assert high == 1.0


@pytest.mark.parametrize("counted", [(-1, 5), (6, 5), (0, 0)])
def test_no_count_of_trials(counted):
    with pytest.raises(ValueError, match="no count of trials"):
        exact_interval(*counted)
