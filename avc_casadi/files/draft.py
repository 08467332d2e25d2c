"""A draft of a file from the options of `avc new`: values as typed, what is assumed, what is not known."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.files.new_options import (
    CONTACT,
    DAMPERS,
    DELAY,
    ENCODER,
    HANDS,
    HOLDS,
    MASS,
    OWN_RANGES,
    RADIUS,
    RATE,
    SPANS,
    Option,
)
from avc_casadi.files.toml import toml_value
from avc_casadi.model.hands import FINGERTIP
from avc_casadi.model.unit_text import read_quantity, unit_of_key

_LEAST_RECIPROCAL = 1.0
"""From here on a number without a unit is no sample time in s and no encoder step in m or rad."""
_STAND_IN_PERIOD_S = 1e-3
"""Stands in place of a faulty rate, which is reported by itself."""


@dataclass(frozen=True)
class Draft(ABC):
    """A draft of a file: `typed` are the values of options by key, as typed."""

    path: Path
    motion: MotionKind = "linear"
    held: str = "grip"
    typed: Mapping[str, str] = field(default_factory=dict)

    @property
    def units(self) -> Units:
        """Names and units of its motion."""
        return units_for(self.motion)

    @abstractmethod
    def options(self) -> tuple[Option, ...]:
        """Return the options for such a device and such hands."""

    def required(self) -> tuple[Option, ...]:
        """Return the options without which there is no file."""
        return tuple(option for option in self.options() if option in (RADIUS, *HANDS))

    @abstractmethod
    def problem(self) -> object:
        """Return the problem of the file, by the common reader."""

    @abstractmethod
    def tables(self) -> Iterator[list[str]]:
        """Yield the lines of each table."""

    def unknown(self) -> list[Option]:
        """Return the unknown properties."""
        return [option for option in self.options() if option.cost and option.key not in self.typed]

    def assumed(self) -> dict[str, str]:
        """Return the defaults in the file, as typed, by key."""
        return {
            option.key: option.default
            for option in self.options()
            if option.default and option.key not in self.typed and not self.keeps(option)
        }

    def faults(self) -> list[Fault]:
        """Return all faults of the values, each under the key of its option."""
        needed = [option for option in self.required() if not self.typed.get(option.key)]
        missing = {option.key: f"is missing; for example {option.examples[not self.units.linear]}" for option in needed}
        missing |= self._without_unit()
        faults = [Fault("", None, key, message) for key, message in missing.items()]
        try:
            self.problem()
        except InputError as error:
            keys = {self.units.key(option.key): option.key for option in self.options()}
            for fault in error.faults:
                key = keys.get(re.sub(r"\[\d\]$", "", fault.key))
                if key not in missing:
                    # An option has no unit, the key of the file names that of what is allowed.
                    message = fault.message if key is None else f"{fault.key} {fault.message}"
                    faults.append(Fault("", None, key or fault.key, message))
        return faults

    def _without_unit(self) -> dict[str, str]:
        """Return what is wrong, by key, with numbers without a unit that cannot be meant in the SI unit of their key.

        They are read as their reciprocals, too: a rate for a sample time, counts or steps per inch for an encoder step.
        """
        faults = {}
        for option in (RATE, ENCODER):
            number = _bare_number(self.typed.get(option.key, ""))
            if number is not None and _LEAST_RECIPROCAL <= number < math.inf:
                unit = unit_of_key(self.units.key(option.key), self.units)
                examples = option.examples[not self.units.linear]
                if option is RATE:
                    examples = f"{number:g} Hz, or {1e3 / number:.3g} ms"
                meant = f"is {number:g} without a unit, which means {number:g} {unit}"
                faults[option.key] = f"{meant}; give a unit: {examples}"
        return faults

    def text(self) -> str:
        """Return the text of the file."""
        lines = ["# Written by `avc new`. Every key that may stand here: problems/README.md of avc-casadi."]
        for table in self.tables():
            lines += ["", *table]
        return "\n".join(lines) + "\n"

    def keeps(self, option: Option) -> bool:  # noqa: ARG002
        """Return whether the device to start from gives a value; a draft without one has none."""
        return False

    def proposal(self, option: Option) -> tuple[str, str]:  # noqa: ARG002
        """Return a value that is proposed, and why; both empty where none is."""
        return "", ""

    def lines(self, table: str) -> Iterator[str]:
        """Yield the lines of the options of a table."""
        for option in self.options():
            if option.table == table:
                yield from self._line(option)

    def hands_lines(self) -> Iterator[str]:
        """Yield the lines of the hands, or a comment where a file without them means these hands."""
        if self.held in OWN_RANGES:
            yield "[hands]"
            yield from self.lines("hands")
        elif self.held == "fingertip":
            yield "[hands]"
            yield from self._fingertip()
            yield f"# Held by {self.held}: {HOLDS[self.held]}"
        else:
            yield f"# No table [hands], held by {self.held}: {HOLDS[self.held]}"

    def _fingertip(self) -> Iterator[str]:
        """Yield the ranges of a finger, of a rotary device those about its axis."""
        radius_m = self.radius_m()
        for key, ends in FINGERTIP.model_dump(exclude={"let_go"}).items():
            yield f"{self.units.key(key)} = {[float(f'{end * radius_m**2:.15g}') for end in ends]}"

    def _line(self, option: Option) -> Iterator[str]:
        """Yield the line of an option: its value, or what not knowing it costs."""
        key = self.units.key(option.key).rpartition(".")[2]
        proposed, why = self.proposal(option)
        typed = self.typed.get(option.key, option.default) or proposed
        stated = typed or option.key in self.typed
        if self.keeps(option) or not (stated or option.cost):
            return
        if stated:
            text = " ".join(typed.split())
            value = self._value(option, text)
            comment = why or (text if option.key in self.typed else f"{text}, assumed")
        elif option in DAMPERS:
            value, comment = 0.0, f"not known, {option.cost}"
        else:
            yield f"{f'# {key}':<31} # not known, {option.cost}"
            return
        yield f"{f'{key} = {toml_value(value)}':<31} # {comment}"

    def _value(self, option: Option, typed: str) -> Any:
        """Return a value in SI units, or the text where it is none, which the reader refuses."""
        unit = unit_of_key(self.units.key(option.key), self.units)
        if option is DELAY:
            return self._delay_samples(typed)
        radius_m = None if self.units.linear or option in (RADIUS, MASS) else self.radius_m()
        span = re.fullmatch(r"(.+?)(?:\bto\b|\.\.)(.+)", typed)
        if option not in SPANS:
            return _read(typed, unit, radius_m)
        if not span and option is CONTACT:
            stiffest = _read(typed, unit, radius_m)
            return (0.0, stiffest) if isinstance(stiffest, float) and stiffest > 0 else stiffest
        low, high = span.groups() if span else (typed, typed)
        # Of "5 to 40 N.s/m" the unit is that of both ends.
        number = re.compile(r"[-+.0-9eE ]+")
        shared_unit = number.sub("", high, count=1) if number.fullmatch(low) else ""
        return _read(f"{low} {shared_unit}", unit, radius_m), _read(high, unit, radius_m)

    def _delay_samples(self, typed: str) -> float | str:
        """Return a delay in samples, also where it is typed as a time; or the text where it is neither.

        A time is divided by the period of the typed sample rate, or of the default rate where none is typed; 1 ms
        stands in where the typed rate is faulty, which is reported by itself.
        """
        samples = _read(typed, "samples")
        seconds = _read(typed, "s")
        if isinstance(samples, str) and isinstance(seconds, float):
            rate = _read(self.typed.get(RATE.key, RATE.default), "s")
            period_s = rate if isinstance(rate, float) and rate > 0 else _STAND_IN_PERIOD_S
            samples = float(f"{seconds / period_s:.12g}")
        return int(samples) if isinstance(samples, float) and samples.is_integer() else samples

    def radius_m(self) -> float:
        """Return the radius of the handle, or 1 where it is missing or faulty, which is reported by itself."""
        radius = _read(self.typed.get(RADIUS.key, ""), "m")
        return radius if isinstance(radius, float) else 1.0


def _bare_number(text: str) -> float | None:
    """Return a number that is typed without a unit, or None."""
    with suppress(ValueError):
        return float(text)
    return None


def _read(text: str, unit: str, metres_per_radian: float | None = None) -> float | str:
    """Return a quantity in a unit, or the text where it is none."""
    with suppress(ValueError):
        return read_quantity(text, unit, metres_per_radian)
    return text
