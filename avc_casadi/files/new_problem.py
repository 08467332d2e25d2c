"""A problem file from knowledge of a device: answers as typed, read, judged and written as TOML."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.quantity import quantity
from avc_casadi._util.units import units_for
from avc_casadi.files.catalogue import device_names
from avc_casadi.files.device_file import load_device
from avc_casadi.files.plausibility import plausibility
from avc_casadi.files.problem_file import parse_problem
from avc_casadi.files.questions import HAND_RANGES, HOLDS, OWN_RANGES, QUESTIONS, RADIUS, Question
from avc_casadi.files.typed_quantity import read_quantity
from avc_casadi.model.hands import FINGERTIP

if TYPE_CHECKING:
    from avc_casadi._util.units import MotionKind, Units
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.model.problem import Problem

UNKNOWN = "unknown"
"""Answer for an unknown value."""
_COMMENT_AT = 31
_RANGE = re.compile(r"(.+?)(?:\bto\b|\.\.)(.+)")


@dataclass(frozen=True)
class NewProblem:
    """A draft of a problem file.

    Attributes:
        path: of the file.
        like: device of the catalogue, or device file, to start from; empty for none.
        motion: of a device without one to start from.
        held: one of `HOLDS`.
        answers: as typed, by the key of their question; others are unanswered.
    """

    path: Path
    like: str = ""
    motion: MotionKind = "linear"
    held: str = "grip"
    answers: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def base(self) -> DeviceFile | None:
        """The device to start from.

        Raises:
            InputError: there is none.
        """
        return load_device(self.like) if self.like else None

    @property
    def units(self) -> Units:
        """Names and units of its motion."""
        return units_for(self.motion if self.base is None else self.base.device.motion)

    def questions(self) -> tuple[Question, ...]:
        """Return the questions."""
        first = () if self.units.linear or self.base is not None else (RADIUS,)
        return (*first, *QUESTIONS, *(HAND_RANGES if self.held in OWN_RANGES else ()))

    def default(self, question: Question) -> str:
        """Return the default answer, as typed: that of the catalogue's device; empty where there is none."""
        if not self._of_base(question):
            return question.default
        value = self._base_value(question)
        if question.unit == "samples":
            return f"{value:g} sample{'' if value == 1 else 's'}"
        if question.key == "device.sample_time_s":
            return quantity(1 / value, "Hz") if value else UNKNOWN
        return quantity(value, self._unit(question)) if value else UNKNOWN

    def example(self, question: Question) -> str:
        """Return an example answer."""
        return question.examples[not self.units.linear]

    def unknown(self) -> list[Question]:
        """Return the unknown properties that no device of the catalogue gives."""
        return [
            one
            for one in self.questions()
            if self._typed(one) == UNKNOWN and not (self._of_base(one) and self.default(one) != UNKNOWN)
        ]

    def assumed(self) -> dict[str, str]:
        """Return the defaults in the file, as typed, by the key of their question."""
        return {
            one.key: self._typed(one)
            for one in self.questions()
            if one.key not in self.answers and not self._kept(one) and self._typed(one) != UNKNOWN
        }

    def faults(self) -> list[Fault]:
        """Return all faults of the answers, each under the key of its question."""
        found = []
        for question in self.questions():
            try:
                self._value(question)
            except ValueError as error:
                found.append(Fault("", None, question.key, str(error)))
        keys = {self.outer(one): one.key for one in self.questions()}
        try:
            # A faulty answer is judged once: an example replaces it.
            replace(self, answers=self._with_examples(found)).problem()
        except InputError as error:
            found += [Fault("", None, keys.get(one.key, one.key), one.message) for one in error.faults]
        return found

    def doubts(self) -> list[Fault]:
        """Return implausible values of a file without faults, each under the key of its question where it has one."""
        keys = {self.outer(one): one.key for one in self.questions()}
        return [Fault("", None, keys.get(one.key, one.key), one.message) for one in plausibility(self.problem())]

    def judged(self, question: Question) -> tuple[list[Fault], list[Fault]]:
        """Return the faults of the answer to a question, and its doubts, independent of further answers."""
        whole = replace(self, answers=self._with_examples(()))
        others = {one.key for one in self.questions()} - {question.key}
        wrong = [one for one in whole.faults() if one.key not in others]
        return wrong, [] if whole.faults() else [one for one in whole.doubts() if one.key == question.key]

    def problem(self) -> Problem:
        """Return the problem of the file, by the common reader.

        Raises:
            InputError: with every fault.
        """
        return parse_problem(self.text(), file=str(self.path), name=self.path.stem, folder=self.path.parent)

    def outer(self, question: Question) -> str:
        """Return the key of a question in the file."""
        return self.units.key(question.key)

    def text(self) -> str:
        """Return the text of the file."""
        lines = ["# Written by `avc new`. Every key that may stand here: problems/README.md of avc-casadi."]
        for table in ("device", "environment", "hands"):
            lines += ["", *self._table(table)]
        return "\n".join(lines) + "\n"

    def _table(self, table: str) -> Iterator[str]:
        asked = [one for one in self.questions() if one.key.startswith(f"{table}.")]
        if table == "hands" and not asked and self.held != "fingertip":
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
        for question in asked:
            yield from self._line(question)
        if table == "hands" and not asked:
            radius = self._radius_m()
            for key, ends in FINGERTIP.model_dump(exclude={"let_go"}).items():
                yield f"{self.units.key(key)} = {[float(f'{end * radius**2:.15g}') for end in ends]}"
            yield f"# Held by {self.held}: {HOLDS[self.held]}"

    def _line(self, question: Question) -> Iterator[str]:
        if self._kept(question):
            return
        typed, value = self._typed(question), self._value(question)
        key = self.outer(question).partition(".")[2]
        if value is None and question.taken is None:
            yield f"{f'# {key}':<{_COMMENT_AT}} # not known, {question.cost}"
            return
        told = typed if question.key in self.answers else f"{typed}, assumed"
        told = f"not known, {question.cost}" if value is None else told
        written = question.taken if value is None else list(value) if isinstance(value, tuple) else value
        yield f"{f'{key} = {written!r}':<{_COMMENT_AT}} # {told}"

    def _typed(self, question: Question) -> str:
        return " ".join(self.answers.get(question.key, self.default(question)).split())

    def _value(self, question: Question) -> float | tuple[float, ...] | None:
        """Return an answer in SI units; None where unknown.

        Raises:
            ValueError: it is not a quantity.
        """
        if self._kept(question):
            return self._base_value(question)
        typed, unit = self._typed(question), self._unit(question)
        allowed = f"for example {self.example(question)}"
        if typed in {"", UNKNOWN}:
            if typed and question.cost:
                return None
            why = HOLDS[self.held] if question in HAND_RANGES else str(question.asks)
            raise ValueError(f"must be known ({why}); allowed: a value in {unit}, {allowed}")
        both = _RANGE.fullmatch(typed)
        try:
            if question in HAND_RANGES:
                low, high = both.groups() if both else (typed, typed)
                alone = re.fullmatch(r"[-+.0-9eE ]+", low)  # the unit of the second is that of both
                of_both = re.sub(r"^[-+.0-9eE ]+", "", high) if alone else ""
                return read_quantity(f"{low} {of_both}", unit), read_quantity(high, unit)
            if question.key == "device.delay_samples":
                return self._delay(typed)
            return read_quantity(typed, unit)
        except ValueError as error:
            raise ValueError(f"{error}; allowed: a value in {unit}, {allowed}") from None

    def _delay(self, typed: str) -> float:
        try:
            samples = read_quantity(typed, "samples")
        except ValueError:
            try:
                period = self._value(next(one for one in QUESTIONS if one.key == "device.sample_time_s"))
            except ValueError:
                period = None
            # A faulty rate is reported by itself.
            period = period if isinstance(period, float) and period > 0 else 1e-3
            samples = float(f"{read_quantity(typed, 's') / period:.12g}")
        return int(samples) if samples.is_integer() else samples

    def _unit(self, question: Question) -> str:
        return question.unit if question is RADIUS else self.units.unit(question.unit)

    def _of_base(self, question: Question) -> bool:
        return self.base is not None and question.key.startswith("device.")

    def _base_value(self, question: Question) -> float | None:
        """Return the value of the device to start from; None where it gives none."""
        if self.base is None:
            return None
        value: float | None = getattr(self.base.device, question.key.partition(".")[2])
        return value

    def _kept(self, question: Question) -> bool:
        """Return whether the device to start from gives it."""
        return self._of_base(question) and self.answers.get(question.key, UNKNOWN).strip() == UNKNOWN

    def _radius_m(self) -> float:
        if self.base is not None:
            return self.base.device.metres_per_unit
        found = None if self.units.linear else self._value(RADIUS)
        return found if isinstance(found, float) else 1.0

    def _with_examples(self, wrong: list[Fault] | tuple[()]) -> dict[str, str]:
        """Return the answers, with examples for the faulty and the missing required ones."""
        keys = {one.key for one in wrong} | {one.key for one in self.questions() if not self._typed(one)}
        examples = {one.key: self.example(one).partition(",")[0] for one in self.questions() if one.key in keys}
        return {**self.answers, **examples}
