"""A URDF read for what an arm needs of it: a tree of simple joints, whose parts that move have mass and inertia.

What URDF lets be left out is written in; what is wrong is told by name, all at once; what is drawn only is not read.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import Fault, InputError, UnsupportedError

if TYPE_CHECKING:
    from avc_casadi.files.arm_file import ModelFile

SLIDES, TURNS = ("prismatic",), ("revolute", "continuous")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_ONCE = (
    "inertial",
    "inertial/origin",
    "inertial/mass",
    "inertial/inertia",
    "origin",
    "parent",
    "child",
    "axis",
    "limit",
)
# A moment of inertia may be negative by rounding.
_ROUNDED = 1e-9


def whole_urdf(model: ModelFile, text: str) -> str:
    """Return a URDF of links, masses and joints alone, with what it leaves out written in.

    Args:
        model: where it is.
        text: what it says.

    Raises:
        InputError: it is no XML, no tree of links, or holds numbers that are none.
        UnsupportedError: joints that are neither hinges nor slides, or parts that move without inertia.
    """
    try:
        root = ET.fromstring(text)  # noqa: S314 - a file that the user names; expat of today refuses entity bombs
    except ET.ParseError as error:
        raise InputError.of(f"is no XML: {error}", file=model.file, key="model.file") from error
    wrong = list(_of_the_words(root))
    if not wrong:
        _refuse_other_joints(model, root)
        wrong = [*_of_the_tree(root), *_of_numbers(root)]
    if wrong:
        raise InputError([Fault(model.file, None, "model.file", one) for one in wrong])
    _refuse_massless(model, root)
    return ET.tostring(_bare(root), encoding="unicode")


def _bare(root: ET.Element) -> ET.Element:
    """Return a robot of what was checked, and nothing else that a parser could trip over."""
    bare = ET.Element("robot", name=root.get("name", "arm"))
    for link in root.findall("link"):
        own = ET.SubElement(bare, "link", name=link.get("name", ""))
        if link.find("inertial/inertia") is not None:
            inertial = ET.SubElement(own, "inertial")
            _copy(link.find("inertial/origin"), inertial, "origin", xyz="0 0 0", rpy="0 0 0")
            _copy(link.find("inertial/mass"), inertial, "mass", value="0")
            _copy(link.find("inertial/inertia"), inertial, "inertia", **dict.fromkeys(_MOMENTS, "0"))
    for joint in root.findall("joint"):
        kind = joint.get("type", "")
        own = ET.SubElement(bare, "joint", name=joint.get("name", ""), type=kind)
        _copy(joint.find("origin"), own, "origin", xyz="0 0 0", rpy="0 0 0")
        for end in ("parent", "child"):
            ET.SubElement(own, end, link=_named(joint, end))
        if kind != "fixed":
            _copy(joint.find("axis"), own, "axis", xyz="1 0 0")
            limit = _limit(joint)
            low, high = ("-inf", "inf") if limit is None else ("0", "0")
            _copy(limit, own, "limit", lower=low, upper=high, effort="0", velocity="0")
    return bare


def _copy(found: ET.Element | None, place: ET.Element, name: str, **usual: str) -> None:
    """Write an element of the given attributes, each as found or else as usual."""
    ET.SubElement(place, name, {key: value if found is None else found.get(key, value) for key, value in usual.items()})


def _limit(joint: ET.Element) -> ET.Element | None:
    """Return the limits of a joint; those of a continuous one say nothing of where it goes."""
    return None if joint.get("type") in ("fixed", "continuous") else joint.find("limit")


def refuse_massless(model: ModelFile, names: list[str]) -> None:
    """Refuse parts that move and have no inertia.

    Args:
        model: where they are.
        names: theirs; none is no fault.

    Raises:
        UnsupportedError: there are some.
    """
    if names:
        raise UnsupportedError(
            f"{model.file}: no inertia is given for what moves: {', '.join(names)}; such models are made for drawing. "
            "Give mass and inertia of every link that moves, from CAD or from a scale",
            key="model.file",
        )


def _refuse_other_joints(model: ModelFile, root: ET.Element) -> None:
    other = [
        f"{joint.get('name')} ({joint.get('type')})"
        for joint in root.findall("joint")
        if joint.get("type") not in (*TURNS, *SLIDES, "fixed")
    ]
    other += [f"{joint.get('name')} (mimic)" for joint in root.findall("joint") if joint.find("mimic") is not None]
    if other:
        raise UnsupportedError(
            f"{model.file}: joints that are neither hinges nor slides of their own: {', '.join(other)}",
            key="model.file",
        )


def _of_the_words(root: ET.Element) -> Iterator[str]:
    """Yield what has no name, and what is said twice where once is meant."""
    if root.tag != "robot":
        yield f"begins with <{root.tag}>; allowed: <robot>"
    elif root.find("link") is None:
        yield "has no link"
    for kind in ("link", "joint"):
        for number, one in enumerate(root.findall(kind), 1):
            if not one.get("name"):
                yield f"{kind} {number} of the file has no name"
            for path in _ONCE:
                if (count := len(one.findall(path))) > 1:
                    yield f"{kind} {one.get('name')}: has {count} of <{path.rsplit('/', 1)[-1]}>; allowed: one"


def _of_the_tree(root: ET.Element) -> Iterator[str]:
    """Yield what keeps links and joints from being a tree."""
    links, joints = [one.get("name", "") for one in root.findall("link")], root.findall("joint")
    for kind, names in (("link", links), ("joint", [one.get("name", "") for one in joints])):
        yield from (f"has {count} {kind}s of the name {name!r}" for name, count in Counter(names).items() if count > 1)
    for joint in joints:
        for end in ("parent", "child"):
            if _named(joint, end) not in links:
                yield f"joint {joint.get('name')}: its {end} {_named(joint, end)!r} is no link of the file"
    children = Counter(_named(joint, "child") for joint in joints)
    yield from (
        f"link {name} is the child of {count} joints; allowed: one" for name, count in children.items() if count > 1
    )
    roots = [name for name in links if name not in children]
    if len(roots) != 1:
        ends = ", ".join(roots) or "a loop"
        yield f"has {len(roots)} links that are no child of a joint ({ends}); allowed: one, the base"
    above = {_named(joint, "child"): _named(joint, "parent") for joint in joints}
    for name in links:
        at = name
        for _ in links:
            at = above.get(at, "")
        if at:
            yield f"link {name} hangs in a loop of joints; allowed: a tree"
            return


def _of_numbers(root: ET.Element) -> Iterator[str]:
    """Yield what should be numbers and are none, and numbers that nothing has."""
    for where in (*root.findall("joint"), *root.findall("link")):
        name = f"{where.tag} {where.get('name')}"
        for path, key, count in (
            ("origin", "xyz", 3),
            ("origin", "rpy", 3),
            ("axis", "xyz", 3),
            ("inertial/origin", "xyz", 3),
            ("inertial/origin", "rpy", 3),
            ("inertial/mass", "value", 1),
            *(("inertial/inertia", moment, 1) for moment in _MOMENTS),
            ("limit", "lower", 1),
            ("limit", "upper", 1),
        ):
            found = where.find(path)
            text = None if found is None else found.get(key)
            if text is not None and _numbers(text, count) is None:
                wanted = "a finite number" if count == 1 else f"{count} finite numbers"
                yield f"{name}: {path.rsplit('/', 1)[-1]} {key} is {text[:60]!r}; allowed: {wanted}"
        limit = _limit(where)
        if limit is not None:
            low, high = (_numbers(limit.get(key, "0"), 1) for key in ("lower", "upper"))
            if low and high and not low[0] < high[0]:
                yield f"{name}: limit goes from {low[0]:g} to {high[0]:g}; allowed: an upper end above the lower one"
        yield from _of_the_inertia(where, name)
        axis = where.find("axis")
        if axis is not None and _numbers(axis.get("xyz", "1 0 0"), 3) == [0.0, 0.0, 0.0]:
            yield f"{name}: axis xyz is 0 0 0; allowed: a direction"


def _of_the_inertia(link: ET.Element, name: str) -> Iterator[str]:
    inertia = link.find("inertial/inertia")
    if _mass(link) < 0:
        yield f"{name}: mass value is {_mass(link):g}; allowed: 0 or more"
    elif _mass(link) > 0 and inertia is None:
        yield f"{name}: has a mass and no <inertia>; give its moments, 0 where it is small"
    elif inertia is not None and (missing := [moment for moment in _MOMENTS if inertia.get(moment) is None]):
        yield f"{name}: its inertia does not tell {', '.join(missing)}; give them, 0 where they are small"
    elif _least_moment(link) < 0:
        yield f"{name}: its inertia has a negative principal moment; allowed: none below 0"


def _numbers(text: str, count: int) -> list[float] | None:
    try:
        found = [float(part) for part in text.split()]
    except ValueError:
        return None
    return found if len(found) == count and all(map(math.isfinite, found)) else None


def _mass(link: ET.Element) -> float:
    mass = link.find("inertial/mass")
    found = None if mass is None else _numbers(mass.get("value", ""), 1)
    return 0.0 if found is None else found[0]


def _least_moment(link: ET.Element) -> float:
    """Return the least principal moment of inertia, 0 where it is that but for rounding, or none is given."""
    inertia = link.find("inertial/inertia")
    read = [None] if inertia is None else [_numbers(inertia.get(moment, "0"), 1) for moment in _MOMENTS]
    values = [one[0] for one in read if one is not None]
    if len(values) < len(_MOMENTS):
        return 0.0
    xx, xy, xz, yy, yz, zz = values
    moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return 0.0 if moments[0] >= -_ROUNDED * np.abs(moments).max() else float(moments[0])


def _refuse_massless(model: ModelFile, root: ET.Element) -> None:
    """Masses of links that are fixed to one that moves count there; of these a link may be without."""
    parents = {_named(joint, "child"): joint for joint in root.findall("joint")}
    carried: dict[str, float] = {}
    for link in root.findall("link"):
        moves = _moved(link.get("name", ""), parents)
        if moves:
            carried[moves] = carried.get(moves, 0.0) + _mass(link)
    refuse_massless(model, [name for name, mass in carried.items() if not mass > 0])


def _named(joint: ET.Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _moved(link: str, parents: dict[str, ET.Element]) -> str:
    """Return the link that moves a link, itself or one that it is fixed to; empty where that is the base."""
    while (joint := parents.get(link)) is not None:
        if joint.get("type") != "fixed":
            return link
        link = _named(joint, "parent")
    return ""
