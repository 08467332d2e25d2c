"""Header of an exported coupling: what it is, how it is called, and what it believes of a position."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi._util.units import FORCE, KG, M_PER_S, METRE, NEWTON, NS_PER_M
from avc_hardware.codegen.c_frame import WORDS, comment, comment_lines
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds

if TYPE_CHECKING:
    from avc_casadi.claims.deployable import Deployable
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem
    from avc_casadi.simulation.emit import Precision
    from avc_hardware.codegen.coupling_program import CouplingProgram

_HEADER = """\
/* A virtual coupling with its wall, made by avc-casadi; do not edit.
 *
 * Coupling {id} for {problem}{title}
 * method {method}, structure {structure}, {rows}
 * wall: {wall_b:.9g} {NS_PER_M} and {wall_k:.9g} {N_PER_M}, on one side, at position 0; contact law {contact}
 * beside the gains: {beside}{detents}
 * {FORCE}: {force}
 * {verdict}
 * sample time: {sample_time:.9g} s, and no other: the gains mean another loop at another rate
 *
 * C99, also C++11 and later; no heap, no library; an int of 16 bits is enough{table}. IEEE {precision} precision.
 * The bits are the same on every machine, with gcc and clang without any flag; elsewhere let the compiler not contract
 * a * b + c. -ffast-math is refused.
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#define AVC_COUPLING_ID "{id}"
#define AVC_COUPLING_SAMPLE_TIME_S {sample_time_literal}
#define AVC_COUPLING_SAMPLE_TIME_NS {sample_time_ns}L
{max_force}
{loop}
{begin_c}
typedef {real} avc_coupling_real_t;

/* What the coupling remembers between two samples. */
typedef struct {{
    /* Known of the position: 0 nothing, 1 the last one, 2 its movement too. Samples below 0 in a row, up to 2. Samples
     * in a row inside the wall until what was outside at a fault is believed to be there. */
    unsigned char started, below, wary;
    /* Samples since the device was inside, up to those after which no {FORCE} acts on it any more. */
    unsigned int left;
    /* Of the last position that was believed. */
    {real} position_before_m, moved_before_m;
    /* Where the wall begins until the device has left it: what it went into the wall unseen does not count. */
    {real} face_m;
{states}
}} avc_coupling_t;

/* Forget everything. Call it once before the first step, and whenever sampling has paused. */
void avc_coupling_start(avc_coupling_t *coupling);

/* One sample. position_m: as measured, signed, never clipped: above 0 inside the wall, below 0 outside.
 * Returns the {FORCE} on the device, {NEWTON}, positive out of the wall{limited}; never NaN.
{faults}
 */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m);

{end_c}"""
_UNBELIEVED = (
    "{bounds} Then the {FORCE} is 0, and the next position is believed. Outside all is forgotten, and there is no "
    "{FORCE} until the device has gone deeper for two samples. Inside the coupling goes on at the depth that it knows. "
    "What a device went into the wall unseen or without {FORCE}, before the first sample or in a fault, does not "
    "count: the wall begins so much deeper until the device has been at 0 or below, and gives back no energy that it "
    "has not got, as far as the positions tell: in one that jumps elsewhere and stays there, the {FORCE} goes on as "
    "at the depth before."
)
_SIGNLESS = (
    "A position that is 0 where none was below 0 twice in a row since the start is taken for a depth that is clipped "
    "at 0 (of an engine, of a proxy): outside, where there is no {FORCE} and all is forgotten."
)
_UNBELIEVED_BY_DETENTS = (
    "{bounds} Then the {FORCE} is 0 and all is forgotten; so it is inside the wall before the first sample outside, "
    "until the device has been at 0 or below."
)


def coupling_header(coupling: Coupling, program: CouplingProgram, precision: Precision, verdict: Deployable) -> str:
    """Return the header; a verdict stands in it."""
    problem, runtime, force = coupling.problem, coupling.runtime, coupling.max_force_n
    bounds = SensorBounds.of(problem.device, detents=problem.detent is not None)
    beside = []
    if runtime.observer_mass_kg is not None:
        ahead = problem.device.delay_samples
        beside.append(f"observer for {runtime.observer_mass_kg:g} {KG}" + (f", {ahead} samples ahead" if ahead else ""))
    if runtime.state_feedback is not None:
        half = runtime.state_feedback.dead_zone_m
        beside.append(
            f"observer of {runtime.state_feedback.states} states with a dead zone of +-{half:.4g} {METRE}, and feedback"
        )
    if program.before is not None:
        slew = "no slew limit" if runtime.slew_per_s is None else f"at most {runtime.slew_per_s:g} a second"
        passive = ", passive" if runtime.passive else ""
        beside.append(f"estimator {runtime.estimator}, hold {runtime.hold_s:g} s, {slew}{passive}")
    if runtime.guard is not None:
        beside.append(f"guard {runtime.guard}")
    count = len(coupling.table)
    low, high = coupling.table.frequency_hz[[0, -1]]
    return _HEADER.format(
        **WORDS,
        id=coupling.id,
        problem=comment(problem.name or "a problem"),
        title=comment(f": {problem.title}") if problem.title else "",
        method=comment(coupling.method),
        structure=comment(coupling.structure),
        contact=comment(coupling.contact),
        rows="constant gains" if program.before is None else f"{count} rows from {low:.6g} to {high:.6g} Hz",
        verdict=comment_lines(
            verdict.sentence if verdict.passed else f"UNSAFE, written by request: {verdict.sentence}"
        ),
        wall_b=coupling.wall.damping_ns_per_m,
        wall_k=coupling.wall.stiffness_n_per_m,
        beside=comment("; ".join(beside) or "nothing"),
        detents=_detents(problem),
        force="the problem knows no limit; limit it yourself" if force is None else f"limited at {force:.9g} {NEWTON}",
        sample_time=coupling.sample_time_s,
        sample_time_literal=precision.literal(coupling.sample_time_s),
        sample_time_ns=round(coupling.sample_time_s * 1e9),
        max_force="" if force is None else f"#define AVC_COUPLING_MAX_FORCE_N {precision.literal(force)}\n",
        precision=precision.name,
        real=precision.c_type,
        table="" if program.before is None else "; on AVR the table stays in flash",
        states="\n".join(f"    {precision.c_type} {name};" for name in program.states),
        limited="" if force is None else ", limited at AVC_COUPLING_MAX_FORCE_N",
        faults="\n".join(
            f" * {comment_lines(told.format(**WORDS, bounds=_unbelieved(bounds)))}"
            for told in ((_UNBELIEVED, _SIGNLESS) if problem.detent is None else (_UNBELIEVED_BY_DETENTS,))
        ),
    )


def _unbelieved(bounds: SensorBounds) -> str:
    """Return the description of rejected positions."""
    return (
        f"Not believed is a position that is NaN, infinite or beyond {FARTHEST_M:.0e} {METRE}; one that is more than "
        f"{bounds.jump_m:.4g} {METRE} from the one before, {bounds.fastest_m_per_s:.4g} {M_PER_S}, which no hand does; "
        f"and one that comes by a movement which differs from the one before by more than {bounds.outside_m:.4g} "
        f"{METRE} outside of the wall, {bounds.outside_m_per_s2:.4g} {M_PER_S} in a second, {bounds.leaving_m:.4g} "
        f"{METRE} as long as the last {FORCE} may act there, or {bounds.change_m:.4g} {METRE} inside, "
        f"{bounds.acceleration_m_per_s2:.4g} {M_PER_S} in a second."
    )


def _detents(problem: Problem) -> str:
    """Return the line on the detents; none where there are none."""
    one = problem.detent
    if one is None:
        return ""
    damper = f", a damper of {one.damping_ns_per_m:.9g} {NS_PER_M}" if one.damping_ns_per_m else ""
    return (
        f"\n * detents everywhere: {one.force_n:.9g} {NEWTON} at most, every {one.pitch_m:.9g} {METRE} from "
        f"{one.centre_m:.9g} {METRE}, on"
        f"\n * {100 * one.width:.9g} % of the way{damper}"
    )
