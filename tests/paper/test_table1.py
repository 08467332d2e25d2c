"""The table: only its column without coupling was fitted, everything else follows, the same for the same seed."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.comparison.table1 import table1
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.simulation.population.motions import MOTIONS
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.trial import Conditions, judged

COUPLINGS = ("none", "static", "closed-form", "static-tuned", "schedule")


@pytest.fixture(scope="module")
def document():
    return table1(12, 5, walls=("VE7",), couplings=COUPLINGS)


@pytest.mark.thorough
def test_counts_are_those_of_the_runs(document):
    problem = avc.load_problem("ve7")
    people = draw_population("A", 12, 5)
    runs = [judged(problem, NO_COUPLING, people, motion, Conditions.declared(problem)) for motion in MOTIONS.values()]
    row = document["rows"][0]
    assert row["coupling"] == "none"
    assert row["stable"] == np.all([run.stable for run in runs], axis=0).sum()


@pytest.mark.thorough
def test_prediction_at_the_stiff_wall(document):
    rows = {row["coupling"]: row for row in document["rows"]}
    assert rows["none"]["stable"] == 0
    for tuned in ("static-tuned", "schedule"):
        assert rows[tuned]["stable"] == rows[tuned]["asymptotic"] == 12
        assert rows[tuned]["apparent_stiffness_n_per_m"] == pytest.approx(1e5, rel=0.08)
    assert rows["static"]["stable"] == 12
    assert rows["static"]["apparent_stiffness_n_per_m"] < 2e4
    assert rows["schedule"]["matched"] == 12
    assert rows["schedule"]["matched_against"] == "static"
    # Nobody can tell constant gains from scheduled ones.
    assert rows["static-tuned"]["unable"] == 12
