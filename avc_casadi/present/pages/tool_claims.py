"""Summary of the claims of a coupling to a simulation, and of its stability region."""

from __future__ import annotations

import math
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import Table, quantity, sample_rows
from avc_casadi._util.units import FORCE, MASS, METRE, NEWTON, Wording
from avc_casadi.claims.stability.periodic import TOLERANCE
from avc_casadi.present.pages.virtual_tool import gain_margin_text, headline, not_used_rows, span
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.claims.stability.tool_loop import ToolLoops
    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.model.problem import Problem

# A gain margin below which a row warns.
_SAFE = 1.5
# Smaller travel is round-off.
_ROUND_OFF = 1e-12
# Dampers of a region that are printed.
_DAMPERS_SHOWN = 9
_EXCHANGES = {
    "on-time": "the device is given the state that the engine's step began with",
    "late": "the device is given the state of the step before",
    "ahead": "the device is given the state that the step has just made",
    "held-force": Wording.of(lambda: f"the engine makes the {FORCE}, and the device holds it for a step"),
}


def certificate_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `certify` document of a coupling to a simulation: stability, and passivity apart.

    Args:
        document: of `avc certify --json`.
        problem: of the certificate.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    rows = [Row("Coupling", coupling_text(document, problem)), *stability_rows(document, problem)]
    # Where the tool is fixed the engine is no port.
    if problem.simulation is not None and problem.simulation.tool_mass_kg is not None:
        rows += passivity_rows(document["passivity"], problem)
    return page.rendered(headline(problem, shown), [*rows, *not_used_rows(document)])


def coupling_text(gains: dict[str, Any], problem: Problem) -> str:
    """Return spring and dampers in words.

    Args:
        gains: by name.
        problem: for its units.
    """
    unit = problem.units.unit
    text = f"spring K {quantity(gains['stiffness_n_per_m'], unit('N/m'))}"
    text += f", damper B {quantity(gains['damping_ns_per_m'], unit('N.s/m'))}"
    if gains["local_damping_ns_per_m"] > 0:
        text += f", damper in the device's loop {quantity(gains['local_damping_ns_per_m'], unit('N.s/m'))}"
    return text


def stability_rows(found: dict[str, Any], problem: Problem) -> list[Row]:
    """Return whether all loops are stable, with their margins, and the worst of them.

    Args:
        found: certificate.
        problem: for its units.
    """
    loops, margin = found["loops"], found["gain_margin"]
    case = case_text(found["worst"], problem)
    worst = Row("Worst loop", f"{case}; spectral radius {found['spectral_radius']:.6g} a step")
    if not found["stable"]:
        return [Row("Stability", f"not all of {loops} loops are stable", Mark.FAIL), worst]
    mode, told = found["least_damped"], f"every hand and released, {loops} loops; {gain_margin_text(margin)}"
    if mode["damping_ratio"] < 1:
        told += f"; least damped {mode['damping_ratio']:.2g} at {quantity(mode['frequency_hz'], 'Hz')}"
    return [Row("Stability", told, Mark.PASS if margin >= _SAFE else Mark.CAUTION), worst]


def contact_rows(loops: ToolLoops, gains: ToolGains, problem: Problem) -> list[Row]:
    """Return with whom the coupling is stable where the tool is free, on a spring and held rigidly, a row for each.

    Args:
        loops: of the problem.
        gains: of the coupling.
        problem: for what its tool is.
    """
    radius = loops.radii(gains).max(axis=1)
    if problem.simulation is not None and problem.simulation.tool_mass_kg is None:
        names = {"Fixed place": [True]}
    else:
        stiff = [one.contact_stiffness_n_per_m for one in loops.tools]
        names = {
            "Tool free": [one == 0 for one in stiff],
            "Tool on a spring": [0 < one < math.inf for one in stiff],
            "Tool held": [math.isinf(one) for one in stiff],
        }
    rows = []
    for name, chosen in names.items():
        if any(chosen):
            hands, released = (radius[chosen, :-1] < 1 - TOLERANCE).all(), (radius[chosen, -1] < 1 - TOLERANCE).all()
            told = (
                "stable with every hand and released"
                if hands and released
                else f"{'stable' if hands else 'unstable'} with {'every' if hands else 'a'} hand, "
                f"{'stable' if released else 'unstable'} released"
            )
            rows.append(Row(name, told, Mark.PASS if hands and released else Mark.FAIL))
    return rows


def passivity_rows(found: dict[str, Any], problem: Problem) -> list[Row]:
    """Return whether the engine's port is passive, and the engines to which that applies.

    Args:
        found: of the certificate.
        problem: for its units.
    """
    if found["refused"]:
        return [Row("Engine's port", f"not judged: {found['refused']}", Mark.CAUTION)]
    unit = problem.units.unit
    margin = quantity(found["margin_ns_per_m"], unit("N.s/m"))
    if found["passive"]:
        told = f"passive, {margin} to spare: stable with any passive engine, whatever its tool weighs or touches"
    elif found["margin_ns_per_m"] is None:
        told = "not passive: with the tool held in place the device is unstable"
    else:
        who = hand_text(found["hand"], problem)
        told = f"not passive: lacks {margin.lstrip('-')} at {quantity(found['frequency_hz'], 'Hz')}, {who}"
    if found["any_hand"] is not None:
        told += "; with any passive hand too (Llewellyn)" if found["any_hand"] else "; not with any hand (Llewellyn)"
    rows = [Row("Engine's port", told, Mark.PASS if found["passive"] else Mark.NONE)]
    if not found["engine_is_implicit"]:
        integrator = "this one" if problem.simulation is None else f"{problem.simulation.integrator}"
        rows.append(
            Row(
                "Passive engine?",
                f"{integrator} is none: its {MASS} is explicit; what holds for it is Stability, for the declared tools",
                Mark.CAUTION if found["passive"] else Mark.NONE,
            )
        )
    return rows


def case_text(case: dict[str, Any], problem: Problem) -> str:
    """Return a loop in words: the hand, the tool and its contact, the integrator of the engine.

    Args:
        case: of a certificate.
        problem: for its units.
    """
    tool, unit = case["tool"], problem.units.unit
    contact = tool["contact_stiffness_n_per_m"]
    touches = "free"
    if contact is None or tool["mass_kg"] is None:
        touches = "held rigidly"
    elif contact > 0:
        touches = f"on {quantity(contact, unit('N/m'))}"
    what = (
        "a fixed place" if tool["mass_kg"] is None else f"a tool of {quantity(tool['mass_kg'], unit('kg'))}, {touches}"
    )
    return f"{hand_text(case['hand'], problem)}; {what}; step {quantity(case['step_s'], 's')}"


def hand_text(hand: dict[str, float], problem: Problem) -> str:
    """Return a hand in words.

    Args:
        hand: its parameters; all 0 for the device released.
        problem: for its units.
    """
    if not any(hand.values()):
        return "the device released"
    unit = problem.units.unit
    keys = (("mass_kg", "kg"), ("damping_ns_per_m", "N.s/m"), ("stiffness_n_per_m", "N/m"))
    return "a hand of " + ", ".join(quantity(hand[key], unit(of)) for key, of in keys)


def region_page(document: dict[str, Any], problem: Problem, page: Page, shown: str, drawn: str | None) -> str:
    """Return the `zwidth` document of a problem with [simulation]: a row for each engine rate.

    Args:
        document: of `avc zwidth --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        drawn: file of the picture, if one was drawn.
    """
    unit, curves, rows = problem.units.unit, document["curves"], []
    for one in curves:
        told = "no coupling is stable"
        if one["stiffest_n_per_m"] is not None:
            k, b = (
                quantity(one["stiffest_n_per_m"], unit("N/m")),
                quantity(one["stiffest_with_ns_per_m"], unit("N.s/m")),
            )
            told = f"stiffest K {k} with B {b}"
            if one["stiffest_with_local_ns_per_m"] > 0:
                local = quantity(one["stiffest_with_local_ns_per_m"], unit("N.s/m"))
                told += f" and a damper of {local} in the device's loop"
        told += ", as declared" if one["declared"] else ""
        mark = Mark.NONE if one["stiffest_n_per_m"] is not None else Mark.FAIL
        rows.append(Row(quantity(one["rate_hz"], "Hz"), told, mark))
    if drawn is not None:
        rows.append(Row("Drawn", drawn))
    return page.rendered(headline(problem, shown), rows, [f"avc recommend {quote(shown)} --out coupling.json"])


def region_lines(document: dict[str, Any], problem: Problem) -> list[str]:
    """Return the largest stable stiffness by damper, a column for each engine rate.

    Args:
        document: of `avc zwidth --json`.
        problem: of the document.
    """
    unit, curves, damping = problem.units.unit, document["curves"], document["damping_ns_per_m"]
    table = Table(
        ("B", *(quantity(one["rate_hz"], "Hz") for one in curves)),
        tuple(
            (
                quantity(damping[row], unit("N.s/m")),
                *(
                    quantity(one["stiffness_n_per_m"][row], unit("N/m")) if one["stiffness_n_per_m"][row] else "none"
                    for one in curves
                ),
            )
            for row in sample_rows(len(damping), _DAMPERS_SHOWN)
        ),
        title="largest stable K, by damper and engine rate",
    )
    beside = "; a critical damper in the device's loop" if document["local_damping_ratio"] else ""
    claim = f"Stable with every hand of [hands] and released, every tool and contact, below each K{beside}."
    return [table.title, table.text(), claim]


def simulated_page(document: dict[str, Any], problem: Problem, page: Page, shown: str, plot: str | None = None) -> str:
    """Return the `simulate` document of a problem with [simulation]: the outcome of one hand on the stiffest contact.

    Args:
        document: of `avc simulate --json`.
        problem: that was simulated.
        page: where it is printed.
        shown: the problem or coupling as the user names it.
        plot: file of the figure; None for none.
    """
    unit, metre, travel = problem.units.unit, problem.units.unit("m"), document["position_peak_to_peak_m"]
    outcomes = {
        "asymptotic": "settles, and does not need dry friction for it",
        "held-by-friction": "is held by dry friction only",
        "unstable": "does not settle",
    }
    rest = {"asymptotic": Mark.PASS, "held-by-friction": Mark.CAUTION, "unstable": Mark.FAIL}[document["outcome"]]
    buzz = "; it buzzes" if document["buzzing"] else ""
    rows = [
        Row("Coupling", f"{coupling_text(document, problem)}, {document['coupling']}"),
        Row("Simulated", f"with this hand the device {outcomes[document['outcome']]}{buzz}", rest),
        Row(
            "At the end",
            f"{quantity(travel if travel > _ROUND_OFF else 0.0, metre)} peak to peak, "
            f"{quantity(document['mean_force_n'], unit('N'))}",
        ),
        Row("Stiffness", f"{quantity(document['apparent_stiffness_n_per_m'], unit('N/m'))} at the handle"),
        Row("Effects", ", ".join(document["effects"])),
    ]
    lines = [page.rendered(headline(problem, shown), rows)]
    if document["trace"] is not None:
        lines.append(f"written: {document['trace']}, its manifest beside it (.json)")
    return "\n".join(lines if plot is None else [*lines, f"drawn: {plot}"])


def check_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `check` document of a problem with [simulation]: tool, engine, exchange.

    Args:
        document: of `avc check --json`.
        problem: that was checked.
        page: where it is printed.
        shown: the problem as the user names it.
    """
    unit, tool = problem.units.unit, problem.simulation
    assert tool is not None  # noqa: S101 - asked of problems with one
    t = problem.device.sample_time_s
    what = "none: the spring leads to a place that the engine sets"
    if tool.tool_mass_kg is not None:
        low, high = tool.contact_stiffness_n_per_m
        end = "rigid" if tool.rigid else quantity(high, unit("N/m"))
        what = f"{span(tool.tool_mass_kg, unit('kg'))}, damping {span(tool.tool_damping_ns_per_m, unit('N.s/m'))}; "
        what += "touches nothing, rigid things" + ("" if tool.rigid else f", springs up to {end}")
        what += f", springs from {quantity(low, unit('N/m'))}" if tool.rigid and low > 0 else ""
    late = f", {tool.steps_late} steps late" if tool.steps_late > 1 else ", a step late" if tool.steps_late else ""
    steps = span(tool.step_s, "s")
    engine = f"a step every {steps}, {max(tool.step_s) / t:.4g} samples of the device; {tool.integrator}"
    rows = [
        Row("File", "valid", Mark.PASS),
        Row("Tool", what),
        Row("Engine", engine),
        Row("Exchange", f"{tool.exchange}{late}: {_EXCHANGES[tool.exchange]}"),
        *(
            [Row("Scene", f"{tool.position_scale:g} {METRE} a metre, {tool.force_scale:g} {NEWTON} a newton")]
            if tool.scale != 1
            else []
        ),
        *not_used_rows(document),
        *(Row("Unusual", f"{one['key']} {one['message']}", Mark.CAUTION) for one in document["warnings"]),
    ]
    next_ = [f"avc recommend {quote(shown)} --out c.json", f"avc zwidth {quote(shown)}"]
    return page.rendered(headline(problem, shown), rows, next_)
