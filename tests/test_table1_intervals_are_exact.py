"""The intervals of the study are those of Clopper and Pearson."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from avc_casadi.simulation.population.settled import exact_interval


@given(
    st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.sampled_from([0.9, 0.95, 0.99])
)
def test_ends_are_beta_quantiles(counted, confidence):
    count, trials = counted
    low, high = exact_interval(count, trials, confidence)
    rest = (1 - confidence) / 2
    assert low == pytest.approx(stats.beta.ppf(rest, count, trials - count + 1) if count else 0.0, abs=1e-11)
    assert high == pytest.approx(stats.beta.isf(rest, count + 1, trials - count) if count < trials else 1.0, abs=1e-11)


def test_all_of_ten_thousand():
    low, high = exact_interval(10_000, 10_000)
    assert low == pytest.approx(0.025 ** (1 / 10_000), rel=1e-12)
    assert low > 0.9996
    assert high == 1.0


@pytest.mark.parametrize("counted", [(-1, 5), (6, 5), (0, 0)])
def test_no_count_of_trials(counted):
    with pytest.raises(ValueError, match="no count of trials"):
        exact_interval(*counted)
