"""CasADi's instructions as C and as numpy: scalars of one precision with equal bits in both, and doubles in lanes.

A scalar program computes each value once; the compiler must neither fuse nor reorder. In lanes a choice is a bit mask
in place of a jump, so that a run has the bits of CasADi's own evaluation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi.model.gains import DeviceLn, double_ln, single_ln

# Numbers between these are printed without an exponent.
_LEAST_PLAIN = 1e-3
_MOST_PLAIN = 1e6


@dataclass(frozen=True)
class Precision:
    """IEEE numbers of one size."""

    name: str
    c_type: str
    suffix: str
    ln: DeviceLn

    @property
    def dtype(self) -> type[Any]:
        """Of numpy."""
        return self.ln.dtype

    @property
    def largest(self) -> float:
        """Largest number."""
        return float(np.finfo(self.dtype).max)

    def literal(self, value: float) -> str:
        """Return a C literal that reads back as exactly the nearest number; InputError beyond this precision."""
        with np.errstate(over="ignore"):
            number = self.dtype(value)
        if not np.isfinite(number):
            raise InputError.of(
                f"the C would contain {value:g}; allowed: below {self.largest:.2g} in {self.name} precision"
            )
        plain = _LEAST_PLAIN <= abs(number) < _MOST_PLAIN or number == 0
        spell = np.format_float_positional if plain else np.format_float_scientific
        text = spell(number, unique=True, trim="0") + self.suffix
        return f"({text})" if text.startswith("-") else text


SINGLE = Precision("single", "float", "f", single_ln)
DOUBLE = Precision("double", "double", "", double_ln)
PRECISIONS = {precision.name: precision for precision in (SINGLE, DOUBLE)}


@dataclass(frozen=True)
class Operation:
    """One operation in scalar C, in numpy, and in C over lanes."""

    c: str
    numpy: Callable[..., Any]
    lanes: str = ""
    truth: bool = False
    of_truth: tuple[bool, ...] = (False, False)


def _rounding(dtype: Any) -> Any:
    """Return the number that leaves no room for a fraction where it is added."""
    return dtype.type(1.5 * 2.0 ** np.finfo(dtype).nmant)


def _nearest(a: Any) -> Any:
    return (a + _rounding(a.dtype)) - _rounding(a.dtype)


_SELECT = "SELECT"
"""Operation condition ? a : b, not of CasADi, which writes it as a sum of two halves."""
_NEAREST = "NEAREST"
"""Operation nearest whole number, not of CasADi."""
# Terms of the series of sin(2 pi u), u up to a quarter, by the bits of the mantissa.
_TERMS = {23: 7, 52: 12}
_BOTH = (True, True)

_SCALAR = {
    "ASSIGN": Operation("{0}", lambda a: a),
    "ADD": Operation("{0} + {1}", lambda a, b: a + b),
    "SUB": Operation("{0} - {1}", lambda a, b: a - b),
    "MUL": Operation("{0} * {1}", lambda a, b: a * b),
    "DIV": Operation("{0} / {1}", lambda a, b: a / b),
    "NEG": Operation("-{0}", lambda a: -a),
    "INV": Operation("{one} / {0}", lambda a: np.float32(1) / a, "SPREAD(1.) / {0}"),
    "SQ": Operation("{0} * {0}", lambda a: a * a),
    "TWICE": Operation("{0} + {0}", lambda a: a + a),
    "SIGN": Operation(
        "{0} > {zero} ? {one} : ({0} < {zero} ? -{one} : {zero})",
        np.sign,
        "PICK({0} < 0., SPREAD(-1.), PICK({0} > 0., SPREAD(1.), {0}))",
    ),
    # IEEE requires the nearest number, of C's library too.
    "SQRT": Operation("sqrt{suffix}({0})", np.sqrt, "each_sqrt({0})"),
    "FABS": Operation(
        "{0} < {zero} ? -{0} : {0}", lambda a: np.where(a < 0, -a, a), "(Lanes)((Bits){0} & 0x7fffffffffffffffLL)"
    ),
    "FMAX": Operation("{0} > {1} ? {0} : {1}", lambda a, b: np.where(a > b, a, b), "LARGER({0}, {1})"),
    "FMIN": Operation("{0} < {1} ? {0} : {1}", lambda a, b: np.where(a < b, a, b), "SMALLER({0}, {1})"),
    "LT": Operation("{0} < {1}", lambda a, b: a < b, "ONE({0} < {1})", truth=True),
    "LE": Operation("{0} <= {1}", lambda a, b: a <= b, "ONE({0} <= {1})", truth=True),
    "EQ": Operation("{0} == {1}", lambda a, b: a == b, "ONE({0} == {1})", truth=True),
    "NE": Operation("{0} != {1}", lambda a, b: a != b, "ONE({0} != {1})", truth=True),
    "NOT": Operation("!{0}", lambda a: ~a, "ONE({0} == 0.)", truth=True, of_truth=_BOTH),
    "AND": Operation("{0} && {1}", lambda a, b: a & b, "ONE(({0} != 0.) & ({1} != 0.))", truth=True, of_truth=_BOTH),
    "OR": Operation("{0} || {1}", lambda a, b: a | b, "ONE(({0} != 0.) | ({1} != 0.))", truth=True, of_truth=_BOTH),
    "IF_ELSE_ZERO": Operation(
        "{0} ? {1} : {zero}",
        lambda a, b: np.where(a, b, np.float32(0)),
        "(Lanes)((Bits){1} & ({0} != 0.))",
        of_truth=(True, False),
    ),
    _NEAREST: Operation("({0} + {rounding}) - {rounding}", _nearest),
    _SELECT: Operation("{0} ? {1} : {2}", np.where, of_truth=(True, False, False)),
}
_TRUTHS = {name for name, operation in _SCALAR.items() if operation.truth}

_OF_ONE = (
    *("floor", "ceil", "sqrt", "log", "log1p", "exp", "expm1", "erf"),
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
)
_OF_TWO = ("fmax", "fmin", "pow", "fmod", "remainder", "atan2", "copysign", "hypot")
_IN_LANES = {"CONSTPOW": "each_pow({0}, {1})"}
_IN_LANES |= {name.upper(): f"each_{name}({{0}}, {{1}})" for name in _OF_TWO}
_IN_LANES |= {name.upper(): f"each_{name}({{0}})" for name in _OF_ONE}
_IN_LANES |= {
    name: operation.lanes or operation.c for name, operation in _SCALAR.items() if name not in {_NEAREST, _SELECT}
}

_HEAD = """
#include <math.h>
#if defined(__AVX512F__)
#define WIDTH 8
#elif defined(__AVX__)
#define WIDTH 4
#else
#define WIDTH 2
#endif
typedef double Lanes __attribute__((vector_size(8 * WIDTH)));
typedef long long Bits __attribute__((vector_size(8 * WIDTH)));
/* Takes 0 away, which changes no number, not even -0. */
#define SPREAD(number) ((number) - (Lanes){0})
#define ONE(yes) ((Lanes)((yes) & (Bits)SPREAD(1.)))
#define PICK(yes, this, that) ((Lanes)(((yes) & (Bits)(this)) | (~(yes) & (Bits)(that))))
#define EACH(name) static inline Lanes each_##name(Lanes a) { \\
  Lanes r; for (int i = 0; i < WIDTH; ++i) r[i] = name(a[i]); return r; }
#define EACH_PAIR(name) static inline Lanes each_##name(Lanes a, Lanes b) { \\
  Lanes r; for (int i = 0; i < WIDTH; ++i) r[i] = name(a[i], b[i]); return r; }
"""
# Of two zeros this library returns the second; others may choose by sign.
_PAIRS = """
#if defined(__x86_64__) && defined(__GLIBC__)
#define LARGER(a, b) PICK(((a) > (b)) | ((b) != (b)), a, b)
#define SMALLER(a, b) PICK(((a) < (b)) | ((b) != (b)), a, b)
#else
#define LARGER(a, b) each_fmax(a, b)
#define SMALLER(a, b) each_fmin(a, b)
#endif
"""

LANES_HEAD = "\n".join(
    [_HEAD, *(f"EACH({name})" for name in _OF_ONE), *(f"EACH_PAIR({name})" for name in _OF_TWO), _PAIRS]
)
"""Head of the C of functions in lanes: `Lanes` of `WIDTH` numbers, and their operations."""


@lru_cache(maxsize=1)
def _names() -> dict[int, str]:
    import casadi  # noqa: PLC0415

    return {value: name.removeprefix("OP_") for name, value in vars(casadi).items() if name.startswith("OP_")}


def _instructions(function: Any) -> Iterator[tuple[str, list[int], list[int], int]]:
    """Yield operation, inputs, outputs and index of each instruction of a function of SX."""
    names = _names()
    for index in range(function.n_instructions()):
        name = names[function.instruction_id(index)]
        yield name, function.instruction_input(index), function.instruction_output(index), index


def in_lanes(function: Any, operands: Sequence[str], results: Sequence[str]) -> str:
    """Return the C of a CasADi function over parallel lanes, a statement an instruction, to follow `LANES_HEAD`."""
    lines = []
    for name, sources, to, index in _instructions(function):
        if name == "INPUT":
            which, element = sources
            value = operands[which].format(element)
        elif name == "CONST":
            value = f"SPREAD({float(function.instruction_constant(index)).hex()})"
        elif name == "OUTPUT":
            lines.append(f"{results[to[0]].format(to[1])} = w{sources[0]};")
            continue
        else:
            value = _IN_LANES[name].format(*(f"w{source}" for source in sources))
        lines.append(f"w{to[0]} = {value};")
    work = ", ".join(f"w{index}" for index in range(max(1, function.sz_w())))
    return "\n  ".join([f"Lanes {work};", *lines])


@dataclass(frozen=True)
class _Node:
    """One value, computed once: an operation on earlier nodes, an input, or a constant."""

    operation: str
    arguments: tuple[int, ...] = ()
    constant: float = 0.0


class FloatProgram:
    """A CasADi function of scalars in one precision, each value computed once: called it is numpy, printed it is C."""

    def __init__(self, function: Any, precision: Precision = SINGLE) -> None:
        """Read the instructions; UnsupportedError for one that has no form in C here."""
        self.precision = precision
        self.inputs = tuple(function.name_in())
        self.outputs = tuple(function.name_out())
        self._nodes: list[_Node] = []
        self._results: dict[int, int] = {}
        self._places: dict[_Node, int] = {}
        latest: dict[int, int] = {}
        for name, sources, to, index in _instructions(function):
            if name == "OUTPUT":
                self._results[to[0]] = latest[sources[0]]
            elif name == "CONST":
                latest[to[0]] = self._number(function.instruction_constant(index))
            elif name == "INPUT":
                latest[to[0]] = self._place_of("INPUT", sources[0])
            elif name in {"FLOOR", "SIN", "COS"}:
                latest[to[0]] = self._expand(name, latest[sources[0]])
            elif name in _SCALAR:
                latest[to[0]] = self._join(name, tuple(latest[source] for source in sources))
            else:
                raise UnsupportedError(f"{function.name()}: the CasADi operation {name} cannot be written as C")
        self._live = self._reachable()

    def _place_of(self, operation: str, *arguments: int, constant: float = 0.0) -> int:
        """Return the place of a value, which is computed once."""
        node = _Node(operation, arguments, constant)
        if node not in self._places:
            self._places[node] = len(self._nodes)
            self._nodes.append(node)
        return self._places[node]

    def _number(self, value: float) -> int:
        return self._place_of("CONST", constant=value)

    def _expand(self, name: str, argument: int) -> int:
        """Expand a library function of C into operations that have the same bits anywhere; return its place."""
        of, number = self._place_of, self._number
        if name == "FLOOR":
            nearest = of(_NEAREST, argument)
            return of("SUB", nearest, of("IF_ELSE_ZERO", of("LT", argument, nearest), number(1.0)))
        # Sine and cosine: the argument in turns, folded into a quarter of a turn, then a power series.
        turns = of("MUL", argument, number(1 / (2 * math.pi)))
        if name == "COS":
            turns = of("ADD", turns, number(0.25))
        rest = of("SUB", turns, of(_NEAREST, turns))
        size = of("FABS", rest)
        quarter = of("FMIN", size, of("SUB", number(0.5), size))
        square = of("SQ", quarter)
        count = _TERMS[np.finfo(self.precision.dtype).nmant]
        terms = [(-1) ** n * (2 * math.pi) ** (2 * n + 1) / math.factorial(2 * n + 1) for n in range(count)]
        series = number(terms[-1])
        for term in reversed(terms[:-1]):
            series = of("ADD", of("MUL", series, square), number(term))
        sine = of("MUL", quarter, series)
        return of(_SELECT, of("LT", rest, number(0.0)), of("NEG", sine), sine)

    def _join(self, name: str, arguments: tuple[int, ...]) -> int:
        """Join (c ? a : 0) + (!c ? b : 0) into one choice."""
        halves = [self._nodes[place] for place in arguments]
        if name == "ADD" and all(half.operation == "IF_ELSE_ZERO" for half in halves):
            (first, a), (second, b) = (half.arguments for half in halves)
            if self._nodes[second] == _Node("NOT", (first,)):
                return self._place_of(_SELECT, first, a, b)
            if self._nodes[first] == _Node("NOT", (second,)):
                return self._place_of(_SELECT, second, b, a)
        return self._place_of(name, *arguments)

    def _reachable(self) -> list[int]:
        """Return the places that the results depend on, in order."""
        live = set(self._results.values())
        for place in range(len(self._nodes) - 1, -1, -1):
            if place in live and self._nodes[place].operation in _SCALAR:
                live |= set(self._nodes[place].arguments)
        return sorted(live)

    def __call__(self, *values: Any) -> tuple[NDArray[Any], ...]:
        """Run on scalars or arrays, one value for each input."""
        dtype = self.precision.dtype
        inputs = [np.asarray(value, dtype=dtype) for value in values]
        work: dict[int, Any] = {}
        with np.errstate(all="ignore"):
            for place in self._live:
                node = self._nodes[place]
                if node.operation == "CONST":
                    work[place] = np.asarray(node.constant, dtype=dtype)
                elif node.operation == "INPUT":
                    work[place] = inputs[node.arguments[0]]
                else:
                    operation = _SCALAR[node.operation]
                    pairs = zip(node.arguments, operation.of_truth, strict=False)
                    work[place] = operation.numpy(*(self._as(work[argument], truth=truth) for argument, truth in pairs))
        return tuple(self._as(work[self._results[index]], truth=False) for index in range(len(self.outputs)))

    def _as(self, value: Any, *, truth: bool) -> NDArray[Any]:
        array = np.asarray(value)
        if truth:
            return array if array.dtype == np.bool_ else array != 0
        return array.astype(self.precision.dtype, copy=False)

    def c_lines(
        self, of_input: Callable[[str], str], of_output: Callable[[str], str | None], *, prefix: str = ""
    ) -> list[str]:
        """Return the statements of a C function; an output may share its place with an input, as a state does."""
        real, literal = self.precision.c_type, self.precision.literal
        words = {"zero": literal(0.0), "one": literal(1.0), "suffix": self.precision.suffix}
        words["rounding"] = literal(float(_rounding(np.dtype(self.precision.dtype))))
        names: dict[int, str] = {}
        lines: list[str] = []

        def value(argument: int, *, truth: bool) -> str:
            """Return the expression of a value, as a number or as a boolean."""
            if truth == (self._nodes[argument].operation in _TRUTHS):
                return names[argument]
            return ("({} != {zero})" if truth else "({} ? {one} : {zero})").format(names[argument], **words)

        for place in self._live:
            node = self._nodes[place]
            if node.operation == "CONST":
                names[place] = literal(node.constant)
            elif node.operation == "INPUT":
                names[place] = of_input(self.inputs[node.arguments[0]])
            else:
                operation = _SCALAR[node.operation]
                pairs = zip(node.arguments, operation.of_truth, strict=False)
                arguments = [value(argument, truth=truth) for argument, truth in pairs]
                names[place] = f"{prefix}v{place}"
                kind = "bool" if operation.truth else real
                lines.append(f"const {kind} {names[place]} = {operation.c.format(*arguments, **words)};")
        # States are read throughout the body: none is written before all is computed.
        late, stores = [], []
        for index, name in enumerate(self.outputs):
            output = of_output(name)
            if output is None:
                continue
            result = value(self._results[index], truth=False)
            if "->" in result:
                late.append(f"const {real} {prefix}r{index} = {result};")
                result = f"{prefix}r{index}"
            stores.append(f"{output} = {result};")
        return lines + late + stores
