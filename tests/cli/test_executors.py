"""One function of many tasks gives the same on one worker, on several and on Dask, whoever is done first."""

import json
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing import parent_process

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi._util.parallel import mapped
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.design.comparison import table1 as _table1
from avc_casadi.model.corners import device_set
from avc_casadi.simulation.population import coupling_trial as _coupling_trial
from avc_casadi.simulation.population.coupling_trial import try_coupling, try_on_devices
from avc_casadi.simulation.population.operators import draw_population
from avc_casadi.simulation.population.settled import settled_hands


@pytest.fixture
def executor(monkeypatch):
    for module, name in ((_table1, "HANDS_AT_ONCE"), (_coupling_trial, "_AT_ONCE")):
        monkeypatch.setattr(module, name, 7)
    with ThreadPoolExecutor(2) as found:
        yield found


@pytest.fixture(scope="module")
def problem():
    return avc.load_problem("ve7")


@pytest.fixture(scope="module")
def coupling(problem):
    return Coupling.of(problem, avc.solve(problem, "static"))


def late(number):
    time.sleep(0.2 if number == 0 else 0.0)  # the first task is done last
    return number**2


def deadly(_):
    if parent_process() is not None:
        os.kill(os.getpid(), signal.SIGKILL)


def test_results_come_in_order(executor):
    told = []

    class Listener:
        def advance(self, *of):
            told.append(of)

    expected = [number**2 for number in range(5)]
    assert mapped(late, range(5), executor, sizes=[2] * 5, things="things", progress=Listener()) == expected
    assert told[-1] == (10, 10, "things")
    assert mapped(late, range(5), workers=2) == mapped(late, range(5)) == expected


def test_a_dead_worker_and_a_fault_end_the_work():
    with pytest.raises(avc.WorkerLostError, match="a worker died"):
        mapped(deadly, range(2), workers=2)
    with pytest.raises(ZeroDivisionError):
        mapped(partial(divmod, 1), [1, 0, 1], workers=2)


@pytest.mark.thorough
def test_dask_gives_the_counts_of_one_process(coupling, tmp_path, capsys):
    distributed = pytest.importorskip("distributed", reason="needs dask: pip install 'avc-casadi[cluster]'")
    avc.write_coupling(coupling, tmp_path / "coupling.json")
    command = ["trial", str(tmp_path / "coupling.json"), "--hands", "10020", "--without-friction", "--json"]

    def answer(*more):
        assert main([*command, *more]) == 0
        return json.loads(capsys.readouterr().out)

    alone = answer("--workers", "1")
    assert 0 < alone["at_rest"] < 10020
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        assert answer("--scheduler", cluster.scheduler_address) == alone


@pytest.mark.thorough
def test_trials(problem, coupling, executor):
    people = draw_population("A", 20, 3)
    one, other = (try_coupling(coupling, people, 3, executor=some).to_dict() for some in (executor, None))
    np.testing.assert_equal(one, other)
    counts = [settled_hands(coupling, 40, 4, block=17, executor=one) for one in (executor, None)]
    assert counts[0] == counts[1] == settled_hands(coupling, 40, 4)
    uncertain = problem.changed(device={"range": {"mass_kg": (0.08, 0.12)}})
    devices = device_set(uncertain.device, draws=1, seed=1)
    alone = try_on_devices(coupling, people, devices, 3)
    assert alone.devices == len(devices) > 1
    np.testing.assert_equal(try_on_devices(coupling, people, devices, 3, executor).to_dict(), alone.to_dict())


@pytest.mark.thorough
def test_a_recommendation_does_not_depend_on_how_many_work_at_it():
    alone, shared = (avc.recommend("reference-r3", hands=30, workers=workers).data() for workers in (1, 2))
    assert alone == shared
