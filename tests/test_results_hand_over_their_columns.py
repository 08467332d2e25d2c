"""Results hand over their columns, and are the same again."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.claims.registry import CLAIMS
from avc_casadi.claims.zwidth import zwidth
from avc_casadi.design.scene_coupling import scene_coupling
from avc_casadi.model.gains import GainTable
from avc_casadi.simulation.screen import screen

PROBLEM = avc.load_problem("figure5").changed(frequency={"points": 30})
SCENE = avc.load_problem("scenes/free-motion")


def _results():
    gains = avc.solve(PROBLEM, "exact")
    run = avc.simulate(SCENE)
    return {
        "schedule": gains,
        "table": GainTable.of(gains),
        "certificate": avc.certify(PROBLEM, gains),
        "comparison": avc.compare(PROBLEM, ("closed-form", "exact"), mine=(2000.0, 7.0)),
        "run": run,
        "judgement": run.judgement,
        "zwidth": zwidth(PROBLEM),
        "screening": screen(SCENE, scene_coupling(SCENE)),
    }


RESULTS = _results()


@pytest.mark.parametrize("name", RESULTS)
def test_columns_are_of_one_length_and_are_those_of_the_result(name):
    columns = RESULTS[name].to_dict()
    assert len({column.shape for column in columns.values()}) == 1
    assert all(column.ndim == 1 for column in columns.values())


def test_columns_hold_the_numbers():
    gains, comparison, run = (RESULTS[name] for name in ("schedule", "comparison", "run"))
    assert gains.to_dict()["stiffness_n_per_m"] is gains.stiffness_n_per_m
    of_exact = comparison.to_dict()["exact: stiffness_n_per_m"]
    np.testing.assert_array_equal(of_exact, comparison.methods["exact"].stiffness_n_per_m)
    assert next(iter(run.to_dict())) == "time_s"
    np.testing.assert_array_equal(run.to_dict()["force_n"], run.force_n)
    always = [name for name, claim in CLAIMS.items() if not claim.on_demand]
    assert list(RESULTS["certificate"].to_dict()["level"]) == always


@pytest.mark.thorough
def test_equal_inputs_give_equal_results():
    for name, again in _results().items():
        np.testing.assert_equal(again.to_dict(), RESULTS[name].to_dict())
