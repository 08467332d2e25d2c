"""Summary of a device of several axes: effective mass at its tip, walls, gains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from avc_casadi._util.quantity import quantity
from avc_casadi._util.text import number, text_table
from avc_casadi._util.units import METRE, MM
from avc_casadi.present.terminal import Mark, Page, Row

# A workspace with a larger share out of reach is warned of.
_MUCH_OUT_OF_REACH = 0.1


def arm_page(document: dict[str, Any], page: Page, at: str | None, normal: str | None) -> str:
    """Return the `arm` document as a headline and rows.

    Args:
        document: of `avc arm --json`.
        page: where it is printed.
        at: position of the tip as the user gave it; None is the workspace.
        normal: of the wall as the user gave it; None is every direction.
    """
    free, held = document["home_free_kg"], document["home_held_kg"]
    along = "any direction" if normal is None else f"normal {normal}"
    rows = [Row(f"Home, {axis}", _masses(free[place], held[place])) for place, axis in enumerate(document["axes"])]
    rows += _pose(document, at, along) if "at" in document else _workspace(document, along)
    if document["out"]:
        rows.append(Row("Written", f'{document["out"]}; in a problem file: device = "{document["out"]}"', Mark.PASS))
    rows += _map(document["map"]) if "map" in document else []
    rows += _gains(document["gains"]) if "gains" in document else []
    title = f"{document['arm']}   {document['title']}" if document["title"] else document["arm"]
    return page.rendered(f"{title} · tip at home {_place(document['home_tip_m'])}", rows)


def _masses(free_kg: float, held_kg: float) -> str:
    return f"{quantity(free_kg, 'kg')} tangent free, {quantity(held_kg, 'kg')} held"


def _pose(document: dict[str, Any], at: str | None, along: str) -> list[Row]:
    pose = document["at"]
    rows = [Row("Here", f"{_masses(pose['free_kg'], pose['held_kg'])}, {along}, {at} {METRE} from home")]
    if not pose["in_workspace"]:
        outside = "outside the declared workspace, for which map and gains are made"
        rows.append(Row("Place", outside, Mark.CAUTION))
    return rows


def _workspace(document: dict[str, Any], along: str) -> list[Row]:
    found = document["workspace"]
    light = f"{quantity(found['lightest_kg'], 'kg')} at {_place(found['lightest_at_m'])}"
    heavy = f"{quantity(found['heaviest_kg'], 'kg')} at {_place(found['heaviest_at_m'])}"
    rows = [Row("Workspace", f"{light} to {heavy}, {along}")]
    if found["out_of_reach"]:
        much = bool(document["out"]) and found["out_of_reach"] > _MUCH_OUT_OF_REACH * found["poses"]
        told = f"{found['out_of_reach']} of {found['poses']} poses of the grid"
        told += ": the file knows of the others alone; give a workspace that the mechanism reaches" if much else ""
        rows.append(Row("Out of reach", told, Mark.CAUTION if much else Mark.NONE))
    return rows


def _map(found: dict[str, Any]) -> list[Row]:
    """Describe the stiffest wall over the workspace, for each normal."""
    rows = []
    for column, label in enumerate(found["labels"]):
        walls = [row[column] for row in found["stiffness_n_per_m"] if row[column] is not None]
        rows.append(Row(f"Wall, {label}", f"{quantity(min(walls), 'N/m')} to {quantity(max(walls), 'N/m')}"))
    there = f"over {sum(found['there'])} poses, every hand and released; drawn: {found['file']}"
    return [*rows, Row("Map", there)]


def _gains(found: dict[str, Any]) -> list[Row]:
    """Describe the span of the gains, and the margins of the coupled loop."""
    claim, regions, worst = found["claim"], found["regions"], found["claim"]["worst"]
    across = [_span(regions, key, unit) for key, unit in (("stiffness_n_per_m", "N/m"), ("damping_ns_per_m", "N.s/m"))]
    surface = [
        _span([{key: [one[f"tangent_{key}"]]} for one in regions], key, unit)
        for key, unit in (("stiffness_n_per_m", "N/m"), ("damping_ns_per_m", "N.s/m"))
    ]
    alone = f"designed along one axis alone {claim['factor_of_one_axis_designs']:.3g}"
    who = "held by a hand" if worst["held"] else "released"
    where = (
        f"{who} at {_place(worst['tip_m'])}, normal {_vector(worst['normal'])}, {worst['delay_samples']:g} samples late"
    )
    return [
        Row("Gains", f"k {across[0]}, b {across[1]} over {len(found['directions'])} normals, {len(regions)} regions"),
        Row("Surface", f"along it k {surface[0]}, b {surface[1]}"),
        Row(
            "Coupled loop",
            f"stable up to {claim['factor']:.3g} times these gains in a search ({alone})",
            Mark.PASS if claim["factor"] >= 1 else Mark.FAIL,
        ),
        Row("Worst", where),
        Row(
            "Keep", "the gains of the first touch until the contact ends: poses and gains are frozen here", Mark.CAUTION
        ),
        Row("Written", f"{', '.join(found['files'])} in {found['folder']}", Mark.PASS),
    ]


def _span(regions: Sequence[dict[str, Any]], key: str, unit: str) -> str:
    values = [value for one in regions for value in one[key]]
    low, high = quantity(min(values), unit), quantity(max(values), unit)
    return low if low == high else f"{low} to {high}"


def arm_lines(document: dict[str, Any]) -> list[str]:
    """Return the sources of the arm, and its gains by region and normal.

    Args:
        document: of `avc arm --json`.
    """
    lines = [document["source"]] if document["source"] else []
    if "gains" not in document:
        return lines
    rows = []
    for place, region in enumerate(document["gains"]["regions"], 1):
        gains = zip(region["stiffness_n_per_m"], region["damping_ns_per_m"], strict=True)
        for way, (k, b) in zip(document["gains"]["directions"], gains, strict=True):
            rows.append([str(place), _vector(way), number(k), number(b)])
        k, b = region["tangent_stiffness_n_per_m"], region["tangent_damping_ns_per_m"]
        rows.append([str(place), "along the surface", number(k), number(b)])
    normal = f"normal\n{', '.join(document['axes'])}"
    return [*lines, text_table(["region", normal, "k\nN/m", "b\nN.s/m"], rows, left=(1,))]


def _place(position_m: Sequence[float]) -> str:
    return f"{_vector([1e3 * one for one in position_m])} {MM}"


def _vector(values: Sequence[float]) -> str:
    return ", ".join(number(one, 3) for one in values)
