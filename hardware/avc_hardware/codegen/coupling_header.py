"""Header of an exported coupling: what it is, how it is called, and what it believes of a position."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_hardware.codegen.c_frame import FRAME, comment, comment_lines, head_words
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds

if TYPE_CHECKING:
    from avc_casadi.claims.deployable import Deployable
    from avc_casadi.coupling import Coupling
    from avc_casadi.simulation.emit import Precision
    from avc_hardware.codegen.coupling_program import CouplingProgram

_HEADER = """\
/* A virtual coupling with its wall, made by avc-casadi; do not edit.
 *
 * Coupling {id} for {problem}{title}
 * method {method}, structure {structure}, {rows}
 * wall: {wall_b:.9g} N.s/m and {wall_k:.9g} N/m, on one side, at position 0; contact law {contact}
 * beside the gains: {beside}{detents}
 * force: {force}
 * {verdict}
 * sample time: {sample_time:.9g} s, and no other: the gains mean another loop at another rate{units}
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
    /* Whether a position is known, whether the law runs, and whether the wall begins deeper than at 0. */
    unsigned char known, runs, moved;
    /* The last position that is a number, and the movement that a hand can have made to it. */
    {real} position_before_m, moved_before_m;
    /* Where the wall begins until the device has left it, what it went into it unseen not counted; and how deep it was
     * when the law ran last. */
    {real} face_m, depth_m;
{states}
}} avc_coupling_t;

/* Forget everything. Call it once before the first step, and whenever sampling has paused. */
void avc_coupling_start(avc_coupling_t *coupling);

/* One sample. position_m: as measured, signed, never clipped: above 0 inside the wall, below 0 outside.
 * Returns the force on the device, N, positive out of the wall{limited}; never NaN.
{faults}
 */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m);

{end_c}"""
_UNBELIEVED = """\
Not believed is a position that is NaN, infinite or beyond {farthest:.0e} m; one that is more than {jump:.4g} m from the
one before, {fastest:.4g} m/s, which no hand does; and one that comes by a movement which differs by more than
{outside:.4g} m outside of the wall, {inside:.4g} m inside, from what a hand can have made. Then the force is 0; """
_OF_WALLS = """\
the coupling goes on as soon as a position is believed, at the depth that it knows. What a device went into the wall
unseen, before the first sample or in a fault, does not count: the wall begins so much deeper until the device has been
at 0 or below."""
_OF_DETENTS = "so it is until the device has been at 0 or below."


def coupling_header(coupling: Coupling, program: CouplingProgram, precision: Precision, verdict: Deployable) -> str:
    """Return the header; a verdict stands in it."""
    problem, force, detent = coupling.problem, coupling.max_force_n, coupling.problem.detent
    bounds = SensorBounds.of(problem.device, detents=detent is not None)
    faults = _UNBELIEVED.format(
        farthest=FARTHEST_M,
        jump=bounds.jump_m,
        fastest=bounds.fastest_m_per_s,
        outside=bounds.outside_m,
        inside=bounds.change_m,
    )
    low, high = coupling.table.frequency_hz[[0, -1]]
    values = {} if detent is None else detent.model_dump()
    detents = comment(", ".join(f"{key} {value:.9g}" for key, value in values.items()))
    return _HEADER.format(
        **FRAME,
        id=coupling.id,
        **head_words(problem),
        method=comment(coupling.method),
        structure=comment(coupling.structure),
        contact=comment(coupling.contact),
        rows="constant gains" if program.before is None else f"{len(coupling.table)} rows, {low:.6g} to {high:.6g} Hz",
        verdict=comment_lines(
            verdict.sentence if verdict.passed else f"UNSAFE, written by request: {verdict.sentence}"
        ),
        wall_b=coupling.wall.damping_ns_per_m,
        wall_k=coupling.wall.stiffness_n_per_m,
        beside=_beside(coupling),
        detents=f"\n * detents everywhere: {detents}" if detents else "",
        force="the problem knows no limit; limit it yourself" if force is None else f"limited at {force:.9g} N",
        sample_time=coupling.sample_time_s,
        sample_time_literal=precision.literal(coupling.sample_time_s),
        sample_time_ns=round(coupling.sample_time_s * 1e9),
        max_force="" if force is None else f"#define AVC_COUPLING_MAX_FORCE_N {precision.literal(force)}\n",
        precision=precision.name,
        real=precision.c_type,
        table="" if program.before is None else "; on AVR the table stays in flash",
        states="\n".join(f"    {precision.c_type} {name};" for name in program.states),
        limited="" if force is None else ", limited at AVC_COUPLING_MAX_FORCE_N",
        faults=f" * {comment_lines(faults + (_OF_WALLS if detent is None else _OF_DETENTS))}",
    )


def _beside(coupling: Coupling) -> str:
    """Return what runs beside the gains, by the keys of [runtime]."""
    runtime = coupling.runtime
    found = [] if coupling.table.constant else ["estimator", "hold_s", "slew_per_s", "passive"]
    found += [key for key in ("observer_mass_kg", "guard") if getattr(runtime, key) is not None]
    told = [f"{key} {getattr(runtime, key)}" for key in found]
    if runtime.state_feedback is not None:
        told.append(f"an observer of {runtime.state_feedback.states} states, and feedback")
    return comment(", ".join(told) or "nothing")
