"""Validation of a whole gain document: a schedule, or every fault at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.units import N_PER_M, NS_PER_M
from avc_casadi.files.problem_document import effect_of
from avc_casadi.model.effects import StateFeedbackEffect
from avc_casadi.model.quantity import (
    FREQUENCIES_HZ,
    LARGEST_DAMPING_NS_PER_M,
    LARGEST_STIFFNESS_N_PER_M,
    MOST_FREQUENCIES,
)
from avc_casadi.model.runtime import STATE_FEEDBACK_KEYS, StateFeedback
from avc_casadi.model.schedule import GainSchedule, Status

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from avc_casadi.model.runtime import StateFeedback


def state_feedback_of(found: object, path: Path, key: str) -> StateFeedback | None:
    """Read state feedback from JSON values, by the rules of the scene's effect.

    Args:
        found: the values; None where there are none.
        path: source file.
        key: of the table in it.

    Raises:
        InputError: with every fault.
    """
    if found is None:
        return None
    if not isinstance(found, Mapping):
        raise InputError.of("must be a table or null", file=str(path), key=key)
    values: Mapping[str, Any] = found
    table = effect_of(StateFeedbackEffect, values, file=str(path), key=key)
    try:
        return StateFeedback(**{name: getattr(table, name) for name in STATE_FEEDBACK_KEYS})
    except InputError as error:
        raise InputError([Fault(str(path), None, f"{key}.{one.key}", one.message) for one in error.faults]) from None


SCHEMA = "avc-gains/1"
COUPLING_SCHEMA = "avc-coupling/1"
GAINS = ("damping_ns_per_m", "stiffness_n_per_m")
CONTACT = "contact_damping_ns_per_m"
_MODELS = ("paper", "sampled-data")
_STRUCTURES = ("series", "damped")
# Larger values are implausible and exceed single precision.
_LARGEST = {
    "frequency_hz": (FREQUENCIES_HZ[1], "Hz"),
    "damping_ns_per_m": (LARGEST_DAMPING_NS_PER_M, NS_PER_M),
    "stiffness_n_per_m": (LARGEST_STIFFNESS_N_PER_M, N_PER_M),
    CONTACT: (LARGEST_DAMPING_NS_PER_M, NS_PER_M),
}
_LIST = "a list of finite numbers >= 0, null where a row has no gains"
_SIGNED = "a list of finite numbers, null where there is none"


class GainCheck:
    """Reader of the keys of one document that collects its faults.

    Args:
        document: values by key.
        path: source file, for messages.
        lines: line of each row in a file of rows; None without lines.
        faults: found before.
    """

    def __init__(
        self, document: Mapping[str, Any], path: Path, lines: Sequence[int] | None = None, faults: Sequence[Fault] = ()
    ) -> None:
        self.document = document
        self.path = path
        self.lines = lines
        self.faults = list(faults)
        self.rows = 0

    def schedule(self) -> GainSchedule:
        """Return the schedule.

        Raises:
            InputError: with every fault.
        """
        self._choice("schema", (SCHEMA, COUPLING_SCHEMA), SCHEMA)
        structure = self._choice("structure", _STRUCTURES, "series")
        model = self._choice("model", _MODELS, "paper")
        sample_time = self._sample_time()
        texts = {key: self._text(key, default) for key, default in (("problem", self.path.stem), ("method", "file"))}
        solver = self._text("solver", "")
        frequency = self._frequencies(sample_time)
        b, k = (self._column(key) for key in GAINS)
        contact = self._column(CONTACT, needed=structure == "damped")
        present = self._present(b, k)
        self._contact(contact, present, structure)
        status = self._status(present)
        reason = self._reasons()
        requested = [self._column(f"requested_{key}", needed=False, signed=True) for key in (*GAINS, CONTACT)]
        rigid = self._flags("requested_rigid")
        impedance, target, notes = self._complex("impedance"), self._complex("target"), self._notes()
        feedback = self._state_feedback()
        if self.faults:
            raise InputError(self.faults)
        return GainSchedule(
            problem=texts["problem"],
            method=texts["method"],
            solver=solver or None,
            structure="damped" if structure == "damped" else "series",
            model=model,
            sample_time_s=sample_time,
            frequency_hz=frequency,
            damping_ns_per_m=b,
            stiffness_n_per_m=k,
            contact_damping_ns_per_m=np.where(present & np.isnan(contact), 0.0, contact),
            impedance=impedance,
            target=target,
            status=status,
            reason=reason,
            notes=notes,
            state_feedback=feedback,
            requested_damping_ns_per_m=np.where(rigid, np.inf, requested[0]),
            requested_stiffness_n_per_m=np.where(rigid, np.inf, requested[1]),
            requested_contact_damping_ns_per_m=self._requested_contact(requested[2], contact, structure),
        )

    def _state_feedback(self) -> StateFeedback | None:
        try:
            return state_feedback_of(self.document.get("state_feedback"), self.path, "state_feedback")
        except InputError as error:
            self.faults += error.faults
            return None

    def _fault(self, key: str, message: str, row: int | None = None) -> None:
        line = None
        if row is not None:
            line = self.lines[row] if self.lines is not None else None
            message = f"row {row + 1}: {message}"
        self.faults.append(Fault(str(self.path), line, key, message))

    def _choice(self, key: str, allowed: tuple[str, ...], default: str) -> str:
        value = self.document.get(key, default)
        if isinstance(value, str) and value in allowed:
            return value
        self._fault(key, f"{_shown(value)} is not known; allowed: {', '.join(map(repr, allowed))}")
        return default

    def _text(self, key: str, default: str) -> str:
        value = self.document.get(key, default)
        if value is None:
            return default
        if not isinstance(value, str) or not value.isprintable():
            self._fault(key, f"is {_shown(value)}; allowed: text in one line")
            return default
        return value

    def _sample_time(self) -> float:
        value = self.document.get("sample_time_s")
        if value is None:
            return math.nan
        time = _number(value)
        if time is None or not 0 < time < math.inf:
            self._fault("sample_time_s", f"is {_shown(value)}; allowed: a finite number above 0, or leave it out")
            return math.nan
        return time

    def _frequencies(self, sample_time: float) -> FloatArray:
        values = self.document.get("frequency_hz")
        self.rows = len(values) if isinstance(values, list) else 0
        if self.rows > MOST_FREQUENCIES:
            raise InputError.of(
                f"has {self.rows} rows; allowed: at most {MOST_FREQUENCIES}", file=str(self.path), key="frequency_hz"
            )
        known = len(self.faults)
        frequency = self._column("frequency_hz")
        if len(self.faults) > known:
            return frequency
        if self.rows == 0:
            if not self.faults:
                self._fault("frequency_hz", "is empty; allowed: at least one row")
            return frequency
        with np.errstate(over="ignore", under="ignore"):
            turns = frequency * sample_time
        for row, value in enumerate(frequency):
            if not value > 0:
                self._fault("frequency_hz", f"is {value:g}; allowed: positive Hz", row)
            elif value < FREQUENCIES_HZ[0]:
                self._fault("frequency_hz", f"is {value:g} Hz; allowed: {FREQUENCIES_HZ[0]:g} Hz and above", row)
            elif turns[row] >= 0.5:
                allowed = f"below half the sampling rate, {0.5 / sample_time:g} Hz at sample_time_s = {sample_time:g}"
                self._fault("frequency_hz", f"is {value:g} Hz; allowed: {allowed}", row)
            if row and value <= frequency[row - 1]:
                word = "repeats" if value == frequency[row - 1] else "is below"
                self._fault(
                    "frequency_hz",
                    f"{value:g} Hz {word} the row before ({frequency[row - 1]:g} Hz); allowed: rising frequencies",
                    row,
                )
        return frequency

    def _column(self, key: str, *, needed: bool = True, signed: bool = False) -> FloatArray:
        """Return one value per row; NaN for null, for an absent optional column, and after a fault."""
        nothing = np.full(self.rows, np.nan)
        allowed = _SIGNED if signed else _LIST
        values = self.document.get(key)
        if values is None:
            if needed:
                self._fault(key, f"is missing; allowed: {allowed}")
            return nothing
        if not isinstance(values, list):
            self._fault(key, f"is {_shown(values)}; allowed: {allowed}")
            return nothing
        if len(values) != self.rows:
            self._fault(key, f"has {len(values)} values; allowed: {self.rows}, as frequency_hz")
            return nothing
        column = nothing
        for row, value in enumerate(values):
            if value is None:
                continue
            number = _number(value)
            if number is None or not math.isfinite(number) or (number < 0 and not signed):
                self._fault(key, f"is {_shown(value)}; allowed: a finite number{'' if signed else ' >= 0'}", row)
            elif key in _LARGEST and number > _LARGEST[key][0]:
                most, unit = _LARGEST[key]
                self._fault(key, f"is {_shown(value)}; allowed: at most {most:g} {unit}", row)
            else:
                column[row] = number
        return column

    def _present(self, b: FloatArray, k: FloatArray) -> BoolArray:
        """Return whether each row has gains; half a pair is a fault, unless its key was faulted as a whole."""
        present = np.isfinite(b) & np.isfinite(k)
        if all(isinstance(self.document.get(key), list) for key in GAINS) and not any(
            fault.key in GAINS for fault in self.faults
        ):
            for row in np.flatnonzero(np.isfinite(b) != np.isfinite(k)):
                key = GAINS[int(np.isfinite(b[row]))]
                self._fault(key, "is null although the other gain is given; allowed: both gains, or neither", int(row))
        return present

    def _contact(self, contact: FloatArray, present: BoolArray, structure: str) -> None:
        if structure == "damped":
            if isinstance(self.document.get(CONTACT), list) and not any(fault.key == CONTACT for fault in self.faults):
                for row in np.flatnonzero(present & np.isnan(contact)):
                    self._fault(CONTACT, "is null although the row has gains; allowed: a finite number >= 0", int(row))
            return
        for row in np.flatnonzero(contact > 0):
            self._fault(
                CONTACT, f"is {contact[row]:g} in the series structure; allowed: 0, or structure 'damped'", int(row)
            )

    def _requested_contact(self, requested: FloatArray, contact: FloatArray, structure: str) -> FloatArray:
        """Return the requested contact damping; by default the gains' own, and none in the series structure."""
        if self.document.get(f"requested_{CONTACT}") is not None:
            return requested
        return np.where(np.isnan(contact), 0.0, contact) if structure == "series" else contact

    def _status(self, present: BoolArray) -> tuple[Status, ...]:
        """Require the status of each row to agree with its gains."""
        implied = tuple(Status.SOLVED if has else Status.INFEASIBLE for has in present)
        values = self.document.get("status")
        if values is None:
            return implied
        known = {item.value for item in Status}
        if not isinstance(values, list) or len(values) != self.rows:
            self._fault(
                "status", f"must be a list of {self.rows}, as frequency_hz; allowed: {', '.join(sorted(known))}"
            )
            return implied
        gains_known = not any(fault.key in GAINS for fault in self.faults)
        found = list(implied)
        for row, value in enumerate(values):
            if not isinstance(value, str) or value not in known:
                self._fault("status", f"is {_shown(value)}; allowed: {', '.join(sorted(known))}", row)
                continue
            found[row] = Status(value)
            if gains_known and found[row].has_gains != present[row]:
                has = "has gains" if present[row] else "has no gains"
                self._fault(
                    "status",
                    f"is {value!r} and the row {has}: that contradicts itself; allowed: gains with "
                    f"{', '.join(item.value for item in Status if item.has_gains)}, null gains with the others",
                    row,
                )
        return tuple(found)

    def _reasons(self) -> tuple[str, ...]:
        values = self.document.get("reason")
        if values is None:
            return ("",) * self.rows
        if (
            not isinstance(values, list)
            or len(values) != self.rows
            or not all(isinstance(item, str) for item in values)
        ):
            self._fault("reason", f"must be a list of {self.rows} texts, as frequency_hz")
            return ("",) * self.rows
        return tuple(values)

    def _flags(self, key: str) -> BoolArray:
        """Return one boolean per row; false where the key is absent."""
        values = self.document.get(key)
        if values is None:
            return np.zeros(self.rows, dtype=bool)
        if not isinstance(values, list) or len(values) != self.rows or not all(isinstance(v, bool) for v in values):
            self._fault(key, f"must be a list of {self.rows} true or false, as frequency_hz")
            return np.zeros(self.rows, dtype=bool)
        return np.array(values, dtype=bool)

    def _notes(self) -> tuple[str, ...]:
        values = self.document.get("notes", [])
        if not isinstance(values, list) or not all(isinstance(item, str) for item in values):
            self._fault("notes", "must be a list of texts")
            return ()
        return tuple(values)

    def _complex(self, key: str) -> ComplexArray:
        real, imaginary = (self._column(f"{key}_{part}", needed=False, signed=True) for part in ("re", "im"))
        return np.asarray(real + 1j * imaginary, dtype=np.complex128)


def _number(value: Any) -> float | None:
    """Return a JSON number as float; infinite where it is too large, None where it is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _shown(value: Any) -> str:
    """Return a value for a message, cut where it is long."""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python writes
        text = "a number of too many digits"
    return text if len(text) <= 60 else f"{text[:57]}..."
