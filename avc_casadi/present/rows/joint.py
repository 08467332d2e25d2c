"""Rows of a joint that an engine moves: a certificate of kp and kd, and a recommendation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from shlex import quote

from avc_casadi._util.arrays import Interval
from avc_casadi._util.json_values import plain
from avc_casadi._util.open_end import AboveZero
from avc_casadi._util.text import plural
from avc_casadi.claims.joint import JointCertificate
from avc_casadi.files.joint_model import ModelledJoint
from avc_casadi.loops.joint import JointGains
from avc_casadi.loops.margins import LEAST_DISK
from avc_casadi.model.ends import LIGHTEST_TOOL_KG, LONGEST_STEP_S
from avc_casadi.model.joint import Joint
from avc_casadi.model.problem import Problem
from avc_casadi.present.row import (
    Answer,
    Mark,
    Part,
    Row,
    Value,
    caution,
    commas,
    grade,
    largest_value,
    least_value,
    parts,
    row,
    span,
    stable_ends,
)
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.reasons import sentence
from avc_casadi.recommendation.joint import DAMPING_RATIO, NO_JOINT_GAINS, JointDesign, JointRecommendation


def gains(stated: JointGains) -> tuple[Part, ...]:
    """Return kp and kd."""
    velocity = "of the difference of the position" if stated.difference else None
    kp, kd = float(stated.kp), float(stated.kd)
    return commas([("kp", Value(kp, "stiffness")), ("kd", Value(kd, "damping"), velocity)])


def certificate(result: JointCertificate, shown: str = "") -> Answer:
    """Return the answer of `certify` of kp and kd of a joint."""
    problem = result.problem
    shown = shown or subject.name_of(problem)
    mark = grade(result.sound, Mark.CAUTION) if result.stable else Mark.FAIL
    ratio: tuple[Part, ...] = ("no oscillation",)
    if result.damping_ratio < 1:
        ratio = (Value(result.damping_ratio, "number", 2), "at", Value(result.damping_ratio_hz, "frequency"))
    factor: Part = "any" if math.isinf(result.largest_gain) else Value(result.largest_gain, "number")
    gain = "largest factor on kp and kd", factor
    rows = [
        row("Stable", "yes" if result.stable else "no", _why(result), mark=mark),
        row("Margins", "disk", Value(result.disk_margin, "number", 2), ",", gain, mark=caution(not result.sound)),
        row("Damping ratio", ratio),
        row("Least stable", _joint(result.worst)),
        row("Stable kp", _stretch(result.stiffness_n_per_m, "stiffness", math.inf), "at this kd"),
        row("Stable kd", _stretch(result.damping_ns_per_m, "damping", math.inf), "at this kp"),
        row("Largest step", _largest_step(result)),
        row("Least mass", _least_mass(result)),
        *subject.unusual(problem),
    ]
    complaint = "" if result.stable else f"avc: {shown}: kp and kd are not stable"
    return Answer(
        kind="certify-joint",
        data=result.document(),
        title=parts(shown, " ", gains(result.gains), "·", subject.end_line(problem.end)),
        rows=tuple(rows),
        commands=(f"avc recommend {quote(shown)}",),
        units=problem.units,
        complaint=complaint,
    )


def _why(result: JointCertificate) -> tuple[Part, ...]:
    """Return what decides."""
    if not result.stable and result.marginal:
        undamped = "" if result.gains.kd else "; kd is 0: give a damper, --kd KD"
        return parts(f": marginal, a motion neither grows nor decays{undamped}")
    if not result.stable:
        return parts(": grows by a factor of", Value(result.spectral_radius, "number", 6), "in a step")
    if result.sound:
        return ()
    below = f"below {LEAST_DISK}" if result.disk_margin < LEAST_DISK else "thin"
    return parts(", but the disk margin is", below)


def _joint(values: Mapping[str, float]) -> tuple[Part, ...]:
    """Return a joint by its values."""
    contact = None
    if values["contact_stiffness_n_per_m"]:
        contact = ("touching", Value(values["contact_stiffness_n_per_m"], "stiffness"))
    damping = Value(values["damping_ns_per_m"], "damping") if values["damping_ns_per_m"] else None
    return commas([Value(values["mass_kg"], "mass"), damping, ("step", Value(values["step_s"], "time")), contact])


def _stretch(ends: Interval | None, of: str, highest: float) -> tuple[Part, ...]:
    if ends is None:
        return ("none",)
    low, high = stable_ends(ends, "stiffness" if of == "stiffness" else "damping", 4)
    if ends[1] < highest:
        return parts(low, "to", high)
    return parts(low) if isinstance(ends[0], AboveZero) else parts(low, "and more")


def _value(number: float, of: str) -> Value:
    return Value(number, "stiffness" if of == "stiffness" else "damping", 4)


def _largest_step(result: JointCertificate) -> tuple[Part, ...]:
    """Return the largest stable step."""
    if result.step_s is None:
        return ("no value is stable",)
    if result.step_s[1] >= LONGEST_STEP_S:
        return ("any",)
    return (largest_value(result.step_s[1], "time", 4),)


def _least_mass(result: JointCertificate) -> tuple[Part, ...]:
    """Return the least mass of the joint that is stable, and what to add to that of the file."""
    if result.mass_kg is None:
        return ("no value is stable",)
    least, most = result.mass_kg
    if least <= LIGHTEST_TOOL_KG and math.isinf(most):
        return ("any",)
    limit = ("at most", largest_value(most, "mass", 4)) if math.isfinite(most) else None
    declared = result.problem.end_as(Joint).engine.tool_mass_kg
    lightest = None if declared is None else declared[0]
    shown = replace(least_value(least, "mass", 4), beside=lightest)
    add = None
    if result.armature_kg and lightest is not None:
        # What is added to the mass as declared reaches the least mass as printed.
        armature = least_value((shown.printed or least) - lightest, "mass", 4)
        add = ("; add", replace(armature, beside=lightest), "(armature)")
    return parts(shown, limit, add)


def drafted(joint: ModelledJoint, problem: Problem, shown: str) -> Answer:
    """Return the answer of `new` of a joint of a model."""
    mass = span(joint.range_kg, "mass"), f"over {plural(joint.poses, 'pose')}, armature included"
    step = Value(joint.step_s, "time"), "" if joint.states_step else "assumed: the model states none"
    actuators: tuple[Part, ...] = ("none with kp or kd on this joint",)
    if joint.kp or joint.kd:
        actuators = gains(JointGains(joint.kp, joint.kd))
    rows = [
        row("Mass", mass),
        row("Step", step, mark=caution(not joint.states_step)),
        row("Integrator", joint.integrator),
        row("Actuators", actuators),
    ]
    onwards = "certify {}" if joint.kp or joint.kd else "recommend {}"
    return subject.answer("new", plain(joint), problem, shown, rows, onwards)


def recommendation(result: JointRecommendation, shown: str = "") -> Answer:
    """Return the answer of `recommend` of a joint."""
    problem = result.problem
    shown = shown or subject.name_of(problem)
    rows = [_stiffest(result)]
    if result.frequency_hz is not None:
        rows.append(_at_frequency(result))
    chosen = result.stiffest if result.at_frequency is None else result.at_frequency
    onwards = []
    if chosen is not None:
        kp, kd = float(chosen.gains.kp), float(chosen.gains.kd)
        onwards.append(f"avc certify {quote(shown)} --kp {kp:.4g} --kd {kd:.4g}")
    return Answer(
        kind="recommend-joint",
        data=result.document(),
        title=parts(shown, " ", subject.end_line(problem.end)),
        rows=tuple(rows),
        commands=tuple(onwards),
        units=problem.units,
        complaint="" if result.passed else f"avc: {shown}: no kp and kd are stable and damp the joint well",
    )


def _stiffest(result: JointRecommendation) -> Row:
    """Return the largest kp that is well damped and robust."""
    if result.stiffest is None:
        return row("Stiffest", sentence(NO_JOINT_GAINS, result.problem.units), mark=Mark.FAIL)
    more = None if result.limited else "; a larger kp is stable too, but its frequency exceeds half the step rate"
    return row("Stiffest", _design(result.stiffest), more, mark=Mark.PASS)


def _at_frequency(result: JointRecommendation) -> Row:
    """Return kp and kd of the required frequency."""
    label = f"At {Value(result.frequency_hz, 'frequency').text(result.problem.units)}"
    if result.at_frequency is None:
        return row(label, f"no kd is stable and has a damping ratio of {DAMPING_RATIO}", mark=Mark.FAIL)
    return row(label, _design(result.at_frequency), mark=grade(result.at_frequency.sound))


def _design(design: JointDesign) -> tuple[Part, ...]:
    ratio, disk = Value(design.damping_ratio, "number", 2), Value(design.disk_margin, "number", 2)
    return parts(gains(design.gains), ", damping ratio", ratio, ", disk margin", disk)
