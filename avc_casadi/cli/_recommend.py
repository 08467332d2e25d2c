"""Recommend the coupling to deploy: its gains, how stiff it feels, what holds it back and what would help."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text
from avc_casadi.cli._text import number, table
from avc_casadi.cli._versions import package_versions

if TYPE_CHECKING:
    import argparse

    from avc_casadi.recommendation import Recommendation

_PHYSICAL_WALL = (
    "the physical wall, which does not know of samples: Z = m s + b_d + b_e + k_e/s at s = j omega, relative to |Z|"
)


# Shares of the force limit and of the stiffness felt from which it is worth a line.
_AT_LIMIT, _STIFFER = 0.97, 1.1
_HANDS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        f"{__doc__}\nExit code 1 if no coupling is deployable: linearly stable with every hand of [hands] and let go."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--out", metavar="FILE", help="write the coupling, .json: for push, stream, export, simulate")
    parser.add_argument(
        "--stiffest", action="store_true", help="search only the stiffest wall that the device can give to every hand"
    )
    parser.add_argument(
        "--lean-on-friction",
        action="store_true",
        help="take the stiffest coupling whose hands rest with the declared dry friction, if not without it",
    )
    parser.add_argument(
        "--prove",
        action="store_true",
        help="prove what is chosen, as avc certify --prove does: minutes where it is robust",
    )
    parser.add_argument("--hands", type=positive_int, metavar="N", help=f"simulated hands (default {_HANDS})")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Recommend, write and show; 1 if nothing can be deployed."""
    from avc_casadi.coupling import coupling_document
    from avc_casadi.recommendation import recommend, stiffest
    from avc_casadi.support import json_text

    if args.stiffest and args.out is not None:
        raise avc.InputError.of("goes with a recommendation, not with --stiffest; leave one of them out", key="--out")
    if args.stiffest and args.hands is not None:
        raise avc.InputError.of(
            "goes with a recommendation: --stiffest simulates nobody, it computes with every corner of [hands] and let "
            "go; leave one of them out",
            key="--hands",
        )
    if args.stiffest and args.prove:
        raise avc.InputError.of("goes with a recommendation, not with --stiffest; leave one of them out", key="--prove")
    hands = _HANDS if args.hands is None else args.hands
    out = None if args.out is None else output_file(args.out, "--out", (".json",))
    problem = avc.load_problem(args.problem)
    if args.stiffest:
        with console.step("stiffest wall"):
            document = stiffest(problem, min(2, os.cpu_count() or 1), console)
        return Answer(document, stiffest_text(document))
    with console.step(f"candidates with {hands} hands"):
        found = recommend(
            problem,
            hands,
            lean_on_friction=args.lean_on_friction,
            prove=args.prove,
            versions=package_versions(),
            progress=console,
        )
    if out is not None and found.coupling is not None:
        write_text(out, json_text(coupling_document(found.coupling)), "--out")
    document = recommend_document(found)
    complaint = "" if found.deployable else f"avc: {problem.name}: no coupling is deployable"
    text = "\n".join(recommendation_lines(document))
    if out is not None and found.coupling is not None:
        text += f"\nwritten: {out}"
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint)


def recommend_document(found: Recommendation) -> dict[str, Any]:
    """Return the `recommend` document, which says what its complex error is taken from."""
    document = found.document()
    if "complex_error" in document["felt"]:
        document["felt"]["complex_error_from"] = _PHYSICAL_WALL
    return document


def recommendation_lines(document: dict[str, Any]) -> list[str]:
    """Return the recommendation for people, the conclusion first."""
    lines = [*conclusion_lines(document), ""]
    if document["what_would_help"]:
        rows = [[one["change"], number(one["stiffest_wall_n_per_m"])] for one in document["what_would_help"]]
        lines += [
            (
                f"a plain spring and damper: {number(document['plain_wall_n_per_m'])} N/m for every hand "
                "(--stiffest: what a robust design gives, and what would help it)"
            ),
            table(["what would help", "plain wall\nN/m"], rows, left=(0,)),
        ]
    if document["certificate"]:
        lines += [f"claim: {claim['sentence']}" for claim in document["certificate"]["deployable"]["claims"]]
    if document["trial"] is not None:
        lines.append(
            f"simulated only: {', '.join(document['trial']['effects'])}; {', '.join(document['trial']['motions'])}"
        )
    if "complex_error_from" in document["felt"]:
        lines.append(f"complex error: distance from {document['felt']['complex_error_from']}")
    lines += [f"assumed: {gap}" for gap in document["assumed"]]
    lines += [f"not used: {what}" for what in document["not_used"]]
    return lines


def conclusion_lines(document: dict[str, Any]) -> list[str]:
    """Return what to deploy and what it feels like, or that nothing can be deployed."""
    coupling, felt, trial = document["coupling"], document["felt"], document["trial"]
    if coupling is None:
        return [f"deploy nothing on {document['problem']}: {document['reason']}"]
    errors = ", ".join(f"{100 * error:.3g} % at {hz} Hz" for hz, error in felt["complex_error"].items())
    first = "deploy on" if document["deployable"] else "DO NOT deploy on"
    asked = [trial, *([document["confirmed"]] if document["confirmed"] else [])]
    hands, at_rest = (sum(one[key] for one in asked) for key in ("hands", "at_rest"))
    if document["deployable"] and at_rest < hands:
        first = f"the least bad, which {hands - at_rest} of {hands} hands do not rest at, on"
    return [
        f"{first} {document['problem']}: {gains_line(coupling)}",
        f"felt: {_felt(felt, limited=trial['at_force_limit'] > 0)}; complex error against the physical wall {errors}",
        (
            f"trial: {trial['at_rest']} of {trial['hands']} hands at rest, {trial['at_rest_without_friction']} without "
            f"friction, {trial['quiet']} without a vibration that is felt; a tap reaches "
            f"{number(trial['tap_force_n'], 3)} N and {number(1e3 * trial['tap_depth_m'], 3)} mm"
        ),
        rest_line(document["rest"]),
        *_limits(document),
        f"other hands, to whom nothing is promised: {_other_hands(document['other_hands'])}",
        f"why: {document['reason']}",
    ]


def rest_line(rest: dict[str, Any]) -> str:
    """Return what is known of rest with every hand: proved, refuted, open or simulated."""
    wall = rest["proved_wall_n_per_m"]
    ends = ""
    if rest["word"] == "open" and wall is not None:
        ends = f"; proof ends at {number(wall)} N/m felt" if wall else "; no softer wall of this kind is proved"
    return f"rest with every hand: {rest['word']}: {rest['sentence']}{ends}"


def _felt(felt: dict[str, Any], *, limited: bool) -> str:
    if felt["stiffness_n_per_m"] is None:
        return "nothing but the force limit" if limited else "nothing: no press ends in contact"
    sensed, handle = felt["stiffness_n_per_m"], felt["stiffness_at_handle_n_per_m"]
    behind = "" if handle == sensed else f" at the sensor, {number(handle)} N/m at the handle"
    return f"{number(sensed)} N/m{behind}, {100 * (felt['share_of_wall'] or 0):.3g} % of the wall"


def _other_hands(tried: dict[str, Any]) -> str:
    return "; ".join(
        f"{holding} {of['at_rest']} of {of['hands']} at rest, {of['at_rest_without_friction']} without friction"
        for holding, of in tried.items()
    )


def _limits(document: dict[str, Any]) -> list[str]:
    """Say what the force limit does, and what leaning on dry friction would give."""
    trial, lines = document["trial"], []
    limit = document["coupling"]["max_force_n"]
    if limit is not None and trial["tap_force_n"] >= _AT_LIMIT * limit:
        presses = f"; so do the presses of {trial['at_force_limit']} hands" if trial["at_force_limit"] else ""
        lines.append(
            f"force: a tap reaches the limit of {number(limit)} N, beyond which no coupling is stiffer{presses}"
        )
    leaning, felt = document["with_friction_n_per_m"], document["felt"]["stiffness_n_per_m"]
    if leaning is not None and felt is not None and leaning > _STIFFER * felt:
        lines.append(
            f"friction: if rest by the declared {number(document['felt']['friction_n'])} N of dry friction is enough, "
            f"{number(leaning)} N/m at least: --lean-on-friction searches for it"
        )
    return lines


def gains_line(coupling: dict[str, Any]) -> str:
    """Return the gains and what runs beside them, as numbers to type into any firmware."""
    rows = coupling["table"]
    named = (
        ("b", "damping_ns_per_m", "N.s/m"),
        ("k", "stiffness_n_per_m", "N/m"),
        ("b_p", "contact_damping_ns_per_m", "N.s/m"),
    )
    gains = ", ".join(f"{symbol} = {_span(rows[key])} {unit}" for symbol, key, unit in named)
    runtime = coupling["runtime"]
    beside = []
    if runtime["observer_mass_kg"] is not None:
        beside.append(
            f"observer of {number(runtime['observer_mass_kg'])} kg (in exported C, not in the packaged firmware)"
        )
    if runtime["state_feedback"] is not None:
        law = runtime["state_feedback"]
        beside.append(
            f"observer of {len(law['innovation'])} states with a dead zone of +-{number(1e6 * law['dead_zone_m'])} um, "
            "and state feedback (numbers in --out and --json, C by avc export)"
        )
    if not coupling["constant"]:
        beside.append(f"estimator {runtime['estimator']} and adaptation over {len(rows['frequency_hz'])} rows")
    if runtime["guard"] is not None:
        beside.append(f"guard {runtime['guard']}")
    wall = coupling["wall"]
    return (
        f"{coupling['method']}: {gains}; beside them: {', '.join(beside) or 'nothing'}; wall "
        f"{number(wall['stiffness_n_per_m'])} N/m, {number(wall['damping_ns_per_m'])} N.s/m; "
        f"T {number(1e3 * coupling['sample_time_s'])} ms (coupling {coupling['id']})"
    )


def _span(values: list[float]) -> str:
    low, high = min(values), max(values)
    return number(low) if low == high else f"{number(low)} to {number(high)}"


def stiffest_text(document: dict[str, Any]) -> str:
    """Return the stiffest wall for people."""
    low, high = document["damping_ns_per_m"]
    rows = [[one["change"], number(one["stiffest_wall_n_per_m"])] for one in document["what_would_help"]]
    return "\n".join(
        [
            (
                f"{document['problem']}: stiffest wall that was found ({document['by']}), linearly stable with every "
                f"corner of [hands] and let go: {number(document['stiffest_wall_n_per_m'])} N/m"
            ),
            (
                f"a plain spring and damper: {number(document['plain_wall_n_per_m'])} N/m, with {number(low)} to "
                f"{number(high)} N.s/m of wall and contact damping together"
            ),
            table(["what would help", "stiffest wall\nN/m"], rows, left=(0,)),
            *(f"assumed: {gap}" for gap in document["assumed"]),
            *(f"not used: {what}" for what in document["not_used"]),
        ]
    )
