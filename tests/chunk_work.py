"""Work for studies in chunks: quick, slow, and of the kind that kills its process."""

import os
import signal
import time
from pathlib import Path

import numpy as np


def drawn(task):
    index, seed = task
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    return {"index": index, "mean": float(rng.standard_normal(1000).mean())}


def killed_once(task):
    """Kill the process at the first call for a task; the mark tells the second one."""
    index, folder = task
    (Path(folder) / f"began-{index}-{os.getpid()}").touch()
    if index == 3 and not (Path(folder) / "mark").exists():
        (Path(folder) / "mark").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"index": index}


def deadly(_):
    os.kill(os.getpid(), signal.SIGKILL)


def slow(task):
    time.sleep(0.05)
    return {"task": task}


def failing(task):
    if task == 2:
        raise ZeroDivisionError("two")
    return {"task": task}
