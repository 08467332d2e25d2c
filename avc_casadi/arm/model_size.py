"""Size of a URDF or an MJCF, from its text: too large a model is refused before it is built."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

from avc_casadi._errors import InputError
from avc_casadi._util.files import opened, read_text

MOST_LINKS = 200
"""Largest number of links or bodies: a humanoid has 60, and equations grow with them."""
_MOST_PARTS, _DEEPEST = 5000, 250
MOST_BYTES, _MOST_FILES, _MOST_ASSET_BYTES = 2**22, 50, 2**26
_KEY = "model.file"
# Elements of MJCF that repeat their content or allocate, and the largest value of each of their numbers.
_SIZED = {"replicate": 1e4, "composite": 1e4, "flexcomp": 1e4, "hfield": 2048, "texture": 4096, "size": 4096}
_SIZES = re.compile(r"count|nrow|ncol|width|height|nuser(?:data|_[a-z]+)|nkey")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?")


def parsed(text: str, file: str) -> ET.Element:
    """Return the tree of a model of bounded size, included and loaded files counted.

    Args:
        text: of the file.
        file: its path.

    Raises:
        InputError: it is no XML, or too large.
    """
    root = _tree(text, file)
    links, seen = _measured(root, Path(file), [Path(file)])
    if links > MOST_LINKS:
        raise InputError.of(f"has {links:.4g} links; allowed: at most {MOST_LINKS}", file=file, key=_KEY)
    if seen > _MOST_PARTS:
        raise InputError.of(f"has {seen:.4g} elements; allowed: at most {_MOST_PARTS}", file=file, key=_KEY)
    return root


def _tree(text: str, file: str) -> ET.Element:
    if re.search(r"<!DOCTYPE|<!ENTITY", text):
        raise InputError.of("declares entities; allowed: elements and attributes alone", file=file, key=_KEY)
    try:
        return ET.fromstring(text)  # noqa: S314 - without entities
    except (ET.ParseError, ValueError) as error:  # ValueError: an unknown encoding
        raise InputError.of(f"is no XML: {error}", file=file, key=_KEY) from error


def _measured(root: ET.Element, path: Path, included: list[Path]) -> tuple[float, float]:
    """Return the number of links and elements below one, repetitions counted."""
    links = parts = 0.0
    folders = {key: one.get(key, "") for one in root.iter("compiler") for key in ("meshdir", "texturedir", "assetdir")}
    level = [(root, 1.0)]
    for _ in range(_DEEPEST):
        below = []
        for element, times in level:
            many = times * _count(element, path)
            parts += many
            links += many if element.tag in ("link", "body") else 0.0
            if element.tag == "include" and element.get("file"):
                more = _included(included[0].parent / element.get("file", ""), path, included)
                links, parts = links + many * more[0], parts + many * more[1]
            elif element.get("file") and root.tag != "robot":
                _load(element.get("file", ""), included[0], folders)
            below += [(inner, many) for inner in element]
        if not below or parts > _MOST_PARTS:
            return links, parts
        level = below
    raise InputError.of(f"is nested deeper than {_DEEPEST} elements", file=str(path), key=_KEY)


def _count(element: ET.Element, path: Path) -> float:
    """Return the number of repetitions of an element's content; its other numbers are bounded separately."""
    most = _SIZED.get(element.tag)
    if most is None:
        return 1.0
    sizes = {key: value for key, value in element.items() if _SIZES.fullmatch(key)}
    for key, value in sizes.items():
        product = math.prod(max(float(one), 1.0) for one in _NUMBER.findall(value.lower()[:200]))
        if not product <= most:
            told = f"{element.tag} {key} is {value[:40]!r}; allowed: at most {most}"
            raise InputError.of(told, file=str(path), key=_KEY)
        if key == "count":
            return product
    return 1.0


def _included(path: Path, by: Path, included: list[Path]) -> tuple[float, float]:
    included.append(path)
    if len(included) > _MOST_FILES:
        raise InputError.of(f"includes more than {_MOST_FILES} files", file=str(by), key=_KEY)
    try:
        text = read_text(path, MOST_BYTES, f"it is included by {by}")
    except InputError as error:
        raise InputError([replace(fault, key=_KEY) for fault in error.faults]) from error
    return _measured(_tree(text, str(path)), path, included)


def _load(name: str, path: Path, folders: dict[str, str]) -> None:
    """Refuse an asset that is no file, or too large; a missing one is reported by MuJoCo."""
    for folder in {"", *folders.values()}:
        place = path.parent / folder / name
        try:
            there = place.exists() and not place.is_dir()
        except (OSError, ValueError):
            there = False
        if there:
            with opened(place, _MOST_ASSET_BYTES, f"it is loaded by {path}"):
                pass
