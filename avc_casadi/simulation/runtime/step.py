"""Step: one algorithm of the control computer as one CasADi function of fixed size, for scenes and firmware."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

# A CasADi SX expression; CasADi ships no types.
Expr = Any


@dataclass(frozen=True)
class Step:
    """One tick of an algorithm: (state, input, parameter) -> (next state, output), all columns.

    The function uses only arithmetic, comparisons, minimum and maximum: no library call, no NaN, no loop. Every state
    is bounded, so that single precision suffices for any running time.
    """

    name: str
    states: tuple[str, ...]
    initial: tuple[float, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    function: Any

    def apply(self, state: list[Expr], inputs: list[Expr], parameters: list[Expr]) -> tuple[list[Expr], list[Expr]]:
        """Apply the tick to expressions and return the next states and the outputs."""
        import casadi as ca  # noqa: PLC0415

        columns = (ca.SX(ca.vertcat(*part)) if part else ca.SX(0, 1) for part in (state, inputs, parameters))
        following, outputs = self.function(*columns)
        return list(ca.vertsplit(following)), list(ca.vertsplit(outputs))


@dataclass
class StepBuilder:
    """Collects the parts of a step."""

    _states: dict[str, tuple[Expr, float]] = field(default_factory=dict)
    _inputs: dict[str, Expr] = field(default_factory=dict)
    _parameters: dict[str, Expr] = field(default_factory=dict)
    _outputs: dict[str, Expr] = field(default_factory=dict)
    _next: dict[str, Expr] = field(default_factory=dict)

    def state(self, name: str, initial: float = 0.0) -> Expr:
        """Add a state."""
        return self._states.setdefault(name, (_symbol(name), initial))[0]

    def input(self, name: str) -> Expr:
        """Add an input."""
        return self._inputs.setdefault(name, _symbol(name))

    def parameter(self, name: str) -> Expr:
        """Add a parameter."""
        return self._parameters.setdefault(name, _symbol(name))

    def follow(self, name: str, value: Expr) -> None:
        """Set the next value of a state."""
        self._next[name] = value

    def output(self, name: str, value: Expr) -> None:
        """Add an output."""
        self._outputs[name] = value

    def insert(self, prefix: str, step: Step, inputs: list[Expr]) -> dict[str, Expr]:
        """Insert another step, which has no parameters, and return its outputs."""
        names = [f"{prefix}_{name}" for name in step.states]
        state = [self.state(name, initial) for name, initial in zip(names, step.initial, strict=True)]
        following, outputs = step.apply(state, inputs, [])
        for name, value in zip(names, following, strict=True):
            self.follow(name, value)
        return dict(zip(step.outputs, outputs, strict=True))

    def done(self, name: str) -> Step:
        """Return the step."""
        import casadi as ca  # noqa: PLC0415

        def column(values: list[Expr]) -> Expr:
            return ca.vertcat(*values) if values else ca.SX(0, 1)

        symbols = [symbol for symbol, _ in self._states.values()]
        function = ca.Function(
            name,
            [column(symbols), column(list(self._inputs.values())), column(list(self._parameters.values()))],
            [ca.SX(column([self._next[key] for key in self._states])), ca.SX(column(list(self._outputs.values())))],
            ["state", "input", "parameter"],
            ["next", "output"],
            # Numbers may be symbols of what surrounds the step.
            {"allow_free": True},
        )
        return Step(
            name=name,
            states=tuple(self._states),
            initial=tuple(initial for _, initial in self._states.values()),
            inputs=tuple(self._inputs),
            parameters=tuple(self._parameters),
            outputs=tuple(self._outputs),
            function=function,
        )


def _symbol(name: str) -> Expr:
    import casadi as ca  # noqa: PLC0415

    return ca.SX.sym(name)
