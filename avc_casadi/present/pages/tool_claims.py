"""What is claimed of a coupling to a simulation, and which couplings are stable, at a glance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import Table, sample_rows
from avc_casadi.present.pages.virtual_tool import headline
from avc_casadi.present.terminal import Mark, Page, Row, quantity

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# A gain margin below which a row warns.
_SAFE = 1.5
# Dampers of a region that are printed.
_DAMPERS_SHOWN = 9


def certificate_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `certify` document of a coupling to a simulation: stability, and passivity apart.

    Args:
        document: of `avc certify --json`.
        problem: what is judged against.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    rows = [Row("Coupling", coupling_text(document, problem)), *stability_rows(document, problem)]
    # Where the engine moves nothing it is no port.
    if problem.simulation is not None and problem.simulation.tool_mass_kg is not None:
        rows += passivity_rows(document["passivity"], problem)
    return page.rendered(headline(problem, shown), rows)


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
    """Return whether all loops are stable, with which margin, and the worst of them.

    Args:
        found: certificate.
        problem: for its units.
    """
    loops, margin = found["loops"], found["gain_margin"]
    case = case_text(found["worst"], problem)
    worst = Row("Worst loop", f"{case}; spectral radius {found['spectral_radius']:.6g} a step")
    if not found["stable"]:
        return [Row("Stability", f"not all of {loops} loops are stable", Mark.FAIL), worst]
    mode, told = found["least_damped"], f"every hand and released, {loops} loops; gain margin {margin:.2g}"
    if mode["damping_ratio"] < 1:
        told += f"; least damped {mode['damping_ratio']:.2g} at {quantity(mode['frequency_hz'], 'Hz')}"
    return [Row("Stability", told, Mark.PASS if margin >= _SAFE else Mark.CAUTION), worst]


def passivity_rows(found: dict[str, Any], problem: Problem) -> list[Row]:
    """Return whether the engine's port is passive, and for which engines that says something.

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
                f"{integrator} is none: its mass is explicit; what holds for it is Stability, for the declared tools",
                Mark.CAUTION if found["passive"] else Mark.NONE,
            )
        )
    return rows


def case_text(case: dict[str, Any], problem: Problem) -> str:
    """Return a loop in words: who holds the device, what the tool is and touches, how the engine steps.

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
        hand: its numbers; all 0 for the device released.
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
        problem: what it was asked for.
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
        told += ", as declared" if one["declared"] else ""
        mark = Mark.NONE if one["stiffest_n_per_m"] is not None else Mark.FAIL
        rows.append(Row(quantity(one["rate_hz"], "Hz"), told, mark))
    if drawn is not None:
        rows.append(Row("Drawn", drawn))
    return page.rendered(headline(problem, shown), rows, [f"avc zwidth {shown} -v"])


def region_lines(document: dict[str, Any], problem: Problem) -> list[str]:
    """Return the largest stable stiffness by damper, a column for each engine rate.

    Args:
        document: of `avc zwidth --json`.
        problem: what it was asked for.
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
