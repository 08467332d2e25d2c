"""Reading a problem file: from a path or a catalogue name to a validated `Problem`."""

from __future__ import annotations

import codecs
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi.files.catalogue import catalogue_names, catalogue_path
from avc_casadi.files.device_file import with_device
from avc_casadi.files.key_lines import KeyLines
from avc_casadi.files.measured_bounds_file import with_measured_bounds
from avc_casadi.files.toml_text import tables_of, text_of
from avc_casadi.model.findings import checked
from avc_casadi.model.problem import Frequency, Problem
from avc_casadi.model.rules import Finding, dotted

# Where the band of a slow device ends, as a share of the sampling rate; that of the default device does.
_BELOW_NYQUIST = 0.45
# Slower devices are told that the band has no room.
_SLOWEST_S = 0.25


def load_problem(source: str | Path) -> Problem:
    """Load a problem file, or a problem of the catalogue by name.

    Args:
        source: a path, or a name as `catalogue` lists them, for example ``figure5``. A text is a path if it
            ends in ``.toml`` or if no problem has that name.

    Returns:
        The validated problem.

    Raises:
        InputError: with every fault of the file at once, each with its line and key.

    Example:
        >>> avc.load_problem("figure5").environment.stiffness_n_per_m
        100000.0
    """
    path = _path_of(source)
    names = {file: name for name, file in catalogue_names().items()}
    _refuse_gains(path)
    text = text_of(path)
    return parse_problem(text, file=str(source), name=names.get(path.resolve(), path.stem), folder=path.parent)


def _refuse_gains(path: Path) -> None:
    """Answer a coupling or gain file in place of a problem file with what takes it."""
    try:
        if not path.is_file():
            return
        with path.open("rb") as file:
            start = file.read(200).removeprefix(codecs.BOM_UTF8).lstrip()
    except (OSError, ValueError):  # told where it is read
        return
    if start.startswith((b"{", b"frequency_hz,")):
        message = (
            "is a coupling or gain file; allowed: a problem file (TOML). The verbs certify, simulate, push, stream and "
            f"export take it, and beside a problem: avc certify P {path}, avc simulate P --gains {path}; in Python: "
            "avc.read_coupling"
        )
        raise InputError.of(message, file=str(path))


def _refuse_device(tables: Mapping[str, Any], file: str) -> None:
    """Answer a device file in place of a problem file with what refers to it."""
    if "sources" in tables and "environment" not in tables:
        message = (
            f'is a device, not a problem; allowed: a problem file with device = "{Path(file).name}" and the wall in '
            "[environment]. The verbs check, excite and identify --device take it"
        )
        raise InputError.of(message, file=file)


def as_problem(problem: Problem | str | Path) -> Problem:
    """Return a problem as it is, or load the file or the name of the catalogue.

    Raises:
        InputError: with every fault of the file, or no problem has that name.
    """
    return problem if isinstance(problem, Problem) else load_problem(problem)


def with_wall(problem: Problem | str | Path) -> Problem:
    """Return a problem as `as_problem` does, where the device's own loop computes a wall.

    Raises:
        UnsupportedError: the other end is a simulation or a follower, and no wall is declared beside it.
    """
    found, wall = as_problem(problem), as_problem(problem).environment
    far = "simulation" if found.simulation is not None else "follower" if found.follower is not None else ""
    if far and not (wall.stiffness_n_per_m or wall.damping_ns_per_m):
        raise UnsupportedError(
            f"{found.name or 'the problem'} couples to a [{far}] and has no wall in [environment], which is asked "
            "for here; avc recommend answers it",
            key="environment",
        )
    return found


def _path_of(source: str | Path) -> Path:
    if isinstance(source, Path) or source.endswith(".toml"):
        return Path(source)
    names = catalogue_names()
    if source in names:
        return names[source]
    try:
        exists = bool(source) and Path(source).exists()
    except (OSError, ValueError):  # too long for a path, or with a NUL in it
        exists = False
    return Path(source) if exists else catalogue_path(source)


def parse_problem(text: str, *, file: str = "problem.toml", name: str = "", folder: Path | None = None) -> Problem:
    r"""Validate the text of a problem file.

    Args:
        text: TOML.
        file: what the faults call the file.
        name: name of the problem.
        folder: what the path of a device file is relative to; None is the working directory.

    Returns:
        The validated problem.

    Raises:
        InputError: with every fault of the text at once, each with its line and key.

    Example:
        >>> wall = "[environment]\ndamping_ns_per_m = 10\nstiffness_n_per_m = 1e5"
        >>> avc.parse_problem("[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2\n" + wall).device.mass_kg
        0.1
    """
    try:
        parsed = tables_of(text, file)
        _refuse_device(parsed, file)
        worded = with_device(parsed, folder)
        if isinstance(worded, tuple):
            result: Problem | list[Finding] = [worded]
        else:
            result = checked(Problem, _with_band(with_measured_bounds(worded.tables, folder)), name)
            result = worded.told([] if isinstance(result, Problem) else result) or result
        if isinstance(result, Problem):
            return result
        lines = KeyLines(text.replace("\r\n", "\n"))
        faults = [Fault(file, lines[path], dotted(path), message) for path, message in result]
    except RecursionError as error:
        raise InputError.of("is nested too deeply; allowed: tables as in the catalogue", file=file) from error
    raise InputError(sorted(faults, key=lambda fault: (fault.line is None, fault.line or 0)))


def _with_band(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """End the band of a slow device, whose file says nothing of its end, below half the sampling rate."""
    device, band = tables.get("device"), tables.get("frequency", {})
    time = device.get("sample_time_s") if isinstance(device, Mapping) else None
    if not isinstance(band, Mapping) or isinstance(time, bool) or not isinstance(time, int | float):
        return tables
    usual = float(Frequency.model_fields["stop_hz"].default)
    if {"stop_hz", "values_hz"} & set(band) or not 0.5 / usual <= time <= _SLOWEST_S:
        return tables
    return {**tables, "frequency": {**band, "stop_hz": _BELOW_NYQUIST / time}}
