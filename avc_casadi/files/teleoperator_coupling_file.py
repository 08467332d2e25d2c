"""The file of a coupling between two devices: its gains at both, with problem, certificate and trial."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from avc_casadi._util.json_values import json_text, plain
from avc_casadi._util.units import speaking
from avc_casadi.files.problem_document import problem_document
from avc_casadi.files.tool_coupling_file import is_tool_coupling, read_gains_to
from avc_casadi.teleoperator_coupling import TeleoperatorCoupling

SCHEMA = "avc-teleoperator-coupling/1"


def teleoperator_coupling_document(coupling: TeleoperatorCoupling) -> dict[str, Any]:
    """Return JSON values: schema, id, gains at leader and follower, problem, certificate, trial, versions."""
    found: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "id": coupling.id,
            **vars(coupling.gains),
            "at_follower": vars(coupling.at_follower),
            "problem_file": problem_document(coupling.problem),
            "certificate": None if coupling.certificate is None else dict(coupling.certificate),
            "trial": None if coupling.trial is None else dict(coupling.trial),
            "versions": dict(coupling.versions),
        }
    )
    return found


def write_teleoperator_coupling(coupling: TeleoperatorCoupling, path: str | Path) -> None:
    """Write the file."""
    with speaking(coupling.problem.units):
        Path(path).write_text(json_text(teleoperator_coupling_document(coupling)), encoding="utf-8")


def is_teleoperator_coupling(path: str | Path) -> bool:
    """Whether a file holds a coupling between two devices; what cannot be read is none."""
    return is_tool_coupling(path, SCHEMA)


def read_teleoperator_coupling(path: str | Path) -> TeleoperatorCoupling:
    """Read the file.

    Raises:
        InputError: with every fault of the file.
    """
    return read_gains_to(path, SCHEMA, "follower", TeleoperatorCoupling)
