"""The two precisions that programs run in: what C and numpy call their numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi.model.gains import DeviceLn, double_ln, single_ln


@dataclass(frozen=True)
class Precision:
    """IEEE numbers of one size.

    Attributes:
        name: as the user says it.
        c_type: of C.
        suffix: of a C literal.
        ln: the natural logarithm that a device computes.
    """

    name: str
    c_type: str
    suffix: str
    ln: DeviceLn

    @property
    def dtype(self) -> type[Any]:
        """Of numpy."""
        return self.ln.dtype

    @property
    def bits(self) -> int:
        """Of a mantissa, the one that is not written down among them."""
        return int(np.finfo(self.dtype).nmant) + 1

    @property
    def largest(self) -> float:
        """Largest number."""
        return float(np.finfo(self.dtype).max)

    def literal(self, value: float) -> str:
        """Return a C literal that reads back as exactly the nearest number of this precision."""
        number = self.dtype(value)
        plain = 1e-3 <= abs(number) < 1e6 or number == 0
        spell = np.format_float_positional if plain else np.format_float_scientific
        text = spell(number, unique=True, trim="0") + self.suffix
        return f"({text})" if text.startswith("-") else text


SINGLE = Precision("single", "float", "f", single_ln)
DOUBLE = Precision("double", "double", "", double_ln)
PRECISIONS = {precision.name: precision for precision in (SINGLE, DOUBLE)}
