"""One function of many tasks gives the same on one worker, on several and on Dask, whoever is done first."""

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing import parent_process

import pytest

import avc_casadi as avc
from avc_casadi._util.parallel import mapped
from avc_casadi.coupling import Coupling
from avc_casadi.design.comparison import table1 as _table1
from avc_casadi.simulation.population import coupling_trial as _coupling_trial


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


@pytest.mark.slow
def test_a_recommendation_does_not_depend_on_how_many_work_at_it():
    alone, shared = (avc.recommend("reference-r3", hands=30, workers=workers).data() for workers in (1, 2))
    assert alone == shared
