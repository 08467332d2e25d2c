"""Work for processes in the background: endless, short, and refused."""

import time

from avc_casadi import InputError


def endless(_, progress):
    for done in range(10**9):
        progress.advance(done, 10**9, "counting")
        time.sleep(0.01)


def halved(task, progress):
    progress.advance(1, 2, "half")
    if task < 0:
        raise InputError.of("is negative", key="task")
    return task / 2
