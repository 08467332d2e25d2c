"""A problem file from the options of `avc new`: values as typed, read by the common reader and written as TOML."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.files.catalogue import device_names
from avc_casadi.files.device_file import DeviceFile, load_device
from avc_casadi.files.model_file import TipMass
from avc_casadi.files.new_options import DAMPING, DELAY, HANDS, HOLDS, MASS, OPTIONS, OWN_RANGES, RADIUS, RATE, Option
from avc_casadi.files.problem_file import parse_problem
from avc_casadi.files.toml import toml_value
from avc_casadi.model.hands import FINGERTIP
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import read_quantity, unit_of_key


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
        known = {} if self.base is None else dict(self.base.device)
        return [
            one
            for one in self.options()
            if one.cost and one.key not in self.typed and not known.get(one.key.partition(".")[2])
        ]

    def assumed(self) -> dict[str, str]:
        """Return the defaults in the file, as typed, by key."""
        return {
            one.key: one.default
            for one in self.options()
            if one.default and one.key not in self.typed and not self._kept(one)
        }

    def faults(self) -> list[Fault]:
        """Return all faults of the values, each under the key of its option."""
        needed = [one for one in self.options() if one in (RADIUS, *HANDS) and not self.typed.get(one.key)]
        words = {one.key: f"is missing; for example {one.examples[not self.units.linear]}" for one in needed}
        found = [Fault("", None, key, message) for key, message in words.items()]
        try:
            self.problem()
        except InputError as error:
            keys = {self.units.key(one.key): one.key for one in self.options()}
            for one in error.faults:
                key = keys.get(re.sub(r"\[\d\]$", "", one.key))
                if key not in words:  # an option has no unit, the key of the file names that of what is allowed
                    message = one.message if key is None else f"{one.key} {one.message}"
                    found.append(Fault("", None, key or one.key, message))
        return found

    def problem(self) -> Problem:
        """Return the problem of the file, by the common reader."""
        return parse_problem(self.text(), file=str(self.path), name=self.path.stem, folder=self.path.parent)

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
            yield from ("", "[device.range]", "# Over poses and contact normals of the model's tip.")
            yield f"mass_kg = [{', '.join(f'{end:.4g}' for end in self.tip.range_kg)}]"
        if table == "hands" and not options:
            radius = self._radius_m()
            for key, ends in FINGERTIP.model_dump(exclude={"let_go"}).items():
                yield f"{self.units.key(key)} = {[float(f'{end * radius**2:.15g}') for end in ends]}"
            yield f"# Held by {self.held}: {HOLDS[self.held]}"

    def _line(self, option: Option) -> Iterator[str]:
        key, typed = self.units.key(option.key).partition(".")[2], self.typed.get(option.key, option.default)
        stated = typed or option.key in self.typed
        if self._kept(option) or not (stated or option.cost):
            return
        if stated:
            value, comment = self._value(option, " ".join(typed.split())), " ".join(typed.split())
            comment = comment if option.key in self.typed else f"{comment}, assumed"
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
            samples = _read(typed, "samples")
            if isinstance(samples, str) and isinstance(seconds := _read(typed, "s"), float):
                period = _read(self.typed.get(RATE.key, RATE.default), "s")
                # A faulty rate is reported by itself.
                samples = float(f"{seconds / (period if isinstance(period, float) and period > 0 else 1e-3):.12g}")
            return int(samples) if isinstance(samples, float) and samples.is_integer() else samples
        radius = None if self.units.linear or option in (RADIUS, MASS) else self._radius_m()
        if option not in HANDS:
            return _read(typed, unit, radius)
        both = re.fullmatch(r"(.+?)(?:\bto\b|\.\.)(.+)", typed)
        low, high = both.groups() if both else (typed, typed)
        bare = re.compile(r"[-+.0-9eE ]+")
        of_both = bare.sub("", high, count=1) if bare.fullmatch(low) else ""
        return _read(f"{low} {of_both}", unit, radius), _read(high, unit, radius)

    def _kept(self, option: Option) -> bool:
        """Return whether the device to start from gives it."""
        return self.base is not None and option.key.startswith("device.") and option.key not in self.typed

    def _radius_m(self) -> float:
        if self.base is not None:
            return self.base.device.metres_per_unit
        radius = _read(self.typed.get(RADIUS.key, ""), "m")
        return radius if isinstance(radius, float) else 1.0


def _read(text: str, unit: str, metres_per_radian: float | None = None) -> float | str:
    with suppress(ValueError):
        return read_quantity(text, unit, metres_per_radian)
    return text
