"""A coupling to a simulation in the parameters and units of one engine: settings, and pitfalls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import InputError
from avc_casadi._util.quantity import quantity
from avc_casadi._util.units import FORCE, FORCES, NS_PER_M, Wording
from avc_casadi.present.pages.engines import ENGINES, Engine, Parameter, Said, number_text
from avc_casadi.present.pages.tool_claims import coupling_text
from avc_casadi.present.pages.virtual_tool import headline as tool_headline
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.other_end_coupling import ToolCoupling

_KEY = "--parameters"
_AHEAD = Wording.of(
    lambda: (
        f"its position and velocity lie in the future of the {FORCE} that made them: that costs a factor of 10 to 60 "
        "of K"
    )
)


def tool_parameters(coupling: ToolCoupling, engine: str) -> Said:
    """Return a coupling to a simulation in the parameters and units of an engine, scales and exchange included.

    Args:
        coupling: of a problem with [simulation].
        engine: one of `ENGINES`.

    Raises:
        InputError: another engine, or one that supports no rotary device, or not the integrator.
    """
    if engine not in ENGINES:
        raise InputError.of(f"is {engine!r}; allowed: {', '.join(ENGINES)}", key=_KEY)
    known = ENGINES[engine]
    if not known.turns and not coupling.problem.units.linear:
        others = ", ".join(name for name, one in ENGINES.items() if one.turns)
        raise InputError.of(f"is {engine!r}, which has no words for a device that turns; allowed: {others}", key=_KEY)
    solved = coupling.tool.solved
    if solved != "nothing" and coupling.tool.integrator not in known.integrators:
        message = f"is {engine!r}, which solves no {solved} of this coupling, as {coupling.tool.integrator} does"
        wanted = " or ".join(known.integrators) or "semi-implicit"
        raise InputError.of(f'{message}; say integrator = "{wanted}" in [simulation] and make it again', key=_KEY)
    said = known.say(coupling)
    return replace(
        said,
        parameters=(*said.parameters, *_scales(coupling)),
        instead=(*said.instead, *_local(coupling)),
        traps=(*_integrator(coupling, known), _exchange(coupling, known), *said.traps),
    )


def parameters_document(said: Said, coupling: ToolCoupling, engine: str) -> dict[str, Any]:
    """Return the parameters as JSON values.

    Args:
        said: the coupling in the engine.
        coupling: with these parameters.
        engine: one of `ENGINES`.
    """
    return {
        "schema": "avc-tool-parameters/1",
        "engine": engine,
        "title": ENGINES[engine].title,
        "coupling": coupling.id,
        "exchange": coupling.tool.exchange,
        "parameters": [vars(one) | {"unit": coupling.units.unit(one.unit)} for one in said.parameters],
        "lines": list(said.lines),
        "instead": list(said.instead),
        "traps": list(said.traps),
    }


def parameters_page(said: Said, coupling: ToolCoupling, engine: str, page: Page, shown: str) -> str:
    """Return the parameters as a headline and rows.

    Args:
        said: the coupling in the engine.
        coupling: with these parameters.
        engine: one of `ENGINES`.
        page: where it is printed.
        shown: the file as the user names it.
    """
    gains, units = coupling.gains, coupling.problem.units
    unit = units.unit
    headline = (
        f"{shown}   in the words of {ENGINES[engine].title} · K {quantity(gains.stiffness_n_per_m, unit('N/m'))}, "
        f"B {quantity(gains.damping_ns_per_m, unit('N.s/m'))} at the device · exchange {coupling.tool.exchange}"
    )
    rows = [
        Row(one.name, f"{number_text(one.value)}{' ' * bool(one.unit)}{unit(one.unit)} · {one.where}")
        for one in said.parameters
    ]
    rows += [Row("" if number else "Each step", line) for number, line in enumerate(said.lines)]
    rows += [Row("Instead", one) for one in said.instead]
    rows += [Row("Trap", one, Mark.CAUTION) for one in said.traps]
    return page.rendered(headline, rows, [f"avc export {quote(shown)} --c DIR"])


def tool_export_page(document: Mapping[str, Any], coupling: ToolCoupling, page: Page, shown: str) -> str:
    """Return the `export` document of a coupling to a simulation as a headline and rows.

    Args:
        document: of `avc export --json`.
        coupling: that was exported.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    rate = quantity(1 / document["sample_time_s"], "Hz")
    rows = [
        *([Row("Unsafe", document["unsafe"], Mark.FAIL)] if document["unsafe"] else []),
        Row("Coupling", f"{coupling.id}: {coupling_text(vars(coupling.gains), coupling.problem)}"),
        Row("C", f"{document['precision']} precision, {rate}, exchange {document['exchange']}, both ends"),
        Row("Written", ", ".join(document["files"])),
    ]
    commands = [f"avc export {quote(shown)} --parameters ENGINE"]
    return page.rendered(tool_headline(coupling.problem, shown), rows, commands)


def _scales(coupling: ToolCoupling) -> list[Parameter]:
    tool, found = coupling.tool, []
    if tool.position_scale != 1:
        found.append(Parameter("position scale", tool.position_scale, "", "the scene's lengths for one of the device"))
    if tool.force_scale != 1:
        found.append(Parameter(f"{FORCE} scale", tool.force_scale, "", f"the device's {FORCES} for one of the scene"))
    return found


def _integrator(coupling: ToolCoupling, engine: Engine) -> list[str]:
    used, has = coupling.tool.integrator, engine.integrators
    if coupling.tool.tool_mass_kg is None or not has or used in has:
        return []
    told = f"the coupling is certified with integrator {used}, and {engine.title} has {', '.join(has)}"
    return [f"{told}: say so in [simulation] and make it again"]


def _exchange(coupling: ToolCoupling, engine: Engine) -> str:
    """Describe what to exchange and when."""
    step, late = engine.step, coupling.tool.steps_late
    later = f", {late} steps later" if late > 1 else ", one step later" if late else ""
    said = {
        "on-time": f"hand out position and velocity that {step} begins with{later}; read after it, {_AHEAD}",
        "late": f"hand out position and velocity that the {step} before began with{later}; read after {step}, {_AHEAD}",
        "ahead": f"certified with position and velocity read after {step}{later}: {_AHEAD}; on-time allows more",
        "held-force": f"hand out the {FORCE} that you apply in {step}{later}; the device holds it until the next one",
    }
    return said[coupling.tool.exchange]


def _local(coupling: ToolCoupling) -> list[str]:
    damping = coupling.gains.local_damping_ns_per_m
    what = f"the damper of {number_text(damping)} {NS_PER_M} acts in the device's own loop, and no engine has it"
    return [f"{what}: avc_coupling_step does"] if damping else []
