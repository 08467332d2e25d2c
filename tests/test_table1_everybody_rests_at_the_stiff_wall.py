"""The wall of figure 5 without friction: what the tuned designs reach, and what they need for it."""

import json
from pathlib import Path

import pytest
from studies.reach import reach, with_observer

import avc_casadi as avc
from avc_casadi.design.tuning import tuned
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.settled import exact_interval
from avc_casadi.simulation.population.trial import Conditions

RESULTS = Path(__file__).parent / "benchmarks" / "results"
PROBLEM = avc.load_problem("ve7")
PEOPLE = draw_population("A", 48, 11)


@pytest.fixture(scope="module", params=[False, True], ids=["static-tuned", "schedule"])
def gains(request):
    return tuned(PROBLEM, scheduled=request.param, margin_ns_per_m=6.0)


@pytest.mark.thorough
def test_everybody_rests_without_friction(gains):
    found = reach(PROBLEM, gains, PEOPLE, Conditions())
    assert found["stable"] == found["people"] == 48
    assert found["stable_by_motion"] == {"press": 48, "tap": 48, "hold": 48}
    assert found["stiffness_share"]["within_8_percent"] == 48
    assert found["buzzing"] == 0
    assert found["error_within_hz"]["physical"] > 40
    assert found["error_at_hz"]["physical"]["10"] < found["error_at_hz"]["sampled"]["10"] < 0.1


@pytest.mark.thorough
def test_a_coarse_encoder_needs_the_observer(gains):
    coarse = Conditions(encoder_m=20e-6)
    assert reach(PROBLEM, gains, PEOPLE, with_observer(PROBLEM, coarse))["stable"] == 48
    assert reach(PROBLEM, gains, PEOPLE, coarse)["stable"] < 5


def test_series_gains_give_half_of_the_wall():
    series = tuned(PROBLEM, scheduled=False, margin_ns_per_m=6.0, structure="series")
    found = reach(PROBLEM, series, PEOPLE, Conditions())
    assert found["stable"] == 48
    assert 0.4 < found["stiffness_share"]["median"] < 0.5
    assert found["error_within_hz"]["physical"] == 0


@pytest.mark.thorough
def test_nothing_is_tuned_beyond_reach():
    assert tuned(PROBLEM, scheduled=False, margin_ns_per_m=300.0) is None


def test_the_kept_result_is_what_is_claimed():
    document = json.loads((RESULTS / "reach.json").read_text(encoding="utf-8"))
    assert document["about"]["command"] == "python tests/benchmarks/reach.py 10000"
    for cell in document["cells"].values():
        kept = (cell["stable_low"], cell["stable_high"])
        assert kept == pytest.approx(exact_interval(cell["stable"], cell["people"]), rel=1e-12)
    for coupling in ("static-tuned", "schedule"):
        for case in ("no friction, margin 6", "as declared, margin 6", "no friction, 107000 N/m at 1 ms"):
            cell = document["cells"][f"{coupling}, set A, {case}"]
            assert cell["stable"] == cell["people"] == cell["stiffness_share"]["within_8_percent"] == 10_000
        # One of the constant gains' hands hums between the steps of a coarse encoder.
        coarse = document["cells"][f"{coupling}, set A, no friction, 20 um, observer"]["stable"]
        assert coarse == (9_999 if coupling == "static-tuned" else 10_000)
