"""One self-contained HTML page: figures inside, nothing loaded from elsewhere."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from avc_casadi.loop import ASSUMPTIONS, PAPER_ERRORS
from avc_casadi.report._summary import device_line, injection_line, scope_line, summary_lines
from avc_casadi.study.comparison import comparison_document

if TYPE_CHECKING:
    from avc_casadi.problem import Problem
    from avc_casadi.study.comparison import Comparison

_ROWS_SHOWN = 24
_PAGE = Path(__file__).with_name("page.html")


@dataclass(frozen=True)
class ReportContents:
    """What the report tells.

    Attributes:
        problem: the problem.
        comparison: its comparison.
        summary: what `summarise` found.
        certificate: the `certify` document.
        figures: caption and SVG text of each figure.
        versions: versions by package.
        conclusion: what to deploy and why, or that nothing can be; one sentence a line.
        deployment: the `recommend` document behind it.
    """

    problem: Problem
    comparison: Comparison
    summary: Mapping[str, Any]
    certificate: Mapping[str, Any]
    figures: Sequence[tuple[str, str]]
    versions: Mapping[str, str]
    conclusion: Sequence[str]
    deployment: Mapping[str, Any]


def report_html(contents: ReportContents) -> str:
    """Return the page."""
    comparison = comparison_document(contents.comparison)
    best = comparison["methods"][comparison["delivered"]]
    push = contents.summary["push"]
    return Template(_PAGE.read_text(encoding="utf-8")).substitute(
        title=escape(f"{contents.problem.name}: {contents.problem.title}"),
        source=escape(contents.problem.source),
        conclusion="\n".join(f"<li>{escape(line)}</li>" for line in contents.conclusion),
        deployment=_deployment(contents.deployment),
        summary="\n".join(f"<li>{escape(line)}</li>" for line in summary_lines(contents.summary)),
        figures="\n".join(_figure(caption, svg) for caption, svg in contents.figures),
        scope=escape(scope_line(contents.summary)),
        verdicts=_verdicts(comparison),
        injection=escape(f"The closed form: {injection_line(contents.summary)}."),
        comparison=_comparison(comparison),
        certificate=f"{_certificate(contents.certificate)}\n{_methods(comparison)}",
        rows=len(best["frequency_hz"]),
        method=escape(comparison["delivered"]),
        gains=_gains(best),
        device=escape(device_line(push)),
        push=_table(("what", "value"), [(key, _text(value)) for key, value in push.items()]),
        problem=_table(("key", "value"), _flat(contents.problem.model_dump(exclude={"name", "title", "source"}))),
        assumptions=_table(("what", "assumed"), [(item.what, item.assumed) for item in ASSUMPTIONS]),
        paper_errors=_table(
            ("equation", "as printed", "correct", "effect"),
            [(item.equation, item.as_printed, item.correct, item.effect) for item in PAPER_ERRORS],
        ),
        versions=_table(("package", "version"), list(contents.versions.items())),
    )


def _deployment(found: Mapping[str, Any]) -> str:
    """Return what was proved of the coupling to deploy, how it was tried, what would help and what is assumed."""
    claims = (found["certificate"] or {}).get("deployable", {}).get("claims", [])
    parts = [
        _table(
            ("claim", "result", "what was found"),
            [(claim["name"], "pass" if claim["pass"] else "FAIL", claim["sentence"]) for claim in claims],
        ),
        _table(
            ("what would help", "stiffest wall, N/m"),
            [(one["change"], _number(one["stiffest_wall_n_per_m"])) for one in found["what_would_help"]],
            numbers=(1,),
        ),
        _table(("assumed, or not used",), [(line,) for line in (*found["assumed"], *found["not_used"])]),
    ]
    return "\n".join(parts)


def _figure(caption: str, svg: str) -> str:
    data = base64.b64encode(svg.encode()).decode()
    text = escape(caption)
    return f'<figure><img src="data:image/svg+xml;base64,{data}" alt="{text}"><figcaption>{text}</figcaption></figure>'


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """Return an HTML table; cells are plain text, columns in ``numbers`` are aligned to the right."""

    def row(cells: Sequence[str], tag: str) -> str:
        opened = [f'<{tag} class="n">' if column in numbers else f"<{tag}>" for column in range(len(cells))]
        inner = (f"{start}{escape(cell)}</{tag}>" for start, cell in zip(opened, cells, strict=True))
        return f"<tr>{''.join(inner)}</tr>"

    body = "\n".join(row(cells, "td") for cells in rows)
    return f"<table>\n<thead>{row(header, 'th')}</thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value)) or "none"
    return _number(value) if isinstance(value, float) else str(value)


def _flat(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            rows += _flat(value, f"{prefix}{key}.")
        elif value is not None:
            rows.append((f"{prefix}{key}", _text(value)))
    return rows


def _verdicts(comparison: Mapping[str, Any]) -> str:
    rows = []
    for verdict, count in comparison["counts"].items():
        first = comparison["verdict"].index(verdict) if count else None
        where = "" if first is None else _number(comparison["frequency_hz"][first])
        rows.append((verdict, str(count), where, "" if first is None else comparison["reason"][first]))
    return _table(("verdict", "frequencies", "first at, Hz", "why there"), rows, numbers=(1, 2))


def _comparison(comparison: Mapping[str, Any]) -> str:
    closed, best = comparison["methods"]["closed-form"], comparison["methods"][comparison["optimum"]]
    columns = (
        ("f, Hz", comparison["frequency_hz"]),
        ("closed form asks for b, N·s/m", closed["requested_damping_ns_per_m"]),
        ("k, N/m", closed["requested_stiffness_n_per_m"]),
        ("error of |Z|, N·s/m", closed["magnitude_error"]),
        (f"{best['method']}, pointwise: b, N·s/m", best["damping_ns_per_m"]),
        ("k, N/m", best["stiffness_n_per_m"]),
        ("error of |Z|, N·s/m", best["magnitude_error"]),
        ("Re Z_h, N·s/m", best["real_part"]),
    )
    count = len(comparison["frequency_hz"])
    step = max(1, -(-count // _ROWS_SHOWN))
    rows = [
        (*(_number(values[row]) for _, values in columns), comparison["verdict"][row]) for row in range(0, count, step)
    ]
    return _table((*(name for name, _ in columns), "verdict"), rows, numbers=range(len(columns)))


def _gains(document: Mapping[str, Any]) -> str:
    columns = (
        ("f, Hz", "frequency_hz"),
        ("b, N·s/m", "damping_ns_per_m"),
        ("k, N/m", "stiffness_n_per_m"),
        ("b_p, N·s/m", "contact_damping_ns_per_m"),
        ("error of |Z|, N·s/m", "magnitude_error"),
        ("complex error", "complex_error"),
        ("Re Z_h, N·s/m", "real_part"),
    )
    rows = [
        (*(_number(document[key][row]) for _, key in columns), document["status"][row], document["reason"][row])
        for row in range(len(document["frequency_hz"]))
    ]
    return _table((*(name for name, _ in columns), "status", "reason"), rows, numbers=range(len(columns)))


def _certificate(certificate: Mapping[str, Any]) -> str:
    rows = [
        (
            level,
            "pass" if found["pass"] else "fail",
            _number(found["margin_ns_per_m"]),
            _number(found["frequency_hz"]),
            found["model"],
            found["claim"],
        )
        for level, found in certificate["levels"].items()
    ]
    return _table(("level", "result", "margin, N·s/m", "at, Hz", "model", "claim"), rows, numbers=(2, 3))


def _methods(comparison: Mapping[str, Any]) -> str:
    """Levels met and share of frequencies that feel real, method by method."""
    jnd = 100 * comparison["methods"][comparison["optimum"]]["realism"]["jnd"]
    rows = [
        (
            name,
            ", ".join(level for level, found in gains["certificate"]["levels"].items() if found["pass"]) or "none",
            _number(100 * gains["realism"]["share_inside_bounds"]),
            _number(100 * gains["realism"]["share_inside_jnd"]),
        )
        for name, gains in comparison["methods"].items()
    ]
    head = (
        "method",
        "levels met",
        "between U and L, % of frequencies",
        f"within {jnd:.3g} % of desired, % of frequencies",
    )
    return _table(head, rows, numbers=(2, 3))
