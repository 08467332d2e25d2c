"""A study in chunks gives the same result on one worker, on many, in several goes and through the death of a worker."""

import json
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context

import pytest
from chunk_work import deadly, drawn, failing, killed_once

import avc_casadi
from avc_casadi import InputError, WorkerLostError
from avc_casadi._util.checkpoint import Chunked, Part
from avc_casadi._util.json_values import json_text
from avc_casadi._util.parallel import Processes

SEED = 11


def study(count=9, seed=SEED, work=drawn):
    return Chunked({"seed": seed}, work, [(index, seed) for index in range(count)], list, [2] * count, "things")


class Listener:
    def __init__(self):
        self.told = []

    def advance(self, done, total, what=""):
        self.told.append((done, total, what))


@pytest.fixture(scope="module")
def alone():
    return study().run()


def test_threads_processes_and_an_executor_give_the_bits_of_one_worker(alone, tmp_path):
    assert len({row["mean"] for row in alone}) == 9
    assert study().run(workers=2, folder=tmp_path / "two") == alone
    with ThreadPoolExecutor(3) as executor:
        assert json_text(study().run(executor)) == json_text(alone)
    assert study().merged(tmp_path / "two") == alone


def test_dask_gives_the_bits_of_one_worker(alone):
    distributed = pytest.importorskip("distributed", reason="needs dask: pip install 'avc-casadi[cluster]'")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None, protocol="inproc://"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert json_text(study().run(client.get_executor())) == json_text(alone)


@pytest.mark.thorough
def test_a_killed_worker_costs_its_chunk_only(tmp_path):
    count = 6
    whole = Chunked({}, killed_once, [(index, str(tmp_path)) for index in range(count)], list)
    assert whole.run(workers=2) == [{"index": index} for index in range(count)]
    began = sorted(path.name.split("-")[1] for path in tmp_path.glob("began-*"))
    assert began == sorted([*map(str, range(count)), "3"])


@pytest.mark.thorough
def test_a_task_that_kills_every_worker_is_named(tmp_path):
    whole = Chunked({}, deadly, [0, 1], list)
    with pytest.raises(WorkerLostError, match=r"chunk [12] of 2: 3 processes died"):
        whole.run(workers=2, folder=tmp_path)
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor,
        pytest.raises(WorkerLostError, match=r"of 2.*same folder"),
    ):
        whole.run(executor, folder=tmp_path)


def test_what_is_done_is_kept_and_not_repeated(alone, tmp_path):
    calls, told = [], Listener()

    def work(task, until):
        calls.append(task[0])
        if task[0] == until:
            raise KeyboardInterrupt
        return drawn(task)

    with pytest.raises(KeyboardInterrupt):
        study(work=partial(work, until=4)).run(folder=tmp_path)
    (tmp_path / "chunk-000002.json").write_text('{"index": 1, "me')  # as a full disk leaves it
    assert study().missing(tmp_path) == [1, 4, 5, 6, 7, 8]
    calls.clear()
    assert study(work=partial(work, until=None)).run(folder=tmp_path, progress=told) == alone
    assert calls == [1, 4, 5, 6, 7, 8]
    assert told.told[0] == (6, 18, "things")
    assert told.told[-1] == (18, 18, "things")


def test_another_study_is_refused(tmp_path):
    study().run(folder=tmp_path)
    for other in (study(seed=12), study(count=8)):
        with pytest.raises(InputError, match=r"another study: its (seed|chunks|release) is .*, of this one"):
            other.run(folder=tmp_path)


def test_jobs_share_a_folder(alone, tmp_path):
    for number in (3, 1):
        assert study().run_part(Part(number, 4), tmp_path) == (2 if number == 3 else 5)
    with pytest.raises(InputError, match=r"5 of 9 chunks; missing: 2, 4, 6, 8\."):
        study().merged(tmp_path)
    for number in (2, 4):
        study().run_part(Part.of_text(f"{number}/4"), tmp_path)
    assert study().merged(tmp_path) == alone
    about = json.loads((tmp_path / "study.json").read_text())
    assert about == {"about": {"seed": SEED}, "chunks": 9, "avc_casadi": avc_casadi.__version__}
    for text in ("0/4", "5/4", "7", "a/b"):
        with pytest.raises(ValueError):  # noqa: PT011 - of any kind
            Part.of_text(text)


def test_a_chunk_that_is_copied_changed_or_of_another_study_is_worked_out_again(alone, tmp_path):
    study(seed=12).run(folder=tmp_path / "other")
    study().run(folder=str(tmp_path / "own"))
    own, other = tmp_path / "own", tmp_path / "other"
    (own / "chunk-000002.json").write_text((own / "chunk-000001.json").read_text())
    (own / "chunk-000003.json").write_text((other / "chunk-000003.json").read_text())
    changed = json.loads((own / "chunk-000004.json").read_text())
    changed["result"]["mean"] += 1.0
    (own / "chunk-000004.json").write_text(json.dumps(changed))
    for index, text in ((5, "{}"), (6, "[]"), (7, "5"), (8, "[" * 100000)):
        (own / f"chunk-{index:06d}.json").write_text(text)
    assert study().missing(own) == [1, 2, 3, 4, 5, 6, 7]
    with pytest.raises(InputError, match=r"missing: 2, 3, 4, 5, 6, 7, 8\."):
        study().merged(own)
    assert study().run(folder=own) == alone


@pytest.mark.thorough
def test_of_two_studies_begun_at_once_in_one_folder_one_is_refused(tmp_path):
    def begun(number, place):
        try:
            study(seed=number).run_part(Part(number, 2), place)
        except InputError:
            return 0
        return number

    with ThreadPoolExecutor(2) as pool:
        for attempt in range(40):
            place = tmp_path / str(attempt)
            winners = [one for one in pool.map(begun, (1, 2), (place, place)) if one]
            assert len(winners) == 1
            assert len(study(seed=winners[0]).missing(place)) in {4, 5}
            assert not list(place.glob("*.partial"))


def test_merging_writes_nothing(tmp_path):
    with pytest.raises(InputError, match="holds no study"):
        study().merged(tmp_path / "mistyped")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file cannot be written \(File exists\).*take the folder again"):
        study().run(folder=tmp_path / "file")
    study().run_part(Part(1, 3), tmp_path / "kept")
    (tmp_path / "kept" / "chunk-000002.json").mkdir()
    with pytest.raises(InputError, match=r"chunk-000002.json cannot be written"):
        study().run(folder=tmp_path / "kept")
    assert not list(tmp_path.glob("kept/*.partial"))


@pytest.mark.parametrize("workers", [0, -1])
def test_nobody_works_nothing_out(workers):
    with pytest.raises(InputError, match=f"is {workers}; allowed: a whole number, 1 or more"):
        study().run(workers=workers)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_fault_ends_the_study(workers):
    with pytest.raises(ZeroDivisionError, match="two"):
        Chunked({}, failing, range(5), list).run(workers=workers)


def test_processes_are_an_executor():
    with Processes(2) as executor:
        assert list(executor.map(abs, [-1, -2, -3])) == [1, 2, 3]
        assert executor.submit(int, "7", base=8).result() == 7
    with pytest.raises(RuntimeError, match="shutdown"):
        executor.submit(abs, 1)
