"""A problem file from the options of `avc new`: values as typed, read, judged and written as TOML."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import units_for
from avc_casadi.files.catalogue import device_names
from avc_casadi.files.device_file import load_device
from avc_casadi.files.new_options import DAMPING, DELAY, HANDS, HOLDS, OPTIONS, OWN_RANGES, RADIUS, RATE, Option
from avc_casadi.files.plausibility import plausibility
from avc_casadi.files.problem_file import parse_problem
from avc_casadi.model.hands import FINGERTIP
from avc_casadi.model.quantity import read_quantity, unit_of_key

if TYPE_CHECKING:
    from avc_casadi._util.units import MotionKind, Units
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.files.model_file import TipMass
    from avc_casadi.model.problem import Problem

_COMMENT_AT = 31
_RANGE = re.compile(r"(.+?)(?:\bto\b|\.\.)(.+)")


@dataclass(frozen=True)
class NewProblem:
    """A draft of a problem file."""

    path: Path
    like: str = ""
    motion: MotionKind = "linear"
    held: str = "grip"
    typed: Mapping[str, str] = field(default_factory=dict)
    tip: TipMass | None = None

    @cached_property
    def base(self) -> DeviceFile | None:
        """The device to start from."""
        return load_device(self.like) if self.like else None

    @property
    def units(self) -> Units:
        """Names and units of its motion."""
        return units_for(self.motion if self.base is None else self.base.device.motion)

    def options(self) -> tuple[Option, ...]:
        """Return the options for such a device and such hands."""
        first = () if self.units.linear or self.base is not None else (RADIUS,)
        return (*first, *OPTIONS, *(HANDS if self.held in OWN_RANGES else ()))

    def unknown(self) -> list[Option]:
        """Return the unknown properties, which no device of the catalogue gives either."""
        return [one for one in self.options() if one.cost and one.key not in self.typed and not self._base_value(one)]

    def assumed(self) -> dict[str, str]:
        """Return the defaults in the file, as typed, by key."""
        return {
            one.key: one.default
            for one in self.options()
            if one.default and one.key not in self.typed and not self._kept(one)
        }

    def faults(self) -> list[Fault]:
        """Return all faults of the values, each under the key of its option."""
        found = []
        for option in self.options():
            try:
                self._value(option)
            except ValueError as error:
                found.append(Fault("", None, option.key, str(error)))
        keys = {self.outer(one): one.key for one in self.options()}
        # A faulty value is judged once: an example replaces it.
        wrong = {one.key for one in found}
        examples = {one.key: self._example(one).partition(",")[0] for one in self.options() if one.key in wrong}
        try:
            replace(self, typed={**self.typed, **examples}).problem()
        except InputError as error:
            found += [Fault("", None, keys.get(one.key, one.key), one.message) for one in error.faults]
        return found

    def doubts(self) -> list[Fault]:
        """Return implausible values of a file without faults, each under the key of its option where it has one."""
        keys = {self.outer(one): one.key for one in self.options()}
        return [Fault("", None, keys.get(one.key, one.key), one.message) for one in plausibility(self.problem())]

    def problem(self) -> Problem:
        """Return the problem of the file, by the common reader."""
        return parse_problem(self.text(), file=str(self.path), name=self.path.stem, folder=self.path.parent)

    def outer(self, option: Option) -> str:
        """Return the key of an option in the file."""
        return self.units.key(option.key)

    def text(self) -> str:
        """Return the text of the file."""
        lines = ["# Written by `avc new`. Every key that may stand here: problems/README.md of avc-casadi."]
        for table in ("device", "environment", "hands"):
            lines += ["", *self._table(table)]
        return "\n".join(lines) + "\n"

    def _table(self, table: str) -> Iterator[str]:
        options = [one for one in self.options() if one.key.startswith(f"{table}.")]
        if table == "hands" and not options and self.held != "fingertip":
            yield f"# No table [hands], held by {self.held}: {HOLDS[self.held]}"
            return
        yield f"[{table}]"
        if table == "device" and self.like:
            named = self.like if self.like in device_names() else os.path.relpath(self.like, self.path.parent or ".")
            yield f'from = "{Path(named).as_posix()}"'
        elif table == "device" and not self.units.linear:
            yield 'motion = "rotary"'
        if table == "device" and self.held == "stylus":
            yield 'held = "stylus"'
        for option in options:
            yield from self._line(option)
        if table == "device" and self.tip is not None:
            ends = ", ".join(f"{end:.4g}" for end in self.tip.range_kg)
            yield from (
                "",
                "[device.range]",
                "# Over poses and contact normals of the model's tip.",
                f"mass_kg = [{ends}]",
            )
        if table == "hands" and not options:
            radius = self._radius_m()
            for key, ends in FINGERTIP.model_dump(exclude={"let_go"}).items():
                yield f"{self.units.key(key)} = {[float(f'{end * radius**2:.15g}') for end in ends]}"
            yield f"# Held by {self.held}: {HOLDS[self.held]}"

    def _line(self, option: Option) -> Iterator[str]:
        if self._kept(option):
            return
        value, key = self._value(option), self.outer(option).partition(".")[2]
        if value is None and option is not DAMPING:
            yield f"{f'# {key}':<{_COMMENT_AT}} # not known, {option.cost}"
            return
        comment = " ".join(self.typed.get(option.key, f"{option.default}, assumed").split())
        comment = f"not known, {option.cost}" if value is None else comment
        written = 0.0 if value is None else list(value) if isinstance(value, tuple) else value
        yield f"{f'{key} = {written!r}':<{_COMMENT_AT}} # {comment}"

    def _value(self, option: Option) -> float | tuple[float, ...] | None:
        """Return a value in SI units; None where unknown."""
        if self._kept(option):
            return self._base_value(option)
        typed, unit = (
            " ".join(self.typed.get(option.key, option.default).split()),
            unit_of_key(self.outer(option).rpartition(".")[2], self.units),
        )
        allowed = f"allowed: a value in {unit}, for example {self._example(option)}"
        if not typed:
            if option.cost and option.key not in self.typed:
                return None
            raise ValueError(f"must be known ({HOLDS[self.held] if option in HANDS else option.text}); {allowed}")
        both = _RANGE.fullmatch(typed)
        try:
            if option in HANDS:
                low, high = both.groups() if both else (typed, typed)
                alone = re.fullmatch(r"[-+.0-9eE ]+", low)  # the unit of the second is that of both
                of_both = re.sub(r"^[-+.0-9eE ]+", "", high) if alone else ""
                radius = None if self.units.linear else self._radius_m()
                return read_quantity(f"{low} {of_both}", unit, radius), read_quantity(high, unit, radius)
            return self._delay(typed) if option is DELAY else read_quantity(typed, unit)
        except ValueError as error:
            raise ValueError(f"{error}; {allowed}") from None

    def _delay(self, typed: str) -> float:
        try:
            samples = read_quantity(typed, "samples")
        except ValueError:
            try:
                period = self._value(RATE)
            except ValueError:
                period = None
            # A faulty rate is reported by itself.
            period = period if isinstance(period, float) and period > 0 else 1e-3
            samples = float(f"{read_quantity(typed, 's') / period:.12g}")
        return int(samples) if samples.is_integer() else samples

    def _example(self, option: Option) -> str:
        return option.examples[not self.units.linear]

    def _base_value(self, option: Option) -> float | None:
        """Return the value of the device to start from; None where it gives none."""
        if self.base is None or not option.key.startswith("device."):
            return None
        value: float | None = getattr(self.base.device, option.key.partition(".")[2])
        return value

    def _kept(self, option: Option) -> bool:
        """Return whether the device to start from gives it."""
        return self.base is not None and option.key.startswith("device.") and option.key not in self.typed

    def _radius_m(self) -> float:
        if self.base is not None:
            return self.base.device.metres_per_unit
        found = None if self.units.linear else self._value(RADIUS)
        return found if isinstance(found, float) else 1.0
