"""Header of an exported coupling to a simulation: the order of a sample, and what ends in less force."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi.loops.engine import ToolLoops
from avc_hardware.codegen.c_frame import FRAME, comment, comment_lines, units_line
from avc_hardware.codegen.other_end_export import FADE_S
from avc_hardware.codegen.sensor_rule import SensorBounds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.virtual_tool import Exchange, VirtualTool

MISSED_STEPS = 5
"""An engine that has missed so many of its longest steps counts as hanging."""
_EXCHANGES: tuple[Exchange, ...] = ("on-time", "late", "ahead", "held-force")

_HEADER = """\
/* The coupling between a haptic device and the tool of a simulation, made by avc-casadi; do not edit.
 *
 * Coupling {id} for {problem}{title}
 * at the device: spring {stiffness:.9g} N/m, damper {damping:.9g} N.s/m{local}
 * in the scene: spring {scene_stiffness:.9g}, damper {scene_damping:.9g}; {scales}
 * engine: {engine}
 * force: {force}
 * {verdict}
 * sample time of the device: {sample_time:.9g} s, and no other: the gains mean another loop at another rate{units}
 *
 * EXCHANGE, for which this is certified: {exchange}.
 * In every sample, in this order:
{order}
 * {otherwise}
 *
{solved}
 * The tool's numbers are the engine's own, in SI units of the scene, with the device's origin and direction. Put the
 * tool where the device is before the first sample: the spring pulls from then on.
 *
 * What goes wrong ends in less force, never in a kick:
 * - The first sample has no velocity.
 * - {bad}
 *   The last good ones are held, the dampers are left out, and the force fades to 0 over {fade_s:.3g} s as
 *   long as it lasts. Once nothing is left of it, whatever comes is believed, and the force comes back as slowly.
 * - No step of the engine in more than {watchdog} samples, {steps} of its steps: it hangs, and the force fades to 0
 *   over {fade_s:.3g} s; it comes back as slowly. {call} says that the engine lives; where it
 *   is called on another computer, call avc_coupling_alive whenever something of the tool comes in.
 * - While it fades the force neither grows nor turns, and it comes back from where it was.
 * - After a fault of more than {fade_s:.3g} s the spring comes back stretched by how far device and tool have gone
 *   apart meanwhile, and pulls them together with energy that no hand has put in: bring the tool to the device first.
 *
 * One thread at a time: an engine in a thread of its own takes the lock of the device's loop for each call. An engine
 * on another computer has its own avc_coupling_t, writes position_m and velocity_m_per_s of the device's newest sample
 * into it and 1 into started, and calls {call}.
 *
 * C99, also C++11 and later; no heap, no library. IEEE {precision} precision. -ffast-math is refused.
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#define AVC_COUPLING_ID "{id}"
#define AVC_COUPLING_EXCHANGE "{name}"
#define AVC_COUPLING_SAMPLE_TIME_S {sample_time_literal}
#define AVC_COUPLING_SAMPLE_TIME_NS {sample_time_ns}L
/* Spring and damper between device and tool, in units of the scene. */
#define AVC_COUPLING_TOOL_STIFFNESS {scene_spring}
#define AVC_COUPLING_TOOL_DAMPING {scene_damper}
{max_force}
{loop}
{begin_c}
typedef {real} avc_coupling_real_t;

/* What the coupling remembers between two samples. */
typedef struct {{
    /* Of the device's newest sample; the velocity is its backward difference. */
    {real} position_m, velocity_m_per_s;
    /* {held_is} */
    {real} {held};
    /* Samples since the last good position, since the last good number of the engine, and since its last step. */
    unsigned long missed, lost, silent;
    /* How far the force has faded; 0 is all of it. */
    unsigned long faded;
    /* That was given last, to the device, to the tool, and out of the engine. */
    {real} force_n, to_tool_n, handed_n;
    /* Known of the position: 0 nothing, 1 the last one, 2 its velocity too; whether anything is of the engine, and
     * whether something was wrong in the last sample. */
    unsigned char started, given, fading;
}} avc_coupling_t;

/* Forget everything. Call it once before the first sample, and whenever sampling has paused. */
void avc_coupling_init(avc_coupling_t *coupling);

/* One sample of the device; returns the force on it, N{limited}; never NaN.
 * position_m: as measured. {given_is} */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {given});

/* The two halves of avc_coupling_step, for an engine that steps between them. */
void avc_coupling_sample(avc_coupling_t *coupling, {real} position_m);
{real} avc_coupling_force(avc_coupling_t *coupling, {given});

{engine_c}
/* The engine lives: where {call} is not called on this coupling. */
void avc_coupling_alive(avc_coupling_t *coupling);

{end_c}"""

_TOOL_FORCE = """\
/* The force on the tool{without}, in units of the scene, from the device's newest sample: once in each
 * step of the engine, with position and velocity that the step begins with. 0 before the first sample, and where one
 * of them is no number. */
{real} avc_coupling_tool_force(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s);
"""
_TARGET = """\
/* Where the engine's spring and damper lead in this step, in units of the scene: once in each step of the engine.
 * Returns what share of both acts: 1, less while something fades, 0 before the first sample. */
{real} avc_coupling_target(avc_coupling_t *coupling, {real} *position_m, {real} *velocity_m_per_s);
"""
_HANDED = """
/* The force for the device's loop, in units of the scene, not to be put on the tool: once in each step of the engine,
 * with position and velocity that the step begins with. */
{real} avc_coupling_handed_force(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s);
"""
_SOLVED = {
    "nothing": "",
    "damper": """\

 * THE ENGINE HAS THE DAMPER: AVC_COUPLING_TOOL_DAMPING times the tool's own velocity, which it solves
 * implicitly, as a damper of the tool's joint beside any drag of the tool. avc_coupling_tool_force leaves that part
 * out. Without it the tool has no damper; with a second one, or in an engine that integrates explicitly, this is
 * another loop than the certified one. Where a position is bad the engine's damper stays.
 *""",
    "spring and damper": """\

 * THE ENGINE HAS SPRING AND DAMPER: AVC_COUPLING_TOOL_STIFFNESS and AVC_COUPLING_TOOL_DAMPING, each
 * times the share that avc_coupling_target returns, between the tool and the position and velocity that it tells; it
 * solves both implicitly. No force of this coupling is put on the tool: one that is computed before the step is
 * another loop, in which a light tool is unstable. Where a position is bad the target stands still at the last one.
 *""",
}


def tool_header(coupling: Coupling, verdict: str, made: Mapping[str, str]) -> str:
    """Return the header; every text passes the allow-list of comments."""
    problem, tool, gains, scene = coupling.problem, coupling.tool, coupling.gains, coupling.in_scene
    device = problem.device
    bounds = SensorBounds.of(device)
    whose = "the device" if tool.exchange == "held-force" else "the device, or of the tool as the device counts it,"
    told: dict[str, object] = {
        "problem": comment(problem.name or "a problem"),
        "title": comment(f": {problem.title}") if problem.title else "",
        "stiffness": gains.stiffness_n_per_m,
        "damping": gains.damping_ns_per_m,
        "local": f", damper of the device's own loop {own:.9g} N.s/m" if (own := gains.local_damping_ns_per_m) else "",
        "scene_stiffness": scene.stiffness_n_per_m,
        "scene_damping": scene.damping_ns_per_m,
        "scales": comment(f"position scale {tool.position_scale:.9g}, force scale {tool.force_scale:.9g}"),
        "engine": comment(_engine(tool)),
        "force": (
            "the problem knows no limit; limit it yourself"
            if device.max_force_n is None
            else f"limited at {device.max_force_n:.9g} N"
        ),
        "units": units_line(problem),
        "verdict": comment_lines(verdict),
        "sample_time": device.sample_time_s,
        "exchange": comment(tool.exchange + (f", and {_steps(tool.steps_late)} later" if tool.steps_late else "")),
        "order": "\n".join(f" *   {number}. {one}" for number, one in enumerate(_order(tool), 1)),
        "otherwise": comment_lines(_otherwise(coupling)),
        "bad": comment_lines(
            f"A number that is none (NaN, infinite), and a position of {whose} that moves faster than "
            f"{bounds.fastest_m_per_s:.4g} m/s, as no hand does; of the device one with a movement that differs "
            f"from the one before by more than {bounds.change_m:.4g} m, {bounds.acceleration_m_per_s2:.4g} "
            f"m/s in a second."
        ).replace(" * ", " *   "),
        "fade_s": max(1, round(FADE_S / device.sample_time_s)) * device.sample_time_s,
        "steps": MISSED_STEPS,
        "name": tool.exchange,
        "call": _call(tool),
        "solved": _SOLVED[tool.solved].format(**FRAME),
        "engine_c": _engine_c(tool, {**FRAME, **made}),
        "limited": "" if device.max_force_n is None else ", limited at AVC_COUPLING_MAX_FORCE_N",
    }
    return _HEADER.format(**FRAME, **made, **told)


def _engine(tool: VirtualTool) -> str:
    """Return the engine that was judged, in a line."""
    steps = " to ".join(f"{one:.9g}" for one in dict.fromkeys(tool.step_s))
    what = "the spring leads to a place that the engine sets"
    if tool.tool_mass_kg is not None:
        masses = " to ".join(f"{one:.9g}" for one in dict.fromkeys(tool.tool_mass_kg))
        what = f"a tool of {masses} kg (in the scene), {tool.integrator}"
    return f"a step every {steps} s, {what}"


def _call(tool: VirtualTool) -> str:
    return "avc_coupling_target" if tool.solved == "spring and damper" else "avc_coupling_tool_force"


def _engine_c(tool: VirtualTool, names: Mapping[str, object]) -> str:
    """Return the declarations of the engine's end."""
    without = " without the damper" if tool.solved == "damper" else ""
    found = (_TARGET if tool.solved == "spring and damper" else _TOOL_FORCE).format(**names, without=without)
    hands_out = tool.solved != "nothing" and tool.exchange == "held-force"
    return found + (_HANDED.format(**names) if hands_out else "")


def _order(tool: VirtualTool) -> list[str]:
    """Return the operations of a sample of the exchange, in order."""
    engine = "where the engine steps: force = avc_coupling_tool_force(its state), then the step"
    if tool.solved == "spring and damper":
        engine = "where the engine steps: avc_coupling_target(...) for its spring and damper, then the step"
    late = tool.queued
    age = f" {_steps(late)} before this one" if late else ""
    if tool.exchange == "held-force":
        if tool.solved != "nothing":
            engine = engine.replace(", then the step", "; force to hand out = avc_coupling_handed_force(its state)")
            engine += "; then the step"
        return [
            "avc_coupling_sample(position)",
            engine,
            f"avc_coupling_force({f'the force of{age}' if late else 'that force'}), the same until the next step",
        ]
    if tool.exchange == "ahead":
        return [
            "avc_coupling_sample(position)",
            engine,
            f"avc_coupling_force(the state that {age.strip() or 'this step'} has made), the same until the next step",
        ]
    given = f"the state that{age} began with" if late else "the state that a step now due begins with"
    return [f"avc_coupling_step(position, {given}), the same until the next step", engine]


def _otherwise(coupling: Coupling) -> str:
    """Describe the other exchanges for which these gains hold."""
    used = coupling.tool.exchange
    held = {
        one: ToolLoops(coupling.problem.changed(simulation={"exchange": one})).stable_over_ranges(coupling.gains)
        for one in _EXCHANGES
        if one != used
    }
    told = "; ".join(f"{one}, {'still stable' if stable else 'unstable'}" for one, stable in held.items())
    return (
        f"With these gains another exchange is another loop: {told}. On-time hands out the state that the engine's "
        "step begins with, late that of the step before, ahead the state that the step has just made: it lies in the "
        f"future of the force that made it, and costs a factor of 10 to 60 of the stiffness. Held-force hands out "
        f"the force."
    )


def _steps(count: int) -> str:
    return "one step" if count == 1 else f"{count} steps"
