"""Tasks that are shared with helpers give what they give alone, in their order; none is done twice."""

import os
import subprocess
import sys
import time
from functools import partial

import pytest

import avc_casadi as avc
from avc_casadi._util.parallel import ALONE, SharedTasks, processors
from avc_casadi.recommendation.stiffest import stiffest


def squared(number):
    return number**2, os.getpid()


def written(folder, name):
    with (folder / name).open("a") as file:
        file.write("once ")
    return name


def slow(number):
    time.sleep(60)
    return number


def broken():
    raise ValueError("this task fails")


@pytest.mark.thorough
def test_results_come_in_order_whoever_works_them_out():
    tasks = [partial(squared, number) for number in range(12)]
    with SharedTasks(2) as crew:
        warm = crew.begin(partial(squared, 0))
        assert warm()[0] == 0
        shared = list(crew.each(tasks))
    assert [found for found, _ in shared] == [found for found, _ in ALONE.each(tasks)]
    assert os.getpid() in {who for _, who in shared}


@pytest.mark.thorough
def test_no_task_is_done_twice(tmp_path):
    names = [f"task{number}" for number in range(6)]
    with SharedTasks(2) as crew:
        begun = [crew.begin(partial(written, tmp_path, f"begun{number}")) for number in range(3)]
        assert list(crew.each([partial(written, tmp_path, name) for name in names])) == names
        for one in begun:
            assert one() == one()
    assert {path.read_text() for path in tmp_path.iterdir()} == {"once "}


def test_left_early_it_drops_what_nobody_has_begun(tmp_path):
    with SharedTasks(2) as crew:
        held = crew.begin(partial(slow, 1))  # the helper is busy, so that all the others are done here
        for name in crew.each([partial(written, tmp_path, f"task{number}") for number in range(4)]):
            if name == "task1":
                break
    assert {path.name for path in tmp_path.iterdir()} == {"task0", "task1"}
    assert callable(held)


def test_the_end_does_not_wait_for_a_helper():
    begun = time.monotonic()
    with SharedTasks(2) as crew:
        crew.begin(partial(slow, 1))
    assert time.monotonic() - begun < 30


@pytest.mark.thorough
@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_a_task_is_raised_where_its_result_is_asked_for(workers):
    with SharedTasks(workers) as crew:
        result = crew.begin(broken)
        with pytest.raises(ValueError, match="this task fails"):
            result()
        with pytest.raises(ValueError, match="this task fails"):
            list(crew.each([partial(squared, 1), broken]))


@pytest.mark.parametrize("workers", [0, -1, 2.5, True, None, "2"])
def test_what_is_no_number_of_processes_is_refused(workers):
    for asked in (avc.recommend, stiffest):
        with pytest.raises(avc.InputError, match="allowed: a whole number, 1 or more"):
            asked("spring" if asked is avc.recommend else avc.load_problem("spring"), workers=workers)


@pytest.mark.thorough
@pytest.mark.skipif(processors() == 1, reason="nobody helps")
def test_a_script_without_its_guard_is_told_of_it(tmp_path):
    script = tmp_path / "no_guard.py"
    script.write_text("import avc_casadi as avc\navc.recommend('spring', hands=10, workers=2)\n")
    command = [sys.executable, str(script)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)  # noqa: S603 - ours
    assert ended.returncode == 1
    assert "__main__" in ended.stderr.splitlines()[-1]


@pytest.mark.thorough
def test_a_recommendation_does_not_depend_on_how_many_work_at_it():
    """Climbs that are given up, one that goes on from what is held, and what is tried beside."""
    problem = avc.load_problem("reference-r3").changed(environment={"stiffness_n_per_m": 3e4})
    alone, shared = (avc.recommend(problem, hands=30, workers=workers).document() for workers in (1, 2))
    assert alone["coupling"]["runtime"]["state_feedback"]
    assert alone == shared
