"""The file of a coupling to a simulation: its gains with problem, certificate and trial."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.json_values import json_text, plain
from avc_casadi._util.units import speaking, told_in
from avc_casadi.files.gain_file import read_document, units_of_document
from avc_casadi.files.problem_document import problem_document, problem_of
from avc_casadi.model.lifted_loop import ToolGains
from avc_casadi.teleoperator_coupling import TeleoperatorCoupling
from avc_casadi.tool_coupling import ToolCoupling

SCHEMA = "avc-tool-coupling/1"
_GAINS = ("stiffness_n_per_m", "damping_ns_per_m", "local_damping_ns_per_m")
_TABLES = ("certificate", "trial", "versions")


def tool_coupling_document(coupling: ToolCoupling) -> dict[str, Any]:
    """Return JSON values: schema, id, gains at the device and in the scene, problem, certificate, trial, versions."""
    found: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "id": coupling.id,
            **vars(coupling.gains),
            "in_scene": {name: getattr(coupling.in_scene, name) for name in _GAINS[:2]},
            "problem_file": problem_document(coupling.problem),
            "certificate": None if coupling.certificate is None else dict(coupling.certificate),
            "trial": None if coupling.trial is None else dict(coupling.trial),
            "versions": dict(coupling.versions),
        }
    )
    return found


def write_tool_coupling(coupling: ToolCoupling, path: str | Path) -> None:
    """Write the file."""
    with speaking(coupling.problem.units):
        Path(path).write_text(json_text(tool_coupling_document(coupling)), encoding="utf-8")


def is_tool_coupling(path: str | Path, schema: str = SCHEMA) -> bool:
    """Whether a file holds a coupling to a simulation, or one of another schema; what cannot be read is none."""
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8")) if str(path).lower().endswith(".json") else None
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(document, Mapping) and document.get("schema") == schema


def read_tool_coupling(path: str | Path) -> ToolCoupling:
    """Read the file.

    Raises:
        InputError: with every fault of the file.
    """
    return read_gains_to(path, SCHEMA, "simulation", ToolCoupling)


_Kind = TypeVar("_Kind", ToolCoupling, TeleoperatorCoupling)


def read_gains_to(path: str | Path, schema: str, table: str, kind: type[_Kind]) -> _Kind:
    """Read the file of a coupling to another end.

    Args:
        path: of the file.
        schema: that it must have.
        table: of the other end, which its problem must have.
        kind: what it holds.

    Raises:
        InputError: with every fault of the file.
    """
    path = Path(path)
    document = read_document(path)
    units = units_of_document(document)
    with told_in(units):
        return _read(units.read(document), str(path), schema, table, kind)


def _read(document: Mapping[str, Any], file: str, schema: str, table: str, kind: type[_Kind]) -> _Kind:
    faults = []
    if document.get("schema") != schema:
        faults.append(Fault(file, None, "schema", f"is {document.get('schema')!r}; allowed: {schema!r}"))
    for key in _GAINS:
        value = document.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1e12:
            faults.append(Fault(file, None, key, f"is {value!r}; allowed: a finite number, 0 or more"))
    faults += [
        Fault(file, None, key, "must be a table or null")
        for key in _TABLES
        if not isinstance(document.get(key), Mapping | None)
    ]
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
