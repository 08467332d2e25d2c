"""An admittance device from its file, a catalogue name or tables: `drive = "velocity"` in [device] makes it one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi._util.json_values import plain
from avc_casadi.files.border import Border
from avc_casadi.files.catalogue import ADMITTANCE, admittance_names, require_source
from avc_casadi.files.toml import KeyLines, tables_of, text_of, toml_lines
from avc_casadi.model.admittance import AdmittanceProblem
from avc_casadi.model.table import dotted, refused, shown

AnyAdmittance = AdmittanceProblem | str | Path | Mapping[str, Any]
"""An admittance problem, a path or a name as `load_admittance` takes it, or the tables of such a file as a dict."""

VERBS = "check, certify, recommend, explore, trial, zwidth and export"
"""Commands that know admittance devices."""


def states_drive(tables: Mapping[str, Any]) -> bool:
    """Return whether tables are those of a device whose drive follows a velocity."""
    device = tables.get("device")
    return isinstance(device, Mapping) and "drive" in device


def refuse_admittance(tables: Mapping[str, Any], file: str) -> None:
    """Refuse an admittance device where a device is commanded a force."""
    if states_drive(tables) and tables["device"]["drive"] != "force":
        fact = f"{file}: device.drive is {shown(tables['device']['drive'])}"
        raise UnsupportedError(f"{fact}: {VERBS} know such an admittance device, nothing else does", key="")


def is_admittance(source: object) -> bool:
    """Return whether a name or a file is that of an admittance device; what cannot be read is none."""
    if isinstance(source, AdmittanceProblem | Mapping):
        return isinstance(source, AdmittanceProblem) or states_drive(source)
    if not isinstance(source, str | Path) or str(source) in admittance_names():
        return isinstance(source, str | Path)
    try:
        return Path(source).suffix == ".toml" and states_drive(tables_of(text_of(Path(source)), str(source)))
    except (InputError, OSError, ValueError):  # reported where it is loaded
        return False


def load_admittance(source: str | Path) -> AdmittanceProblem:
    """Load the file of an admittance device, or one of the catalogue by name.

    Args:
        source: a path, or a name such as ``admittance/cobot``.

    Returns:
        The validated problem.

    Raises:
        InputError: with every fault of the file at once, each with its line and key.

    Example:
        >>> avc.load_admittance("admittance/cobot").device.drive
        'velocity'
    """
    require_source(source, f"the path of a file, or a name such as {ADMITTANCE}cobot")
    path = admittance_names().get(str(source), Path(source))
    name = str(source) if str(source) in admittance_names() else path.stem
    return parse_admittance(text_of(path), file=str(source), name=name)


def parse_admittance(text: str, *, file: str = "problem.toml", name: str = "") -> AdmittanceProblem:
    """Validate the text of a file of an admittance device.

    Raises:
        InputError: with every fault of the text at once, each with its line and key.

    Example:
        >>> avc.parse_admittance("[device]").device
        Traceback (most recent call last):
        avc_casadi._errors.InputError: ...
    """
    tables = tables_of(text, file)
    result = _of_tables(tables, name)
    if isinstance(result, AdmittanceProblem):
        return result
    lines = KeyLines(text)
    faults = [Fault(file, lines[path], dotted(path), message) for path, message in result]
    raise InputError(sorted(faults, key=lambda fault: (fault.line is None, fault.line or 0)))


def as_admittance(problem: AnyAdmittance) -> AdmittanceProblem:
    """Return an admittance problem unchanged, or load its file or name, or make it of its tables."""
    if isinstance(problem, AdmittanceProblem):
        return problem
    if isinstance(problem, str | Path):
        return load_admittance(problem)
    if not isinstance(problem, Mapping):
        allowed = "allowed: an admittance problem, its path or name, or its tables as a dict"
        raise InputError.of(f"is {shown(problem)}; {allowed}", key="problem")
    result = _of_tables(plain(dict(problem)), "")
    if isinstance(result, AdmittanceProblem):
        return result
    raise refused(result, "problem")


def _of_tables(tables: Mapping[str, Any], name: str) -> AdmittanceProblem | list[Any]:
    device = tables.get("device")
    if isinstance(device, Mapping) and "from" in device:
        return [(("device", "from"), "is not supported for an admittance device; state all values in [device]")]
    if isinstance(device, Mapping) and device.get("drive") == "position":
        allowed = 'allowed: "velocity"; for a drive that follows a position, state how it follows a changing position'
        return [(("device", "drive"), f'is "position"; {allowed}')]
    border = Border()
    border.read(tables, *border.device_table(tables.get("device"), {}))
    return border.checked(AdmittanceProblem, name)


def dump_admittance(problem: AdmittanceProblem) -> str:
    """Write an admittance problem as TOML with every value, defaults included; the name is that of the file."""
    tables = problem.model_dump(exclude_none=True)
    del tables["name"]
    return "\n".join(toml_lines((), problem.units.keyed(tables))) + "\n"
