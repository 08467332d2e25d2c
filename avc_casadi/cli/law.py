"""Pieces of a law as typed: `--ki`, `--virtual-mass`, `--velocity "window 5"`, `--notch "150 Hz"`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import avc_casadi as avc
from avc_casadi._util.units import Units
from avc_casadi.cli import arguments as cli
from avc_casadi.files.problem_file import is_device
from avc_casadi.model.control_law import CommandFilter, NotchFilter
from avc_casadi.model.ends import Wall
from avc_casadi.model.joint import Joint
from avc_casadi.model.table import shown
from avc_casadi.model.unit_text import read_quantity, unit_of_key

TYPED = {"k": "stiffness_n_per_m", "b": "damping_ns_per_m", "b_p": "local_damping_ns_per_m"}
"""Options that state a gain of any law, and its key."""
_NUMBERS = {
    **TYPED,
    "cutoff_hz": "cutoff_hz",
    "ki": "integral_n_per_m_s",
    "virtual_mass": "virtual_mass_kg",
}
"""Options that state a number of a law, and its key."""
_KEYS = {**_NUMBERS, "velocity": "velocity", "friction_compensation": "friction_compensation", "notch": "filters"}
"""Options that state a piece of a law, and its key."""

_OF_JOINTS = {"kp": "stiffness_n_per_m", "kd": "damping_ns_per_m"}
"""Names of the gains of a joint, and the key of each."""


def number_named(typed: str) -> str:
    """Return the key of a number of a law that is typed as its option, such as `ki`; any other text unchanged."""
    name = typed.removeprefix("--").replace("-", "_")
    return {**_NUMBERS, **_OF_JOINTS}.get(name, typed)


FULL_SPEED_M_PER_S = 0.02
"""Speed at the handle from which a typed friction compensation pushes with all of its force, unless one is typed."""


def read_numbers(args: argparse.Namespace, units: Units, handle_radius_m: float | None) -> None:
    """Replace the numbers of a law as typed, with or without a unit, by their SI values in these units.

    For a device that turns, a value may also be that of the handle, as in a file; a joint has none.
    """
    faults: list[avc.Fault] = []
    for option, key in _NUMBERS.items():
        typed = getattr(args, option)
        if typed is not None:
            unit = unit_of_key(units.key(key), units)
            try:
                setattr(args, option, _typed(typed, unit, option, handle_radius_m))
            except avc.InputError as error:
                faults += error.faults
    if faults:
        raise avc.InputError(faults)


def law_pieces(args: argparse.Namespace, problem: avc.Problem) -> dict[str, Any]:
    """Return the keys of a table [law] that options other than k, b, b_p and cutoff state.

    Keys of a table in it, such as the velocity, are merged with those of the same kind in the law of the problem.
    """
    declared = problem.law
    gains = {"integral_n_per_m_s": args.ki, "virtual_mass_kg": args.virtual_mass}
    keys: dict[str, Any] = {key: value for key, value in gains.items() if value is not None}
    if args.velocity is not None and args.cutoff_hz is not None:
        why = f"is a low-pass of the velocity, and --velocity is {shown(args.velocity)}; give one of the two options"
        raise avc.InputError.of(why, key="cutoff_hz")
    if args.velocity is not None:
        with cli.faults_of("velocity"):
            keys["velocity"] = _velocity(args.velocity)
    if args.friction_compensation is not None:
        keys["friction_compensation"] = _compensation(args.friction_compensation, problem)
    if args.notch is not None:
        keys["filters"] = _with_notch(() if declared is None else declared.filters, hertz(args.notch, "notch"))
    return keys


def _with_notch(filters: Sequence[CommandFilter], frequency_hz: float) -> tuple[Any, ...]:
    """Return filters with the frequency of their notch replaced, or with a notch after them where they have none."""
    places = [place for place, item in enumerate(filters) if isinstance(item, NotchFilter)]
    if len(places) > 1:
        named = " and ".join(f"law.filters[{place}]" for place in places)
        why = f"is one frequency, but {named} are {len(places)} notches; change their frequency_hz in the file"
        raise avc.InputError.of(why, key="notch")
    declared = filters[places[0]] if places else NotchFilter(frequency_hz=frequency_hz)
    place = places[0] if places else len(filters)
    return (*filters[:place], declared.model_dump() | {"frequency_hz": frequency_hz}, *filters[place + 1 :])


def states_law(source: str, gains: str | None) -> bool:
    """Return whether a source is a problem with a law that no file of gains stands beside, or a joint."""
    if gains is not None or source.endswith(".json") or is_device(source):
        return False
    problem = avc.load_problem(source)
    return problem.law is not None or isinstance(problem.end, Joint)


def with_pieces(problem: avc.Problem, pieces: dict[str, Any], law: dict[str, float]) -> avc.Problem:
    """Return a problem with pieces in its law; a law that it has not is one of what is typed alone.

    A problem whose end has no law is returned as it is: the end refuses the pieces.
    """
    if not isinstance(problem.end, Wall | Joint):
        return problem
    typed = {key: law[name] for name, key in TYPED.items() if name in law} if problem.law is None else {}
    keys = {**typed, **pieces}
    options = {key: option for option, key in _KEYS.items() if key in keys}
    with faults_of_keys(options):
        return problem.changed(law=keys)


@contextmanager
def faults_of_keys(options: Mapping[str, str]) -> Iterator[None]:
    """Let faults of keys of [law], which are found inside, name the options that state these keys."""
    try:
        yield
    except avc.InputError as error:
        raise avc.InputError([_of_option(fault, options) for fault in error.faults]) from error


@contextmanager
def faults_of_file(name: str, typed: str) -> Iterator[None]:
    """Let faults of a problem, which are found inside and bear its name, name its file as typed."""
    try:
        yield
    except avc.InputError as error:
        faults = [replace(fault, file=typed) if fault.file == name else fault for fault in error.faults]
        raise avc.InputError(faults) from error


def _of_option(fault: avc.Fault, options: Mapping[str, str]) -> avc.Fault:
    """Return a fault as that of the option that states its key; one of another key unchanged."""
    key = fault.key.removeprefix("law.").removeprefix("admittance.")
    option = next((option for stated, option in options.items() if re.match(rf"{stated}(\W|$)", key)), None)
    if option is None:
        return fault
    part = key.rpartition(".")[2]
    message = fault.message if part == key else f"{part} {fault.message}"
    return avc.Fault("", None, option, message)


def _compensation(typed: str, problem: avc.Problem) -> dict[str, float]:
    """Return what is typed of a friction compensation: its force and, after a comma, the speed of its full force.

    Without a speed it is that of the law, which is merged; a usual one where the law has no compensation.
    """
    units, handle_radius_m = problem.units, problem.device.handle_radius_m
    force, _, speed = typed.partition(",")
    force_n = _typed(force.strip(), units.unit("N"), "friction_compensation", handle_radius_m)
    if not speed and problem.law is not None and problem.law.friction_compensation is not None:
        return {"force_n": force_n}
    if not speed:
        return {"force_n": force_n, "velocity_m_per_s": FULL_SPEED_M_PER_S / (handle_radius_m or 1.0)}
    full_speed = _typed(speed.strip(), units.unit("m/s"), "friction_compensation", handle_radius_m)
    return {"force_n": force_n, "velocity_m_per_s": full_speed}


def _velocity(typed: str) -> dict[str, Any]:
    """Return the table of an estimator of the velocity: its kind, then its number where it has one."""
    kind, _, number = typed.strip().partition(" ")
    if kind == "difference" and not number:
        return {"kind": kind}
    if kind == "window" and re.fullmatch(r"\s*\d{1,6}(\s*samples?)?\s*", number):
        return {"kind": kind, "samples": int(re.findall(r"\d+", number)[0])}
    if kind == "low-pass" and number:
        return {"kind": kind, "cutoff_hz": hertz(number, "velocity")}
    if kind == "kalman" and number:
        return {"kind": kind, "bandwidth_hz": hertz(number, "velocity")}
    if kind == "ticks" and number:
        return {"kind": kind, "timeout_s": _typed(number, "s", "velocity")}
    allowed = 'allowed: "difference", "window 5" (samples), "low-pass 80 Hz", "kalman 40 Hz", "ticks 20 ms"'
    raise avc.InputError.of(f"is {shown(typed)}; {allowed}", key="velocity")


def hertz(typed: str, option: str) -> float:
    """Return a frequency as typed, in Hz."""
    return _typed(typed, "Hz", option)


def _typed(typed: str, unit: str, option: str, handle_radius_m: float | None = None) -> float:
    """Return a quantity as typed, in SI units."""
    try:
        return read_quantity(typed, unit, handle_radius_m)
    except ValueError as error:
        raise avc.InputError.of(f"is {shown(typed)}, {error}", key=option) from None
