"""Summary of the coupling of a teleoperator: spring and dampers, rendering, claims, limits."""

from __future__ import annotations

from collections.abc import Callable
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import quantity
from avc_casadi._util.units import FORCE, METRE, NEWTON
from avc_casadi.present.pages.virtual_tool import gain_margin_text, inertia_text, not_used_rows, span
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.other_end_coupling import TeleoperatorCoupling

# A gain margin below which a row warns.
_SAFE = 1.5
# An impedance error in free motion above which both devices feel distinctly altered.
_DRAGS = 1.0


def bilateral_page(
    document: dict[str, Any],
    problem: Problem,
    page: Page,
    shown: str = "P",
    written: str | None = None,
    *,
    verbose: bool = False,
) -> str:
    """Return the `recommend` document of a problem with [follower] as a headline and some rows.

    Args:
        document: of `avc recommend --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        written: file of the coupling; None if none was written.
        verbose: with all details below.
    """
    following = f"avc recommend {quote(shown)} --out coupling.json"
    if not document["deployable"]:
        following = f"avc check {quote(shown)}"
    elif written is not None:
        following = f"avc export {quote(written)} --c DIR"
    text = page.rendered(bilateral_headline(problem, shown), bilateral_rows(document, problem), [following])
    if verbose:
        lines = [f"reason: {document['reason']}", *(f"assumed: {gap}" for gap in document["assumed"])]
        lines += [f"not used: {what}" for what in document["not_used"]]
        text = "\n".join([text, "", "\n".join(lines)])
    return text


def bilateral_headline(problem: Problem, shown: str) -> str:
    """Return a problem with [follower] in a line: follower, architecture, leader.

    Args:
        problem: the problem.
        shown: as the user names it.
    """
    follower, device, unit = problem.follower, problem.device, problem.units.unit
    assert follower is not None  # noqa: S101 - asked of problems with one
    there = quantity(follower.delays_s[-1][0], "s")
    return (
        f"{shown}   follower {quantity(follower.mass_kg, unit('kg'))}, {quantity(1 / follower.sample_time_s, 'Hz')}, "
        f"{there} away, {follower.architecture} · leader {quantity(device.mass_kg, unit('kg'))}, "
        f"{quantity(1 / device.sample_time_s, 'Hz')}"
    )


def follower_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `check` document of a problem with [follower]: follower, link, architecture, contact.

    Args:
        document: of `avc check --json`.
        problem: that was checked.
        page: where it is printed.
        shown: the problem as the user names it.
    """
    follower, unit = problem.follower, problem.units.unit
    assert follower is not None  # noqa: S101 - asked of problems with one
    there, back = (span(one, "s") for one in (follower.delay_s, follower.return_delay_s or follower.delay_s))
    sent = f", a {follower.force} {FORCE} is sent back" if follower.architecture == "position-force" else ""
    scaled = f"{follower.position_scale:g} {METRE} and {1 / follower.force_scale:g} {NEWTON} for one of the leader"
    rows = [
        Row("File", "valid", Mark.PASS),
        Row(
            "Follower",
            f"{quantity(follower.mass_kg, unit('kg'))}, {quantity(follower.damping_ns_per_m, unit('N.s/m'))}, "
            f"{quantity(1 / follower.sample_time_s, 'Hz')}, delay {follower.delay_samples:g}",
        ),
        Row(
            "Link",
            f"{there} there, {back} back; {100 * follower.jitter:g} % of jitter, {100 * follower.lost_share:g} % of "
            "the messages lost",
        ),
        Row("Architecture", f"{follower.architecture}{sent}"),
        Row("Touches", f"nothing, up to {_touched(problem)}"),
        *([Row("Scales", scaled)] if (follower.position_scale, follower.force_scale) != (1, 1) else []),
        *not_used_rows(document),
        *(Row("Warning", f"{one['key']} {one['message']}", Mark.CAUTION) for one in document["warnings"]),
    ]
    return page.rendered(bilateral_headline(problem, shown), rows, [f"avc recommend {quote(shown)} --out c.json"])


def _touched(problem: Problem) -> str:
    """Describe the stiffest object that the follower touches."""
    follower = problem.follower
    assert follower is not None  # noqa: S101 - asked of problems with one
    high = follower.contact_stiffness_n_per_m[1]
    return "a rigid object" if follower.rigid else f"a spring of {quantity(high, problem.units.unit('N/m'))}"


def bilateral_export_page(document: dict[str, Any], coupling: TeleoperatorCoupling, page: Page, shown: str) -> str:
    """Return the `export` document of a teleoperator as a headline and rows.

    Args:
        document: of `avc export --json`.
        coupling: that was exported.
        page: where it is printed.
        shown: the coupling as the user names it.
    """
    unit, rates = coupling.problem.units.unit, (document["sample_time_s"], document["follower_sample_time_s"])
    springs = [
        f"{who} K {quantity(gains.stiffness_n_per_m, unit('N/m'))}, B {quantity(gains.damping_ns_per_m, unit('N.s/m'))}"
        for who, gains in (("leader", coupling.gains), ("follower", coupling.at_follower))
    ]
    told = " and ".join(quantity(1 / one, "Hz") for one in dict.fromkeys(rates))
    rows = [
        *([Row("Unsafe", document["unsafe"], Mark.FAIL)] if document["unsafe"] else []),
        Row("Coupling", f"{coupling.id}: {'; '.join(springs)}"),
        Row("C", f"{document['precision']} precision, {told}; one source for both ends"),
        *(Row("File" if place == 0 else "", one) for place, one in enumerate(document["files"])),
    ]
    return page.rendered(f"{shown}   leader and follower, {coupling.follower.architecture}", rows)


def _set_by(found: dict[str, Any], unit: Callable[[str], str]) -> str:
    """Describe which loop first exceeds the limit."""
    case = found["limited_by"]
    hand, touched = case["hand"], case["environment_n_per_m"]
    who = "the leader released"
    if any(hand.values()):
        parts = zip(hand.values(), ("kg", "N.s/m", "N/m"), strict=True)
        who = f"a hand of {', '.join(quantity(value, unit(of)) for value, of in parts)}"
    stiff = f"on a spring of {quantity(touched, unit('N/m'))}" if touched else "free"
    there, back = (quantity(one, "s") for one in case["delays_s"])
    return f"{who}, the follower {'on a rigid object' if touched is None else stiff}, {there} there and {back} back"


def bilateral_rows(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Return the rows of the `recommend` document.

    Args:
        document: of `avc recommend --json`.
        problem: of the document.
    """
    found, unit = document["teleoperation"], problem.units.unit
    limit = Row("Linear limit", f"K {quantity(found['stiffest_n_per_m'], unit('N/m'))}, set by {_set_by(found, unit)}")
    if not document["deployable"]:
        return [
            Row("Coupling", f"none is deployable: {document['reason']}", Mark.FAIL),
            limit,
            *not_used_rows(document),
        ]
    told = f"spring K {quantity(found['stiffness_n_per_m'], unit('N/m'))}"
    told += f", damper B {quantity(found['damping_ns_per_m'], unit('N.s/m'))}"
    if found["local_damping_ns_per_m"] > 0:
        told += f", damper of each loop {quantity(found['local_damping_ns_per_m'], unit('N.s/m'))}"
    rows = [
        Row("Coupling", told, Mark.PASS),
        Row("Contact", f"{quantity(found['rendered_stiffness_n_per_m'], unit('N/m'))} pressed, on {_touched(problem)}"),
    ]
    if found["felt"]:
        slow = found["felt"][0]
        told = f"feels like {inertia_text(slow, problem)}"
        rows.append(Row("Free motion", told, Mark.CAUTION if slow["free_error"] > _DRAGS else Mark.NONE))
    mode, margin = found["least_damped"], found["gain_margin"]
    stable = f"all hands and released, free to {_touched(problem)}, {found['loops']} loops; {gain_margin_text(margin)}"
    if mode["damping_ratio"] < 1:
        stable += f"; least damped {mode['damping_ratio']:.2g} at {quantity(mode['frequency_hz'], 'Hz')}"
    rows.append(Row("Stability", stable, Mark.PASS if margin >= _SAFE else Mark.CAUTION))
    if found["passivity_margin_ns_per_m"] is not None:
        passive = found["passivity_margin_ns_per_m"] >= 0
        needed = quantity(found["passive_damping_ns_per_m"], unit("N.s/m"))
        told = (
            "for any operator and environment" if passive else f"not for any operator: that asks for {needed} a device"
        )
        rows.append(Row("Passivity", told, Mark.PASS if passive else Mark.CAUTION))
    trial = document["trial"]
    link = f"{100 * trial['jitter']:g} % of jitter, {100 * trial['lost_share']:g} % of the messages lost"
    rows.append(
        Row(
            "Simulated",
            f"{trial['settled']} of {trial['hands']} hands settle ({', '.join(trial['motions'])}); {link}",
            Mark.PASS if trial["settled"] == trial["hands"] else Mark.FAIL,
        )
    )
    return [*rows, limit, *not_used_rows(document)]
