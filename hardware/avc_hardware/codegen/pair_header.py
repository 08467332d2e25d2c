"""Header of an exported coupling to another end: what it is, the order of a sample, what ends in less force."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.model.ends import Clock, End, Follower, Simulation, not_known
from avc_hardware.codegen.c_frame import FRAME, NS_PER_S, comment, comment_lines, head_words, judged_for
from avc_hardware.codegen.sensor import DRIFT_M, JUMP_M, SENSOR_TYPE, SensorBounds, fade_samples

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.simulation.emit import Precision

_WRONG = """\
A position that is no number (NaN, infinite), or to which no hand can have brought the device since the last good one:
faster than {fastest}, or by a movement that differs from the one before by more than {change} a sample ({driven}
in the mean after a lost one). The last good one stays, the dampers are left out, and the force fades as long as it
lasts{more}. After more than one lost sample a position is believed when it is seen twice, wherever it is after {lost}.
FAULT MODEL: bad positions of a device at rest without force, the first of them {jump} or more away, the others
wherever they like or as they agree, drifting by {drift} a sample at most, give no force: up to {lasting} in a row.
More in a row, or a smaller jump, cannot be told from a hand."""
_OF_ENGINE = """\
A number of the engine that is none, or a tool that moves faster: the same. Once nothing is left of the force, whatever
comes is believed. No step of the engine for more than {silence}: it hangs, and the force fades. {call} says that it
lives; where it is called on another computer, call avc_coupling_alive whenever something of the tool comes in."""
_OF_FOLLOWER = """\
Old messages, duplicates, and messages that are no number or farther from the last good one than that speed would bring
it are ignored. No new message for more than {silence}: the force fades. Once nothing is left, any sound message but the
last one again is believed: the other end may have started anew, and then counts from 1. So the link may repeat its
newest message for ever, but must never hand out older ones again."""
_THREADS = """: an engine in a thread of its own takes the lock of the device's loop for each call. An engine on
 * another computer has its own avc_coupling_t, writes own.position_m and own.velocity_m_per_s of the device's newest
 * sample into it and 1 into started, and calls {call}"""

MISSED_STEPS = 5
"""An engine that has missed so many of its longest steps counts as hanging."""

_HEADER = """\
/* The coupling between {between}, made by avc-casadi; do not edit.
 *
 * Coupling {id} for {problem}{title}
{facts}
 * {verdict}
 * {judged_for}
 * sample time: {times}, and no other: the gains mean another loop at another rate{units}
 *
{use}
 *
 * What goes wrong ends in less force, never in a kick:
 * - The force comes in over {fade_s:.3g} s from the first sample on, wherever both ends are.
 * - {wrong}
 * - While a force fades it neither grows nor turns, and it comes back from where it was, over {fade_s:.3g} s.
 * - After a fault of more than {fade_s:.3g} s the spring comes back stretched by how far both ends have gone apart, and
 *   pulls them together with energy that no hand has put in: bring them together first.
 *
 * One thread at a time{threads}.
 * C99, also C++11 and later; no heap, no library. IEEE {precision} precision. -ffast-math is refused.
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#include <stdint.h>

#define AVC_COUPLING_ID "{id}"
{digest}
{defines}
{begin_c}
typedef {real} avc_coupling_real_t;

{sensor}
/* What one end tells the other, in its own units. */
typedef struct {{
    /* 0: nothing was measured yet, and nobody believes it. */
    uint32_t number;
    {real} position_m, velocity_m_per_s;
    /* With which it presses, where the other end feels that in place of spring and damper. */
    {real} force_n;
}} avc_coupling_message_t;

/* What one end knows. */
typedef struct {{
    {real} sample_time_s;
    /* Own metres and newtons for one of the other end. */
    {real} position_scale, force_scale;
    {real} stiffness_n_per_m, damping_ns_per_m, local_damping_ns_per_m;
    {real} max_force_n;
    /* The farthest that the own position goes in a sample, in the first one; what steps and noise add; by how much its
     * movement changes: by a hand, by hand and actuator, at stops and contacts under force, and without. */
    {real} jump_m, start_m, unsure_m, hand_m, driven_m, inside_m, struck_m;
    /* A force that does not count for that. */
    {real} quiet_n;
    /* The farthest that the other's position goes from one message to the next; what its encoder adds; its fastest. */
    {real} far_jump_m, far_step_m, far_fastest_m_per_s;
    /* In own samples: until the other end is silent, and in which a force fades; in which a force of before may still
     * act, and after which the own position is wherever it is. */
    unsigned long watchdog, fade;
    unsigned short pushed, lost;
    /* Messages that may lie between two. */
    uint32_t most;
    /* Whether a force of the other end is felt in place of spring and damper. */
    unsigned char feels_force;
}} avc_coupling_end_t;

/* What an end remembers between two samples. */
typedef struct {{
    const avc_coupling_end_t *end;
    avc_coupling_sensor_t sensor;
    /* Of the newest good sample, and the newest good one of the other end. */
    avc_coupling_message_t own, far;
    /* Samples since the last good position, since the last good number of the other end, and since it was heard. */
    unsigned long missed, lost, silent;
    /* How far the force has faded; 0 is all of it. */
    unsigned long faded;
    /* That was given last. */
    {real} force_n{engine_forces};
    /* Whether the own position and the other end are known, and whether something was wrong in the last sample. */
    unsigned char started, given, fading;
}} avc_coupling_t;

/* Forget everything. Call it once before the first sample, and whenever sampling has paused. */
{calls}
{end_c}"""

_ENGINE_CALLS = """\
void avc_coupling_init(avc_coupling_t *coupling);

/* One sample of the device, its position as measured.
 * Returns the force on it, N, positive towards positive positions; never NaN. */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {given});

/* The two halves of avc_coupling_step, for an engine that steps between them. */
void avc_coupling_sample(avc_coupling_t *coupling, {real} position_m);
{real} avc_coupling_force(avc_coupling_t *coupling, {given});

/* The engine lives: where none of the following is called on this coupling. */
void avc_coupling_alive(avc_coupling_t *coupling);

"""
_TOOL_FORCE = """\
/* The force on the tool{without}, in units of the scene, positive towards positive positions, from the
 * device's newest sample: once in each step of the engine, with position and velocity that the step begins with. 0
 * before the first sample, and where one of them is no number. */
{real} avc_coupling_tool_force(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s);
"""
_TARGET = """\
/* Where the engine's spring and damper lead in this step, in units of the scene: once in each step of the engine.
 * Returns what share of both acts: 1, less while something fades, 0 before the first sample. */
{real} avc_coupling_target(avc_coupling_t *coupling, {real} *position_m, {real} *velocity_m_per_s);
"""
_HANDED_FORCE = """\
/* The force for the device's loop, in units of the scene, not to be put on the tool: once in each step of the engine,
 * with position and velocity that the step begins with. */
{real} avc_coupling_handed_force(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s);
"""
_FOLLOWER_CALLS = """\
void avc_coupling_init(avc_coupling_t *coupling, const avc_coupling_end_t *end);

extern const avc_coupling_end_t AVC_COUPLING_LEADER;
extern const avc_coupling_end_t AVC_COUPLING_FOLLOWER;

/* One sample; returns the force on the own device, N, positive towards its positive positions; never NaN.
 * position_m: as measured. message: one that has arrived, or NULL. */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, const avc_coupling_message_t *message);

/* What to send after the step. */
avc_coupling_message_t avc_coupling_message(const avc_coupling_t *coupling);

/* Take a message, and return whether it was newer and sound. */
int avc_coupling_receive(avc_coupling_t *coupling, const avc_coupling_message_t *message);

/* The two halves of avc_coupling_step round what arrives; a message of positions may be sent between them. */
void avc_coupling_sample(avc_coupling_t *coupling, {real} position_m);
{real} avc_coupling_force(avc_coupling_t *coupling);

"""

_USE_OF_FOLLOWER = """\
 * One source for both ends.
 * Each end, once:     avc_coupling_init(&coupling, &AVC_COUPLING_LEADER), or AVC_COUPLING_FOLLOWER
 * in each sample:     avc_coupling_receive for each message that has arrived, in any order (the last may go with step);
 *                     force = avc_coupling_step(&coupling, own_position, NULL or a message);
 *                     message = avc_coupling_message(&coupling), sent to the other end.
 * A message holds each end's own units and scales are applied here by who receives it. How it is packed into bytes is
 * yours; number is what tells old from new."""
_MEASURED = "\n * The follower puts the force with which it presses, as measured, into message.force_n before it sends."
_USE_OF_ENGINE = """\
 * EXCHANGE, for which this is certified: {exchange}; another one is another loop.
{clock}
 * In every sample, in this order:
{order}
 * The tool's numbers, the same until the engine's next step, are the engine's own, in SI units of the scene, with the
 * device's origin and direction. Put the tool where the device is before the first sample: the spring pulls from then
 * on.{solved}"""
_CLOCKS: dict[Clock, str] = {
    "own": " * The engine's steps may begin at any time, by a clock of its own.",
    "device": """\
 * START EACH STEP OF THE ENGINE FROM THE DEVICE'S LOOP, at a sample, a whole number of samples after the step before.
 * With steps by a clock of its own this is another loop than the certified one.""",
}
_SOLVED = {
    "nothing": "",
    "damper": """
 *
 * THE ENGINE HAS THE DAMPER: AVC_COUPLING_TOOL_DAMPING times the tool's own velocity, which it solves implicitly, as a
 * damper of the tool's joint beside any drag of the tool. avc_coupling_tool_force leaves that part out. Without it the
 * tool has no damper; with a second one, or in an engine that integrates explicitly, this is another loop than the
 * certified one. Where a position is bad the engine's damper stays.""",
    "spring and damper": """
 *
 * THE ENGINE HAS SPRING AND DAMPER: AVC_COUPLING_TOOL_STIFFNESS and AVC_COUPLING_TOOL_DAMPING, each times the share
 * that avc_coupling_target returns, between the tool and the position and velocity that it tells; it solves both
 * implicitly. No force of this coupling is put on the tool: one that is computed before the step is another loop, in
 * which a light tool is unstable. Where a position is bad the target stands still at the last one.""",
}


_ENGINE_DEFINES = """\
#define AVC_COUPLING_EXCHANGE "{exchange}"
#define AVC_COUPLING_SAMPLE_TIME_S {time}
#define AVC_COUPLING_SAMPLE_TIME_NS {time_ns}L
/* Spring and damper between device and tool, in units of the scene. */
#define AVC_COUPLING_TOOL_STIFFNESS {stiffness}
#define AVC_COUPLING_TOOL_DAMPING {damping}
{loop}"""


def pair_header(coupling: Coupling, precision: Precision, verdict: str, silences_s: Sequence[float]) -> str:
    """Return the header; every text of a file passes the allow-list of comments."""
    problem = coupling.problem
    of_end = header_words(coupling.end, coupling, precision)
    ends: dict[str, Device] = of_end.pop("devices")
    silences = zip(silences_s, ends, strict=True)
    silence = " or ".join(f"{silence_s:.4g} s ({name})" for silence_s, name in silences)
    wrong = _wrong(ends, of_end.pop("more"))
    also = of_end.pop("also").format(silence=silence)
    limits = "; ".join(f"{name} {_limit(device)}" for name, device in ends.items())
    facts = [*of_end.pop("facts"), f"force limits: {limits}"]
    return _HEADER.format(
        **FRAME,
        **head_words(problem),
        **of_end,
        id=coupling.id,
        facts="\n".join(f" * {comment_lines(fact)}" for fact in facts),
        verdict=comment_lines(verdict),
        judged_for=judged_for(JudgedFor.of_coupling(coupling)),
        times=" and ".join(f"{device.sample_time_s:.9g} s ({name})" for name, device in ends.items()),
        wrong="\n * - ".join(comment_lines(fault).replace("\n * ", "\n *   ") for fault in (wrong, also)),
        fade_s=max(fade_samples(device) * device.sample_time_s for device in ends.values()),
        precision=precision.name,
        real=precision.c_type,
        sensor=SENSOR_TYPE.format(real=precision.c_type, more=""),
    )


def _limit(device: Device) -> str:
    """Return the force limit of a device in words."""
    return "no limit is stated; limit the force yourself" if device.max_force_n is None else f"{device.max_force_n:g} N"


def _wrong(ends: Mapping[str, Device], more: str) -> str:
    """Return what the header says of positions that are not believed, with the numbers of every end."""
    bounds = {name: SensorBounds.of(device) for name, device in ends.items()}

    def of_each(text: Callable[[Device, SensorBounds], str]) -> str:
        return " and ".join(f"{text(device, bounds[name])} ({name})" for name, device in ends.items())

    return _WRONG.format(
        fastest=of_each(lambda _, bound: f"{bound.fastest_m_per_s:.4g} m/s"),
        change=of_each(lambda _, bound: f"{bound.inside_m + bound.unsure_m:.4g} m"),
        driven=of_each(lambda _, bound: f"{bound.driven_m + bound.unsure_m:.4g} m"),
        lost=of_each(lambda device, bound: f"{bound.lost_samples * device.sample_time_s:.4g} s"),
        jump=of_each(lambda device, _: f"{JUMP_M / device.metres_per_unit:.4g} m"),
        drift=of_each(lambda device, _: f"{DRIFT_M / device.metres_per_unit:.4g} m"),
        lasting=of_each(lambda device, bound: f"{bound.most_bad_samples(device.metres_per_unit)}"),
        more=more,
    )


def _keys(values: Mapping[str, Any]) -> str:
    """Return keys and values as in a problem file."""
    return ", ".join(f"{key} {value}" for key, value in values.items() if value is not None)


@singledispatch
def header_words(end: End, coupling: Coupling, precision: Precision) -> dict[str, Any]:  # noqa: ARG001
    """Return what the header of a coupling to an end says of its own.

    Raises:
        UnsupportedError: no C is known of this kind of end.
    """
    raise not_known(end, "C")


@header_words.register(Follower)
def _of_follower(follower: Follower, coupling: Coupling, precision: Precision) -> dict[str, Any]:
    """Return the words of the header of a coupling to a follower: facts of both ends, use, and definitions."""
    device = coupling.problem.device
    link = follower.model_dump(exclude=set(type(device).model_fields), exclude_none=True)
    measured = follower.architecture == "position-force" and follower.force == "measured"
    times = (("LEADER", device), ("FOLLOWER", follower))
    defines = (
        f"#define AVC_COUPLING_{end}_SAMPLE_TIME_S {precision.literal(device.sample_time_s)}\n" for end, device in times
    )
    return {
        "devices": {"leader": device, "follower": follower},
        "more": "; no new message is sent, and the force of the other end fades too",
        "between": "a leader and its follower",
        "facts": [
            f"leader: {_keys(vars(coupling.gains))}",
            f"follower: {_keys(vars(coupling.at_follower))}",
            f"[follower] {_keys(link)}",
        ],
        "use": _USE_OF_FOLLOWER + (_MEASURED if measured else ""),
        "also": _OF_FOLLOWER,
        "threads": "",
        "defines": "".join(defines),
        "engine_forces": "",
        "calls": _FOLLOWER_CALLS.format(real=precision.c_type),
    }


@header_words.register(Simulation)
def _of_engine(tool: Simulation, coupling: Coupling, precision: Precision) -> dict[str, Any]:
    """Return the words of the header of a coupling to a simulation: facts, order of the calls, and their C."""
    device = coupling.problem.device
    scene = coupling.in_scene
    real = precision.c_type
    literal = precision.literal
    held, solves = tool.exchange == "held-force", tool.solved == "spring and damper"
    given = f"{real} tool_force_n" if held else f"{real} tool_position_m, {real} tool_velocity_m_per_s"
    calls = _ENGINE_CALLS + (_TARGET if solves else _TOOL_FORCE)
    calls += _HANDED_FORCE if held and tool.solved != "nothing" else ""
    call = "avc_coupling_target" if solves else "avc_coupling_tool_force"
    late = f", and {_steps(tool.steps_late)} later" if tool.steps_late else ""
    order = "\n".join(f" *   {number}. {operation}" for number, operation in enumerate(_order(tool), 1))
    without = " without the damper" if tool.solved == "damper" else ""
    return {
        "devices": {"device": device},
        "more": "",
        "between": "a haptic device and the tool of a simulation",
        "facts": [
            f"device: {_keys(vars(coupling.gains))}",
            f"scene: {_keys(vars(scene))}",
            f"[simulation] {_keys(tool.model_dump(exclude_none=True))}",
        ],
        "use": _USE_OF_ENGINE.format(
            exchange=comment(tool.exchange + late),
            clock=_CLOCKS[tool.clock],
            order=order,
            solved=_SOLVED[tool.solved],
        ),
        "also": _OF_ENGINE.format(silence="{silence}", call=call),
        "threads": _THREADS.format(call=call),
        "defines": _ENGINE_DEFINES.format(
            exchange=tool.exchange,
            time=literal(device.sample_time_s),
            time_ns=round(device.sample_time_s * NS_PER_S),
            stiffness=literal(scene.stiffness_n_per_m),
            damping=literal(scene.damping_ns_per_m),
            loop=FRAME["loop"],
        ),
        "engine_forces": ", to_tool_n, handed_n",
        "calls": calls.format(real=real, given=given, without=without) + "\n",
    }


def _order(tool: Simulation) -> list[str]:
    """Return the operations of a sample of the exchange, in order."""
    first = "force = avc_coupling_tool_force(its state)"
    if tool.solved == "spring and damper":
        first = "avc_coupling_target(...) for its spring and damper"
    if tool.exchange == "held-force" and tool.solved != "nothing":
        first += "; force for the device = avc_coupling_handed_force(its state)"
    engine = f"where the engine steps: {first}; then the step"
    if tool.substeps > 1:
        engine += f", {tool.substeps} internal steps of the engine for one call: the force is held over all of them"
    late = f"{_steps(tool.queued)} before this one" if tool.queued else ""
    if tool.exchange in {"held-force", "ahead"}:
        given = f"the force of {late}" if late else "that force"
        if tool.exchange == "ahead":
            given = f"the state that {late or 'this step'} has made"
        return ["avc_coupling_sample(position)", engine, f"avc_coupling_force({given})"]
    given = f"the state that {late} began with" if late else "the state that a step now due begins with"
    return [f"avc_coupling_step(position, {given})", engine]


def _steps(count: int) -> str:
    return "one step" if count == 1 else f"{count} steps"
