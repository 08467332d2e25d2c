"""One sample of the loop, its states, inputs, parameters and traces owned by effects; and the steps inserted there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.runtime import PLAIN, Poles


class _CasADi:
    """CasADi, which takes long to load, imported at its first use."""

    def __getattr__(self, name: str) -> Any:
        import casadi  # noqa: PLC0415

        return getattr(casadi, name)


ca: Any = _CasADi()
# A CasADi SX expression; CasADi ships no types.
Expr = Any


def column(*symbols: Expr) -> Expr:
    """Stack symbols, in the order in which CasADi stores their entries."""
    return ca.veccat(*symbols) if symbols else ca.SX(0, 1)


# (samples, seed of the run) -> one number a sample.
InputValues = Callable[[int, int], FloatArray]


@dataclass
class Slot:
    """One named vector of the step function."""

    name: str
    symbol: Expr
    initial: float = 0.0
    values: InputValues | None = None


@dataclass(frozen=True)
class TickGains:
    """Gains of the coupling that change from sample to sample, as expressions."""

    damping_ns_per_m: Expr
    stiffness_n_per_m: Expr
    contact_damping_ns_per_m: Expr
    anchor_m: Expr
    touching: Expr


@dataclass
class Tick:
    """The loop at one sample, built up station by station; signals are None where no effect has set them."""

    sample_time_s: float
    start_m: float
    position: Expr = None
    observing: Expr = None
    command: Expr = None
    command_before: Expr = None
    poles: Poles = PLAIN
    late: Expr = None
    undelayed: Expr = None
    dropped: Expr = None
    frequency_hz: Expr = None
    frequency_valid: Expr = None
    adapt: Callable[[Expr, bool], TickGains] | None = None
    adaptive: TickGains | None = None
    environment_energy_j: Expr = 0.0
    coupling_energy_j: Expr = 0.0
    at_end: list[Callable[[], None]] = field(default_factory=list)
    states: list[Slot] = field(default_factory=list)
    inputs: list[Slot] = field(default_factory=list)
    parameters: list[Slot] = field(default_factory=list)
    traces: dict[str, Expr] = field(default_factory=dict)
    _next: dict[str, Expr] = field(default_factory=dict)
    _computed: set[str] = field(default_factory=set)

    @property
    def rate_gain_per_s(self) -> float:
        """Weight of the newest value in a velocity, 1/T without a filter."""
        return (1.0 + self.poles[0] + self.poles[1]) / self.sample_time_s

    def state(self, name: str, initial: float = 0.0, *, computed: bool = True) -> Expr:
        """Add a state; a `computed` one belongs to the computer and stays unchanged in a dropped sample."""
        if computed:
            self._computed.add(name)
        return self._add(self.states, name, initial=initial)

    def input(self, name: str, values: InputValues) -> Expr:
        """Add a signal that is known beforehand at every sample."""
        return self._add(self.inputs, name, values=values)

    def parameter(self, name: str, sparsity: Any = None) -> Expr:
        """Add a number (or a matrix of the given sparsity) that a run sets, for example for each hand."""
        return self._add(self.parameters, name, sparsity=sparsity)

    def since_start(self, before: Expr) -> Expr:
        """Return the previous value of what moves with the position; an observer begins at the same."""
        return before if self.observing is None else ca.if_else(self.observing, before, self.position)

    def follow(self, name: str, value: Expr) -> None:
        """Set the next value of a state."""
        self._next[name] = value

    def previous_force(self, *, delayed: bool) -> Expr:
        """Return the force of the previous sample, as held or as commanded before any delay: a state added once."""
        name = "held_force_n" if delayed else "asked_force_n"
        state = self.find_state(name)
        if state is not None:
            return state

        def settle() -> None:
            value = self.command if delayed or self.undelayed is None else self.undelayed
            self.follow(name, 0.0 if value is None else value)

        self.at_end.append(settle)
        return self.state(name, computed=not delayed)

    def find_state(self, name: str) -> Expr:
        """Return the symbol of an existing state, or None."""
        return next((slot.symbol for slot in self.states if slot.name == name), None)

    def trace(self, name: str, value: Expr) -> None:
        """Record a signal."""
        self.traces[name] = value

    def successors(self) -> list[Expr]:
        """Return the next value of every state, in order."""
        if self.dropped is None:
            return [self._next[slot.name] for slot in self.states]
        return [
            ca.if_else(self.dropped, slot.symbol, self._next[slot.name])
            if slot.name in self._computed
            else self._next[slot.name]
            for slot in self.states
        ]

    def _add(self, slots: list[Slot], name: str, *, sparsity: Any = None, **content: Any) -> Expr:
        symbol = ca.SX.sym(name) if sparsity is None else ca.SX.sym(name, sparsity)
        slots.append(Slot(name, symbol, **content))
        return symbol


class Rate:
    """Velocity in the computer, gain * value - offset: the value may be known only later, in an implicit force law."""

    def __init__(
        self, tick: Tick, name: str, initial: float = 0.0, *, view: Callable[[Expr], Expr] = lambda before: before
    ) -> None:
        """Add the states."""
        self._tick = tick
        self._name = name
        before = view(tick.state(f"{name}_before_m", initial))
        self.before = before
        self.gain = tick.rate_gain_per_s
        self.offset: Expr = self.gain * before
        self._rates: list[tuple[str, Expr]] = []
        for name_of, pole in zip(("rate", "older_rate"), tick.poles, strict=True):
            if pole:
                self._rates.append((f"{name}_{name_of}_m_per_s", tick.state(f"{name}_{name_of}_m_per_s")))
                self.offset += pole * self._rates[-1][1]

    def settle(self, value: Expr) -> Expr:
        """Set the value of this sample and return its rate."""
        rate = self.gain * value - self.offset
        self._tick.follow(f"{self._name}_before_m", value)
        following = rate
        for name, now in self._rates:
            self._tick.follow(name, following)
            following = now
        return rate


@dataclass(frozen=True)
class Step:
    """One tick, (state, input, parameter) -> (next state, output): no library call, NaN or loop, all states bounded."""

    name: str
    states: tuple[str, ...]
    initial: tuple[float, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    function: Any


@dataclass
class StepBuilder:
    """Collects the parts of a step."""

    _states: dict[str, tuple[Expr, float]] = field(default_factory=dict)
    _inputs: dict[str, Expr] = field(default_factory=dict)
    _parameters: dict[str, Expr] = field(default_factory=dict)
    _next: dict[str, Expr] = field(default_factory=dict)

    def state(self, name: str, initial: float = 0.0) -> Expr:
        """Add a state."""
        return self._states.setdefault(name, (ca.SX.sym(name), initial))[0]

    def input(self, name: str) -> Expr:
        """Add an input."""
        return self._inputs.setdefault(name, ca.SX.sym(name))

    def parameter(self, name: str) -> Expr:
        """Add a parameter."""
        return self._parameters.setdefault(name, ca.SX.sym(name))

    def follow(self, name: str, value: Expr) -> None:
        """Set the next value of a state."""
        self._next[name] = value

    def only_where(self, runs: Expr) -> None:
        """Let all states so far keep their values where a condition is false."""
        self._next = {name: ca.if_else(runs, self._next[name], symbol) for name, (symbol, _) in self._states.items()}

    def build(self, name: str, **outputs: Expr) -> Step:
        """Return the step with its outputs."""
        symbols = [symbol for symbol, _ in self._states.values()]
        function = ca.Function(
            name,
            [column(*symbols), column(*self._inputs.values()), column(*self._parameters.values())],
            [ca.SX(column(*(self._next[key] for key in self._states))), ca.SX(column(*outputs.values()))],
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
            outputs=tuple(outputs),
            function=function,
        )


def delay_line(host: Tick | StepBuilder, name: str, newest: Expr, length: int) -> list[Expr]:
    """Return a force and its values of the last samples, the newest first."""
    line = [newest]
    for place in range(1, length + 1):
        before = host.state(f"{name}_{place}_n")
        host.follow(f"{name}_{place}_n", line[-1])
        line.append(before)
    return line


def insert(
    host: Tick | StepBuilder, prefix: str, step: Step, inputs: list[Expr], parameters: Sequence[Expr] = ()
) -> dict[str, Expr]:
    """Add a step's states to a sample, or to another step, and return its outputs."""
    names = [f"{prefix}_{name}" for name in step.states]
    state = [host.state(name, initial) for name, initial in zip(names, step.initial, strict=True)]
    following, outputs = step.function(*(ca.SX(column(*part)) for part in (state, inputs, parameters)))
    for name, value in zip(names, ca.vertsplit(following), strict=True):
        host.follow(name, value)
    return dict(zip(step.outputs, ca.vertsplit(outputs), strict=True))
