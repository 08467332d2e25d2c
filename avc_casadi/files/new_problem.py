"""A problem file from the options of `avc new`: values as typed, read by the common reader and written as TOML."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from avc_casadi._errors import InputError
from avc_casadi._util.units import Units, units_for
from avc_casadi.files.catalogue import device_names
from avc_casadi.files.device_file import DeviceFile, load_device
from avc_casadi.files.draft import Draft
from avc_casadi.files.model_file import TipMass
from avc_casadi.files.new_options import FORCE_OPTIONS, HANDS, OWN_RANGES, RADIUS, WALL_DAMPING, Option
from avc_casadi.files.problem_file import parse_problem
from avc_casadi.loops.damped_wall import proposed_damper_ns_per_m
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class NewProblem(Draft):
    """A draft of a problem file.

    `like` names a device to start from, and `tip` is the mass of a model.
    """

    like: str = ""
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
        return (*first, *FORCE_OPTIONS, *(HANDS if self.held in OWN_RANGES else ()))

    def unknown(self) -> list[Option]:
        """Return the unknown properties, which no device of the catalogue gives either."""
        known = {} if self.base is None else dict(self.base.device)
        return [option for option in super().unknown() if not known.get(option.key_in_table)]

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

    def problem(self) -> Problem:
        """Return the problem of the file, by the common reader."""
        return parse_problem(self.text(), file=str(self.path), name=self.path.stem, folder=self.path.parent)

    def tables(self) -> Iterator[list[str]]:
        """Yield the lines of device, wall and hands."""
        yield list(self._device())
        yield ["[environment]", *self.lines("environment")]
        yield list(self.hands_lines())

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
        yield from self.lines("device")
        if self.tip is not None:
            yield ""
            yield "[device.range]"
            yield "# Over poses and contact normals of the model's tip."
            yield f"mass_kg = [{', '.join(f'{end:.4g}' for end in self.tip.range_kg)}]"

    def proposal(self, option: Option) -> tuple[str, str]:
        """Return the damper of the wall that is proposed."""
        proposed = self.proposed_damper if option is WALL_DAMPING else ""
        if not proposed or proposed == "0":
            return proposed, ""
        return proposed, f"{proposed}, proposed: contact is well damped; --wall-damping 0 for a wall without damper"

    def keeps(self, option: Option) -> bool:
        """Return whether the device to start from gives it."""
        return self.base is not None and option.table == "device" and option.key not in self.typed

    def radius_m(self) -> float:
        """Return the radius of the handle, that of the device to start from where there is one."""
        return super().radius_m() if self.base is None else self.base.device.metres_per_unit
