"""The file of a coupling to another end, a simulation or a second device: gains, problem, certificate and trial."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text, plain
from avc_casadi._util.units import speaking
from avc_casadi.files.gain_file import read_document, units_of_document, unsound_tables
from avc_casadi.files.problem_document import problem_document, problem_of
from avc_casadi.model.lifted_loop import ToolGains
from avc_casadi.other_end_coupling import TeleoperatorCoupling, ToolCoupling

TOOL_SCHEMA, TELEOPERATOR_SCHEMA = "avc-tool-coupling/1", "avc-teleoperator-coupling/1"
_GAINS = ("stiffness_n_per_m", "damping_ns_per_m", "local_damping_ns_per_m")
_TABLES = ("certificate", "trial", "versions")


def other_end_document(coupling: ToolCoupling | TeleoperatorCoupling) -> dict[str, Any]:
    """Return JSON values: schema, id, gains at both ends, problem, certificate, trial, versions.

    Gains are those of the device, N/m and N.s/m; beside them ``in_scene`` or ``at_follower``.
    """
    if isinstance(coupling, ToolCoupling):
        schema, key = TOOL_SCHEMA, "in_scene"
        there = {name: getattr(coupling.in_scene, name) for name in _GAINS[:2]}
    else:
        schema, key, there = TELEOPERATOR_SCHEMA, "at_follower", vars(coupling.at_follower)
    found: dict[str, Any] = plain(
        {
            "schema": schema,
            "id": coupling.id,
            **vars(coupling.gains),
            key: there,
            "problem_file": problem_document(coupling.problem),
            "certificate": None if coupling.certificate is None else dict(coupling.certificate),
            "trial": None if coupling.trial is None else dict(coupling.trial),
            "versions": dict(coupling.versions),
        }
    )
    return found


def write_other_end(coupling: ToolCoupling | TeleoperatorCoupling, path: str | Path) -> None:
    """Write the file."""
    with speaking(coupling.problem.units):
        write_file(path, json_text(other_end_document(coupling)))


def is_tool_coupling(path: str | Path) -> bool:
    """Return whether a file holds a coupling to a simulation; False if unreadable."""
    return _schema_of(path) == TOOL_SCHEMA


def is_teleoperator_coupling(path: str | Path) -> bool:
    """Return whether a file holds a coupling between two devices; False if unreadable."""
    return _schema_of(path) == TELEOPERATOR_SCHEMA


def read_tool_coupling(path: str | Path) -> ToolCoupling:
    """Read the file of a coupling to a simulation.

    Raises:
        InputError: with every fault of the file.
    """
    return _read_file(Path(path), TOOL_SCHEMA, "simulation", ToolCoupling)


def read_teleoperator_coupling(path: str | Path) -> TeleoperatorCoupling:
    """Read the file of a coupling between two devices.

    Raises:
        InputError: with every fault of the file.
    """
    return _read_file(Path(path), TELEOPERATOR_SCHEMA, "follower", TeleoperatorCoupling)


def _schema_of(path: str | Path) -> object:
    try:
        return read_document(Path(path)).get("schema") if str(path).lower().endswith(".json") else None
    except InputError:
        return None


_Kind = TypeVar("_Kind", ToolCoupling, TeleoperatorCoupling)


def _read_file(path: Path, schema: str, table: str, kind: type[_Kind]) -> _Kind:
    document = read_document(path)
    units = units_of_document(document)
    with speaking(units):
        return _read(units.read(document), str(path), schema, table, kind)


def _read(document: Mapping[str, Any], file: str, schema: str, table: str, kind: type[_Kind]) -> _Kind:
    faults = []
    if document.get("schema") != schema:
        faults.append(Fault(file, None, "schema", f"is {document.get('schema')!r}; allowed: {schema!r}"))
    for key in _GAINS:
        value = document.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1e12:
            faults.append(Fault(file, None, key, f"is {value!r}; allowed: a finite number, 0 or more"))
    faults += unsound_tables(document, file, _TABLES)
    tables, problem = document.get("problem_file"), None
    if not isinstance(tables, Mapping) or not isinstance(tables.get(table), Mapping):
        message = f"is missing; allowed: the tables of a problem file, [{table}] among them"
        faults.append(Fault(file, None, "problem_file", message))
    else:
        try:
            problem = problem_of(tables, file=file, key="problem_file")
        except InputError as error:
            faults += error.faults
    if faults or problem is None:
        raise InputError(faults)
    found = kind(
        problem,
        ToolGains(*(float(document[key]) for key in _GAINS)),
        document.get("certificate"),
        document.get("trial"),
        document.get("versions") or {},
    )
    if document.get("id") != found.id:
        message = (
            f"is {document.get('id')!r}, and what the file holds is {found.id!r}: it was changed since; make it again: "
            "avc recommend P --out FILE"
        )
        raise InputError.of(message, file=file, key="id")
    return found
