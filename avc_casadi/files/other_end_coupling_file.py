"""The file of a coupling to another end, a simulation or a second device: gains, problem, certificate and trial."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from avc_casadi._errors import InputError
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text, plain
from avc_casadi.files.gain_file import JsonTable, faults_of, read_document, units_of_document
from avc_casadi.files.problem_document import problem_document
from avc_casadi.files.rotary_keys import in_keys_of
from avc_casadi.model.findings import checked
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import Quantity, Table, shown
from avc_casadi.model.virtual_tool import ToolGains
from avc_casadi.other_end_coupling import TeleoperatorCoupling, ToolCoupling

TOOL_SCHEMA, TELEOPERATOR_SCHEMA = "avc-tool-coupling/1", "avc-teleoperator-coupling/1"
_ENDS: dict[str, tuple[str, type[ToolCoupling | TeleoperatorCoupling]]] = {
    TOOL_SCHEMA: ("simulation", ToolCoupling),
    TELEOPERATOR_SCHEMA: ("follower", TeleoperatorCoupling),
}
_Gain = Annotated[float, BeforeValidator(Quantity("", 1e-300, 1e12))]


class _EndDocument(Table):
    id: Any = None
    stiffness_n_per_m: _Gain
    damping_ns_per_m: _Gain
    local_damping_ns_per_m: _Gain
    problem_file: Problem
    certificate: JsonTable = None
    trial: JsonTable = None
    versions: JsonTable = None
    in_scene: Any = None
    at_follower: Any = None
    motion: Any = None
    units: Any = None


def other_end_document(coupling: ToolCoupling | TeleoperatorCoupling) -> dict[str, Any]:
    """Return JSON values; gains are those of the device, beside them ``in_scene`` or ``at_follower``."""
    if isinstance(coupling, ToolCoupling):
        schema, key = TOOL_SCHEMA, "in_scene"
        there = {name: getattr(coupling.in_scene, name) for name in ("stiffness_n_per_m", "damping_ns_per_m")}
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
    write_file(path, json_text(coupling.units.document(other_end_document(coupling))))


def is_tool_coupling(path: str | Path) -> bool:
    """Return whether a file holds a coupling to a simulation; False if unreadable."""
    return _schema_of(path) == TOOL_SCHEMA


def is_teleoperator_coupling(path: str | Path) -> bool:
    """Return whether a file holds a coupling between two devices; False if unreadable."""
    return _schema_of(path) == TELEOPERATOR_SCHEMA


def read_tool_coupling(path: str | Path) -> ToolCoupling:
    """Read the file of a coupling to a simulation, or raise every fault of it."""
    found = _read_file(Path(path), TOOL_SCHEMA)
    assert isinstance(found, ToolCoupling)  # noqa: S101 - by its schema
    return found


def read_teleoperator_coupling(path: str | Path) -> TeleoperatorCoupling:
    """Read the file of a coupling between two devices, or raise every fault of it."""
    found = _read_file(Path(path), TELEOPERATOR_SCHEMA)
    assert isinstance(found, TeleoperatorCoupling)  # noqa: S101 - by its schema
    return found


def _schema_of(path: str | Path) -> object:
    try:
        return read_document(Path(path)).get("schema") if str(path).lower().endswith(".json") else None
    except InputError:
        return None


def _read_file(path: Path, schema: str) -> ToolCoupling | TeleoperatorCoupling:
    document = read_document(path)
    units, file = units_of_document(document), str(path)
    end, kind = _ENDS[schema]
    with in_keys_of(units):
        if document.pop("schema", None) != schema:
            raise InputError.of(f"is another; allowed: {shown(schema)}", file=file, key="schema")
        found = checked(_EndDocument, units.read(document))
        if isinstance(found, list):
            raise InputError(faults_of(found, file))
        if getattr(found.problem_file, end) is None:
            raise InputError.of(f"has no [{end}]; allowed: a problem with it", file=file, key="problem_file")
        gains = ToolGains(found.stiffness_n_per_m, found.damping_ns_per_m, found.local_damping_ns_per_m)
        coupling = kind(found.problem_file, gains, found.certificate, found.trial, found.versions or {})
        if found.id != coupling.id:
            message = f"is {shown(found.id)}, and what the file holds is {coupling.id!r}: it was changed since"
            raise InputError.of(f"{message}; make it again: avc recommend P --out FILE", file=file, key="id")
    return coupling
