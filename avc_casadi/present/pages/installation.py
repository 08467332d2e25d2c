"""Summary of an installation: working solvers, packages, compilers, ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from avc_casadi._util.text import text_table
from avc_casadi.present.terminal import Mark, Page, Row

_NO = "no right to open it: add yourself to its group (dialout)"


def installation_page(document: dict[str, Any], ports: Sequence[Row], page: Page) -> str:
    """Return the `doctor` document as a headline and rows.

    Args:
        document: of `avc doctor --json`.
        ports: rows of the ports.
        page: where it is printed.
    """
    programs = [name for name, place in document["programs"].items() if place]
    missing = [name for name, place in document["programs"].items() if not place]
    solvers = document["solvers"]
    rows = [
        Row(
            "Solvers",
            ", ".join(f"{name} {'solves' if solves else 'does NOT solve'}" for name, solves in solvers.items()),
            Mark.PASS if all(solvers.values()) else Mark.FAIL,
        ),
        Row("Packages", ", ".join(f"{name} {version}" for name, version in document["packages"].items())),
        Row("Programs", ", ".join(programs) or "none", Mark.PASS if not missing else Mark.NONE),
        *([Row("Absent", ", ".join(missing), Mark.CAUTION)] if missing else []),
        Row("Emulator", "installed", Mark.PASS)
        if document["emulator"]
        else Row("Emulator", "absent; pip install 'avc-casadi[emulator]'", Mark.CAUTION),
        *ports,
        Row("This folder", "writable", Mark.PASS)
        if document["folder_writable"]
        else Row("This folder", "NOT writable", Mark.FAIL),
    ]
    return page.rendered(f"{document['executable']} on {document['platform']}", rows, ["avc doctor -v"])


def installation_lines(document: dict[str, Any]) -> list[str]:
    """Return the paths of the programs.

    Args:
        document: of `avc doctor --json`.
    """
    programs = [(name, found or "absent") for name, found in document["programs"].items()]
    return [text_table(("program", "place"), programs, left=(0, 1))]


def port_rows(ports: Sequence[Mapping[str, Any]], *, asked: bool) -> list[Row]:
    """Return the serial ports as rows, a port each.

    Args:
        ports: of `avc doctor --json`, with ``avc_device`` where it was queried.
        asked: whether each port was queried for its device.
    """
    rows = [
        Row(
            port["device"],
            ", ".join(filter(None, [*_described(port), _device(port["avc_device"]) if asked else ""])),
            Mark.PASS if port["accessible"] else Mark.CAUTION,
        )
        for port in ports
    ]
    return rows or [Row("Serial ports", "none")]


def _described(port: Mapping[str, Any]) -> list[str]:
    number_of = f"serial number {port['serial_number']}" if port["serial_number"] else ""
    return [port["description"], number_of, "may be opened" if port["accessible"] else _NO]


def _device(found: Mapping[str, Any] | None) -> str:
    """Describe the avc device behind a port."""
    if found is None:
        return "no avc device"
    own = found["unique_id"] or "without a number"
    return f"avc device {own}, coupling {found['coupling_id'] or 'none'}"
