"""Covariance matrix adaptation, for goals without slopes, the same every time."""

from __future__ import annotations

import sys
import warnings
from importlib.abc import MetaPathFinder
from threading import get_ident
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray

_POPULATION = 10


class _Without(MetaPathFinder):
    """Modules that this thread does not find, unless they are loaded already."""

    def __init__(self, *names: str) -> None:
        self._names, self._thread = names, get_ident()

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> None:  # noqa: ARG002
        """Find nothing, for everybody else to look on."""
        if fullname in self._names and get_ident() == self._thread:
            raise ModuleNotFoundError(f"{fullname} is left out", name=fullname)


def _cma() -> Any:
    """Import the package without what it can do without: plotting and statistics cost a second and are not used."""
    unused = _Without("matplotlib", "matplotlib.pyplot", "scipy.stats")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is left out
        sys.meta_path.insert(0, unused)
        try:
            import cma  # noqa: PLC0415
        finally:
            sys.meta_path.remove(unused)
    return cma


def evolution(
    start: FloatArray, bounds: tuple[FloatArray, FloatArray], spread: float, draw: np.random.Generator
) -> Any:
    """Prepare covariance matrix adaptation (Hansen 2016): an object that is asked for points and told their values.

    Args:
        start: where to begin, shape (knobs,).
        bounds: lower and upper.
        spread: of the first points.
        draw: its random numbers; its own generator would seed numpy's, which belongs to the caller.
    """
    options = {
        "bounds": [bound.tolist() for bound in bounds],
        "popsize": _POPULATION,
        "randn": lambda *shape: draw.standard_normal(shape),
        "seed": np.nan,
        "verbose": -9,
        "verb_log": 0,
    }
    return _cma().CMAEvolutionStrategy(np.clip(start, *bounds), spread, options)
