"""The report of a run: what to deploy first, then the paper's question and the details."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.text import counts_text, number, with_problem
from avc_casadi._util.units import KG, N_PER_M, NS_PER_M, spoken
from avc_casadi.claims.certificate import levels_table
from avc_casadi.design.comparison.document import comparison_document, comparison_tables
from avc_casadi.files.catalogue import catalogue_names
from avc_casadi.paper.errata import ASSUMPTIONS, PAPER_ERRORS
from avc_casadi.present.pages.recommendation import recommendation_rows
from avc_casadi.present.report.frame import (
    Picture,
    columns_html,
    filled,
    items_html,
    page_html,
    rows_html,
    settings,
    table_html,
    value_text,
)
from avc_casadi.present.report.summary import device_line, injection_line, scope_line, summary_lines
from avc_casadi.recommendation.preconditions import not_judged
from avc_casadi.recommendation.told import hardly_rendered, pushed_through

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.deployed import Deployed


def picture_words(comparison: Comparison) -> Mapping[str, str]:
    """Return a sentence for each of the figures boundaries, perceived and comparison.

    Args:
        comparison: behind the figures.
    """
    band = f"from {_span(comparison.frequency_hz)} Hz"
    desired = np.abs(comparison.target)
    gains, closed = comparison.methods[comparison.delivered], comparison.methods["closed-form"]
    with np.errstate(divide="ignore", invalid="ignore"):
        upper, lower, bare = (
            100 * np.abs(curve) / desired for curve in (comparison.upper, comparison.lower, comparison.without_coupling)
        )
        error, closed_error = (100 * one.magnitude_error / desired for one in (gains, closed))
    return {
        "boundaries": (
            f"Two charts {band}. The desired |Z_h| runs from {_span(desired)} {NS_PER_M}. Relative to it the upper "
            f"bound lies at {_span(upper)} %, the lower at {_span(lower)} %, the wall without coupling at "
            f"{_span(bare)} %."
        ),
        "perceived": (
            f"Charts {band} of {comparison.delivered} beside the closed form. |Z_h| of {comparison.delivered} errs by "
            f"{_most(error)} % of the desired at most; b lies within {_span(gains.damping_ns_per_m)} {NS_PER_M}, k "
            f"within {_span(gains.stiffness_n_per_m)} {N_PER_M}. Re Z_h is {_least(gains.real_part)} {NS_PER_M} at "
            f"least; without coupling {_least(np.real(comparison.without_coupling))}."
        ),
        "comparison": (
            f"Errors {band}: {comparison.delivered} misses |Z_h| by at most {_most(error)} % and the complex impedance "
            f"by {_most(100 * gains.complex_error)} %; the closed form, of which {int(closed.usable.sum())} of "
            f"{closed.rows} rows can be built, by {_most(closed_error)} %. Verdicts: "
            f"{counts_text(comparison.counts())}."
        ),
    }


def _known(values: ArrayLike) -> list[float]:
    array = np.asarray(values, dtype=float)
    return [float(value) for value in array[np.isfinite(array)]]


def _span(values: ArrayLike) -> str:
    known = _known(values)
    return f"{number(min(known), 3)} to {number(max(known), 3)}" if known else "nothing known"


def _most(values: ArrayLike) -> str:
    return number(max(_known(values), default=float("nan")), 3)


def _least(values: ArrayLike) -> str:
    return number(min(_known(values), default=float("nan")), 3)


# Share of the wanted stiffness from which a wall counts as the wanted one.
_THE_WALL = 0.9


@dataclass(frozen=True)
class ReportContents:
    """Contents of the report.

    Attributes:
        problem: the problem.
        comparison: its comparison.
        summary: what `summarise` found.
        certificate: the `certify` document.
        figures: the figures of the paper's question.
        versions: versions by package.
        conclusion: what to deploy and why, or that nothing is deployable; one sentence a line.
        deployment: the `recommend` document behind it.
        deployed: the figures of the coupling, its rendering and its loop; none where nothing is deployable.
    """

    problem: Problem
    comparison: Comparison
    summary: Mapping[str, Any]
    certificate: Mapping[str, Any]
    figures: Sequence[Picture]
    versions: Mapping[str, str]
    conclusion: Sequence[str]
    deployment: Mapping[str, Any]
    deployed: Sequence[Picture] = ()


def report_html(contents: ReportContents) -> str:
    """Return the page."""
    comparison = comparison_document(contents.comparison)
    best = comparison["methods"][comparison["delivered"]]
    push = contents.summary["push"]
    tables = comparison_tables(comparison)
    body = filled(
        "page",
        verdict=_verdict(contents.deployment),
        rendered="\n".join(figure.html() for figure in contents.deployed[:1]),
        rows=rows_html(recommendation_rows(dict(contents.deployment), contents.problem)),
        loop="\n".join(figure.html() for figure in contents.deployed[1:]),
        conclusion=_conclusion([*contents.conclusion, *_undelivered(contents.deployment, push)]),
        deployment=_deployment(contents.deployment),
        summary=items_html(summary_lines(contents.summary)),
        figures="\n".join(figure.html() for figure in contents.figures),
        scope=escape(scope_line(contents.summary)),
        verdicts=table_html(tables.verdicts),
        injection=escape(f"The closed form: {injection_line(contents.summary)}."),
        comparison=table_html(tables.frequencies),
        certificate="\n".join(map(table_html, (levels_table(contents.certificate), tables.safety, tables.realism))),
        counted=str(len(best["frequency_hz"])),
        method=escape(comparison["delivered"]),
        gains=_gains(best),
        device=escape(device_line(push)),
        push=columns_html(("what", "value"), [(key, value_text(value)) for key, value in spoken().keyed(push).items()]),
        problem=columns_html(
            ("key", "value"), settings(contents.problem.model_dump(exclude={"name", "title", "source"}))
        ),
        assumptions=columns_html(("what", "assumed"), [(item.what, str(item.assumed)) for item in ASSUMPTIONS]),
        paper_errors=columns_html(
            ("equation", "as printed", "correct", "effect"),
            [(item.equation, item.as_printed, item.correct, item.effect) for item in PAPER_ERRORS],
        ),
    )
    title = ": ".join(filter(None, (contents.problem.name, contents.problem.title)))
    return page_html(
        title, contents.problem.source, with_problem(body, escape(_file(contents.problem))), contents.versions
    )


def deployed_words(document: Mapping[str, Any], found: Deployed) -> Mapping[str, tuple[str, str]]:
    """Return the caption and a sentence for each of the figures rendered and loop.

    Args:
        document: the `recommend` document.
        found: behind the figures.
    """
    felt, shaken, margins = document["felt"], found.shaken, document["margins"]
    hand = found.hands.values(found.worst)
    least = ", ".join(
        f"{number(hand[key], 3)} {unit}"
        for key, unit in (("mass_kg", KG), ("damping_ns_per_m", NS_PER_M), ("stiffness_n_per_m", N_PER_M))
    )
    told = "; ".join(
        f"{who.replace('_', ' ')} gain {_limit(one['gain'])}, phase {_limit(one['phase_deg'])} degrees, delay "
        f"{_limit(one['delay_samples'])} samples"
        for who, one in margins.items()
    )
    stiffness = ", ".join(
        f"{number(stiff, 3)} {N_PER_M} at {hz:g} Hz"
        for hz, stiff in zip(shaken.frequency_hz, shaken.stiffness_n_per_m, strict=True)
    )
    static = (
        "nothing at rest"
        if felt["stiffness_n_per_m"] is None
        else f"{number(felt['stiffness_n_per_m'])} {N_PER_M} at rest"
    )
    rendered = (
        f"Two charts. A handle that is shaken measures {stiffness}; {static}, where "
        f"{number(found.coupling.problem.environment.stiffness_n_per_m)} {N_PER_M} are wanted. Simulated hands press "
        f"the wall; the least damped one has {least}."
    )
    loop = (
        "Four charts: size and phase of the loop gain over frequency, its Nyquist plot, and where the device is after "
        f"it struck the wall. Margins: {told}."
    )
    return {
        "rendered": (
            "What is rendered against what was wanted: to a shaken handle, and to hands that press.",
            rendered,
        ),
        "loop": (f"The loop broken at the actuator; smallest margins: {told}. Least damped hand: {least}.", loop),
    }


def _limit(margin: float | None) -> str:
    return "without limit" if margin is None else number(margin, 3)


def _file(problem: Problem) -> str:
    """Return the problem's name in commands: in the catalogue, else its file beside the report's folder."""
    return problem.name if problem.name in catalogue_names() else f"{problem.name}.toml"


def _verdict(found: Mapping[str, Any]) -> str:
    """Return the verdict in a line: deploy this, do not, or there is nothing to deploy."""
    if found["coupling"] is None:
        return f'<p class="verdict fail">Deploy nothing: {escape(found["reason"].partition(";")[0])}.</p>'
    if not found["deployable"]:
        return f'<p class="verdict fail">Do not deploy this coupling: {escape(found["reason"])}.</p>'
    rested = [found["trial"], *([found["confirmed"]] if found["confirmed"] else [])]
    doubts = ["not every simulated hand settles with it"] * any(one["at_rest"] < one["hands"] for one in rested)
    doubts += ["most hands push through the wall"] * pushed_through(found)
    doubts += [f"not judged with {escape(what.partition(' (')[0])}" for what in not_judged(found["not_used"])]
    if doubts:
        return f'<p class="verdict fail">Deployable, but {" and ".join(doubts)}.</p>'
    felt, share = found["felt"]["stiffness_n_per_m"], found["felt"]["share_of_wall"]
    if felt is None or share is None or (share >= _THE_WALL and not hardly_rendered(found)):
        return '<p class="verdict pass">Deploy this coupling.</p>'
    softer = f"{number(felt)} {N_PER_M} are rendered, {100 * share:.3g} % of the wall"
    if hardly_rendered(found):
        moving = number(found["felt"]["stiffness_in_motion_n_per_m"].get("1", felt))
        told = f"{softer}, and {moving} {N_PER_M} at 1 Hz"
        return f'<p class="verdict fail">Deployable, but hardly a wall: {told}.</p>'
    return f'<p class="verdict pass">Deploy this coupling; the wall is softened: {softer}.</p>'


def _undelivered(found: Mapping[str, Any], push: Mapping[str, Any]) -> list[str]:
    """Return why the packaged firmware did not receive a deployable coupling."""
    return (
        [device_line(push).replace("device:", "packaged firmware:", 1)]
        if found["coupling"] and "skipped" in push
        else []
    )


def _conclusion(lines: Sequence[str]) -> str:
    """Return the sentences of the conclusion, each under its leading term."""
    parts = (line.partition(": ") for line in lines)
    rows = (f"<dt>{escape(what)}</dt><dd>{escape(told)}</dd>" for what, _, told in parts)
    return "<dl>\n" + "\n".join(rows) + "\n</dl>"


def _deployment(found: Mapping[str, Any]) -> str:
    """Return the trial of the coupling, its proofs, the sensitivity of the stiffness limit, and the assumptions."""
    claims = (found["certificate"] or {}).get("deployable", {}).get("claims", [])
    tried = {
        "the hands of the choice": found["trial"],
        "fresh hands": found["confirmed"],
        **{f"{holding}, outside the design set": of for holding, of in found["other_hands"].items()},
        "corner hands, model mismatch": found["off_file"],
    }
    if found["coupling"] is None and not found["what_would_help"]:
        return columns_html(("assumed, or not used",), [(line,) for line in (*found["assumed"], *found["not_used"])])
    parts = [
        "<h3>How simulated hands fared</h3>",
        columns_html(
            ("hands", "how many", "settle", "without friction", "below threshold"),
            [
                (who, *(of[key] for key in ("hands", "at_rest", "at_rest_without_friction", "quiet")))
                for who, of in tried.items()
                if of
            ],
            left=(0,),
        ),
        "<h3>What is claimed of it</h3>",
        columns_html(
            ("claim", "result", "what was found"),
            [
                *((claim["name"], "pass" if claim["pass"] else "FAIL", claim["sentence"]) for claim in claims),
                *((("settling (L7)", found["rest"]["word"], found["rest"]["sentence"]),) if found["rest"] else ()),
            ],
        ),
        "<h3>What limits it, and what would help</h3>",
        columns_html(
            ("what would help", f"plain spring and damper hold, by linear stability alone, {N_PER_M}"),
            [
                ("the device as it is", found["plain_wall_n_per_m"]),
                *((one["change"], one["stiffest_wall_n_per_m"]) for one in found["what_would_help"]),
            ],
            left=(0,),
        ),
        columns_html(("assumed, or not used",), [(line,) for line in (*found["assumed"], *found["not_used"])]),
    ]
    return "\n".join(parts)


def _gains(document: Mapping[str, Any]) -> str:
    columns = (
        ("f\nHz", "frequency_hz"),
        (f"b\n{NS_PER_M}", "damping_ns_per_m"),
        (f"k\n{N_PER_M}", "stiffness_n_per_m"),
        (f"b_p\n{NS_PER_M}", "contact_damping_ns_per_m"),
        (f"error of |Z|\n{NS_PER_M}", "magnitude_error"),
        ("impedance error\nrelative", "complex_error"),
        (f"Re Z_h\n{NS_PER_M}", "real_part"),
        ("status", "status"),
        ("reason", "reason"),
    )
    rows = zip(*(document[key] for _, key in columns), strict=True)
    return columns_html(tuple(name for name, _ in columns), rows, left=(7, 8))
