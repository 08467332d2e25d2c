"""A typed quantity with any fitting unit, in SI units."""

from __future__ import annotations

import math
import re

# Size in SI units, and powers of kg, m, s and rad.
_SYMBOLS = {
    "g": (1e-3, (1, 0, 0, 0)),
    "m": (1.0, (0, 1, 0, 0)),
    "s": (1.0, (0, 0, 1, 0)),
    "N": (1.0, (1, 1, -2, 0)),
    "Hz": (1.0, (0, 0, -1, 0)),
    "rad": (1.0, (0, 0, 0, 1)),
}
_ALONE = {
    "in": (0.0254, (0, 1, 0, 0)),
    "dpi": (1 / 0.0254, (0, -1, 0, 0)),
    "lb": (0.45359237, (1, 0, 0, 0)),
    "lbf": (4.4482216152605, (1, 1, -2, 0)),
    "ozf": (0.27801385095378, (1, 1, -2, 0)),
    **dict.fromkeys(("deg", "degrees", "\N{DEGREE SIGN}"), (math.pi / 180, (0, 0, 0, 1))),
    **dict.fromkeys(("turn", "turns", "rev"), (2 * math.pi, (0, 0, 0, 1))),
    **dict.fromkeys(("count", "counts", "step", "steps", "sample", "samples"), (1.0, (0, 0, 0, 0))),
}
_TYPED_PREFIXES = {"": 0, "k": 3, "M": 6, "G": 9, "c": -2, "m": -3, "u": -6, "n": -9}
# Units typed without a sign between them.
_GLUED = ((r"Nms\b", "N.m.s"), (r"Nm\b", "N.m"), (r"Ns\b", "N.s"), (r"g(?=[cm]?m2)", "g."))
_BITS = re.compile(r"\s*(\d{1,2})[\s-]*bits?\s*")
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)


def read_quantity(text: str, unit: str) -> float:
    """Return a quantity as typed in SI units: ``55 um`` as 5.5e-5, ``1 kHz`` for a time, ``450 dpi`` for a step.

    Args:
        text: a number, and its unit; without one it is in SI units. A number per length or time, in place of the length
            or time itself, is inverted; counts alone are those of a turn, and so are those of an encoder's bits.
        unit: that is wanted, such as ``N.m/rad`` or ``samples``.

    Raises:
        ValueError: it is not a number, or of another unit.
    """
    if bits := _BITS.fullmatch(text):
        text = f"{2 ** int(bits[1])} counts"
    found = _NUMBER.fullmatch(text)
    typed, wanted = None if found is None else _unit(found[2]), _unit(unit)
    if found is None or typed is None or wanted is None or not math.isfinite(number := float(found[1])):
        raise ValueError(f"{text!r} is no number with a unit")
    if not found[2]:
        return number
    factor, powers = typed
    if not any(powers) and wanted == _unit("rad"):
        factor, powers = factor / (2 * math.pi), (0, 0, 0, -1)
    value, inverse = number * factor, tuple(-power for power in powers)
    if any(powers) and inverse == wanted[1] and value:
        value = 1 / value
    # N.m/rad typed without the angle is meant with it.
    elif powers != wanted[1] and not (any(powers[:3]) and powers[:3] == wanted[1][:3]):
        raise ValueError(f"{' '.join(text.split())!r} is in another unit than {unit}")
    return float(f"{value:.15g}")


def _unit(text: str) -> tuple[float, tuple[int, ...]] | None:
    """Return the size of a unit in SI units and its powers of kg, m, s and rad; None where unknown."""
    for pattern, plain in _GLUED:
        text = re.sub(pattern, plain, text)
    text = text.replace("\N{MICRO SIGN}", "u").replace("\N{GREEK SMALL LETTER MU}", "u")
    text = text.replace("\N{SUPERSCRIPT TWO}", "2").replace("^", "")
    above, *below = text.split("/")
    size, powers = 1.0, [0, 0, 0, 0]
    for part, sign in ((above, 1), *((one, -1) for one in below)):
        for symbol in filter(None, re.split(r"[.\N{MIDDLE DOT}*\s]+", part)):
            found = re.fullmatch(r"(\D+)(\d?)", symbol)
            one = None if found is None else _symbol(found[1])
            if found is None or one is None:
                return None
            power = sign * int(found[2] or 1)
            size *= one[0] ** power
            powers = [before + power * here for before, here in zip(powers, one[1], strict=True)]
    return size, tuple(powers)


def _symbol(text: str) -> tuple[float, tuple[int, ...]] | None:
    if text in _ALONE:
        return _ALONE[text]
    for symbol, (size, powers) in _SYMBOLS.items():
        exponent = _TYPED_PREFIXES.get(text.removesuffix(symbol))
        if text.endswith(symbol) and exponent is not None:
            return size * 10.0**exponent, powers
    return None
