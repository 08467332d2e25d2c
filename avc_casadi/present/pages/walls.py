"""Summary and tables of the walls that a device can render."""

from __future__ import annotations

from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number, percent, sample_rows, text_table
from avc_casadi._util.units import N_PER_M, NS_PER_M
from avc_casadi.present.pages.subject import headline, passive_limit, quantities
from avc_casadi.present.terminal import Mark, Page, Row

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

_SHORT = {
    "passive-paper": "passive\npaper",
    "passive-sampled-data": "passive\nsampled",
    "passive-delayed": "passive\n1 sample late",
    "stable-released": "stable\nreleased",
    "stable-hands": "stable\nall hands",
}
_ROWS = 16


def walls_page(document: dict[str, Any], problem: Problem, page: Page, shown: str, drawn: str | None) -> str:
    """Return the `zwidth` document as a headline and rows.

    Args:
        document: of `avc zwidth --json`.
        problem: of the document.
        page: where it is printed.
        shown: the problem as the user names it.
        drawn: file of the picture, if one was drawn.
    """
    rows = [_bare(document)]
    if document["not_used"]:
        unused = ", ".join(map(problem.units.key, document["not_used"]))
        rows.append(Row("Not used", f"{unused}: declared, and no part of these claims", Mark.CAUTION))
    rows += [*_curves(document, problem), *_constant(document, problem), *_bounds(document, problem)]
    rows += [Row("Not judged", why, Mark.CAUTION) for why in document["refused"]]
    if drawn is not None:
        rows.append(Row("Drawn", drawn))
    onwards = [f"avc recommend {quote(shown)} --stiffest", f"avc zwidth {quote(shown)} -v"]
    return page.rendered(headline(problem, shown), rows, onwards)


def _bare(document: dict[str, Any]) -> Row:
    """Describe the claims that the wanted wall meets without coupling."""
    met = [curve["claim"] for curve in document["curves"].values() if curve["wanted_wall"]]
    if not met:
        return Row("Without coupling", "this wall is neither passive nor stable", Mark.CAUTION)
    curves = document["curves"]
    every = len(met) == len(curves)
    if curves["stable-hands"]["wanted_wall"] and not curves["stable-released"]["wanted_wall"]:
        met.append("unstable when released")
    return Row("Without coupling", f"this wall is {'; '.join(met)}", Mark.PASS if every else Mark.CAUTION)


def _curves(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Describe the stiffest wall without coupling for each claim."""
    told, damping, rows = quantities(problem.units), document["wall_damping_ns_per_m"], []
    for key, curve in document["curves"].items():
        if key == "passive-delayed":  # of another device: in the figure and with -v
            continue
        label = _SHORT[key].replace("\n", ", ").capitalize()
        known = [(k, b) for k, b in zip(curve["stiffness_n_per_m"], damping, strict=True) if k is not None]
        if known:
            k, b = max(known)
            at = f"{told(k, 'N/m')}, with a wall damping of {told(b, 'N.s/m')}"
            # The paper's hold calls any stiffness passive, with damping enough.
            rows.append(Row(label, f"{at}; beyond it not looked at" if b == damping[-1] else f"up to {at}"))
        else:
            rows.append(Row(label, "no wall"))
    return rows


def _bounds(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Describe the bounds of the literature, with their sources."""
    told = quantities(problem.units)
    rows = [passive_limit(document["passive_limit_n_per_m"], problem.units)]
    if document["passive_spring_n_per_m"] is not None:
        spring, rule = told(document["passive_spring_n_per_m"], "N/m"), told(document["rule_n_per_m"][0], "N/m")
        rows += [
            Row("Passive spring", f"{spring}, 2 b/((1 + 2 d) T) (Diolaiti et al. 2006)"),
            Row("Linear rule", f"{rule} at B = 0, (b + b_h + B)/(T/2 + t_d) (Gil, Hulin et al. 2009)"),
        ]
    if document["encoder_limit_n_per_m"] is not None:
        limit = told(document["encoder_limit_n_per_m"], "N/m")
        rows.append(Row("Encoder limit", f"{limit} for a passive wall, 2 f_c/Delta (Abbott and Okamura 2005)"))
    return rows


def _constant(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Describe the best constant coupling for this wall, in both models."""
    told, rows = quantities(problem.units), []
    for one in document["static"]:
        if one["condition"] != "all":
            continue
        label = f"Constant, {one['model'].removesuffix('-data')}"
        if one["found"]:
            gains = f"k {told(one['stiffness_n_per_m'], 'N/m')}, b {told(one['damping_ns_per_m'], 'N.s/m')}"
            gains += f", b_p {told(b_p, 'N.s/m')}" if (b_p := one["contact_damping_ns_per_m"]) else ""
            rows.append(Row(label, f"{gains}: passive at all frequencies, error {percent(one['error'])}"))
        else:
            rows.append(Row(label, "no constant coupling is passive at all frequencies"))
    return rows


def walls_lines(document: dict[str, Any]) -> list[str]:
    """Return the full `zwidth` document: the region as a table, Llewellyn's table, constant couplings.

    Args:
        document: of `avc zwidth --json`.
    """
    curves, damping = document["curves"], document["wall_damping_ns_per_m"]
    rows = [
        [number(columns[row]) for columns in (damping, *(one["stiffness_n_per_m"] for one in curves.values()))]
        for row in sample_rows(len(damping), _ROWS)
    ]
    lines = [
        f"largest stiffness ({N_PER_M}) of a wall B + K/s without coupling",
        text_table([f"B\n{NS_PER_M}", *(_SHORT[key] for key in curves)], rows),
        *(f"  {_SHORT[key].replace(chr(10), ' ')}: {curve['claim']}" for key, curve in curves.items()),
    ]
    if any(None in curve["stiffness_n_per_m"] for curve in curves.values()):
        lines.append("  -: no stiffness meets the claim at this B")
    return [*lines, *_llewellyn(document), *_static(document), *_used(document)]


def _llewellyn(document: dict[str, Any]) -> list[str]:
    found = document["llewellyn"]
    if found is None:
        return []
    columns = (found["damping_ratio"], found["paper_kc_t_over_b_d"], found["sampled_data_kc_t_over_b_d"])
    body = [[number(value, 5) for value in row] for row in zip(*columns, strict=True)]
    return [
        "",
        "static coupling for any passive wall: largest k_c T/b_d that Llewellyn's condition (6) allows",
        text_table(("b_c/b_d", "paper's hold\nas printed", "sampled-data\nhold"), body),
        "  -: no stiffness is allowed",
    ]


def _static(document: dict[str, Any]) -> list[str]:
    if not document["static"]:
        return []
    keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
    body = [
        [
            row["condition"],
            row["model"],
            *(number(row[key] if row["found"] else None) for key in keys),
            number(100 * row["error"] if row["found"] else None),
        ]
        for row in document["static"]
    ]
    return [
        "",
        "best constant coupling: llewellyn for any passive wall, all for this wall at all frequencies"
        + ("; nominal device, not its ranges" if document["device_corners"] > 1 else ""),
        text_table(
            ("condition", "model", f"b\n{NS_PER_M}", f"k\n{N_PER_M}", f"b_p\n{NS_PER_M}", "error\n%"), body, left=(0, 1)
        ),
    ]


def _used(document: dict[str, Any]) -> list[str]:
    named = (("used", document["used"]), ("not used", document["not_used"]))
    lines = [f"declared and {word}: {', '.join(keys)}" for word, keys in named if keys]
    return ["", *lines] if lines else []
