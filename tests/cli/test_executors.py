"""One function of many tasks gives the same on one worker, on several and on an executor, whoever is done first."""

import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from multiprocessing import parent_process

import pytest

import avc_casadi as avc
from avc_casadi._util.parallel import map_tasks


def late(number):
    time.sleep(0.2 if number == 0 else 0.0)  # the first task is done last
    return number**2


def deadly(_):
    if parent_process() is not None:
        os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
def test_results_come_in_order():
    told = []

    class Listener:
        def advance(self, *of):
            told.append(of)

    expected = [number**2 for number in range(5)]
    with ThreadPoolExecutor(2) as executor:
        assert map_tasks(late, range(5), executor, sizes=[2] * 5, things="things", progress=Listener()) == expected
    assert told[-1] == (10, 10, "things")
    assert map_tasks(late, range(5), workers=2) == map_tasks(late, range(5)) == expected


def test_a_dead_worker_and_a_fault_end_the_work():
    with pytest.raises(avc.WorkerLostError):
        map_tasks(deadly, range(2), workers=2)
    with pytest.raises(ZeroDivisionError):
        map_tasks(partial(divmod, 1), [1, 0, 1], workers=2)


@pytest.mark.slow
def test_a_recommendation_does_not_depend_on_how_many_work_at_it():
    alone, shared = (avc.recommend("figure5", hands=30, workers=workers).data() for workers in (1, 2))
    assert alone == shared
