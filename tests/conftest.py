import os
import signal

# Threads of the linear algebra spin while they wait for a processor that the other worker has; commands inherit this.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything loads NumPy

import pytest
from hypothesis import HealthCheck, settings

# A shell starts what runs in the background with Ctrl-C ignored, and commands inherit it: tests send it to them.
signal.signal(signal.SIGINT, signal.default_int_handler)

# How long drawing takes is the machine's affair.
REPEATABLE = {"derandomize": True, "deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("quick", max_examples=30, **REPEATABLE)
settings.register_profile("slow", max_examples=100, **REPEATABLE)
settings.load_profile("quick")


def pytest_configure(config):
    if config.getoption("markexpr") == "slow":
        settings.load_profile("slow")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file on one worker, so that what they share is worked out once."""
    from xdist.scheduler import LoadFileScheduling  # noqa: PLC0415 - pytest-xdist may be switched off

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)
