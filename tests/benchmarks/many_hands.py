"""A million hands at the wall of figure 5 (VE7), at rest or not, and what more workers are worth.

python tests/benchmarks/many_hands.py [PEOPLE]

Overwrites results/many_hands.json beside this file. First everybody on two processes, which are killed once on the
way, with the whole command, after about a third of the chunks, and go on from their folder. Then a few chunks on one
and on two processes, on threads and on Dask, and 16 workers by a model: the processor times of
chunks that were measured, handed out in their order to whoever is idle. Some minutes on two cores that do nothing else.
"""

from __future__ import annotations

import heapq
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from distributed import Client, LocalCluster
from script_arguments import script_arguments
from studied import about, cpu_seconds

import avc_casadi as avc
from avc_casadi._util.json_values import json_text
from avc_casadi._util.parallel import Processes
from avc_casadi.simulation.population.motions import MOTIONS, TRIAL_S
from avc_casadi.simulation.population.settled import settling_study

RESULTS = Path(__file__).parent / "results" / "many_hands.json"
WALL, SEED, WORKERS = "ve7", 2026, 2
# Share of the chunks after which the command is killed, and chunks of the comparison.
KILLED_AFTER, FEW = 1 / 3, 4
MODELLED = (1, 2, 4, 8, 16)


def killed(command: Sequence[str], folder: Path, chunks: int) -> int:
    """Run a command and kill it, with its workers, when so many chunks stand in its folder."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)  # noqa: S603
    while process.poll() is None and len(list(folder.glob("chunk-*.json"))) < chunks:
        time.sleep(0.05)
    if process.poll() is not None:
        raise RuntimeError("the command ended before it could be killed")
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return len(list(folder.glob("chunk-*.json")))


def everybody(coupling: Path, people: int, chunks: int) -> dict[str, Any]:
    """Try everybody by the command, killed once."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "kept"
        command = [
            *(sys.executable, "-m", "avc_casadi", "trial", str(coupling), "--json"),
            *("--hands", str(people), "--seed", str(SEED), "--workers", str(WORKERS), "--resume", str(folder)),
        ]
        started = time.perf_counter()
        kept = killed(command, folder, round(KILLED_AFTER * chunks))
        first = time.perf_counter() - started
        before = cpu_seconds()
        answer = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603
        used, whole = cpu_seconds() - before, time.perf_counter() - started
    return {
        "answer": json.loads(answer.stdout),
        "chunks": chunks,
        "kept_at_the_kill": kept,
        "seconds_until_the_kill": round(first, 1),
        "seconds": round(whole, 1),
        "processor_seconds_after_the_kill": round(used, 1),
        "samples": people * len(MOTIONS) * round(TRIAL_S / avc.load_problem(WALL).device.sample_time_s),
    }


def timed(study: Any, executor: Executor | None) -> dict[str, Any]:
    """Time some chunks, the workers started and warm."""
    if executor is not None:
        list(executor.map(study.work, study.tasks[:WORKERS]))
    started = time.perf_counter()
    found = study.run(executor)
    return {"seconds": time.perf_counter() - started, "text": json_text(found.document())}


def finished(seconds: Sequence[float], workers: int) -> float:
    """When the last of some chunks is done, each begun by whoever is idle first."""
    idle = [0.0] * workers
    for one in seconds:
        heapq.heappush(idle, heapq.heappop(idle) + one)
    return max(idle)


def compared(coupling: avc.Coupling, chunk: int, chunks: int) -> dict[str, Any]:
    """The same chunks by every kind of worker, and more workers by the model."""
    study = settling_study(coupling, FEW * chunk, SEED, chunk=chunk)
    found = {"this process": timed(study, None)}
    with Processes(1) as one:
        found["1 process"] = timed(study, one)
        seconds = list(one.map(seconds_of, [study] * FEW, range(FEW)))
    with Processes(WORKERS) as two:
        found["2 processes"] = timed(study, two)
    with ThreadPoolExecutor(WORKERS) as threads:
        found["2 threads"] = timed(study, threads)
    with (
        LocalCluster(n_workers=WORKERS, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        found["2 workers of Dask"] = timed(study, client.get_executor())
    everybody = [seconds[index % FEW] for index in range(chunks)]
    return {
        "hands": FEW * chunk,
        "chunk": chunk,
        "equal_to_the_byte": len({one["text"] for one in found.values()}) == 1,
        "seconds": {name: round(one["seconds"], 2) for name, one in found.items()},
        "efficiency_of_two": round(found["1 process"]["seconds"] / found["2 processes"]["seconds"] / WORKERS, 3),
        "chunk_seconds": [round(one, 4) for one in seconds],
        "model": {
            str(workers): {
                "seconds": round(finished(everybody, workers), 2),
                "efficiency": round(sum(everybody) / finished(everybody, workers) / workers, 3),
            }
            for workers in MODELLED
        },
    }


def seconds_of(study: Any, index: int) -> float:
    """Processor time of a chunk."""
    started = time.process_time()
    study.work(study.tasks[index])
    return time.process_time() - started


def main() -> None:
    people = script_arguments(__doc__, people=1_000_000).people
    made = about(f"python tests/benchmarks/many_hands.py {people}", SEED)
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / f"{WALL}.json"
        coupling = avc.recommend(WALL).coupling
        assert coupling is not None
        avc.write_coupling(coupling, file)
        study = settling_study(coupling, people, SEED)
        document = {"about": made, "wall": WALL, "million": everybody(file, people, len(study.tasks))}
        document["workers"] = compared(coupling, study.tasks[0][1], len(study.tasks))
    RESULTS.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
