"""Every study that takes an executor gives with it what it gives alone, people cut wherever they are."""

from concurrent.futures import ThreadPoolExecutor

import pytest
from studies import reach as _reach
from studies.accuracy.study import study_accuracy
from studies.reach import reach
from studies.table1 import table as _table
from studies.table1.table import table1, table1_study

import avc_casadi as avc
from avc_casadi._util.json_values import json_text
from avc_casadi.coupling import Coupling
from avc_casadi.model.corners import device_set
from avc_casadi.model.gains import Gains
from avc_casadi.simulation.population import coupling_trial as _coupling_trial
from avc_casadi.simulation.population.coupling_trial import try_coupling, try_on_devices
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.trial import Conditions


@pytest.fixture
def executor(monkeypatch):
    for module in (_reach, _table, _coupling_trial):
        monkeypatch.setattr(module, "_AT_ONCE", 7)
    with ThreadPoolExecutor(2) as found:
        yield found


@pytest.fixture(scope="module")
def problem():
    return avc.load_problem("ve7")


@pytest.mark.thorough
def test_trials(problem, executor):
    coupling = Coupling.of(problem, avc.solve(problem, "static"))
    people = draw_population("A", 20, 3)
    assert try_coupling(coupling, people, 3, executor=executor) == try_coupling(coupling, people, 3)
    uncertain = problem.changed(device={"range": {"mass_kg": (0.08, 0.12)}})
    devices = device_set(uncertain.device, draws=1, seed=1)
    alone = try_on_devices(coupling, people, devices, 3)
    assert alone.devices == len(devices) > 1
    assert try_on_devices(coupling, people, devices, 3, executor) == alone


def test_reach(problem, executor):
    arguments = problem, Gains(10.0, 7e3, 20.0), draw_population("B", 16, 1), Conditions()
    assert json_text(reach(*arguments, executor=executor)) == json_text(reach(*arguments))


@pytest.mark.thorough
def test_table1(executor, tmp_path):
    asked = {"walls": ("VE7",), "couplings": ("none", "closed-form")}
    whole = json_text(table1(10, 5, **asked, executor=executor))
    study = table1_study(10, 5, **asked)
    assert study.sizes == [7, 3, 7, 3]
    assert json_text(study.run(folder=tmp_path)) == whole
    assert json_text(study.merged(tmp_path)) == whole


@pytest.mark.thorough
def test_accuracy(executor):
    problem = avc.load_problem("figure5").changed(frequency={"points": 5})
    found = study_accuracy(problem, tolerances=(1e-6,), solvers=("ipopt",), executor=executor)
    assert [(cost.method, cost.solver) for cost in found.solvers] == [
        ("closed-form", None),
        ("exact", None),
        ("direct", found.solvers[2].solver),
        ("direct", "ipopt"),
    ]
    assert [cost.default for cost in found.solvers] == [False, False, True, False]
    assert found.solvers[1].optimal_share == 1.0
