"""A problem from its file, a catalogue name or tables, and back as TOML or JSON."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from functools import wraps
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi._util.json_values import plain
from avc_casadi.files.admittance_file import drive_faults, refuse_admittance, states_drive
from avc_casadi.files.border import in_keys_of
from avc_casadi.files.catalogue import (
    DEVICES,
    admittance_names,
    catalogue_names,
    catalogue_path,
    device_names,
    require_source,
)
from avc_casadi.files.device_file import DeviceFile, with_device
from avc_casadi.files.kinds import FileKind, kind_of_bytes, require_problem_text
from avc_casadi.files.toml import KeyLines, tables_of, text_of, toml_lines
from avc_casadi.model.ends import Wall
from avc_casadi.model.joint import NoDevice
from avc_casadi.model.problem import Frequency, Problem
from avc_casadi.model.table import Finding, dotted, refused, shown, valid
from avc_casadi.model.table import Path as KeyPath

BELOW_NYQUIST = 0.45
"""End of the band of a slow device, as a share of the sampling rate, the same as by default."""
_LONGEST_BANDED_S = 0.25
"""Longest sample time for which the band is limited."""
_TABLES_OF_A_JOINT = ("name", "title", "source", "simulation", "law")
"""What a file of a joint without a device states."""

_TELLING_BYTES = 2**20
"""Bytes at the beginning of a file that show its kind."""
_NO_WALL = "; your own gains need no wall: state them in a table [law]"
"""Advice where a problem has no wall."""


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
    require_source(source, "the path of a problem file, or a name as `avc list` shows them")
    path = admittance_names().get(str(source)) or _path_of(source)
    names = {file: name for name, file in catalogue_names().items()}
    text = text_of(path)
    require_problem_text(text, str(path))
    return parse_problem(text, file=str(source), name=names.get(path.resolve(), path.stem), folder=path.parent)


def is_device(source: str) -> bool:
    """Return whether a name or a file is that of a device rather than a problem."""
    if not source.endswith(".toml"):
        return source.startswith(DEVICES) or (source in device_names() and source not in catalogue_names())
    try:
        tables = tables_of(text_of(Path(source)), source)
    except InputError:  # reported where it is loaded as a problem
        return False
    is_table = isinstance(tables.get("device"), dict)
    return is_table and set(tables) <= set(DeviceFile.model_fields) and not states_drive(tables)


def kind_of_file(path: Path) -> FileKind:
    """Return the kind of an existing file."""
    with path.open("rb") as file:
        kind = kind_of_bytes(file.read(_TELLING_BYTES))
    return FileKind.DEVICE if kind is FileKind.PROBLEM and is_device(str(path)) else kind


F = TypeVar("F", bound=Callable[..., Any])
AnyProblem = Problem | str | Path | Mapping[str, Any]
"""A problem, a path or a name as `load_problem` takes it, or the tables of a problem file as a dict."""


def load_any(problem: AnyProblem) -> Problem:
    """Return a problem unchanged, or load its file or catalogue name, or make it of its tables."""
    if isinstance(problem, Problem):
        findings = list(_not_finite((), problem.model_dump()))
        if findings:
            raise refused(findings, problem.name or "problem")
        return problem
    if isinstance(problem, str | Path):
        return load_problem(problem)
    if not isinstance(problem, Mapping):
        allowed = "allowed: a problem, its path or name, or its tables as a dict"
        raise InputError.of(f"is {shown(problem)}; {allowed}", key="problem")
    result = _of_tables(plain(dict(problem)), "problem", "", None)
    if isinstance(result, Problem):
        return result
    raise refused(result, "problem")


def require_device(problem: AnyProblem) -> Problem:
    """Return a problem as by `load_any`.

    Raises:
        UnsupportedError: it is a joint that an engine moves, without a device.
    """
    loaded = load_any(problem)
    if isinstance(loaded.device, NoDevice):
        fact = f"{loaded.name or 'it'} is a joint that an engine moves, without a device and a hand"
        known_to = "avc check P, avc certify P --kp KP --kd KD and avc recommend P know it"
        raise UnsupportedError(f"{fact}; {known_to}", key="device")
    return loaded


def _not_finite(path: KeyPath, value: Any) -> Iterator[Finding]:
    """Yield the numbers that `model_copy` put in place unchecked."""
    if isinstance(value, Mapping | tuple):
        for key, item in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield from _not_finite((*path, key), item)
    elif isinstance(value, float) and not math.isfinite(value):
        yield path, f"is {value}; allowed: a finite number"


def accepts_problem(function: F) -> F:
    """Decorate a function of a problem: it takes its file or name as well, and its faults name keys as that does."""

    @wraps(function)
    def of_any(problem: AnyProblem, *args: Any, **options: Any) -> Any:
        loaded = require_device(problem)
        with in_keys_of(loaded.units):
            return function(loaded, *args, **options)

    return cast("F", of_any)


def require_wall(problem: AnyProblem) -> Problem:
    """Return a problem as by `require_device`, with a wall rendered by the device's own loop."""
    loaded = require_device(problem)
    wall, end = loaded.wall, loaded.end
    if not (isinstance(end, Wall) or wall.stiffness_n_per_m or wall.damping_ns_per_m):
        fact = f"{loaded.name or 'it'} couples to a [{end.kind}], not a wall"
        raise UnsupportedError(f"{fact}; use avc recommend P, or avc certify P --k K --b B", key="environment")
    return loaded


def _path_of(source: str | Path) -> Path:
    if isinstance(source, Path) or source.endswith(".toml"):
        return Path(source)
    names = catalogue_names()
    if source in names:
        return names[source]
    # Of pathlib a name that is too long raises.
    return Path(source) if os.path.exists(source) else catalogue_path(source)  # noqa: PTH110


def parse_problem(text: str, *, file: str = "problem.toml", name: str = "", folder: Path | None = None) -> Problem:
    r"""Validate the text of a problem file.

    Args:
        text: TOML.
        file: name in faults.
        name: name of the problem.
        folder: base of the path of a device file; None is the working directory.

    Returns:
        The validated problem.

    Raises:
        InputError: with every fault of the text at once, each with its line and key.

    Example:
        >>> wall = "[environment]\ndamping_ns_per_m = 10\nstiffness_n_per_m = 1e5"
        >>> avc.parse_problem("[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2\n" + wall).device.mass_kg
        0.1
    """
    if not isinstance(text, str):
        raise InputError.of(f"is {shown(text)}; allowed: the text of a problem file", file=file, key="text")
    try:
        result = _of_tables(tables_of(text, file), file, name, folder)
        if isinstance(result, Problem):
            return result
        lines = KeyLines(text)
        faults = [Fault(file, lines[path], dotted(path), message) for path, message in result]
    except RecursionError as error:
        raise InputError.of("is nested too deeply; allowed: tables as in the built-in problems", file=file) from error
    raise InputError(sorted(faults, key=lambda fault: (fault.line is None, fault.line or 0)))


def _of_tables(tables: Mapping[str, Any], file: str, name: str, folder: Path | None) -> Problem | list[Finding]:
    """Return the problem of the tables of a file, or all faults, each at its path in the file."""
    faults = drive_faults(tables)
    if faults:
        return faults
    refuse_admittance(tables, file)
    law, device = tables.get("law"), tables.get("device")
    for key in ("force_feedback", "torque_feedback"):
        if isinstance(law, Mapping) and key in law:
            return [(("law", key), "is the feedback of a force sensor; give [device.force_sensor], or leave it out")]
    if isinstance(device, Mapping) and device.get("drive") == "force":
        # What every device without a force sensor is commanded.
        tables = {**tables, "device": {key: value for key, value in device.items() if key != "drive"}}
    if "sources" in tables and "environment" not in tables:
        message = f'is a device; allowed: a problem file with device = "{Path(file).name}" and a wall, [environment]'
        raise InputError.of(message, file=file)
    border = with_device(tables, folder)
    if isinstance(border, tuple):
        return [border]
    border.tables = {**_with_band(border.tables)}
    result = border.checked(Problem, name)
    if isinstance(result, Problem):
        return result
    return [(path, f"{message}{_NO_WALL}" if path == ("environment",) else message) for path, message in result]


def _with_band(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Limit the band of a slow device, where its file gives no end, to below half the sampling rate."""
    device, band = tables.get("device"), tables.get("frequency", {})
    sample_time_s = device.get("sample_time_s") if isinstance(device, Mapping) else None
    if not isinstance(band, Mapping):
        return tables
    if isinstance(sample_time_s, bool) or not isinstance(sample_time_s, int | float):
        return tables
    usual_hz = float(Frequency.model_fields["stop_hz"].default)
    # For slower devices an error says that the band has no room.
    slow = 0.5 / usual_hz <= sample_time_s <= _LONGEST_BANDED_S
    if {"stop_hz", "values_hz"} & set(band) or not slow:
        return tables
    return {**tables, "frequency": {**band, "stop_hz": BELOW_NYQUIST / sample_time_s}}


def dump_problem(problem: Problem) -> str:
    """Write a problem as TOML with every value, defaults included.

    The name is not written: it is that of the file.

    Args:
        problem: any problem.

    Raises:
        InputError: it is no problem.

    Returns:
        Text from which `parse_problem` makes an equal problem.

    Example:
        >>> text = avc.dump_problem(avc.load_problem("figure5"))
        >>> avc.parse_problem(text, name="figure5") == avc.load_problem("figure5")
        True
    """
    if not isinstance(problem, Problem):
        raise InputError.of(f"is {shown(problem)}; allowed: a Problem, as load_problem returns it", key="problem")
    tables = _tables_of(problem, "python")
    del tables["name"]
    return "\n".join(toml_lines((), problem.units.keyed(tables))) + "\n"


def problem_document(problem: Problem) -> dict[str, Any]:
    """Return a problem as JSON values, with its name and every value, defaults included."""
    return _tables_of(problem, "json")


def _tables_of(problem: Problem, mode: Literal["json", "python"]) -> dict[str, Any]:
    """Return the tables of a problem; a band of listed frequencies holds these alone, a joint what it states."""
    if isinstance(problem.device, NoDevice):
        return problem.model_dump(mode=mode, include=set(_TABLES_OF_A_JOINT), exclude_unset=True, exclude_none=True)
    tables = problem.model_dump(mode=mode, exclude_none=True)
    if "values_hz" in tables["frequency"]:
        tables["frequency"] = {"values_hz": tables["frequency"]["values_hz"]}
    return tables


def problem_of(document: Mapping[str, Any], *, file: str = "problem") -> Problem:
    """Read `problem_document` back."""
    tables = {table: values for table, values in document.items() if table != "name"}
    return valid(Problem, tables, file, str(document.get("name", "")))
