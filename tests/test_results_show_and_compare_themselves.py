"""Results answer ==, show themselves in a few lines, and hand over their columns."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi._util.arrays import Comparable, same
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
        "coupling": avc.Coupling.of(PROBLEM, gains),
        "certificate": avc.certify(PROBLEM, gains),
        "comparison": avc.compare(PROBLEM, ("closed-form", "exact"), mine=(2000.0, 7.0)),
        "problem": PROBLEM,
        "run": run,
        "judgement": run.judgement,
        "zwidth": zwidth(PROBLEM),
        "screening": screen(SCENE, scene_coupling(SCENE)),
    }


RESULTS = _results()
TABULAR = [name for name, result in RESULTS.items() if hasattr(result, "to_dict")]


KNOB = avc.load_problem("knob").changed(frequency={"points": 6})


@pytest.fixture
def knob(tmp_path, monkeypatch):
    """Six frequencies of a device that turns, in a file of one's own."""
    monkeypatch.chdir(tmp_path)
    Path("knob-of-six.toml").write_text(avc.dump_problem(KNOB.model_copy(update={"name": "knob-of-six"})))
    return "knob-of-six.toml"


def test_what_people_wrote_is_escaped():
    assert "&lt;b&gt;" in replace(RESULTS["schedule"], problem="<b>")._repr_html_()


@pytest.mark.parametrize("name", TABULAR)
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


@pytest.mark.parametrize("name", TABULAR)
def test_pandas_gets_the_columns_against_the_first(name, monkeypatch):
    class DataFrame:
        def __init__(self, columns):
            self.columns = columns

        def set_index(self, index):
            return self.columns, index

    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=DataFrame))
    columns, index = RESULTS[name].to_pandas()
    assert same(columns, RESULTS[name].to_dict())
    assert index == next(iter(columns))


def test_without_pandas_the_way_to_get_it_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(avc.MissingExtraError, match=r"pip install pandas.*to_dict\(\)"):
        RESULTS["schedule"].to_pandas()


@pytest.mark.thorough
def test_equal_inputs_give_equal_results():
    again = avc.solve(PROBLEM, "exact")
    assert again.solve_seconds != RESULTS["schedule"].solve_seconds
    assert again == RESULTS["schedule"]
    assert avc.certify(PROBLEM, again) == RESULTS["certificate"]
    assert avc.compare(PROBLEM, ("closed-form", "exact"), mine=(2000.0, 7.0)) == RESULTS["comparison"]
    assert avc.simulate(SCENE) == RESULTS["run"]
    assert zwidth(PROBLEM) == RESULTS["zwidth"]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("schedule", {"stiffness_n_per_m": RESULTS["schedule"].stiffness_n_per_m * (1 + 1e-15)}),
        ("certificate", {"rows_without_gains": 1}),
        ("comparison", {"target": RESULTS["comparison"].target + 1e-9}),
        ("run", {"force_n": RESULTS["run"].force_n[:-1]}),
        ("zwidth", {"hands": 0}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_any_other_number_is_unequal(name, change):
    other = replace(RESULTS[name], **change)
    assert other != RESULTS[name]
    assert replace(other, **{key: getattr(RESULTS[name], key) for key in change}) == RESULTS[name]


def test_undefined_numbers_are_equal_to_themselves():
    nothing = np.array([np.nan, 1.0])
    assert same(nothing, nothing.copy())
    assert not same(nothing, np.array([np.nan, 2.0]))
    assert not same(np.array(["a"]), np.array(["a", "b"]))
    assert not same(np.zeros(1), 0.0)


@pytest.mark.parametrize("name", [name for name, result in RESULTS.items() if isinstance(result, Comparable)])
def test_results_with_arrays_are_no_keys_unless_they_stand_for_what_runs(name):
    result = RESULTS[name]
    assert result != 1
    if name == "table":
        assert hash(result) == hash(GainTable(result.rows.copy()))
        return
    with pytest.raises(TypeError, match="unhashable"):
        hash(result)
