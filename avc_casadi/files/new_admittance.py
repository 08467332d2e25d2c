"""The file of an admittance device from the options of `avc new --drive velocity`, as typed from a data sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from avc_casadi._errors import Fault
from avc_casadi.files.admittance_file import parse_admittance
from avc_casadi.files.draft import Draft
from avc_casadi.files.new_options import (
    CONTACT,
    CONTACT_DAMPING,
    HANDS,
    NEEDED_OF_VELOCITY,
    OWN_RANGES,
    RADIUS,
    VELOCITY_OPTIONS,
    Option,
)
from avc_casadi.model.admittance import AdmittanceProblem


@dataclass(frozen=True)
class NewAdmittance(Draft):
    """A draft of the file of an admittance device, without a law: `recommend` finds one."""

    def options(self) -> tuple[Option, ...]:
        """Return the options for such a device and such hands; the damping of a contact where there is one."""
        first = () if self.units.linear else (RADIUS,)
        dampers = () if CONTACT.key in self.typed or CONTACT_DAMPING.key in self.typed else (CONTACT_DAMPING,)
        of_drive = tuple(option for option in VELOCITY_OPTIONS if option not in dampers)
        return (*first, *of_drive, *(HANDS if self.held in OWN_RANGES else ()))

    def required(self) -> tuple[Option, ...]:
        """Return the options without which there is no file."""
        return (*super().required(), *NEEDED_OF_VELOCITY)

    def faults(self) -> list[Fault]:
        """Return all faults of the values, and a hold that such devices do not know."""
        unheld = 'is "stylus"; allowed for an admittance device: grip, wheel, fingertip, foot or other'
        return [*([Fault("", None, "--held", unheld)] if self.held == "stylus" else []), *super().faults()]

    def problem(self) -> AdmittanceProblem:
        """Return the problem of the file, by the common reader."""
        return parse_admittance(self.text(), file=str(self.path), name=self.path.stem)

    def tables(self) -> Iterator[list[str]]:
        """Yield the lines of device, sensor, hands and contact."""
        motion = [] if self.units.linear else ['motion = "rotary"']
        yield ["[device]", *motion, 'drive = "velocity"', *self.lines("device")]
        yield [f"[{self.units.key('device.force_sensor')}]", *self.lines("device.force_sensor")]
        yield list(self.hands_lines())
        yield ["[contact]", *self.lines("contact")]
