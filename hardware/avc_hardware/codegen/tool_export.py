"""Export of a coupling to a simulation: the device's end and the engine's end of spring and damper, as C."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from avc_casadi._util.units import FORCE, KG, M_PER_S, METRE, NEWTON, NS_PER_M, in_its_units
from avc_casadi.claims.stability.tool_loop import ToolLoops
from avc_hardware.codegen.export import HEADER, NAME, SOURCE, WIDE_ENOUGH
from avc_hardware.codegen.operations import DOUBLE, Precision
from avc_hardware.codegen.other_end_export import FADE_S, checked, eased_c, named, verdict
from avc_hardware.codegen.packages import WORDS, comment, comment_lines
from avc_hardware.codegen.sensor_rule import FARTHEST_M, SensorBounds, believed_c

if TYPE_CHECKING:
    from avc_casadi.model.virtual_tool import Exchange, VirtualTool
    from avc_casadi.other_end_coupling import ToolCoupling

# An engine that has missed so many of its longest steps counts as hanging.
_STEPS = 5
_EXCHANGES: tuple[Exchange, ...] = ("on-time", "late", "ahead", "held-force")

_HEADER = """\
/* The coupling between a haptic device and the tool of a simulation, made by avc-casadi; do not edit.
 *
 * Coupling {id} for {problem}{title}
 * at the device: spring {stiffness:.9g} {N_PER_M}, damper {damping:.9g} {NS_PER_M}{local}
 * in the scene: spring {scene_stiffness:.9g}, damper {scene_damping:.9g}; {scales}
 * engine: {engine}
 * {FORCE}: {force}
 * {verdict}
 * sample time of the device: {sample_time:.9g} s, and no other: the gains mean another loop at another rate
 *
 * EXCHANGE, for which this is certified: {exchange}.
 * In every sample, in this order:
{order}
 * {otherwise}
 *
 * The tool's numbers are the engine's own, in SI units of the scene, with the device's origin and direction. Put the
 * tool where the device is before the first sample: the spring pulls from then on.
 *
 * What goes wrong ends in less {FORCE}, never in a kick:
 * - The first sample has no velocity.
 * - {bad}
 *   The last good ones are held, the dampers are left out, and the {FORCE} fades to 0 over {fade_s:.3g} s as
 *   long as it lasts. Once nothing is left of it, whatever comes is believed, and the {FORCE} comes back as slowly.
 * - No step of the engine in more than {watchdog} samples, {steps} of its steps: it hangs, and the {FORCE} fades to 0
 *   over {fade_s:.3g} s; it comes back as slowly. avc_coupling_tool_force says that the engine lives; where it
 *   is called on another computer, call avc_coupling_alive whenever something of the tool comes in.
 * - While it fades the {FORCE} neither grows nor turns, and it comes back from where it was.
 *
 * One thread at a time: an engine in a thread of its own takes the lock of the device's loop for each call. An engine
 * on another computer has its own avc_coupling_t, writes position_m and velocity_m_per_s of the device's newest sample
 * into it and 1 into started, and calls avc_coupling_tool_force.
 *
 * C99, also C++11 and later; no heap, no library. IEEE {precision} precision. -ffast-math is refused.
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#define AVC_COUPLING_ID "{id}"
#define AVC_COUPLING_EXCHANGE "{name}"
#define AVC_COUPLING_SAMPLE_TIME_S {sample_time_literal}
#define AVC_COUPLING_SAMPLE_TIME_NS {sample_time_ns}L
{max_force}
/* Define AVC_LOOP_SAMPLE_TIME_NS as your loop's own, and a coupling for another one does not compile. */
#ifdef AVC_LOOP_SAMPLE_TIME_NS
#if AVC_LOOP_SAMPLE_TIME_NS != AVC_COUPLING_SAMPLE_TIME_NS
#error "this coupling is made for another sample time than the loop that runs it"
#endif
#endif

#ifdef __cplusplus
extern "C" {{
#endif

typedef {real} avc_coupling_real_t;

/* What the coupling remembers between two samples. */
typedef struct {{
    /* Of the device's newest sample; the velocity is its backward difference. */
    {real} position_m, velocity_m_per_s;
    /* {held_is} */
    {real} {held};
    /* Samples since the last good position, since the last good number of the engine, and since its last step. */
    unsigned long missed, lost, silent;
    /* How far the {FORCE} has faded; 0 is all of it. */
    unsigned long faded;
    /* That was given last, to the device and to the tool. */
    {real} force_n, to_tool_n;
    /* Known of the position: 0 nothing, 1 the last one, 2 its velocity too; whether anything is of the engine, and
     * whether something was wrong in the last sample. */
    unsigned char started, given, fading;
}} avc_coupling_t;

/* Forget everything. Call it once before the first sample, and whenever sampling has paused. */
void avc_coupling_init(avc_coupling_t *coupling);

/* One sample of the device; returns the {FORCE} on it, {NEWTON}{limited}; never NaN.
 * position_m: as measured. {given_is} */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {given});

/* The two halves of avc_coupling_step, for an engine that steps between them. */
void avc_coupling_sample(avc_coupling_t *coupling, {real} position_m);
{real} avc_coupling_force(avc_coupling_t *coupling, {given});

/* The {FORCE} on the tool, in units of the scene, from the device's newest sample: once in each step of the engine, \
with
 * position and velocity that the step begins with. 0 before the first sample, and where one of them is no number. */
{real} avc_coupling_tool_force(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s);

/* The engine lives: where avc_coupling_tool_force is not called on this coupling. */
void avc_coupling_alive(avc_coupling_t *coupling);

#ifdef __cplusplus
}}
#endif

#endif
"""

_SOURCE = """\
/* Coupling {id}: spring and damper to the tool of a simulation; do not edit. */
#include "avc_coupling.h"

#ifdef __FAST_MATH__
#error "compile without -ffast-math: a position that is not a number must be seen"
#endif
{check}
/* In samples: until an engine that does not step hangs, and in which the {FORCE} fades. */
#define WATCHDOG {watchdog}ul
#define FADE {fade}ul

{believed}
{eased}
void avc_coupling_init(avc_coupling_t *coupling)
{{
    coupling->position_m = {zero};
    coupling->velocity_m_per_s = {zero};
{clear}
    coupling->missed = 0ul;
    coupling->lost = 0ul;
    coupling->silent = 0ul;
    coupling->faded = 0ul;
    coupling->force_n = {zero};
    coupling->to_tool_n = {zero};
    coupling->started = 0u;
    coupling->given = 0u;
    coupling->fading = 0u;
}}

void avc_coupling_alive(avc_coupling_t *coupling)
{{
    coupling->silent = 0ul;
}}

void avc_coupling_sample(avc_coupling_t *coupling, {real} position_m)
{{
    if (coupling->missed >= FADE) {{
        coupling->started = 0u;
    }}
    if (coupling->silent <= WATCHDOG) {{
        coupling->silent++;
    }}
    if (!believed(position_m, coupling->position_m, coupling->velocity_m_per_s * AVC_COUPLING_SAMPLE_TIME_S,
                  coupling->missed == 0ul || coupling->started == 0u ? coupling->started : 1u, {jump}, {change})) {{
        coupling->velocity_m_per_s = {zero};
        if (coupling->missed < FADE) {{
            coupling->missed++;
        }}
        return;
    }}
    coupling->velocity_m_per_s = {zero};
    if (coupling->started != 0u) {{
        coupling->velocity_m_per_s =
            (position_m - coupling->position_m) / (({real})(coupling->missed + 1ul) * AVC_COUPLING_SAMPLE_TIME_S);
    }}
    coupling->position_m = position_m;
    coupling->started = coupling->started != 0u && coupling->missed == 0ul ? 2u : 1u;
    coupling->missed = 0ul;
}}

{real} avc_coupling_force(avc_coupling_t *coupling, {given})
{{
    {real} force_n = {zero};
    if (coupling->lost >= FADE) {{
        coupling->given = 0u;
    }}
    if ({good}) {{
{keep}
        coupling->lost = 0ul;
        coupling->given = 1u;
    }} else if (coupling->lost < FADE) {{
        coupling->lost++;
    }}
    if (coupling->started != 0u && coupling->given != 0u) {{
        force_n = {spring};
        if (coupling->missed == 0ul && coupling->lost == 0ul) {{
            force_n -= {dampers};
        }}
{clip}    }}
    return eased(coupling, force_n,
                 coupling->missed == 0ul && coupling->lost == 0ul && coupling->silent <= WATCHDOG, FADE);
}}

{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {given})
{{
    avc_coupling_sample(coupling, position_m);
    return avc_coupling_force(coupling, {passed});
}}

{real} avc_coupling_tool_force(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s)
{{
    {real} force_n, left_n;
    avc_coupling_alive(coupling);
    if (coupling->started == 0u || !within(tool_position_m, {scene_farthest}) ||
        !within(tool_velocity_m_per_s, {scene_farthest})) {{
        return {zero};
    }}
    force_n = {scene_spring} * ({position_scale} * coupling->position_m - tool_position_m);
    if (coupling->missed == 0ul) {{
        force_n += {scene_damper} * ({position_scale} * coupling->velocity_m_per_s - tool_velocity_m_per_s);
    }}
    left_n = left_of(force_n, coupling->faded, FADE);
    coupling->to_tool_n = coupling->missed == 0ul ? left_n : no_more(left_n, coupling->to_tool_n);
    return coupling->to_tool_n;
}}
"""


@in_its_units
def export_tool_c(
    coupling: ToolCoupling, *, precision: str = "single", name: str = NAME, unsafe: bool = False
) -> dict[str, str]:
    """Return a coupling to a simulation as C, ``avc_coupling.h`` and ``avc_coupling.c``, by file name.

    The device's end in each of its samples (spring, damper, damper of its own loop, force limit, scales, watchdog of
    the engine) and the engine's end in each of its steps. Names and comments are those of the device.

    Args:
        coupling: of a problem with [simulation].
        precision: ``single`` (float) or ``double``.
        name: prefix of the files, functions, types and macros (in capitals).
        unsafe: whether a coupling that is not stable is written too.

    Raises:
        NotDeployableError: a loop of the problem is not stable with it.
        InputError: another precision, or a name invalid in C.
    """
    chosen = checked(precision, name)
    judged = verdict(coupling.problem, ToolLoops(coupling.problem), coupling.gains, unsafe=unsafe)
    words, numbers = _words(coupling.tool, chosen), _numbers(coupling, chosen)
    files = {
        HEADER: _HEADER.format(**WORDS, **words, **numbers, **_told(coupling, judged)),
        SOURCE: _SOURCE.format(**WORDS, **words, **numbers),
    }
    return named(coupling.problem, files, name)


def _numbers(coupling: ToolCoupling, precision: Precision) -> dict[str, str]:
    """Return the literals of a coupling for both files."""
    device, tool, literal = coupling.problem.device, coupling.tool, precision.literal
    bounds = SensorBounds.of(device)
    samples = math.ceil(max(tool.step_s) / device.sample_time_s - 1e-9)
    scene, force = coupling.in_scene, device.max_force_n
    return {
        "id": coupling.id,
        "precision": precision.name,
        "check": WIDE_ENOUGH if precision is DOUBLE else "",
        "real": precision.c_type,
        "zero": literal(0.0),
        "sample_time_literal": literal(device.sample_time_s),
        "sample_time_ns": str(round(device.sample_time_s * 1e9)),
        "watchdog": str(_STEPS * samples),
        "fade": str(max(1, round(FADE_S / device.sample_time_s))),
        "scene_farthest": literal(FARTHEST_M * tool.position_scale),
        "believed": believed_c(precision),
        "eased": eased_c(precision),
        "jump": literal(bounds.jump_m),
        "change": literal(bounds.change_m),
        "position_scale": literal(tool.position_scale),
        "scene_spring": literal(scene.stiffness_n_per_m),
        "scene_damper": literal(scene.damping_ns_per_m),
        "clip": "" if force is None else _clip("AVC_COUPLING_MAX_FORCE_N"),
        "max_force": "" if force is None else f"#define AVC_COUPLING_MAX_FORCE_N {literal(force)}\n",
        **_law(coupling, precision, bounds.fastest_m_per_s),
    }


def _clip(limit: str) -> str:
    return (
        f"        if (force_n > {limit}) {{\n            force_n = {limit};\n        }}\n"
        f"        if (force_n < -{limit}) {{\n            force_n = -{limit};\n        }}\n"
    )


def _law(coupling: ToolCoupling, precision: Precision, fastest: float) -> dict[str, str]:
    """Return the force on the device as expressions: spring, dampers, valid inputs."""
    gains, tool, literal = coupling.gains, coupling.tool, precision.literal
    local = f"{literal(gains.local_damping_ns_per_m)} * coupling->velocity_m_per_s"
    if tool.exchange == "held-force":
        return {
            "good": f"within(tool_force_n, {literal(FARTHEST_M / tool.force_scale)})",
            "keep": _lines(["coupling->tool_force_n = tool_force_n;"], 8),
            "clear": _lines([f"coupling->tool_force_n = {literal(0.0)};"], 4),
            "spring": f"-({literal(tool.force_scale)} * coupling->tool_force_n)",
            "dampers": local,
        }
    scale = literal(tool.position_scale)
    # A tool may move as far in a step of the engine as in a sample.
    farthest = fastest * tool.position_scale * max(*tool.step_s, coupling.problem.device.sample_time_s)
    kept = ("tool_position_m", "tool_velocity_m_per_s")
    spring = f"coupling->position_m - coupling->tool_position_m / {scale}"
    damper = f"coupling->velocity_m_per_s - coupling->tool_velocity_m_per_s / {scale}"
    dampers = f"{literal(gains.damping_ns_per_m)} * ({damper})"
    return {
        "good": f"within(tool_position_m, {literal(FARTHEST_M * tool.position_scale)}) &&\n"
        f"        within(tool_velocity_m_per_s, {literal(fastest * tool.position_scale)}) &&\n"
        f"        (coupling->given == 0u || within(tool_position_m - coupling->tool_position_m, {literal(farthest)}))",
        "keep": _lines([f"coupling->{one} = {one};" for one in kept], 8),
        "clear": _lines([f"coupling->{one} = {literal(0.0)};" for one in kept], 4),
        "spring": f"-({literal(gains.stiffness_n_per_m)} * ({spring}))",
        "dampers": f"{dampers} +\n                       {local}" if gains.local_damping_ns_per_m else dampers,
    }


def _words(tool: VirtualTool, precision: Precision) -> dict[str, str]:
    """Return names of the inputs of the device's loop: the tool's state, or the force on it."""
    real = precision.c_type
    if tool.exchange == "held-force":
        return {
            "given": f"{real} tool_force_n",
            "passed": "tool_force_n",
            "held": "tool_force_n",
            "held_is": f"The last good {FORCE} on the tool, in units of the scene.",
            "given_is": (
                f"tool_force_n: the newest {FORCE} on the tool, from avc_coupling_tool_force\n"
                " * or of the engine itself, the same until its next step; 0 before the first one."
            ),
        }
    return {
        "given": f"{real} tool_position_m, {real} tool_velocity_m_per_s",
        "passed": "tool_position_m, tool_velocity_m_per_s",
        "held": "tool_position_m, tool_velocity_m_per_s",
        "held_is": "The last good state of the tool, in units of the scene.",
        "given_is": (
            "tool_position_m, tool_velocity_m_per_s: of the tool in the scene,\n"
            " * the same until the engine's next step."
        ),
    }


def _told(coupling: ToolCoupling, verdict: str) -> dict[str, object]:
    """Return the comments of the header; every text passes the allow-list of comments."""
    problem, tool, gains, scene = coupling.problem, coupling.tool, coupling.gains, coupling.in_scene
    device = problem.device
    bounds = SensorBounds.of(device)
    whose = "the device" if tool.exchange == "held-force" else "the device, or of the tool as the device counts it,"
    return {
        "problem": comment(problem.name or "a problem"),
        "title": comment(f": {problem.title}") if problem.title else "",
        "stiffness": gains.stiffness_n_per_m,
        "damping": gains.damping_ns_per_m,
        "local": f", damper of the device's own loop {own:.9g} {NS_PER_M}"
        if (own := gains.local_damping_ns_per_m)
        else "",
        "scene_stiffness": scene.stiffness_n_per_m,
        "scene_damping": scene.damping_ns_per_m,
        "scales": comment(f"position scale {tool.position_scale:.9g}, {FORCE} scale {tool.force_scale:.9g}"),
        "engine": comment(_engine(tool)),
        "force": (
            "the problem knows no limit; limit it yourself"
            if device.max_force_n is None
            else f"limited at {device.max_force_n:.9g} {NEWTON}"
        ),
        "verdict": comment_lines(verdict),
        "sample_time": device.sample_time_s,
        "exchange": comment(tool.exchange + (f", and {_steps(tool.steps_late)} later" if tool.steps_late else "")),
        "order": "\n".join(f" *   {number}. {one}" for number, one in enumerate(_order(tool), 1)),
        "otherwise": comment_lines(_otherwise(coupling)),
        "bad": comment_lines(
            f"A number that is none (NaN, infinite), and a position of {whose} that moves faster than "
            f"{bounds.fastest_m_per_s:.4g} {M_PER_S}, as no hand does; of the device one with a movement that differs "
            f"from the one before by more than {bounds.change_m:.4g} {METRE}, {bounds.acceleration_m_per_s2:.4g} "
            f"{M_PER_S} in a second."
        ).replace(" * ", " *   "),
        "fade_s": max(1, round(FADE_S / device.sample_time_s)) * device.sample_time_s,
        "steps": _STEPS,
        "name": tool.exchange,
        "limited": "" if device.max_force_n is None else ", limited at AVC_COUPLING_MAX_FORCE_N",
    }


def _engine(tool: VirtualTool) -> str:
    """Return the engine that was judged, in a line."""
    steps = " to ".join(f"{one:.9g}" for one in dict.fromkeys(tool.step_s))
    what = "the spring leads to a place that the engine sets"
    if tool.tool_mass_kg is not None:
        masses = " to ".join(f"{one:.9g}" for one in dict.fromkeys(tool.tool_mass_kg))
        what = f"a tool of {masses} {KG} (in the scene), {tool.integrator}"
    return f"a step every {steps} s, {what}"


def _order(tool: VirtualTool) -> list[str]:
    """Return the operations of a sample of the exchange, in order."""
    engine = f"where the engine steps: {FORCE} = avc_coupling_tool_force(its state), then the step"
    late = tool.queued
    age = f" {_steps(late)} before this one" if late else ""
    if tool.exchange == "held-force":
        return [
            "avc_coupling_sample(position)",
            engine,
            f"avc_coupling_force({f'the {FORCE} of{age}' if late else f'that {FORCE}'}), the same until the next step",
        ]
    if tool.exchange == "ahead":
        return [
            "avc_coupling_sample(position)",
            engine,
            f"avc_coupling_force(the state that {age.strip() or 'this step'} has made), the same until the next step",
        ]
    given = f"the state that{age} began with" if late else "the state that a step now due begins with"
    return [f"avc_coupling_step(position, {given}), the same until the next step", engine]


def _otherwise(coupling: ToolCoupling) -> str:
    """Describe the other exchanges for which these gains hold."""
    used = coupling.tool.exchange
    held = {
        one: ToolLoops(coupling.problem.changed(simulation={"exchange": one})).stable(coupling.gains)
        for one in _EXCHANGES
        if one != used
    }
    told = "; ".join(f"{one}, {'still stable' if stable else 'unstable'}" for one, stable in held.items())
    return (
        f"With these gains another exchange is another loop: {told}. On-time hands out the state that the engine's "
        "step begins with, late that of the step before, ahead the state that the step has just made: it lies in the "
        f"future of the {FORCE} that made it, and costs a factor of 10 to 60 of the stiffness. Held-force hands out "
        f"the {FORCE}."
    )


def _steps(count: int) -> str:
    return "one step" if count == 1 else f"{count} steps"


def _lines(lines: list[str], indent: int) -> str:
    return "\n".join(f"{'':{indent}}{line}" for line in lines)
