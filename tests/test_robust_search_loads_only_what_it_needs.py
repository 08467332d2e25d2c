"""The package of the robust search brings plotting and statistics along, which cost more than a short search."""

import subprocess
import sys

import pytest

SEARCHED = """
import sys
import numpy as np
from avc_casadi.design.robust.cma_continuation import evolution
search = evolution(np.ones(2), (-2 * np.ones(2), 2 * np.ones(2)), 0.3, np.random.default_rng(0))
for _ in range(20):
    points = search.ask()
    search.tell(points, [float((point**2).sum()) for point in points])
assert search.result.fbest < 1e-2
print(*(name for name in ("matplotlib", "scipy.stats") if name in sys.modules))
import scipy.stats
import matplotlib.pyplot
"""


@pytest.mark.thorough
def test_a_search_loads_neither_plots_nor_statistics_and_hides_them_from_nobody():
    command = [sys.executable, "-c", SEARCHED]
    found = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603 - ours
    assert found.stdout.split() == []
