"""What a CasADi operation is in C and in numpy: the same operation of one precision, equal bits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_hardware._precision import Precision

Value = Any  # an array of the program's precision, or of truths


@dataclass(frozen=True)
class Operation:
    """How an operation is written in C and done in numpy; the compiler must neither fuse nor reorder.

    Attributes:
        c: with places for the arguments and the numbers zero and one.
        numpy: the same.
        truth: whether the result is a truth value.
        of_truth: which arguments are truth values.
    """

    c: str
    numpy: Callable[..., Value]
    truth: bool = False
    of_truth: tuple[bool, ...] = (False, False)


SELECT = -1  # condition ? a : b, which CasADi writes as a sum of two halves
NEAREST = -2  # the nearest whole number, as a sum too large to hold a fraction leaves it; none of those beyond it
# Terms of the series of sin(2 pi u), u up to a quarter, by the bits of the precision.
TERMS = {24: 7, 53: 12}


def operations(ca: Any, precision: Precision) -> dict[int, Operation]:
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
