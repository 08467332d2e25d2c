"""What the page lets an engineer change where an engine is at the other end: tool, engine, exchange, spring and damper.

Values that a problem file takes as a number or as [lowest, highest] are two fields, the second of them empty where it
is a number: what is typed in the first moves both then.
"""

from __future__ import annotations

from typing import Any, get_args

from avc_casadi.model.virtual_tool import RIGID_N_PER_M, Exchange, ToolIntegrator
from avc_casadi.present.explore.fields import FIELDS, Field

ENGINE, SCENE, SPANS, PAIR = (
    "Tool and engine",
    "Between device and scene",
    "Ranges of tool and engine",
    "Spring and damper",
)
STEP, CONTACT = "simulation.step_s", "simulation.contact_stiffness_n_per_m"
DAMPER = "simulation.contact_damping_ns_per_m"
_SAME = "the same"
_T = "device.sample_time_s"

TOOL_GAINS: tuple[Field, ...] = (
    Field("gains.stiffness_n_per_m", PAIR, "spring K", "N/m", 10, 1e5, "log"),
    Field("gains.damping_ns_per_m", PAIR, "damper B", "N·s/m", 0.01, 200, "log"),
    Field("gains.local_damping_ns_per_m", PAIR, "damper of the device's loop", "N·s/m", 0, 50, blank="none"),
)
"""K, B and the damper that the device's own loop adds."""
TOOL_FIELDS: tuple[Field, ...] = (
    Field("simulation.tool_mass_kg.0", ENGINE, "tool mass", "kg", 0.005, 5, "log", blank="no tool"),
    Field(f"{STEP}.0", ENGINE, "engine step", "ms", 0.2, 50, "log", factor=1e-3, whole_of=_T),
    Field("simulation.integrator", ENGINE, "integrator", scale="choice", choices=get_args(ToolIntegrator)),
    Field("simulation.exchange", ENGINE, "exchange", scale="choice", choices=get_args(Exchange)),
    Field("simulation.steps_late", ENGINE, "late besides", "steps", 0, 8, whole=True),
    Field(f"{CONTACT}.1", ENGINE, "contacts, stiffest", "N/m", 100, 1e6, "log", blank="rigid alone"),
    Field(f"{DAMPER}.0", ENGINE, "their damper", "N·s/m", 0, 100, blank="critical"),
    Field("simulation.tool_damping_ns_per_m.0", ENGINE, "tool damping", "N·s/m", 0, 10),
    Field("simulation.stiffness_n_per_m", ENGINE, "K that is wanted", "N/m", 10, 1e5, "log", blank="the stiffest"),
    *(field for field in FIELDS if field.key.startswith(("device.", "hands."))),
    Field("simulation.tool_mass_kg.1", SPANS, "tool mass, at most", "kg", 0.005, 5, "log", blank=_SAME, folded=True),
    Field(
        f"{STEP}.1", SPANS, "step, at most", "ms", 0.2, 50, "log", factor=1e-3, blank=_SAME, folded=True, whole_of=_T
    ),
    Field(
        "simulation.tool_damping_ns_per_m.1", SPANS, "tool damping, at most", "N·s/m", 0, 10, blank=_SAME, folded=True
    ),
    Field(f"{CONTACT}.0", SPANS, "contacts, softest", "N/m", 0, 1e5, blank="0", folded=True),
    Field(f"{DAMPER}.1", SPANS, "their damper, at most", "N·s/m", 0, 100, blank=_SAME, folded=True),
    Field("simulation.position_scale", SCENE, "position scale", "", 0.1, 10, "log", folded=True),
    Field("simulation.force_scale", SCENE, "force scale", "", 0.1, 10, "log", folded=True),
)


def put_of_tool(table: dict[str, Any], key: str, value: Any) -> None:
    """Set a value of [simulation] by its key there; None takes it away, or makes a range a number."""
    name, _, end = key.partition(".")
    if not end:
        if value is None:
            table.pop(name, None)
        else:
            table[name] = value
    elif name == "contact_stiffness_n_per_m":
        table[name][int(end)] = (0.0, RIGID_N_PER_M)[int(end)] if value is None else value
    elif end == "0" and value is None:
        table.pop(name, None)
    else:
        both = list(table.get(name) or [value, value])
        one_number = both[0] == both[1]
        both[int(end)] = both[0] if value is None else value
        table[name] = [both[0], both[0]] if end == "0" and one_number else both


def value_of_tool(table: dict[str, Any], key: str) -> Any:
    """Return a value of [simulation] by its key there, as its field shows it; None where that is empty."""
    name, _, end = key.partition(".")
    value = table.get(name)
    if not end or value is None:
        return value
    if name == "contact_stiffness_n_per_m":
        return None if value[int(end)] >= RIGID_N_PER_M else value[int(end)]
    return None if end == "1" and value[0] == value[1] else value[int(end)]
