"""Diagnosis of a log of an oscillating loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi.coupling import Coupling
from avc_casadi.identification.diagnosis.causes import weigh
from avc_casadi.identification.diagnosis.evidence import (
    felt,
    integral_sentence,
    law_sentence,
    oscillation_sentence,
    ticks_sentence,
)
from avc_casadi.identification.diagnosis.intended import Declared, law_differs, other_unit
from avc_casadi.identification.diagnosis.law import Law, find_integral, find_law, with_outside_force, without_repeats
from avc_casadi.identification.diagnosis.log import Log, log_of
from avc_casadi.identification.diagnosis.model import Diagnosis
from avc_casadi.identification.diagnosis.oscillation import TracedOscillation, find_oscillation
from avc_casadi.identification.diagnosis.plant import fit_plants
from avc_casadi.identification.diagnosis.relay import find_switched_force, find_two_rates
from avc_casadi.identification.diagnosis.saturation import exceeded, limited
from avc_casadi.identification.diagnosis.verdict import Judge
from avc_casadi.identification.read import read_columns
from avc_casadi.identification.record import Columns
from avc_casadi.identification.units import Layout
from avc_casadi.model.device import Device
from avc_casadi.model.problem import Hands

_DRAWS = 16
# A law with a smaller residual is that of the log; another one must have a residual so much smaller.
_EXACT, _BETTER = 5e-3, 0.3


def diagnose(
    log: str | Path | Columns,
    *,
    layout: Layout | None = None,
    device: Device | None = None,
    hands: Hands | None = None,
    coupling: Coupling | None = None,
    stiffness_n_per_m: float | None = None,
    damping_ns_per_m: float | None = None,
    flip_force: bool = False,
    seed: int = 0,
    progress: Progress = SILENT,
) -> Diagnosis:
    """Diagnose one log of time, position and commanded force.

    Args:
        log: a file, or its columns.
        layout: columns and units of the file.
        device: as declared; None assumes a default.
        hands: those that the loop was designed for; None takes the usual ranges.
        coupling: the intended one; its device and hands are taken where none are given.
        stiffness_n_per_m: intended k, in place of a coupling.
        damping_ns_per_m: intended b.
        flip_force: whether the log counts the force against +position.
        seed: of the random draws.
        progress: of the diagnosis.

    Raises:
        InputError: every fault of the log, or a force that drives the device away from its equilibrium.
    """
    columns = log if isinstance(log, Columns) else _one(read_columns(log, layout), log)
    if coupling is not None:
        device = device or coupling.problem.device
        hands = hands or coupling.problem.hands
    meant = coupling, stiffness_n_per_m, damping_ns_per_m
    return _diagnosed(columns, device, hands, meant, flip_force, seed, progress)


def _diagnosed(
    columns: Columns,
    device: Device | None,
    hands: Hands | None,
    meant: tuple[Coupling | None, float | None, float | None],
    flip_force: bool,
    seed: int,
    progress: Progress,
) -> Diagnosis:
    coupling, stiffness_n_per_m, damping_ns_per_m = meant
    _check_motion(columns, device)
    reach_m = 1.0 if device is None else device.metres_per_unit
    grid, notes = log_of(columns, flip_force=flip_force, reach_m=reach_m)
    if not np.ptp(grid.position_m):
        if np.ptp(grid.force_n):
            raise InputError.of(
                "never changes, and the force does; allowed: a log of a device that moves. An encoder that is "
                "stuck, or a column that is not the position, looks like this",
                file=columns.file,
                key="position",
            )
        notes = [*notes, "the position never changes: an encoder that is stuck looks like this too"]
    declared = Declared.of(device, hands, grid.ticks.sample_time_s)
    limit_n = declared.device.max_force_n
    if limit_n is not None and exceeded(grid, limit_n):
        # The declared limit does not apply to this log.
        ranges = declared.device.range.model_copy(update={"max_force_n": None})
        unlimited = declared.device.model_copy(update={"max_force_n": None, "range": ranges})
        declared = replace(declared, device=unlimited)
        most = number(float(np.abs(grid.force_n).max()), 3)
        said = f"the log commands up to {most}, and max_force_n declares {number(limit_n, 3)} "
        notes = [*notes, f"{said}, beyond which it may not have acted: is the limit, or a unit, another one?"]
    grid = without_repeats(with_outside_force(grid, declared.device.max_force_n), declared.device.max_force_n)
    if grid.outside_n:
        said = f"a constant force of {number(-grid.outside_n, 3)} stands outside contact"
        notes = [*notes, f"{said}: a weight that is compensated, or an offset of that column"]
    with progress.step("oscillation"):
        swing = limited(grid, find_oscillation(grid), declared.device.max_force_n)
    law = find_law(grid, declared.device.max_force_n)
    if law is not None and law.told and law.stiffness_n_per_m < 0 and law.damping_ns_per_m < 0:
        raise InputError.of(
            f"gives k = {number(law.stiffness_n_per_m, 3)} and b = {number(law.damping_ns_per_m, 3)} "
            f": the force drives the device away; allowed: force along +position, or --flip-force; or "
            "the sign of the loop is wrong, and that is what is wrong with it",
            file=columns.file,
            key="force",
        )
    integral = find_integral(grid, law, declared.device.max_force_n)
    evidence = [oscillation_sentence(swing.found, felt(grid, swing, declared)), ticks_sentence(grid.ticks, declared)]
    if integral is not None:
        law = None
        evidence.append(integral_sentence(integral))
    elif law is None:
        evidence.append("the force tells of no spring and no damper" if grid.force_n.any() else "no force is commanded")
    else:
        evidence.append(law_sentence(law, grid.ticks.period_s))
        notes += law_differs(law, swing.found, grid, coupling, stiffness_n_per_m, damping_ns_per_m)
    unit = other_unit(grid, swing.found, law, declared, coupling, stiffness_n_per_m)
    judge = Judge(grid, swing, law, declared, evidence, [*declared.notes, *notes])
    if early := judge.at_once() or judge.in_another_unit(unit) or judge.jumps() or judge.integrates(integral):
        return early
    if other := _by_another_law(judge, law, grid, swing, declared, seed, progress) or judge.moves_on():
        return other
    if law is None or not law.told:
        return judge.without_model()
    with progress.step("device and hand"):
        fits = fit_plants(grid, swing, declared, law.lag, _DRAWS, seed)
    if wrong := judge.drives(law, fits):
        return wrong
    with progress.step("causes"):
        asked = weigh(fits, law, grid, swing.found, declared)
    with progress.step("cures"):
        return judge.judged(law, fits, asked)


def _by_another_law(
    judge: Judge,
    law: Law | None,
    grid: Log,
    swing: TracedOscillation,
    declared: Declared,
    seed: int,
    progress: Progress,
) -> Diagnosis | None:
    """Return the verdict on a force unlike a spring and damper of one rate, where it is of another known kind."""
    most = math.inf if law is None or not law.told else _BETTER * law.misfit
    if most < _BETTER * _EXACT:
        return None
    device = declared.device
    relay = find_switched_force(grid, swing, device.max_force_n, device.coulomb_friction_n)
    rates = None if relay is not None else find_two_rates(grid)
    other = relay or rates
    if other is None or other.law.misfit > most:
        return None
    with progress.step("device and hand"):
        fits = fit_plants(grid, swing, declared, other.law.lag, _DRAWS, seed)
    return judge.relay(relay, fits) if relay is not None else judge.two_rates(rates, fits) if rates else None


def _check_motion(columns: Columns, device: Device | None) -> None:
    """Refuse a rotary log with a linear device, or without a handle radius."""
    turns, motion = columns.motion == "rotary", None if device is None else device.motion
    if motion == columns.motion or (device is None and not turns):
        return
    allowed = "a log of its own motion: rad and N.m of what turns, m and N at a handle, x = r theta and F = tau/r"
    message = f"is {columns.motion} by its units, and the device is {motion}; allowed: {allowed}"
    if device is None:
        message = (
            "is of a device that turns, and nothing says where the hand holds it; allowed: beside --device, --problem "
            "or --coupling, whose device has handle_radius_m"
        )
    raise InputError.of(message, file=columns.file, key="position")


def _one(columns: Sequence[Columns], file: str | Path) -> Columns:
    if len(columns) > 1:
        raise InputError.of(
            f"holds {len(columns)} records; allowed: one record a log, in files of their own", file=str(file)
        )
    return columns[0]
