"""A CasADi expression as single-precision C, and the same operations in numpy: one program, equal bits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi import UnsupportedError
from avc_hardware._table import Float32Array

_ONE, _ZERO = np.float32(1), np.float32(0)


def _chosen(condition: Float32Array, one: Float32Array, other: Float32Array) -> Float32Array:
    return np.where(condition, one, other)


@dataclass(frozen=True)
class _Operation:
    """How an operation is written in C and done in numpy; neither may be fused or reordered."""

    c: str
    numpy: Callable[..., Float32Array]


def _operations(ca: Any) -> dict[int, _Operation]:
    return {
        ca.OP_ASSIGN: _Operation("{0}", lambda a: a),
        ca.OP_ADD: _Operation("{0} + {1}", lambda a, b: a + b),
        ca.OP_SUB: _Operation("{0} - {1}", lambda a, b: a - b),
        ca.OP_MUL: _Operation("{0} * {1}", lambda a, b: a * b),
        ca.OP_DIV: _Operation("{0} / {1}", lambda a, b: a / b),
        ca.OP_NEG: _Operation("-{0}", lambda a: -a),
        ca.OP_INV: _Operation("1.0f / {0}", lambda a: _ONE / a),
        ca.OP_SQ: _Operation("{0} * {0}", lambda a: a * a),
        ca.OP_TWICE: _Operation("{0} + {0}", lambda a: a + a),
        ca.OP_FABS: _Operation("{0} < 0.0f ? -{0} : {0}", lambda a: _chosen(a < 0, -a, a)),
        ca.OP_FMAX: _Operation("{0} > {1} ? {0} : {1}", lambda a, b: _chosen(a > b, a, b)),
        ca.OP_FMIN: _Operation("{0} < {1} ? {0} : {1}", lambda a, b: _chosen(a < b, a, b)),
        ca.OP_LT: _Operation("{0} < {1} ? 1.0f : 0.0f", lambda a, b: _chosen(a < b, _ONE, _ZERO)),
        ca.OP_LE: _Operation("{0} <= {1} ? 1.0f : 0.0f", lambda a, b: _chosen(a <= b, _ONE, _ZERO)),
        ca.OP_NOT: _Operation("{0} > 0.0f ? 0.0f : 1.0f", lambda a: _chosen(a > 0, _ZERO, _ONE)),
        ca.OP_IF_ELSE_ZERO: _Operation("{0} > 0.0f ? {1} : 0.0f", lambda a, b: _chosen(a > 0, b, _ZERO)),
    }


@dataclass(frozen=True)
class _Step:
    operation: int
    inputs: tuple[int, ...]
    output: int
    constant: float


class FloatProgram:
    """The instructions of a CasADi function of scalars, in CasADi's order.

    Attributes:
        inputs: names of the scalar inputs.
        outputs: names of the scalar outputs.
    """

    def __init__(self, function: Any) -> None:
        """Take the instructions of an SX function whose inputs and outputs are all scalars.

        Raises:
            UnsupportedError: an operation that has no single-precision form here.
        """
        import casadi as ca  # noqa: PLC0415

        self._ca = ca
        self._operations = _operations(ca)
        self.inputs = tuple(function.name_in())
        self.outputs = tuple(function.name_out())
        self._steps = []
        for index in range(function.n_instructions()):
            operation = function.instruction_id(index)
            if operation not in {ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, *self._operations}:
                raise UnsupportedError(f"{function.name()}: CasADi operation {operation} has no single-precision form")
            self._steps.append(
                _Step(
                    operation,
                    tuple(function.instruction_input(index)),
                    function.instruction_output(index)[0],
                    function.instruction_constant(index) if operation == ca.OP_CONST else 0.0,
                )
            )

    def __call__(self, *values: Any) -> tuple[Float32Array, ...]:
        """Run in single precision on scalars or arrays, one value an input."""
        given = [np.asarray(value, dtype=np.float32) for value in values]
        work: dict[int, Float32Array] = {}
        results: dict[int, Float32Array] = {}
        with np.errstate(all="ignore"):
            for step in self._steps:
                if step.operation == self._ca.OP_CONST:
                    work[step.output] = np.asarray(step.constant, dtype=np.float32)
                elif step.operation == self._ca.OP_INPUT:
                    work[step.output] = given[step.inputs[0]]
                elif step.operation == self._ca.OP_OUTPUT:
                    results[step.output] = work[step.inputs[0]]
                else:
                    chosen = self._operations[step.operation]
                    work[step.output] = np.asarray(chosen.numpy(*(work[at] for at in step.inputs)), dtype=np.float32)
        return tuple(results[index] for index in range(len(self.outputs)))

    def c_body(self, of_input: Callable[[str], str], of_output: Callable[[str], str]) -> list[str]:
        """Return the lines of a C function body, without braces."""
        lines: list[str] = []
        names: dict[int, str] = {}
        stores: list[str] = []
        for number, step in enumerate(self._steps):
            if step.operation == self._ca.OP_CONST:
                names[step.output] = literal(np.float32(step.constant))
                continue
            if step.operation == self._ca.OP_INPUT:
                names[step.output] = of_input(self.inputs[step.inputs[0]])
                continue
            arguments = [names[at] for at in step.inputs]
            if step.operation == self._ca.OP_OUTPUT:
                # stored at the end: an output may share its place with an input
                stores.append(f"{of_output(self.outputs[step.output])} = {arguments[0]};")
                continue
            name = f"v{number}"
            lines.append(f"const float {name} = {self._operations[step.operation].c.format(*arguments)};")
            names[step.output] = name
        return lines + stores


def literal(value: np.float32) -> str:
    """Return a C literal that reads back as exactly this number."""
    text = np.format_float_scientific(value, unique=True, trim="0")
    return f"({text}f)" if text.startswith("-") else f"{text}f"
