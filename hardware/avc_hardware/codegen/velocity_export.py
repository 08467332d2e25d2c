"""Export of a velocity estimator for a custom wall: the expressions of scenes, as C."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi import InputError
from avc_casadi._util.units import METRE, in_its_units
from avc_casadi.model.velocity import RunningEstimator, VelocityEstimator, velocity_estimator
from avc_casadi.model.velocity_keys import VelocityFilterEffect
from avc_hardware.codegen.c_frame import NAME, WORDS, checked, compiler_checks, named
from avc_hardware.codegen.float_program import FloatProgram
from avc_hardware.codegen.packages import comment
from avc_hardware.codegen.sensor_rule import FARTHEST_M

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

_HEADER = """\
/* A velocity estimator, made by avc-casadi; do not edit.
 *
 * {estimator}{settings}, for {problem}
 * sample time: {sample_time:.9g} s, and no other
 *
 * Call avc_coupling_velocity_init once, then avc_coupling_velocity in every sample with the measured position: signed,
 * in SI units, neither clipped nor filtered. One that is NaN, infinite or beyond {farthest} is left out: the last
 * velocity is returned.
 *
 * C99, also C++11 and later; no heap. IEEE {precision} precision. -ffast-math is refused.
 */
#ifndef AVC_COUPLING_VELOCITY_H
#define AVC_COUPLING_VELOCITY_H

{begin_c}
typedef struct {{
    {real} {states};
    unsigned char started;
}} avc_coupling_velocity_t;

/* At rest at a position; at the first good one where this is none. */
void avc_coupling_velocity_init(avc_coupling_velocity_t *of, {real} position_m);

/* One sample; returns the velocity, {M_PER_S}. */
{real} avc_coupling_velocity(avc_coupling_velocity_t *of, {real} position_m);

/* The position for the spring of the wall, in the unit of position: the measured one, or the estimator's own. */
{real} avc_coupling_velocity_position(const avc_coupling_velocity_t *of);

{end_c}"""
_SOURCE = """\
/* Made by avc-casadi; see avc_coupling_velocity.h. */
#include "avc_coupling_velocity.h"

#include <math.h>
#include <stdbool.h>

{checks}
static unsigned char sound({real} position_m)
{{
    return position_m >= -{farthest} && position_m <= {farthest};
}}

void avc_coupling_velocity_init(avc_coupling_velocity_t *of, {real} position_m)
{{
    of->started = sound(position_m);
    position_m = of->started ? position_m : {zero};
    {initial}
}}

{real} avc_coupling_velocity(avc_coupling_velocity_t *of, {real} position_m)
{{
    if (!sound(position_m)) return of->velocity_out;
    if (!of->started) avc_coupling_velocity_init(of, position_m);
    {body}
    return of->velocity_out;
}}

{real} avc_coupling_velocity_position(const avc_coupling_velocity_t *of)
{{
    return of->position_out;
}}
"""


@in_its_units
def export_velocity_c(problem: Problem, *, precision: str = "single", name: str = NAME) -> dict[str, str]:
    """Return header and source of the estimator of a scene's effect velocity-filter.

    Args:
        problem: with the effect in its scene.
        precision: ``single`` or ``double``.
        name: prefix of files, functions, types and macros.

    Returns:
        Header and source by file name.

    Raises:
        InputError: the scene has no such effect, one of its parameters is missing, or no such precision or name.
    """
    kind = checked(precision, name)
    table = next((one for one in problem.scene.effects if isinstance(one, VelocityFilterEffect)), None)
    if table is None:
        raise InputError.of(
            "has no effect velocity-filter, which names the estimator; add [[scene.effects]] with "
            'kind = "velocity-filter" and estimator = "foaw", for example',
            file=problem.name,
            key="scene.effects",
        )
    found = velocity_estimator(problem, table)
    states, function = _step(found, problem.device.sample_time_s)
    program = FloatProgram(function, kind)
    real, places = kind.c_type, {state: f"of->{state}" for state in states}
    body = program.c_lines(
        lambda given: places.get(given, "position_m"), lambda given: f"of->{given.removeprefix('next_')}"
    )
    kept = [*states, "velocity_out", "position_out"]
    initial = dict.fromkeys(kept, kind.literal(0.0)) | {
        state: "position_m" for state, at in states.items() if at == 1.0
    }
    initial["position_out"] = "position_m"
    told = table.model_dump(exclude_none=True, exclude={"kind", "estimator"})
    settings = "".join(f", {key} = {value}" for key, value in told.items())
    header = _HEADER.format(
        **WORDS,
        estimator=comment(table.estimator),
        settings=comment(settings),
        problem=comment(problem.name),
        sample_time=problem.device.sample_time_s,
        precision=kind.name,
        farthest=f"{FARTHEST_M:.0e} {METRE}",
        real=real,
        states=", ".join(kept),
    )
    source = _SOURCE.format(
        real=real,
        checks=compiler_checks(kind),
        zero=kind.literal(0.0),
        farthest=kind.literal(FARTHEST_M),
        initial="\n    ".join(f"of->{state} = {value};" for state, value in initial.items()),
        body="\n    ".join(body),
    )
    files = {f"{NAME}_velocity.h": header, f"{NAME}_velocity.c": source}
    return named(problem, files, name)


def _step(found: VelocityEstimator, sample_time_s: float) -> tuple[dict[str, float], Any]:
    """Return the states with their values at rest at 1 m, and a sample as a CasADi function of scalars."""
    import casadi as ca  # noqa: PLC0415

    x = ca.SX.sym("position_m")
    if isinstance(found, RunningEstimator):
        states = found.initial(1.0)
        symbols = {name: ca.SX.sym(name) for name in states}
        following, velocity, position = found.step(x, symbols)
    else:
        states = {"before_m": 1.0, "velocity_m_per_s": 0.0, "earlier_m_per_s": 0.0}
        symbols = {name: ca.SX.sym(name) for name in states}
        first, second = found.poles or (0.0, 0.0)
        last, earlier = symbols["velocity_m_per_s"], symbols["earlier_m_per_s"]
        raw = (x - symbols["before_m"]) / sample_time_s
        velocity, position = (1 + first + second) * raw - first * last - second * earlier, x
        following = {"before_m": x, "velocity_m_per_s": velocity, "earlier_m_per_s": last}
    outputs = {f"kept_{name}": following[name] for name in states} | {
        "velocity_out": velocity,
        "position_out": position,
    }
    inputs = {f"kept_{name}": symbols[name] for name in states} | {"position_m": x}
    # A state is an input and an output of one name, to distinguish outputs.
    names = [f"next_{name}" for name in outputs]
    function = ca.Function("velocity", [*inputs.values()], [*outputs.values()], [*inputs], names)
    return {f"kept_{name}": at for name, at in states.items()}, function
