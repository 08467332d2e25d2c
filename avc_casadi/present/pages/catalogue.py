"""Summary of a problem file or a device file: validity and meaning."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import quantity
from avc_casadi.present.pages.subject import headline, passive_limit, quantities
from avc_casadi.present.terminal import Mark, Page, Row
from avc_casadi.recommendation.preconditions import asked_of_others, not_judged

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.model.problem import Problem

# Unit of a key of a linear device by its ending, the longest first.
_UNITS = {
    "_ns_per_m": "N.s/m",
    "_n_per_m": "N/m",
    "_m_per_s": "m/s",
    "_kg": "kg",
    "_hz": "Hz",
    "_n": "N",
    "_m": "m",
    "_s": "s",
}
# Values of a device that have a row of their own; the others share one.
_MOST_VALUES = 7


def problem_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `check` document of a problem as a headline and rows.

    Args:
        document: of `avc check --json`.
        problem: that was checked.
        page: where it is printed.
        shown: the problem as the user names it.
    """
    low, high, nyquist = (quantity(document[f"{key}_hz"], "Hz") for key in ("lowest", "highest", "nyquist"))
    rows = [
        Row("Valid", document["title"] or "yes", Mark.PASS),
        *([Row("Source", document["source"])] if document["source"] else []),
        Row("Asked for", f"structure {document['structure']}, model {document['model']}, scope {document['scope']}"),
        Row("Frequencies", f"{document['frequencies']}, {low} to {high}; Nyquist {nyquist}"),
        passive_limit(document["passive_limit_n_per_m"], problem.units),
    ]
    if document["declared"]:
        rows.append(Row("Declared", ", ".join(map(problem.units.key, document["declared"]))))
    rows += [
        Row("Not used", f"{what}: what is recommended is not judged with it", Mark.CAUTION)
        for what in not_judged(document["not_used"])
    ]
    rows += [Row("Not used", told) for told in asked_of_others(document["not_used"])]
    rows += [Row("Warning", f"{one['key']} {one['message']}", Mark.CAUTION) for one in document["warnings"]]
    # Where nothing is deployable whatever the gains, its row says so.
    none = any(one["key"] == "avc recommend" for one in document["warnings"])
    onwards = [] if none else [f"avc recommend {quote(shown)} --out coupling.json"]
    return page.rendered(headline(problem, shown), rows, onwards)


def new_page(document: dict[str, Any], problem: Problem, page: Page, shown: str) -> str:
    """Return the `new` document as a headline and rows: what was written, what is unknown and what is unlikely."""
    units, told, hands = problem.units, quantities(problem.units), problem.hands
    ranges = (
        f"{told(low, unit)} to {told(high, unit)}"
        for (low, high), unit in (
            (hands.mass_kg, "kg"),
            (hands.damping_ns_per_m, "N.s/m"),
            (hands.stiffness_n_per_m, "N/m"),
        )
    )
    not_known = [f"{one['key'].partition('.')[2]}: {one['message']}" for one in document["not_known"]]
    assumed = ", ".join(f"{units.key(key)} {value}" for key, value in document["assumed"].items())
    rows = [
        Row("Written", document["file"], Mark.PASS),
        *_model_rows(document["model"], told),
        Row("Hands", f"{document['held']}: {', '.join(ranges)}"),
        *([Row("Assumed", assumed)] if assumed else []),
        *(Row("Not known", one, Mark.CAUTION) for one in not_known),
        *(Row("Warning", f"{one['key']} {one['message']}", Mark.CAUTION) for one in document["warnings"]),
    ]
    return page.rendered(headline(problem, shown), rows, [f"avc recommend {quote(shown)} --out coupling.json"])


def _model_rows(model: dict[str, Any] | None, told: Callable[[float, str], str]) -> list[Row]:
    """Return what a model said of the mass, and what was left out of it."""
    if model is None:
        return []
    lowest, highest = (told(end, "kg") for end in model["range_kg"])
    mass = f"{told(model['mass_kg'], 'kg')}, {lowest} to {highest} over {model['poses']} poses and all normals"
    rows = [Row("Mass", f"{mass} of {model['tip']}")]
    if left_out := model["singular_poses"]:
        near = "near a singular one, where it grows without end: limits of the joints keep a hand away from them"
        rows.append(Row("Left out", f"{left_out} poses {near}", Mark.CAUTION))
    if model["has_dry_friction"]:
        rows.append(Row("Not used", "dry friction of the model's joints; that at the tip: --friction", Mark.CAUTION))
    return rows


def device_page(document: dict[str, Any], units: Units, page: Page) -> str:
    """Return the `check` document of a device as a headline and rows, a value each with its range and grade."""
    sources, ranges = document["sources"], document["range"]
    told = {}
    for key, value in document["values"].items():
        told[units.key(key)] = _value(key, value, units)
        if isinstance(ends := ranges.get(key), list):
            told[units.key(key)] += f" ({_value(key, ends[0], units)} to {_value(key, ends[1], units)})"
        told[units.key(key)] += f", {sources[key]['grade']}" if key in sources else ""
    rows = [Row(key, value) for key, value in list(told.items())[:_MOST_VALUES]]
    if len(told) > _MOST_VALUES:
        rows.append(Row("and", "; ".join(f"{key} {value}" for key, value in list(told.items())[_MOST_VALUES:])))
    rows.insert(0, Row("Valid", document["title"] or "yes", Mark.PASS))
    gaps = [gap for gap in document["gaps"] if units.inner(gap) not in document["values"]]
    if gaps:
        rows.append(Row("Not known", ", ".join(gaps), Mark.CAUTION))
    onwards = [f'in a problem file: device = "{document["referred_as"]}"']
    return page.rendered(f"{document['device']}   device file", rows, onwards)


def device_lines(document: dict[str, Any], units: Units) -> list[str]:
    """Return the source of each value of a device, and the example of its SDK.

    Args:
        document: of `avc check --json`.
        units: of the device's motion.
    """
    lines = [f"{units.key(key)}: {one['grade']}, {one['source']}" for key, one in document["sources"].items()]
    if document["sdk_example"] is not None:
        example = dict(document["sdk_example"])
        source = example.pop("source")
        lines.append(
            f"example of an SDK: {', '.join(f'{units.key(key)} {one}' for key, one in example.items())}   {source}"
        )
    return lines


def _value(key: str, value: Any, units: Units) -> str:
    """Format a value in the unit of its key's ending."""
    if isinstance(value, Mapping):
        return ", ".join(f"{_word(name)} {_value(name, one, units)}" for name, one in value.items())
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    unit = None if key.endswith("radius_m") else next((_UNITS[one] for one in _UNITS if key.endswith(one)), None)
    if unit is None:
        return f"{value:.4g}"
    return quantities(units)(value, unit)


def _word(key: str) -> str:
    ending = next((ending for ending in _UNITS if key.endswith(ending)), "")
    return key.removesuffix(ending).replace("_", " ")
