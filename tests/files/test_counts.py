"""Numbers of hands, seeds and processes are whole numbers of a range, in every call that takes them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi as avc
from avc_casadi.design.comparison.table1 import table1
from avc_casadi.simulation.population.admittance_trial import try_admittance
from avc_casadi.simulation.population.law_trial import try_law

NO_COUNTS = (
    st.integers(max_value=-1)
    | st.integers(min_value=2**40)
    | st.floats()
    | st.booleans()
    | st.text(max_size=3)
    | st.none()
    | st.just([1])
)


@pytest.mark.slow
@given(NO_COUNTS, st.sampled_from([("hands", avc.recommend), ("seed", avc.recommend), ("workers", avc.recommend)]))
def test_no_other_value_begins_a_recommendation(value, option):
    key, call = option
    with pytest.raises(avc.InputError) as caught:
        call("spring", **{key: value})
    assert [fault.key for fault in caught.value.faults] == [key]


@pytest.mark.parametrize("hands", [0, -3, 2.5, "many", True])
def test_every_call_of_hands_refuses_them_and_all_other_counts_at_once(hands):
    device = "[device]\nmass_kg = 1.0\ndamping_ns_per_m = 1.0\n"
    stated = avc.parse_problem(f"{device}[law]\nstiffness_n_per_m = 10.0\ndamping_ns_per_m = 1.0\n")
    for call in (
        lambda: avc.recommend("spring", hands, -1),
        lambda: table1(hands, -1),
        lambda: try_admittance("admittance/cobot", hands, -1),
        lambda: try_law(stated, hands, -1),
    ):
        with pytest.raises(avc.InputError) as caught:
            call()
        assert {fault.key for fault in caught.value.faults} == {"hands", "seed"}


@pytest.mark.slow
def test_whole_numbers_of_numpy_are_whole():
    table = avc.solve("soft", "exact")
    found = avc.certify("soft", table, draws=np.int64(2), seed=np.uint32(3))
    assert found.levels["L5"].passed == avc.certify("soft", table, draws=2, seed=3).levels["L5"].passed
