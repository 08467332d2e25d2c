"""Export of an admittance law as C for custom firmware: a function from position and force to a commanded motion."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass

from avc_casadi import InputError, NotDeployableError
from avc_casadi._errors import Fault
from avc_casadi.claims.admittance import HandleAnalysis, certify_admittance, unstable_at_corners_hz
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.claims.sensor_motion import SensorLoops
from avc_casadi.model.admittance import AdmittanceProblem, VirtualImpedance
from avc_casadi.simulation.emit import Precision
from avc_hardware.codegen import c_frame

HAND_M_PER_S = 1.0
"""Speed at which a hand meets the stiffest contact: a force that rises faster is refused once."""
HELD_SAMPLES = 2
"""Readings that may be missing: the last force that was believed is held."""
STOP_S = 0.05
"""Time in which the velocity falls from its limit to 0 where no reading is believed."""
_LEAST_JUMP_SHARE = 0.01
"""Least jump of a reading that is refused once, as a share of the sensor's range."""
_SIGMAS = 6.0
"""Noise that a jump may have, in rms."""
_FALSE_ALARM = 1e-9
"""Probability with which noise repeats a reading as often as a sensor that is stuck."""
_MOST_REPEATED = 0.5
"""Probability of a repeated reading above which a stuck sensor cannot be told from a quiet one."""

_HEADER = """\
/* Admittance law, made by avc-casadi; do not edit.
 *
 * {problem}{title}
 * law: {law}
 * {verdict}
 * {judged_for}
 * sample time: {period:.9g} s, and no other{units}
 *
 * FAULT MODEL. A reading is believed if it is finite, inside of +-{full:.9g} N, and within {jump:.4g} N of the last one
 * that was believed, or of the one before it, which was refused for a jump.
 * - One bad reading at a time, whatever it says: the last force that was believed is held. A device at rest stays so.
 * - Bad readings in a row that agree are believed from the second: they move a device at rest by {push:.4g} m for each
 *   of them in all, never faster than {fastest:.4g} m/s. A smaller error than a jump is believed at once.
 * - Readings that are not finite, at the end of the range or that jump each time: after {held} of them, without
 *   {again} believed ones in a row between, the velocity falls to 0 within {stop:.4g} s. It stays there until {again}
 *   readings in a row are believed, half a swing of the handle on its sensor: a blow may stop the device so long.
 * {stuck}
 * {pushed_back}
 * {position}
 * {offset}
 */
#ifndef AVC_COUPLING_H
#define AVC_COUPLING_H

#define AVC_COUPLING_ID "{id}"
{digest}
#define AVC_COUPLING_SAMPLE_TIME_S {period_literal}
#define AVC_COUPLING_SAMPLE_TIME_NS {period_ns}L
#define AVC_COUPLING_MAX_SPEED_M_PER_S {max_speed}

{loop}
{begin_c}
typedef {real} avc_coupling_real_t;

/* What the law remembers between two samples. */
typedef struct {{
    {real} filtered_n, velocity_m_per_s;
    /* The force that was believed last, one that was refused for a jump, the last reading; the same of positions. */
    {real} believed_n, jumped_n, reading_n;
    {real} believed_m, jumped_m;
    unsigned int missed, believed, repeated, lost;
    unsigned char begun, jumps, placed, moves, stopped;
}} avc_coupling_t;

/* Forget everything: the device is at rest. Call it before the first step, and whenever sampling has paused. */
void avc_coupling_start(avc_coupling_t *coupling);

/* One sample. position_m: of the drive, about which the spring of the law pulls; without a spring it is not read.
 * force_n: of the sensor, positive where the hand pushes towards +position.
 * Returns {returns}; never NaN.
 */
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {real} force_n);

{end_c}"""

_SOURCE = """\
/* Admittance law {id}; do not edit. */
#include "avc_coupling.h"

{checks}
/* One rounding an operation, so that the bits are the same on every machine. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize ("fp-contract=off")
#endif

void avc_coupling_start(avc_coupling_t *coupling)
{{
    coupling->filtered_n = {zero};
    coupling->velocity_m_per_s = {zero};
    coupling->believed_n = {zero};
    coupling->jumped_n = {zero};
    coupling->reading_n = {zero};
    coupling->believed_m = {zero};
    coupling->jumped_m = {zero};
    coupling->missed = 0u;
    coupling->believed = 0u;
    coupling->repeated = 0u;
    coupling->lost = 0u;
    coupling->begun = 0u;
    coupling->jumps = 0u;
    coupling->placed = 0u;
    coupling->moves = 0u;
    coupling->stopped = 0u;
}}

static int within({real} difference, {real} most)
{{
    return difference >= -most && difference <= most;
}}

/* Whether a force is believed; keeps it, or that it jumped. */
static int felt(avc_coupling_t *coupling, {real} force_n)
{{
    const int again = coupling->jumps != 0u && within(force_n - coupling->jumped_n, {jump});
    const int near = coupling->begun != 0u && within(force_n - coupling->believed_n, {jump});
    coupling->jumps = 0u;
    if (!within(force_n, {full})) {{
        return 0;
    }}
    if (!near && !again) {{
        coupling->jumps = 1u;
        coupling->jumped_n = force_n;
        return 0;
    }}
    coupling->begun = 1u;
    coupling->believed_n = force_n;
    return 1;
}}
{stuck}{place}
{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {real} force_n)
{{
    {real} velocity;
{each}    if (felt(coupling, force_n)) {{
        coupling->believed += coupling->believed < {again}u;
    }} else {{
        coupling->believed = 0u;
        coupling->missed += coupling->missed <= {held}u;
    }}
    if (coupling->believed >= {again}u) {{
        coupling->missed = 0u;
    }}
    if (coupling->missed > {held}u{is_stuck}{is_lost}) {{
        /* No reading to trust: the velocity falls to 0, and the force that was held is forgotten. */
        coupling->begun = coupling->stopped != 0u ? coupling->begun : 0u;
        coupling->stopped = 1u;
        coupling->filtered_n = {zero};
        velocity = coupling->velocity_m_per_s;
        velocity = velocity > {fall} ? velocity - {fall} : velocity < -{fall} ? velocity + {fall} : {zero};
        coupling->velocity_m_per_s = velocity;
        return {out};
    }}
    coupling->stopped = 0u;
    coupling->filtered_n += {share} * (coupling->believed_n - coupling->filtered_n);
    velocity = {alpha} * coupling->velocity_m_per_s + {beta} * {push};
    velocity = velocity > {max_speed} ? {max_speed} : velocity < -{max_speed} ? -{max_speed} : velocity;
    coupling->velocity_m_per_s = velocity;
    return {out};
}}
"""
_STUCK = """
/* Whether the same reading has come so often that noise explains it no more; a quiet sensor may say 0 for ever. */
static int stuck(avc_coupling_t *coupling, {real} force_n)
{{
    coupling->repeated = force_n == coupling->reading_n ? coupling->repeated + (coupling->repeated < {most}u) : 0u;
    coupling->reading_n = force_n;
    return coupling->repeated >= {most}u;
}}
"""
_PLACE = """
/* Whether a position is lost; keeps one that is believed: finite, near the last one, or the second that agrees. */
static int lost(avc_coupling_t *coupling, {real} position_m)
{{
    const int again = coupling->moves != 0u && within(position_m - coupling->jumped_m, {way});
    coupling->moves = 0u;
    if (within(position_m, {farthest})) {{
        if (coupling->placed == 0u || again || within(position_m - coupling->believed_m, {way})) {{
            coupling->placed = 1u;
            coupling->lost = 0u;
            coupling->believed_m = position_m;
            return 0;
        }}
        coupling->moves = 1u;
        coupling->jumped_m = position_m;
    }}
    coupling->lost += coupling->lost <= {held}u;
    return coupling->lost > {held}u || coupling->placed == 0u;
}}
"""
_FARTHEST_M = 1e3
_RETURNS = {
    "velocity": "the velocity to command, m/s, at most AVC_COUPLING_MAX_SPEED_M_PER_S",
    "position": "by how much to move the commanded position, m: the sample time times a velocity of at most\n"
    " * AVC_COUPLING_MAX_SPEED_M_PER_S. Begin with the drive's own position as the commanded one",
}
"""What a step returns, by what the drive is commanded."""


@dataclass(frozen=True)
class FaultBounds:
    """What the step refuses, and what motion is possible under a fault, in the device's units.

    Attributes:
        full_n: readings at or beyond this are at the end of the sensor's range.
        jump_n: change of a reading that is refused once.
        push_m: motion for each bad reading in a row that agrees with the one before; infinite without damping.
        pushed_back_m: the same, where hands, contacts and the swing of the handle push back with a true force.
        stop_m: motion until a device stands still whose readings are no longer believed.
        repeated: equal readings in a row after which a sensor counts as stuck; 0: that cannot be seen.
        fall_m_per_s: by how much the velocity falls in a sample where no reading is believed.
        way_m: change of a position that is refused once.
        again: readings in a row that are believed before those that were missing are forgotten.
    """

    full_n: float
    jump_n: float
    push_m: float
    pushed_back_m: float
    stop_m: float
    repeated: int
    fall_m_per_s: float
    way_m: float
    again: int

    @classmethod
    def of(cls, problem: AdmittanceProblem, law: VirtualImpedance) -> FaultBounds:
        """Return the largest jump of a true reading, N, and the motion, m, that refused and bad readings allow.

        The problem states the range of its sensor and its largest speed.
        """
        device, sensor = problem.device, problem.device.force_sensor
        assert sensor.max_force_n is not None  # noqa: S101 - `_required` has asked
        assert device.max_speed_m_per_s is not None  # noqa: S101
        period, full = device.sample_time_s, sensor.max_force_n
        stiffest = problem.hands.stiffness_n_per_m[1] + problem.contact.stiffest_contact_n_per_m
        rise = stiffest * HAND_M_PER_S / device.metres_per_unit * period
        noise = _SIGMAS * sensor.noise_rms_n + 2 * sensor.resolution_n
        damping = law.damping_ns_per_m
        push_m = period * full / damping if damping else math.inf
        again = _half_swing(problem)
        loops = SensorLoops.around(HandleAnalysis(problem).pairs, law.law(period))
        # Of readings that are held and those that are refused while the velocity falls to 0.
        stop_s = (HELD_SAMPLES + 1) * period + STOP_S / 2
        return cls(
            full_n=full,
            jump_n=min(max(rise + noise, _LEAST_JUMP_SHARE * full), full),
            push_m=push_m,
            pushed_back_m=max(push_m, full * loops.motion_m_per_n(2 * again)),
            stop_m=device.max_speed_m_per_s * stop_s,
            repeated=_repeated(sensor.noise_rms_n, sensor.resolution_n),
            fall_m_per_s=device.max_speed_m_per_s * period / STOP_S,
            way_m=3 * device.max_speed_m_per_s * period,
            again=again,
        )


def _half_swing(problem: AdmittanceProblem) -> int:
    """Return the samples of half a swing of the handle on its sensor, pi sqrt((m_s + m)/k_s)/T, m the heaviest hand.

    Within it a swing passes the place where its force changes most: a reading near a peak, where it hardly changes,
    says nothing of the next ones.
    """
    device, sensor = problem.device, problem.device.force_sensor
    carried_kg = sensor.handle_mass_kg + problem.hands.mass_kg[1]
    return 1 + math.ceil(math.pi * math.sqrt(carried_kg / sensor.stiffness_n_per_m) / device.sample_time_s)


def _repeated(noise_n: float, step_n: float) -> int:
    """Return how many equal readings in a row noise explains no more; 0 where it may repeat one for ever.

    Two readings of normal noise sigma on steps d are equal with a probability of about d/(2 sigma sqrt(pi)).
    """
    if not noise_n or not step_n:
        return 0
    equal = step_n / (2 * noise_n * math.sqrt(math.pi))
    return 0 if equal > _MOST_REPEATED else math.ceil(math.log(_FALSE_ALARM) / math.log(equal))


def admittance_files(
    problem: AdmittanceProblem, *, precision: str = "single", name: str = c_frame.NAME, unsafe: bool = False
) -> dict[str, str]:
    """Return the law of an admittance problem as C, by file name.

    Raises:
        InputError: no law, or no range of the sensor and no largest speed.
        NotDeployableError: it is not deployable, and `unsafe` is not set.
    """
    chosen = c_frame.checked(precision, name)
    law = _required(problem)
    # An unstable law is refused before the ranges are searched.
    swings_hz = None if unsafe else unstable_at_corners_hz(problem, law)
    if swings_hz is not None:
        raise _refusal(problem, f"unstable: the device swings at {swings_hz:.3g} Hz")
    certificate = certify_admittance(problem, remedies=False, limits=False)
    if not certificate.passed and not unsafe:
        raise _refusal(problem, certificate.reason)
    verdict = f"{'deployable' if certificate.passed else 'NOT DEPLOYABLE, exported by request'}: {certificate.reason}"
    bounds = FaultBounds.of(problem, law)
    files = c_frame.header_and_source(
        _header(problem, law, bounds, verdict, chosen), _source(problem, law, bounds, chosen)
    )
    return c_frame.named(files, name)


def _refusal(problem: AdmittanceProblem, reason: str) -> NotDeployableError:
    return NotDeployableError(
        f"{problem.typed_name}: {reason}; avc certify {problem.typed_name} says what would help. "
        "--unsafe (in Python unsafe=True) overrides."
    )


def _required(problem: AdmittanceProblem) -> VirtualImpedance:
    """Return the law of a problem that states what the C needs; InputError with each value that is missing."""
    missing = {
        "law": problem.law,
        "device.max_speed_m_per_s": problem.device.max_speed_m_per_s,
        "device.force_sensor.max_force_n": problem.device.force_sensor.max_force_n,
    }
    why = "is missing; give a value: the exported code limits the motion under a fault with it"
    faults = [
        Fault(problem.typed_name, None, problem.units.key(key), why) for key, value in missing.items() if value is None
    ]
    if faults or problem.law is None:
        raise InputError(faults)
    return problem.law.admittance


def law_id(problem: AdmittanceProblem) -> str:
    """Return the identifier of a law on its device: 8 hexadecimal digits."""
    document = problem.model_dump(mode="json", include={"device", "law"})
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:8]


def _header(
    problem: AdmittanceProblem, law: VirtualImpedance, bounds: FaultBounds, verdict: str, precision: Precision
) -> str:
    """Return the text of the C header: units, law, verdict, and what happens with readings that are refused."""
    device = problem.device
    turns = "It turns: read m as rad, N as N.m, kg as kg.m2 and N.s/m as N.m.s/rad in names and numbers."
    return _HEADER.format(
        **c_frame.FRAME,
        problem=c_frame.comment(problem.name or "a problem"),
        title=c_frame.comment(f": {problem.title}") if problem.title else "",
        units="" if problem.units.linear else f"\n * {turns}",
        law=c_frame.comment(_told(law)),
        verdict=c_frame.comment_lines(verdict),
        judged_for=c_frame.judged_for(JudgedFor.of_admittance(problem)),
        period=device.sample_time_s,
        full=bounds.full_n,
        jump=bounds.jump_n,
        push=bounds.push_m,
        fastest=device.max_speed_m_per_s,
        held=HELD_SAMPLES,
        again=bounds.again,
        stop=STOP_S,
        stuck=c_frame.comment_lines(_told_of_stuck(bounds, law, device.sample_time_s)),
        pushed_back=c_frame.comment_lines(_told_of_push(bounds)),
        position=c_frame.comment_lines(_told_of_position(bounds, law)),
        offset=c_frame.comment_lines(_told_of_offset(law)),
        id=law_id(problem),
        returns=_RETURNS[device.drive],
        period_literal=precision.literal(device.sample_time_s),
        period_ns=round(device.sample_time_s * c_frame.NS_PER_S),
        max_speed=precision.literal(device.max_speed_m_per_s or 0.0),
        real=precision.c_type,
    )


def _told(law: VirtualImpedance) -> str:
    filtered = f", force below {law.cutoff_hz:.6g} Hz" if law.cutoff_hz else ""
    spring = f", spring {law.stiffness_n_per_m:.6g} N/m" if law.stiffness_n_per_m else ""
    return f"virtual mass {law.mass_kg:.6g} kg, damping {law.damping_ns_per_m:.6g} N.s/m{spring}{filtered}"


def _told_of_stuck(bounds: FaultBounds, law: VirtualImpedance, period_s: float) -> str:
    if not bounds.repeated:
        return "- A stuck sensor is not detected: its noise and resolution may repeat a reading for ever."
    speed = f"at {1 / law.damping_ns_per_m:.4g} m/s for each N" if law.damping_ns_per_m else "faster and faster"
    time_s = bounds.repeated * period_s
    return f"- A stuck sensor is detected after {bounds.repeated} equal readings, {time_s:.4g} s: it moves {speed}."


def _told_of_push(bounds: FaultBounds) -> str:
    """Return what hands, contacts and the handle add: the motion of an error shakes the handle, which pushes back."""
    pushed_back = f"The device moves by {bounds.pushed_back_m:.4g} m for each bad reading at most"
    if math.isinf(bounds.pushed_back_m):
        pushed_back = "The motion then has no bound"
    return (
        "The motions above are those of the bad readings alone. Then hand, contact and the swing of the handle push "
        f"back with a true force, which the law follows. {pushed_back}, with the hands and contacts of the problem. "
        f"If true readings jump too, they are refused: before it stands still, the device moves by "
        f"{bounds.stop_m:.4g} m more."
    )


def _told_of_position(bounds: FaultBounds, law: VirtualImpedance) -> str:
    if not law.stiffness_n_per_m:
        return "The position is not used: the law has no spring."
    believed = (
        f"A position is believed within {bounds.way_m:.4g} m of the last one, or the second in a row that agrees."
    )
    returns = "The motions above are those of the force. By its spring the device also returns to its rest position"
    return f"{believed} {returns}, position 0, where the held force does not balance the spring."


def _told_of_offset(law: VirtualImpedance) -> str:
    """Return what a constant offset f does: it moves the rest position by f/K, without a spring the device at f/B."""
    unseen = "An offset of the sensor is not detected as a fault. It moves the"
    if law.stiffness_n_per_m:
        return f"{unseen} rest position by {1 / law.stiffness_n_per_m:.4g} m for each N."
    drift_m_per_s = 1 / law.damping_ns_per_m if law.damping_ns_per_m else math.inf
    return f"{unseen} device at {drift_m_per_s:.4g} m/s for each N."


def _source(problem: AdmittanceProblem, law: VirtualImpedance, bounds: FaultBounds, precision: Precision) -> str:
    """Return the text of the C source: v+ = (M v + T (g - k x))/(M + B T), g the filtered force, in checked steps."""
    period, literal = problem.device.sample_time_s, precision.literal
    total = law.mass_kg + law.damping_ns_per_m * period
    share = 1.0 if law.cutoff_hz is None else -math.expm1(-2 * math.pi * law.cutoff_hz * period)
    spring = law.stiffness_n_per_m
    words = {"real": precision.c_type, "held": HELD_SAMPLES, "way": literal(bounds.way_m)}
    pull = f"(coupling->filtered_n - {literal(spring)} * coupling->believed_m)"
    return _SOURCE.format(
        checks=c_frame.compiler_checks(precision),
        id=law_id(problem),
        real=precision.c_type,
        zero=literal(0.0),
        jump=literal(bounds.jump_n),
        # A reading at the end of the range is not inside of it.
        full=literal(bounds.full_n * (1 - 1e-6)),
        held=HELD_SAMPLES,
        again=bounds.again,
        fall=literal(bounds.fall_m_per_s),
        share=literal(share),
        alpha=literal(law.mass_kg / total),
        beta=literal(period / total),
        push=pull if spring else "coupling->filtered_n",
        out="velocity" if problem.device.drive == "velocity" else f"{literal(period)} * velocity",
        max_speed=literal(problem.device.max_speed_m_per_s or 0.0),
        stuck=_STUCK.format(**words, most=bounds.repeated) if bounds.repeated else "",
        is_stuck=" || is_stuck" if bounds.repeated else "",
        place=_PLACE.format(**words, farthest=literal(_FARTHEST_M)) if spring else "",
        is_lost=" || is_lost" if spring else "",
        each=_each_sample(stuck=bool(bounds.repeated), spring=bool(spring)),
    )


def _each_sample(*, stuck: bool, spring: bool) -> str:
    """Return what is looked at in each sample, whether the force is believed or not."""
    lines = ["const int is_stuck = stuck(coupling, force_n);"] if stuck else []
    lines += ["const int is_lost = lost(coupling, position_m);"] if spring else ["(void)position_m;"]
    return "".join(f"    {line}\n" for line in sorted(lines, key=lambda line: line.startswith("(")))
