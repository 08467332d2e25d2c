"""Summary of a certificate: deployable or not and the deciding claims, then the others; and all of it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number, rows_text
from avc_casadi._util.units import MASS
from avc_casadi.claims.certificate import levels_table
from avc_casadi.claims.stability.frozen_loop import RADIUS_TOLERANCE
from avc_casadi.present.pages.subject import headline, passive_limit, quantities
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# Name of each deployment claim, and the text of its failure.
_CLAIMS = {
    "hands": ("Every hand", "with hands"),
    "let-go": ("Released", "when released"),
    "dead-zone": ("Dead zone", "in the dead zone"),
    "detent": ("Detents", "on detents"),
}
_OUTCOMES = {"proved": Mark.PASS, "refuted": Mark.FAIL, "open": Mark.CAUTION}


def certificate_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `certify` document as a headline and rows.

    Args:
        document: of `avc certify --json`; ``gains`` is None where they stand in no file.
        problem: of the certificate.
        page: where it is printed.
        shown: the problem as the user names it.
    """
    file, levels, verdict = document["gains"], document["levels"], document["deployable"]
    rows = [
        _verdict(verdict),
        *_claims(verdict, levels["L5"], problem),
        *(_proof(name, level, page) for name, level in levels.items() if level["outcome"]),
        _per_frequency(levels),
        passive_limit(document["passive_limit_n_per_m"], problem.units),
        *(Row("Note", note, Mark.CAUTION) for note in document["notes"]),
    ]
    if document["proof_files"]:
        rows.append(Row("Written", ", ".join(document["proof_files"])))
    onwards = [] if verdict["pass"] else [f"avc recommend {quote(shown)} --out coupling.json"]
    if file is not None:
        onwards = [*(onwards or [f"avc export {quote(file)} --c DIR"]), f"avc certify {quote(file)} -v"]
    return page.rendered(headline(problem, file or shown), rows, onwards)


def _verdict(verdict: Mapping[str, Any]) -> Row:
    """State whether it may be deployed, and the failed claims."""
    if verdict["pass"]:
        thin = verdict.get("thin", "")
        said = f"yes: linearly stable with every hand and released{thin}"
        return Row("Deployable", said, Mark.CAUTION if thin else Mark.PASS)
    failed = dict.fromkeys(_named(one["name"])[1] for one in verdict.get("claims", ()) if not one["pass"])
    why = f"not linearly stable {' and '.join(failed)}" if failed else "no row has gains"
    return Row("Deployable", f"no: {why}", Mark.FAIL)


def _claims(verdict: Mapping[str, Any], hands: Mapping[str, Any], problem: Problem) -> list[Row]:
    """Describe each claim with its worst spectral radius; of those on detents the worst alone."""
    worst: dict[str, Mapping[str, Any]] = {}
    for claim in verdict.get("claims", ()):
        label, _ = _named(claim["name"])
        if label not in worst or _hardness(claim) > _hardness(worst[label]):
            worst[label] = claim
    return [_claim(label, claim, hands, problem) for label, claim in worst.items()]


def _named(claim: str) -> tuple[str, str]:
    return _CLAIMS["detent" if claim.startswith("detent") else claim]


def _hardness(claim: Mapping[str, Any]) -> tuple[bool, float]:
    return not claim["pass"], claim["spectral_radius"] or 0.0


def _claim(label: str, claim: Mapping[str, Any], hands: Mapping[str, Any], problem: Problem) -> Row:
    radius = claim["spectral_radius"]
    if not claim["pass"] or radius is None:
        return Row(label, claim["sentence"], Mark.PASS if claim["pass"] else Mark.FAIL)
    told = f"spectral radius {number(radius, 5)} at most"
    if claim["name"] == "hands" and hands["margin_ns_per_m"] is not None:
        margin = quantities(problem.units)(hands["margin_ns_per_m"], "N.s/m")
        told += f"; {margin} of the device's damping may be lost"
    return Row(label, told, Mark.PASS)


def _proof(name: str, level: Mapping[str, Any], page: Page) -> Row:
    """Describe the result of a proof, in one line."""
    told = f"{level['outcome']}: {level['title'] if level['outcome'] == 'proved' else level['claim']}"
    return Row(
        name,
        textwrap.shorten(told, page.width - 18, placeholder=" ..."),
        _OUTCOMES[level["outcome"]],
    )


def _per_frequency(levels: Mapping[str, Any]) -> Row:
    """Describe the claims that deployment does not need: those of the paper, each row at its frequencies."""
    others = {name: level for name, level in levels.items() if not level["outcome"] and name != "L5"}
    words = {
        "met": [name for name, level in others.items() if level["pass"]],
        "not met": [name for name, level in others.items() if not level["pass"] and not level["refused"]],
        "not judged": [name for name, level in others.items() if level["refused"]],
    }
    told = "; ".join(f"{', '.join(names)} {word}" for word, names in words.items() if names)
    return Row("Passivity", f"{told}; deployment does not need it (-v)")


def answered(level: Mapping[str, Any]) -> str:
    """Return whether a claim is met, as text of the table.

    Args:
        level: of a certificate.
    """
    if not level["pass"]:
        return "not judged" if level["refused"] else "not met"
    return "met"


def certificate_lines(document: dict[str, Any], problem: Problem) -> list[str]:
    """Return the full `certify` document: the table of levels, each claim, and related results.

    Args:
        document: of `avc certify --json`.
        problem: of the certificate.
    """
    table, hands, claimed = levels_table(document), document["levels"]["L5"], document["claimed"]
    scope = f"scope {problem.stability.scope}, model {problem.stability.model}"
    return [
        document["deployable"]["sentence"],
        f"asked for by the problem file ({scope}): {claimed}, {answered(document['levels'][claimed])}",
        f"{problem.name}: {rows_text(len(document['frequency_hz']))} of {document['gains']}, {document['judged']}",
        table.text(),
        *(f"  {note}" for note in table.notes),
        *beside_hands(hands),
    ]


def beside_hands(level: Mapping[str, Any]) -> list[str]:
    """Return the results related to L5: its margin in words, and the device released.

    Args:
        level: L5 of a certificate.
    """
    radius, lines = level.get("released_spectral_radius"), []
    if level["margin_ns_per_m"] is not None:
        word = "could lose before it becomes unstable" if level["margin_ns_per_m"] >= 0 else "lacks"
        lines.append(
            f"L5's margin is the device damping that it {word} with the worst hand; L0 to L3 give the lowest Re Z_h, "
            "L4 what (6) leaves"
        )
    if radius is not None:
        if radius < 1 - RADIUS_TOLERANCE:
            word = "settles"
        elif level["released_pass"] or radius <= 1 + RADIUS_TOLERANCE:
            word = f"keeps its speed or place where nothing acts on it, as any free {MASS}, and does not run away"
        else:
            word = "not stable"
        lines.append(f"device released: {word}; spectral radius {number(radius, 6)} at worst")
    return lines
