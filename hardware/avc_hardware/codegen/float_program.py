"""A CasADi expression as C of one precision, and the same operations in numpy: one program, equal bits."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Collection, Container, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi import UnsupportedError
from avc_hardware.codegen.operations import NEAREST, SELECT, SINGLE, TERMS, Precision, Value, operations


@dataclass(frozen=True)
class _Node:
    """One value, computed once: an operation on earlier nodes, an input, or a constant."""

    operation: int
    arguments: tuple[int, ...] = ()
    constant: float = 0.0


@dataclass
class _Body:
    """The statements of a C function under construction.

    Attributes:
        of_input: expression of an input.
        constants: by place, the expression of a constant in place of its number.
        prefix: of the names of values.
        names: of the defined values, by place.
        truths: places of the boolean ones.
        lines: the statements.
    """

    of_input: Callable[[str], str]
    constants: Mapping[int, str]
    prefix: str = ""
    names: dict[int, str] = field(default_factory=dict)
    truths: set[int] = field(default_factory=set)
    lines: list[str] = field(default_factory=list)


class FloatProgram:
    """The instructions of a CasADi function of scalars, in CasADi's order, each value computed once.

    Attributes:
        inputs: names of the scalar inputs.
        outputs: names of the scalar outputs.
        precision: of every operation.
    """

    def __init__(self, function: Any, precision: Precision = SINGLE) -> None:
        """Read the instructions of an SX function whose inputs and outputs are all scalars.

        Raises:
            UnsupportedError: an operation that has no form in C here.
        """
        import casadi as ca  # noqa: PLC0415

        self._ca = ca
        self.precision = precision
        self._operations = operations(ca, precision)
        self.inputs = tuple(function.name_in())
        self.outputs = tuple(function.name_out())
        self._nodes: list[_Node] = []
        self._results: dict[int, int] = {}
        self._known: dict[_Node, int] = {}
        latest: dict[int, int] = {}
        for index in range(function.n_instructions()):
            operation = function.instruction_id(index)
            inputs = function.instruction_input(index)
            output = function.instruction_output(index)[0]
            if operation == ca.OP_OUTPUT:
                self._results[output] = latest[inputs[0]]
                continue
            if operation == ca.OP_CONST:
                node = _Node(operation, constant=function.instruction_constant(index))
            elif operation == ca.OP_INPUT:
                node = _Node(operation, (inputs[0],))
            elif operation in (ca.OP_FLOOR, ca.OP_SIN, ca.OP_COS):
                latest[output] = self._written_out(operation, latest[inputs[0]])
                continue
            elif operation in self._operations:
                node = self._joined(_Node(operation, tuple(latest[at] for at in inputs)))
            else:
                raise UnsupportedError(f"{function.name()}: CasADi operation {operation} has no form in C")
            latest[output] = self._place_of(node)
        self._needed = self._reachable()

    def _place_of(self, node: _Node) -> int:
        """Return the place of a value, which is computed once."""
        if node not in self._known:
            self._known[node] = len(self._nodes)
            self._nodes.append(node)
        return self._known[node]

    def _written_out(self, operation: int, at: int) -> int:
        """Expand a library function of C into operations that have the same bits anywhere; return its place.

        The sine is that of the nearest turn, folded to a quarter of it, as a series.
        """
        ca = self._ca

        def of(operation: int, *arguments: int) -> int:
            return self._place_of(_Node(operation, arguments))

        def number(value: float) -> int:
            return self._place_of(_Node(ca.OP_CONST, constant=value))

        if operation == ca.OP_FLOOR:
            nearest = of(NEAREST, at)
            above = of(ca.OP_LT, at, nearest)
            return of(ca.OP_SUB, nearest, of(ca.OP_IF_ELSE_ZERO, above, number(1.0)))
        turns = of(ca.OP_MUL, at, number(1 / (2 * math.pi)))
        if operation == ca.OP_COS:
            turns = of(ca.OP_ADD, turns, number(0.25))
        rest = of(ca.OP_SUB, turns, of(NEAREST, turns))
        size = of(ca.OP_FABS, rest)
        folded = of(ca.OP_FMIN, size, of(ca.OP_SUB, number(0.5), size))
        square = of(ca.OP_SQ, folded)
        terms = [(-1) ** n * (2 * math.pi) ** (2 * n + 1) / math.factorial(2 * n + 1) for n in range(self._terms)]
        series = number(terms[-1])
        for term in reversed(terms[:-1]):
            series = of(ca.OP_ADD, of(ca.OP_MUL, series, square), number(term))
        found = of(ca.OP_MUL, folded, series)
        return of(SELECT, of(ca.OP_LT, rest, number(0.0)), of(ca.OP_NEG, found), found)

    @property
    def _terms(self) -> int:
        return TERMS[self.precision.bits]

    def _joined(self, node: _Node) -> _Node:
        """Join (c ? a : 0) + (!c ? b : 0) into one choice."""
        ca = self._ca
        if node.operation != ca.OP_ADD:
            return node
        halves = [self._nodes[at] for at in node.arguments]
        if any(half.operation != ca.OP_IF_ELSE_ZERO for half in halves):
            return node
        (first, a), (second, b) = (half.arguments for half in halves)
        if self._nodes[second] == _Node(ca.OP_NOT, (first,)):
            return _Node(SELECT, (first, a, b))
        if self._nodes[first] == _Node(ca.OP_NOT, (second,)):
            return _Node(SELECT, (second, b, a))
        return node

    def _reachable(self, known: Container[int] = (), wanted: Iterable[int] | None = None) -> list[int]:
        """Return the places that some results depend on, in order; known values have no dependencies."""
        needed = set(self._results.values() if wanted is None else wanted)
        for at in range(len(self._nodes) - 1, -1, -1):
            if at in needed and at not in known and self._nodes[at].operation in self._operations:
                needed |= set(self._nodes[at].arguments)
        return sorted(needed)

    def knowing(self, truths: Mapping[str, bool]) -> FloatProgram:
        """Return the program specialised to boolean inputs of known value: the choices are made, the rest is unchanged.

        Args:
            truths: by name of the input. Places of constants are unchanged.
        """
        ca = self._ca
        known: dict[int, bool] = {}
        stands_for: list[int] = []
        nodes: list[_Node] = []
        for at, own in enumerate(self._nodes):
            stands_for.append(at)
            if own.operation == ca.OP_INPUT:
                name = self.inputs[own.arguments[0]]
                if name in truths:
                    known[at] = truths[name]
                nodes.append(own)
                continue
            node = replace(own, arguments=tuple(stands_for[argument] for argument in own.arguments))
            truth = known.get(node.arguments[0]) if node.arguments else None
            if truth is not None and node.operation == ca.OP_NOT:
                known[at] = not truth
            elif truth is not None and node.operation == SELECT:
                stands_for[at] = node.arguments[1 if truth else 2]
            elif truth is not None and node.operation == ca.OP_IF_ELSE_ZERO:
                if truth:
                    stands_for[at] = node.arguments[1]
                else:
                    node = _Node(ca.OP_CONST)
            nodes.append(node)
        made: FloatProgram = copy.copy(self)
        made._nodes = nodes
        made._results = {index: stands_for[at] for index, at in self._results.items()}
        made._needed = made._reachable()
        return made

    def constants_of(self, other: FloatProgram) -> dict[int, float] | None:
        """Return the values of this program's constants in another, by place.

        Returns:
            None where the other has another form: other operations, or one constant with two values.
        """
        found: dict[int, float] = {}
        seen: set[tuple[int, int]] = set()
        pairs = [(self._results[index], other._results[index]) for index in self._results]
        while pairs:
            own, its = pair = pairs.pop()
            if pair in seen:
                continue
            seen.add(pair)
            node, twin = self._nodes[own], other._nodes[its]
            if node.operation != twin.operation:
                return None
            if node.operation == self._ca.OP_CONST:
                if found.setdefault(own, twin.constant) != twin.constant:
                    return None
            elif node.operation == self._ca.OP_INPUT:
                if node.arguments != twin.arguments:
                    return None
            else:
                pairs.extend(zip(node.arguments, twin.arguments, strict=True))
        return found

    def __call__(self, *values: Any) -> tuple[NDArray[Any], ...]:
        """Run in the program's precision on scalars or arrays, one value per input."""
        dtype = self.precision.dtype
        given = [np.asarray(value, dtype=dtype) for value in values]
        work: dict[int, Value] = {}
        with np.errstate(all="ignore"):
            for at in self._needed:
                node = self._nodes[at]
                if node.operation == self._ca.OP_CONST:
                    work[at] = np.asarray(node.constant, dtype=dtype)
                elif node.operation == self._ca.OP_INPUT:
                    work[at] = given[node.arguments[0]]
                else:
                    chosen = self._operations[node.operation]
                    pairs = zip(node.arguments, chosen.of_truth, strict=False)
                    work[at] = chosen.numpy(*(self._as(work[argument], truth=truth) for argument, truth in pairs))
        return tuple(self._as(work[self._results[index]], truth=False) for index in range(len(self.outputs)))

    def _as(self, value: Value, *, truth: bool) -> NDArray[Any]:
        array = np.asarray(value)
        if truth:
            return array if array.dtype == np.bool_ else array != 0
        return array.astype(self.precision.dtype, copy=False)

    def settled_by(self, inputs: Collection[str], constants: Collection[int] = ()) -> tuple[int, ...]:
        """Return the values that depend on some inputs alone and are used with others too.

        Args:
            inputs: names; given once for many runs.
            constants: places of constants that count as such inputs.
        """
        ca = self._ca
        known: set[int] = set()
        asked: set[int] = set(self._results.values())
        for at in self._needed:
            node = self._nodes[at]
            if node.operation == ca.OP_CONST:
                given = at in constants
            elif node.operation == ca.OP_INPUT:
                given = self.inputs[node.arguments[0]] in inputs
            else:
                literal = {place for place in node.arguments if self._nodes[place].operation == ca.OP_CONST}
                given = set(node.arguments) <= known | literal
                if not given:
                    asked |= set(node.arguments)
            if given:
                known.add(at)
        return tuple(sorted(known & asked))

    def c_lines(
        self,
        of_input: Callable[[str], str],
        of_output: Callable[[str], str | None],
        *,
        constants: Mapping[int, str] | None = None,
        kept: Mapping[int, str] | None = None,
        prefix: str = "",
    ) -> list[str]:
        """Return the statements of a C function; an output may share its place with an input, as a state does.

        Args:
            of_input: expression of an input.
            of_output: target of an output; None where it is unused.
            constants: by place, the expression of a constant in place of its number.
            kept: by place, where precomputed values are stored (`settled_by`, `settling_lines`).
            prefix: of the names of values, for two programs in one function.
        """
        there = kept or {}
        real = self.precision.c_type
        body = _Body(of_input, constants or {}, prefix, dict(there))
        self._write(body, self._reachable(there))
        # States are read throughout the body: none is written before all is computed.
        late, stores = [], []
        for index, name in enumerate(self.outputs):
            place = of_output(name)
            if place is None:
                continue
            value = self._value(body, self._results[index], truth=False)
            if "->" in value and value not in there.values():
                late.append(f"const {real} {prefix}r{index} = {value};")
                value = f"{prefix}r{index}"
            stores.append(f"{place} = {value};")
        return body.lines + late + stores

    def settling_lines(
        self, of_input: Callable[[str], str], kept: Mapping[int, str], *, constants: Mapping[int, str] | None = None
    ) -> list[str]:
        """Return the statements that compute and store the values to be kept."""
        body = _Body(of_input, constants or {})
        self._write(body, self._reachable((), kept))
        return body.lines + [f"{place} = {self._value(body, at, truth=False)};" for at, place in kept.items()]

    def _write(self, body: _Body, places: list[int]) -> None:
        """Add the statements that compute the values at some places, in order."""
        zero, one = self.precision.literal(0.0), self.precision.literal(1.0)
        for at in places:
            if at in body.names:
                continue
            node = self._nodes[at]
            if node.operation == self._ca.OP_CONST:
                body.names[at] = body.constants.get(at) or self.precision.literal(node.constant)
            elif node.operation == self._ca.OP_INPUT:
                body.names[at] = body.of_input(self.inputs[node.arguments[0]])
            else:
                chosen = self._operations[node.operation]
                pairs = zip(node.arguments, chosen.of_truth, strict=False)
                given = [self._value(body, value, truth=truth) for value, truth in pairs]
                text = chosen.c.format(*given, zero=zero, one=one)
                body.names[at] = f"{body.prefix}v{at}"
                if chosen.truth:
                    body.truths.add(at)
                kind = "bool" if chosen.truth else self.precision.c_type
                body.lines.append(f"const {kind} {body.names[at]} = {text};")

    def _value(self, body: _Body, at: int, *, truth: bool) -> str:
        """Return the expression of a value, as a number or as a boolean."""
        name, literal = body.names[at], self.precision.literal
        if truth == (at in body.truths):
            return name
        return f"({name} != {literal(0.0)})" if truth else f"({name} ? {literal(1.0)} : {literal(0.0)})"
