"""CasADi's operations in C and in numpy, of one precision and with equal bits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi import InputError
from avc_casadi.model.gains import DeviceLn, double_ln, single_ln


@dataclass(frozen=True)
class Precision:
    """IEEE numbers of one size.

    Attributes:
        name: as users write it.
        c_type: of C.
        suffix: of a C literal.
        ln: natural logarithm as on the device.
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
        """Bits of the mantissa, the implicit one included."""
        return int(np.finfo(self.dtype).nmant) + 1

    @property
    def largest(self) -> float:
        """Largest number."""
        return float(np.finfo(self.dtype).max)

    def literal(self, value: float) -> str:
        """Return a C literal that reads back as exactly the nearest number of this precision.

        Raises:
            InputError: it is none, or beyond this precision: C has no word for it.
        """
        with np.errstate(over="ignore"):
            number = self.dtype(value)
        if not np.isfinite(number):
            raise InputError.of(f"holds {value:g}; allowed: below {self.largest:.2g} in {self.name} precision")
        plain = 1e-3 <= abs(number) < 1e6 or number == 0
        spell = np.format_float_positional if plain else np.format_float_scientific
        text = spell(number, unique=True, trim="0") + self.suffix
        return f"({text})" if text.startswith("-") else text


SINGLE = Precision("single", "float", "f", single_ln)
DOUBLE = Precision("double", "double", "", double_ln)
PRECISIONS = {precision.name: precision for precision in (SINGLE, DOUBLE)}

Value = Any  # an array of the program's precision, or of booleans


@dataclass(frozen=True)
class Operation:
    """An operation in C and in numpy; the compiler must neither fuse nor reorder.

    Attributes:
        c: with places for the arguments and the numbers zero and one.
        numpy: the same.
        truth: whether the result is boolean.
        of_truth: indices of boolean arguments.
    """

    c: str
    numpy: Callable[..., Value]
    truth: bool = False
    of_truth: tuple[bool, ...] = (False, False)


SELECT = -1  # condition ? a : b, which CasADi writes as a sum of two halves
NEAREST = -2  # nearest whole number, by adding and subtracting a number too large for a fraction; not for larger values
# Terms of the series of sin(2 pi u), u up to a quarter, by the bits of the precision.
TERMS = {24: 7, 53: 12}


def operations(ca: Any, precision: Precision) -> dict[int, Operation]:
    """Return each operation of CasADi in a precision, by its number."""

    def arithmetic(c: str, numpy: Callable[..., Value]) -> Operation:
        return Operation(c, numpy)

    def comparison(c: str, numpy: Callable[..., Value]) -> Operation:
        return Operation(c, numpy, truth=True)

    zero = np.float32(0)
    both = (True, True)
    whole = precision.dtype(1.5 * 2.0 ** (precision.bits - 1))
    text = precision.literal(float(whole))
    return {
        ca.OP_ASSIGN: arithmetic("{0}", lambda a: a),
        ca.OP_ADD: arithmetic("{0} + {1}", lambda a, b: a + b),
        ca.OP_SUB: arithmetic("{0} - {1}", lambda a, b: a - b),
        ca.OP_MUL: arithmetic("{0} * {1}", lambda a, b: a * b),
        ca.OP_DIV: arithmetic("{0} / {1}", lambda a, b: a / b),
        ca.OP_NEG: arithmetic("-{0}", lambda a: -a),
        ca.OP_INV: arithmetic("{one} / {0}", lambda a: np.float32(1) / a),
        ca.OP_SQ: arithmetic("{0} * {0}", lambda a: a * a),
        ca.OP_TWICE: arithmetic("{0} + {0}", lambda a: a + a),
        ca.OP_SIGN: arithmetic("{0} > {zero} ? {one} : ({0} < {zero} ? -{one} : {zero})", np.sign),
        # IEEE requires the nearest number, of C's library too.
        ca.OP_SQRT: arithmetic(f"sqrt{precision.suffix}({{0}})", np.sqrt),
        ca.OP_FABS: arithmetic("{0} < {zero} ? -{0} : {0}", lambda a: np.where(a < 0, -a, a)),
        ca.OP_FMAX: arithmetic("{0} > {1} ? {0} : {1}", lambda a, b: np.where(a > b, a, b)),
        ca.OP_FMIN: arithmetic("{0} < {1} ? {0} : {1}", lambda a, b: np.where(a < b, a, b)),
        ca.OP_LT: comparison("{0} < {1}", lambda a, b: a < b),
        ca.OP_LE: comparison("{0} <= {1}", lambda a, b: a <= b),
        ca.OP_EQ: comparison("{0} == {1}", lambda a, b: a == b),
        ca.OP_NE: comparison("{0} != {1}", lambda a, b: a != b),
        ca.OP_NOT: Operation("!{0}", lambda a: ~a, truth=True, of_truth=both),
        ca.OP_AND: Operation("{0} && {1}", lambda a, b: a & b, truth=True, of_truth=both),
        ca.OP_OR: Operation("{0} || {1}", lambda a, b: a | b, truth=True, of_truth=both),
        ca.OP_IF_ELSE_ZERO: Operation("{0} ? {1} : {zero}", lambda a, b: np.where(a, b, zero), of_truth=(True, False)),
        NEAREST: arithmetic(f"({{0}} + {text}) - {text}", lambda a: (a + whole) - whole),
        SELECT: Operation("{0} ? {1} : {2}", np.where, of_truth=(True, False, False)),
    }
