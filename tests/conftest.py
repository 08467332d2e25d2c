import os
import signal
from zlib import crc32

# Threads of the linear algebra spin while they wait for a processor that the other worker has; commands inherit this.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before anything loads NumPy

import pytest
from hypothesis import HealthCheck, settings

# A shell starts what runs in the background with Ctrl-C ignored, and commands inherit it: tests send it to them.
signal.signal(signal.SIGINT, signal.default_int_handler)

# How long drawing takes is the machine's affair.
settings.register_profile(
    "repeatable", derandomize=True, deadline=None, max_examples=100, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("repeatable")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keep the tests of a file on one worker, so that what they share is worked out once."""
    from xdist.scheduler import LoadFileScheduling  # noqa: PLC0415 - pytest-xdist may be switched off

    config.option.loadscopereorder = False
    return LoadFileScheduling(config, log)


def pytest_addoption(parser):
    parser.addoption("--one-file-of", type=int, default=1, help="run the tests of one of so many files, drawn")
    parser.addoption("--draw", default="", help="text that draws them: another draws others")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Take the files that are drawn; leave some cases of what says the same of many for `pytest -m exhaustive`."""
    files, draw = config.getoption("one_file_of"), config.getoption("draw")
    if files > 1:
        drawn = [crc32(f"{draw} {item.path.name}".encode()) % files == 0 for item in items]
        config.hook.pytest_deselected(items=[item for item, taken in zip(items, drawn, strict=True) if not taken])
        items[:] = [item for item, taken in zip(items, drawn, strict=True) if taken]
    seen = {}
    for item in items:
        marker = item.get_closest_marker("one_of")
        if marker is not None:
            place = seen[item.parent, item.function] = seen.get((item.parent, item.function), -1) + 1
            # Spread by the golden ratio, as cases may repeat with any period; the first always runs.
            if place * 0.6180339887 % 1 * marker.args[0] >= 1:
                item.add_marker("exhaustive")
