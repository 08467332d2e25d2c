"""A device with a force sensor from its file, a catalogue name or tables.

`drive = "velocity"` in [device] makes it an admittance device; a device that is commanded a force has force feedback
where it has a force sensor.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi._util.json_values import plain
from avc_casadi.files.border import Border
from avc_casadi.files.catalogue import ADMITTANCE, admittance_names, require_source
from avc_casadi.files.toml import KeyLines, tables_of, text_of, toml_lines
from avc_casadi.model.admittance import ADMITTANCE_DRIVES, AdmittanceProblem
from avc_casadi.model.sensed import ForceFeedbackProblem, SensorProblem
from avc_casadi.model.table import Finding, dotted, one_of, refused, shown

AnyAdmittance = AdmittanceProblem | str | Path | Mapping[str, Any]
"""An admittance problem, a path or a name as `load_admittance` takes it, or the tables of such a file as a dict."""

AnyForceFeedback = ForceFeedbackProblem | str | Path | Mapping[str, Any]
"""The same of a device with a force sensor that is commanded a force."""

VERBS = "check, certify, recommend, explore, trial, zwidth and export"
"""Commands for admittance devices."""
_IN_PYTHON = "in Python avc.certify_admittance, recommend_admittance and, for zwidth, mass_width"
_SENSORS = ("force_sensor", "torque_sensor")
_OF_A_DRIVE = ("drive_bandwidth_hz", "drive_order", "drive_damping_ratio")
_DRIVES = ("force", *ADMITTANCE_DRIVES)


def states_drive(tables: Mapping[str, Any]) -> bool:
    """Return whether tables are those of a device with a force sensor, or with a drive that follows a motion."""
    return _model_of(tables) is not None


def _model_of(tables: Mapping[str, Any]) -> type[AdmittanceProblem | ForceFeedbackProblem] | None:
    """Return what tables are read as; None: a device that is commanded a force, without a sensor."""
    device = tables.get("device")
    if not isinstance(device, Mapping):
        return None
    drive = device.get("drive")
    if drive in ADMITTANCE_DRIVES:
        return AdmittanceProblem
    # Without a drive that is known it is read as what its keys are of, so that the error is that key alone.
    if drive != "force" and any(key in device for key in _OF_A_DRIVE):
        return AdmittanceProblem
    if any(key in device for key in _SENSORS):
        return ForceFeedbackProblem
    return AdmittanceProblem if "drive" in device and drive != "force" else None


def drive_faults(tables: Mapping[str, Any]) -> list[Finding]:
    """Return the faults of tables whose drive is not known; none of others."""
    if _model_of(tables) is None or tables["device"].get("drive", "force") in _DRIVES:
        return []
    result = _of_tables(tables, "")
    return result if isinstance(result, list) else []


def refuse_admittance(tables: Mapping[str, Any], file: str) -> None:
    """Refuse a device with a force sensor, of a drive that is known, where any other is commanded a force."""
    model = _model_of(tables)
    if model is None:
        return
    if model is AdmittanceProblem:
        fact = f"{file}: device.drive is {shown(tables['device'].get('drive', 'missing'))}"
        supported = f"this is not supported for an admittance device, but {VERBS} are"
        raise UnsupportedError(f"{fact}; {supported} ({_IN_PYTHON})", key="")
    raise _unsupported_feedback(file)


def _unsupported_feedback(file: str) -> UnsupportedError:
    """Return what refuses a device with force feedback where something needs another device."""
    fact = f"{file}: the device is commanded a force and has a force sensor, which this does not support"
    return UnsupportedError(f"{fact}; use avc check, recommend or certify {file}", key="")


def is_admittance(source: object) -> bool:
    """Return whether a name or a file is that of a device with a force sensor; what cannot be read is none."""
    if isinstance(source, AdmittanceProblem | ForceFeedbackProblem | Mapping):
        return not isinstance(source, Mapping) or states_drive(source)
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
    return _of_velocity(load_sensor_problem(source), str(source))


def load_sensor_problem(source: str | Path) -> SensorProblem:
    """Load the file of a device with a force sensor, or one of the catalogue by name."""
    require_source(source, f"the path of a file, or a name such as {ADMITTANCE}cobot")
    path = admittance_names().get(str(source), Path(source))
    name = str(source) if str(source) in admittance_names() else path.stem
    return _parsed(text_of(path), str(source), name)


def _of_velocity(problem: SensorProblem, file: str) -> AdmittanceProblem:
    """Return an admittance problem, or refuse that of a device that is commanded a force."""
    if isinstance(problem, ForceFeedbackProblem):
        raise _unsupported_feedback(file)
    return problem


def parse_admittance(text: str, *, file: str = "problem.toml", name: str = "") -> AdmittanceProblem:
    """Validate the text of a file of an admittance device.

    Raises:
        InputError: with every fault of the text at once, each with its line and key.

    Example:
        >>> avc.parse_admittance("[device]").device
        Traceback (most recent call last):
        avc_casadi._errors.InputError: ...
    """
    return _of_velocity(_parsed(text, file, name), file)


def _parsed(text: str, file: str, name: str) -> SensorProblem:
    result = _of_tables(tables_of(text, file), name)
    if not isinstance(result, list):
        return result
    lines = KeyLines(text)
    faults = [Fault(file, lines[path], dotted(path), message) for path, message in result]
    raise InputError(sorted(faults, key=lambda fault: (fault.line is None, fault.line or 0)))


def as_admittance(problem: AnyAdmittance) -> AdmittanceProblem:
    """Return an admittance problem unchanged, or load its file or name, or make it of its tables."""
    return _of_velocity(_as_sensor_problem(problem), label_of(problem))


def label_of(problem: AnyAdmittance | AnyForceFeedback) -> str:
    """Return what errors call a problem: its path or name as given; of tables and objects the name of their file."""
    if isinstance(problem, str | Path):
        return str(problem)
    return problem.typed_name if isinstance(problem, AdmittanceProblem | ForceFeedbackProblem) else "the problem"


def as_force_feedback(problem: AnyForceFeedback) -> ForceFeedbackProblem:
    """Return a problem of force feedback unchanged, or load its file or name, or make it of its tables."""
    stated = _as_sensor_problem(problem)
    if isinstance(stated, AdmittanceProblem):
        fact = f"{label_of(problem)}: device.drive is {shown(stated.device.drive)}"
        raise UnsupportedError(f"{fact}: avc.certify_admittance judges such an admittance device", key="")
    return stated


def _as_sensor_problem(problem: AnyAdmittance | AnyForceFeedback) -> SensorProblem:
    """Return the problem of a device with a force sensor, from itself, its file or name, or its tables."""
    if isinstance(problem, AdmittanceProblem | ForceFeedbackProblem):
        return problem
    if isinstance(problem, str | Path):
        return load_sensor_problem(problem)
    if not isinstance(problem, Mapping):
        allowed = "allowed: an admittance problem, its path or name, or its tables as a dict"
        raise InputError.of(f"is {shown(problem)}; {allowed}", key="problem")
    result = _of_tables(plain(dict(problem)), "")
    if not isinstance(result, list):
        return result
    raise refused(result, "problem")


def _of_tables(tables: Mapping[str, Any], name: str) -> SensorProblem | list[Finding]:
    """Return the problem of tables in the units of their motion, or what is wrong with them."""
    device = tables.get("device")
    if isinstance(device, Mapping) and "from" in device:
        why = "is not supported for a device with a force sensor; state all values in [device]"
        return [(("device", "from"), why)]
    border = Border()
    drive = device.get("drive", "force") if isinstance(device, Mapping) else "force"
    if isinstance(device, Mapping) and drive not in _DRIVES:
        unknown = f"is {shown(drive)}; allowed: {one_of(list(_DRIVES), drive)}"
        if not any(key in device for key in (*_OF_A_DRIVE, *_SENSORS)):
            return [(("device", "drive"), unknown)]  # nothing says which other keys are right
        border.fault(("device", "drive"), unknown)
    border.read(tables, *border.device_table(tables.get("device"), {}))
    return border.checked(_model_of(tables) or AdmittanceProblem, name)


def dump_admittance(problem: SensorProblem) -> str:
    """Write a problem of a device with a force sensor as TOML with every value; the name is that of the file.

    Hands that are assumed are left out, so that they remain assumed.
    """
    tables = problem.model_dump(exclude_none=True)
    del tables["name"]
    if problem.assumes_hands:
        del tables["hands"]
    return "\n".join(toml_lines((), problem.units.keyed(tables))) + "\n"
