"""A problem file from the options of `avc new`: values as typed, read by the common reader and written as TOML."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.files.catalogue import device_names
from avc_casadi.files.device_file import DeviceFile, load_device
from avc_casadi.files.model_file import TipMass
from avc_casadi.files.new_options import (
    DAMPING,
    DELAY,
    HANDS,
    HOLDS,
    MASS,
    OPTIONS,
    OWN_RANGES,
    RADIUS,
    RATE,
    WALL_DAMPING,
    Option,
)
from avc_casadi.files.problem_file import parse_problem
from avc_casadi.files.toml import toml_value
from avc_casadi.loops.damped_wall import proposed_damper_ns_per_m
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.model.hands import FINGERTIP
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import read_quantity, unit_of_key

_STAND_IN_PERIOD_S = 1e-3
"""Stands in place of a faulty rate, which is reported by itself."""


@dataclass(frozen=True)
class NewProblem:
    """A draft of a problem file.

    `like` names a device to start from, `typed` are the values of options by key, as typed, and `tip` is the mass of a
    model.
    """

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
        known = {} if self.base is None else dict(self.base.device)
        return [
            option
            for option in self.options()
            if option.cost and option.key not in self.typed and not known.get(option.key_in_table)
        ]

    def assumed(self) -> dict[str, str]:
        """Return the defaults in the file, as typed, by key."""
        return {
            option.key: option.default
            for option in self.options()
            if option.default and option.key not in self.typed and not self._kept(option)
        }

    @cached_property
    def proposed_damper(self) -> str:
        """The damper of the wall that is proposed, with its unit: "0" where none helps, empty where one was typed."""
        if WALL_DAMPING.key in self.typed:
            return ""
        undamped = replace(self, typed={**self.typed, WALL_DAMPING.key: "0"})
        try:
            problem = undamped.problem()
        except InputError:  # the faults of the other values are reported by themselves
            return "0"
        damper = proposed_damper_ns_per_m(PlantFamily.of(problem), problem.environment.stiffness_n_per_m)
        return f"{damper:g} {self.units.unit('N.s/m')}" if damper else "0"

    def faults(self) -> list[Fault]:
        """Return all faults of the values, each under the key of its option."""
        needed = [option for option in self.options() if option in (RADIUS, *HANDS) and not self.typed.get(option.key)]
        missing = {option.key: f"is missing; for example {option.examples[not self.units.linear]}" for option in needed}
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

    def problem(self) -> Problem:
        """Return the problem of the file, by the common reader."""
        return parse_problem(self.text(), file=str(self.path), name=self.path.stem, folder=self.path.parent)

    def text(self) -> str:
        """Return the text of the file."""
        lines = ["# Written by `avc new`. Every key that may stand here: problems/README.md of avc-casadi."]
        for table in (self._device(), self._environment(), self._hands()):
            lines += ["", *table]
        return "\n".join(lines) + "\n"

    def _device(self) -> Iterator[str]:
        """Yield the lines of the device."""
        yield "[device]"
        if self.like:
            in_catalogue = self.like in device_names()
            named = self.like if in_catalogue else os.path.relpath(self.like, self.path.parent or ".")
            yield f'from = "{Path(named).as_posix()}"'
        elif not self.units.linear:
            yield 'motion = "rotary"'
        if self.held == "stylus":
            yield 'held = "stylus"'
        yield from self._lines("device")
        if self.tip is not None:
            yield ""
            yield "[device.range]"
            yield "# Over poses and contact normals of the model's tip."
            yield f"mass_kg = [{', '.join(f'{end:.4g}' for end in self.tip.range_kg)}]"

    def _environment(self) -> Iterator[str]:
        """Yield the lines of the wall."""
        yield "[environment]"
        yield from self._lines("environment")

    def _hands(self) -> Iterator[str]:
        """Yield the lines of the hands, or a comment where a file without them means these hands."""
        if self.held in OWN_RANGES:
            yield "[hands]"
            yield from self._lines("hands")
        elif self.held == "fingertip":
            yield "[hands]"
            yield from self._fingertip()
            yield f"# Held by {self.held}: {HOLDS[self.held]}"
        else:
            yield f"# No table [hands], held by {self.held}: {HOLDS[self.held]}"

    def _lines(self, table: str) -> Iterator[str]:
        """Yield the lines of the options of a table."""
        for option in self.options():
            if option.key.startswith(f"{table}."):
                yield from self._line(option)

    def _fingertip(self) -> Iterator[str]:
        """Yield the ranges of a finger, of a rotary device those about its axis."""
        radius_m = self._radius_m()
        for key, ends in FINGERTIP.model_dump(exclude={"let_go"}).items():
            yield f"{self.units.key(key)} = {[float(f'{end * radius_m**2:.15g}') for end in ends]}"

    def _line(self, option: Option) -> Iterator[str]:
        """Yield the line of an option: its value, or what not knowing it costs."""
        key = self.units.key(option.key).partition(".")[2]
        typed = self.typed.get(option.key, option.default)
        proposed = self.proposed_damper if option is WALL_DAMPING else ""
        typed = typed or proposed
        stated = typed or option.key in self.typed
        if self._kept(option) or not (stated or option.cost):
            return
        if stated:
            text = " ".join(typed.split())
            value = self._value(option, text)
            comment = text if option.key in self.typed else f"{text}, assumed"
            if proposed and proposed != "0":
                comment = f"{text}, proposed: contact is well damped; --wall-damping 0 for a wall without damper"
        elif option is DAMPING:
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
        radius_m = None if self.units.linear or option in (RADIUS, MASS) else self._radius_m()
        if option not in HANDS:
            return _read(typed, unit, radius_m)
        span = re.fullmatch(r"(.+?)(?:\bto\b|\.\.)(.+)", typed)
        low, high = span.groups() if span else (typed, typed)
        # Of "5 to 40 N.s/m" the unit is that of both ends.
        number = re.compile(r"[-+.0-9eE ]+")
        shared_unit = number.sub("", high, count=1) if number.fullmatch(low) else ""
        return _read(f"{low} {shared_unit}", unit, radius_m), _read(high, unit, radius_m)

    def _delay_samples(self, typed: str) -> float | str:
        """Return a delay in samples, also where it is typed as a time; or the text where it is neither."""
        samples = _read(typed, "samples")
        seconds = _read(typed, "s")
        if isinstance(samples, str) and isinstance(seconds, float):
            rate = _read(self.typed.get(RATE.key, RATE.default), "s")
            period_s = rate if isinstance(rate, float) and rate > 0 else _STAND_IN_PERIOD_S
            samples = float(f"{seconds / period_s:.12g}")
        return int(samples) if isinstance(samples, float) and samples.is_integer() else samples

    def _kept(self, option: Option) -> bool:
        """Return whether the device to start from gives it."""
        return self.base is not None and option.key.startswith("device.") and option.key not in self.typed

    def _radius_m(self) -> float:
        """Return the radius of the handle, or 1 where it is missing or faulty, which is reported by itself."""
        if self.base is not None:
            return self.base.device.metres_per_unit
        radius = _read(self.typed.get(RADIUS.key, ""), "m")
        return radius if isinstance(radius, float) else 1.0


def _read(text: str, unit: str, metres_per_radian: float | None = None) -> float | str:
    """Return a quantity in a unit, or the text where it is none."""
    with suppress(ValueError):
        return read_quantity(text, unit, metres_per_radian)
    return text
