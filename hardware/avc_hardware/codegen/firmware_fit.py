"""Compatibility of a coupling with the packaged firmware, or with that of a device, and its single-precision values."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from avc_casadi import NotDeployableError, UnsupportedError
from avc_casadi.coupling import require_coupling
from avc_hardware.codegen.figures import SLOWEST_ESTIMATE_S, Config, RuntimeFigures, board_limits, device_config

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


_ROUNDING = 1e-9
"""Share by which a sample time may exceed its limit by rounding."""
_SINGLE_ROUNDING = 1e-6
"""Share by which numbers that are equal in single precision differ at most."""


class FirmwareLacksError(NotDeployableError, UnsupportedError):
    """A coupling needs features that the device's firmware lacks, and is refused (command line: exit code 1)."""


def check_runs_on(
    coupling: Coupling, has: RuntimeFigures | None = None, *, most_states: int = 16, bound: bool = False
) -> None:
    """Refuse a coupling that needs features that the firmware lacks: the packaged one, or that of a device."""
    require_coupling(coupling)
    if coupling.problem.detent is not None:
        fault = "the firmware does not support [detent]; export the coupling as C: avc export FILE --c DIR"
        raise UnsupportedError(f"{coupling.problem.name}: {fault}", key="detent")
    runtime = coupling.runtime
    lacks = []
    if runtime.observer_mass_kg is not None:
        lacks.append("it has no observer between encoder steps (runtime.observer_mass_kg)")
    feedback = runtime.state_feedback
    constant = coupling.table.constant
    if feedback is not None and feedback.states > most_states:
        lacks.append(
            f"it supports {most_states} observer states, the coupling has {feedback.states} "
            "(runtime.state_feedback; recommend again with a simpler device)"
        )
    if not constant and coupling.sample_time_s > SLOWEST_ESTIMATE_S * (1 + _ROUNDING):
        lacks.append(f"its estimator runs at sample times up to {SLOWEST_ESTIMATE_S:.3g} s")
    if feedback is not None and not constant:
        lacks.append("it supports state feedback with constant gains only (runtime.state_feedback)")
    if runtime.guard not in {None, "passivity-controller"}:
        lacks.append(f"it does not support the guard {runtime.guard} (allowed: passivity-controller, or no guard)")
    if has is not None and not constant:
        lacks += _differences(figures_of(coupling), has, bound=bound)
    if lacks:
        raise FirmwareLacksError(
            f"{coupling.problem.name}: the coupling does not run on this firmware: {'; '.join(lacks)}. "
            "Take another coupling (such as avc solve P --method static-tuned --out FILE), or export "
            "it for firmware of your own: avc export FILE --c DIR"
        )


def _differences(wanted: RuntimeFigures, has: RuntimeFigures, *, bound: bool) -> list[str]:
    """Return what the firmware's program, or its handle where it keeps its own, has otherwise than a coupling."""
    equal = {
        "estimator": wanted.estimator == has.estimator,
        "passive": wanted.passive == has.passive,
        "hand_m_per_unit": not bound
        or math.isclose(wanted.hand_m_per_unit, has.hand_m_per_unit, rel_tol=_SINGLE_ROUNDING),
    }
    names = (name for name, holds in equal.items() if not holds)
    return [f"its {name} is {getattr(has, name)}, the coupling's {getattr(wanted, name)}" for name in names]


def config_for(coupling: Coupling, device: Config, *, bound: bool) -> Config:
    """Return the configuration for a coupling on a device: a bound one keeps its limits and its handle."""
    wanted = figures_of(coupling)
    limits = device.limits
    figures = device.figures
    if not bound:
        limits = board_limits(coupling.problem.device)
        figures = replace(figures, sample_time_s=limits.sample_time_s, metres_per_count=limits.metres_per_count)
        figures = replace(figures, hand_m_per_unit=wanted.hand_m_per_unit)
    if not coupling.table.constant:
        figures = replace(figures, hold_s=wanted.hold_s, slew_per_s=wanted.slew_per_s)
    if coupling.runtime.guard is not None:
        figures = replace(figures, guard_damping_ns_per_m=wanted.guard_damping_ns_per_m)
    return Config(limits, figures)


def figures_of(coupling: Coupling) -> RuntimeFigures:
    """Return the figures of a firmware for a coupling; by default those of the boards."""
    runtime, figures = coupling.runtime, device_config(coupling.problem.device).figures
    if runtime.guard is not None:
        figures = replace(figures, guard_damping_ns_per_m=coupling.problem.device.damping_ns_per_m)
    if coupling.table.constant:
        return figures
    return replace(
        figures,
        estimator=runtime.estimator,
        hold_s=runtime.hold_s,
        slew_per_s=runtime.slew_per_s,
        passive=runtime.passive,
    )
