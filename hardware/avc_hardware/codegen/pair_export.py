"""Export of a coupling to another end as C: a spring and damper to a message, with a watchdog."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import TYPE_CHECKING

from avc_casadi import NotDeployableError
from avc_casadi.design.virtual_tool import search_of
from avc_casadi.model.ends import End, Follower, Simulation, not_known
from avc_hardware.codegen.c_frame import compiler_checks, header_and_source
from avc_hardware.codegen.pair_header import MISSED_STEPS, pair_header
from avc_hardware.codegen.sensor import FARTHEST_M, ROUNDING, SENSOR, SensorBounds, fade_samples

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.ends import ToolGains
    from avc_casadi.simulation.emit import Precision

# A link without so many messages in a row, jitter aside, is silent: with 1 % of losses once in 1e10 messages.
_MESSAGES = 5

_SOURCE = """\
/* Coupling {id}: spring and damper to {other}; do not edit. */
#include "avc_coupling.h"

{checks}
{ends}
{sensor}
/* Whether the other end can be so, after as many of its messages. */
static int plausible(const avc_coupling_t *coupling, const avc_coupling_message_t *far, uint32_t ahead)
{{
    const avc_coupling_end_t *end = coupling->end;
    const {real} moved_m = far->position_m - coupling->far.position_m;
    return within(far->position_m, {farthest}) && within(far->force_n, {farthest}) &&
           within(far->velocity_m_per_s, end->far_fastest_m_per_s) &&
           (coupling->given == 0u || (ahead <= end->most &&
                                      within(moved_m, ({real})ahead * end->far_jump_m + end->far_step_m)));
}}

/* What is left of a force that fades; 0 where it is no number. */
static {real} left_of(const avc_coupling_t *coupling, {real} force_n)
{{
    const unsigned long faded = coupling->faded, fade = coupling->end->fade;
    if (!within(force_n, {largest})) {{
        return {zero};
    }}
    return faded == 0ul ? force_n : force_n * (({real})(fade - faded) / ({real})fade);
}}

/* A force that is no larger than another, and in no other direction. */
static {real} no_more({real} force_n, {real} than_n)
{{
    const {real} low = than_n < {zero} ? than_n : {zero}, high = than_n > {zero} ? than_n : {zero};
    return force_n < low ? low : (force_n > high ? high : force_n);
}}

/* The force to give where the law asks for one. While something is wrong it fades and never grows, although a spring
 * that has lost its damper may ask for more; then it comes back from where it was. */
static {real} eased(avc_coupling_t *coupling, {real} law_n, int sound)
{{
    const {real} last_n = coupling->force_n;
    const unsigned long fade = coupling->end->fade;
    law_n = within(law_n, {largest}) ? law_n : {zero};
    if (!sound) {{
        coupling->faded += coupling->faded < fade ? 1ul : 0ul;
        coupling->force_n = no_more(left_of(coupling, law_n), last_n);
    }} else {{
        coupling->faded -= coupling->faded > 0ul ? 1ul : 0ul;
        if (coupling->fading != 0u && (law_n < {zero} || law_n > {zero})) {{
            const unsigned long kept =
                (unsigned long)(({real})fade * (no_more(law_n, last_n) / law_n) + {one_and_a_half});
            coupling->faded = kept + coupling->faded < fade ? fade - kept : coupling->faded;
        }}
        coupling->force_n = left_of(coupling, law_n);
    }}
    coupling->fading = !sound;
    return coupling->force_n;
}}

static void begin(avc_coupling_t *coupling, const avc_coupling_end_t *end)
{{
    const avc_coupling_message_t nothing = {{0u, {zero}, {zero}, {zero}}};
    coupling->end = end;
    forget(&coupling->sensor);
    coupling->own = nothing;
    coupling->far = nothing;
    coupling->missed = 0ul;
    coupling->lost = 0ul;
    coupling->silent = 0ul;
    coupling->faded = 0ul;
    coupling->force_n = {zero};
{clear}    coupling->started = 0u;
    coupling->given = 0u;
    coupling->fading = 0u;
}}

void avc_coupling_sample(avc_coupling_t *coupling, {real} position_m)
{{
    const avc_coupling_end_t *end = coupling->end;
    avc_coupling_message_t *own = &coupling->own;
    /* Stops and contacts strike it without a force of this coupling too. */
    const {real} first_m = coupling->sensor.pushed != 0u ? end->inside_m : end->struck_m;
    const int seen = look(&coupling->sensor, end, position_m, first_m);
    if (coupling->missed >= end->fade) {{
        coupling->started = 0u;
    }}
    if (coupling->silent < end->watchdog + end->fade) {{
        coupling->silent++;
    }} else {{
        coupling->given = 0u;
    }}
    /* Except after a single lost sample a place is seen twice before it stretches the spring. */
    if (seen == REFUSED || (seen == AGAIN && coupling->missed != 1ul)) {{
        coupling->missed += coupling->missed < end->fade ? 1ul : 0ul;
        return;
    }}
    if (coupling->started == 0u) {{
        own->position_m = position_m;
        coupling->faded = end->fade;
    }}
    own->velocity_m_per_s = coupling->sensor.moved_m / end->sample_time_s;
    own->position_m = position_m;
    own->number += own->number < UINT32_MAX ? 1u : 2u;
    coupling->started = 1u;
    coupling->missed = 0ul;
}}

/* Spring and damper to what is known of the other end, or its force; the damper of the own loop; the limit. */
static {real} pull(avc_coupling_t *coupling)
{{
    const avc_coupling_end_t *end = coupling->end;
    const avc_coupling_message_t *own = &coupling->own, *far = &coupling->far;
    const int good = coupling->missed == 0ul && coupling->lost == 0ul && coupling->given != 0u;
    {real} pull_n = {zero}, force_n = {zero};
    if (coupling->started != 0u && coupling->given != 0u) {{
        if (end->feels_force != 0u) {{
            pull_n = -(end->force_scale * far->force_n);
        }} else {{
            pull_n = end->stiffness_n_per_m * (end->position_scale * far->position_m - own->position_m);
            if (good) {{
                pull_n +=
                    end->damping_ns_per_m * (end->position_scale * far->velocity_m_per_s - own->velocity_m_per_s);
            }}
        }}
        force_n = good ? pull_n - end->local_damping_ns_per_m * own->velocity_m_per_s : pull_n;
        if (force_n > end->max_force_n) {{
            force_n = end->max_force_n;
        }}
        if (force_n < -end->max_force_n) {{
            force_n = -end->max_force_n;
        }}
    }}
    force_n = eased(coupling, force_n, good && coupling->silent <= end->watchdog);
    coupling->own.force_n = left_of(coupling, pull_n);
    push(&coupling->sensor, end, force_n);
    return force_n;
}}

{calls}"""

_FOLLOWER = """\
void avc_coupling_init(avc_coupling_t *coupling, const avc_coupling_end_t *end)
{{
    begin(coupling, end);
}}

avc_coupling_message_t avc_coupling_message(const avc_coupling_t *coupling)
{{
    return coupling->own;
}}

int avc_coupling_receive(avc_coupling_t *coupling, const avc_coupling_message_t *message)
{{
    const uint32_t ahead = message->number - coupling->far.number;
    if (message->number == 0u || ahead == 0u || !plausible(coupling, message, ahead)) {{
        return 0;
    }}
    coupling->far = *message;
    coupling->silent = 0ul;
    coupling->given = 1u;
    return 1;
}}

{real} avc_coupling_force(avc_coupling_t *coupling)
{{
    return pull(coupling);
}}

{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, const avc_coupling_message_t *message)
{{
    avc_coupling_sample(coupling, position_m);
    if (message) {{
        (void)avc_coupling_receive(coupling, message);
    }}
    return avc_coupling_force(coupling);
}}
"""

_ENGINE = """\
void avc_coupling_init(avc_coupling_t *coupling)
{{
    begin(coupling, &AVC_COUPLING_DEVICE);
}}

void avc_coupling_alive(avc_coupling_t *coupling)
{{
    coupling->silent = 0ul;
}}

{real} avc_coupling_force(avc_coupling_t *coupling, {given})
{{
    avc_coupling_message_t tool = {{1u, {zero}, {zero}, {zero}}};
{tool}
    if (coupling->lost >= coupling->end->fade) {{
        coupling->given = 0u;
    }}
    if (plausible(coupling, &tool, 1u)) {{
        coupling->far = tool;
        coupling->lost = 0ul;
        coupling->given = 1u;
    }} else if (coupling->lost < coupling->end->fade) {{
        coupling->lost++;
    }}
    return pull(coupling);
}}

{real} avc_coupling_step(avc_coupling_t *coupling, {real} position_m, {given})
{{
    avc_coupling_sample(coupling, position_m);
    return avc_coupling_force(coupling, {passed});
}}
"""

# A force of spring and damper from the tool's present state.
_PULL = """
{real} avc_coupling_{which}(avc_coupling_t *coupling, {real} tool_position_m, {real} tool_velocity_m_per_s)
{{
    {real} force_n;
    avc_coupling_alive(coupling);
    if (coupling->started == 0u || !within(tool_position_m, {farthest}) ||
        !within(tool_velocity_m_per_s, {farthest})) {{
        return {zero};
    }}
    force_n = AVC_COUPLING_TOOL_STIFFNESS * ({scale} * coupling->own.position_m - tool_position_m);
    if (coupling->missed == 0ul) {{
        force_n += AVC_COUPLING_TOOL_DAMPING * {speed};
    }}
    force_n = left_of(coupling, force_n);
    coupling->{kept} = coupling->missed == 0ul ? force_n : no_more(force_n, coupling->{kept});
    return coupling->{kept};
}}
"""

_TARGET = """
{real} avc_coupling_target(avc_coupling_t *coupling, {real} *position_m, {real} *velocity_m_per_s)
{{
    avc_coupling_alive(coupling);
    *position_m = {scale} * coupling->own.position_m;
    *velocity_m_per_s = coupling->missed == 0ul ? {scale} * coupling->own.velocity_m_per_s : {zero};
    return coupling->started == 0u ? {zero} : left_of(coupling, {one});
}}
"""


# Bounds of the own position, as the C of an end names them.
_OF_END = {name: f"end->{name}_m" for name in ("jump", "start", "unsure", "hand", "driven")}
_OF_END |= {"lost": "end->lost", "pushed": "end->pushed", "quiet": "end->quiet_n"}
_OF_END |= {"end": ", const avc_coupling_end_t *end", "passed": ", end"}


@singledispatch
def also_judged(end: End) -> str:  # noqa: ARG001
    """Return in which states of the other end the loops are judged too."""
    return ""


@also_judged.register(Follower)
def _follower_judged(end: Follower) -> str:  # noqa: ARG001
    return ", the follower free and in contact"


def pair_verdict(coupling: Coupling, *, unsafe: bool) -> tuple[str, bool]:
    """Judge gains on the loops of their own problem, independent of any certificate: a sentence, and whether stable."""
    problem = coupling.problem
    gains = coupling.gains
    search = search_of(coupling.end, problem)
    fault = search.fault(gains)
    if fault is None:
        known = f"with every hand of [hands] and released{also_judged(coupling.end)}"
        return f"deployable: all {search.loop_count} loops are linearly stable, {known}", True
    radius, case = search.loops.radius(gains)
    worst = "with a hand" if any(case.hand.values()) else "released"
    why = f"not deployable: {fault}; spectral radius {radius:.6g} {worst}"
    if not unsafe:
        raise NotDeployableError(f"{problem.name or 'the problem'}: {why}. Make it again: avc recommend P --out FILE")
    return f"UNSAFE, written by request: {why}", False


def pair_files(coupling: Coupling, precision: Precision, verdict: str) -> dict[str, str]:
    """Return header and source of a coupling to a simulation or a follower, by file name."""
    literal = precision.literal
    words = {
        "id": coupling.id,
        "checks": compiler_checks(precision),
        "real": precision.c_type,
        "zero": literal(0.0),
        "one": literal(1.0),
        "one_and_a_half": literal(1.5),
        "half": literal(0.5),
        "largest": literal(precision.largest),
        "farthest": literal(FARTHEST_M),
    }
    words |= {"sensor": SENSOR.format(**words, **_OF_END)}
    code = pair_code(coupling.end, coupling, precision, words)
    silences_s = [end.watchdog * end.device.sample_time_s for end in code.ends]
    ends = "\n".join(end.c(precision) for end in code.ends)
    source = _SOURCE.format(**words, other=code.other, clear=code.clear, ends=ends, calls=code.calls)
    return header_and_source(pair_header(coupling, precision, verdict, silences_s), source)


@dataclass(frozen=True)
class _Reach:
    """Bounds of what the other end tells, in its units."""

    jump_m: float
    """The farthest that its position goes from one message to the next."""
    step_m: float
    """What its encoder adds."""
    fastest_m_per_s: float


@dataclass(frozen=True)
class _End:
    """One end: its device, gains, and what it believes of the other."""

    name: str
    device: Device
    gains: ToolGains
    scales: tuple[float, float]  # own metres and newtons for one of the other end
    far: _Reach
    watchdog: int
    most: int = 1
    feels_force: bool = False

    def c(self, precision: Precision) -> str:
        """Return it as a constant of C."""
        device = self.device
        gains = self.gains
        bounds = SensorBounds.of(device)
        numbers = (
            device.sample_time_s,
            *self.scales,
            gains.stiffness_n_per_m,
            gains.damping_ns_per_m,
            gains.local_damping_ns_per_m,
            precision.largest if device.max_force_n is None else device.max_force_n,
            bounds.jump_m,
            bounds.start_m,
            bounds.unsure_m,
            bounds.hand_m,
            bounds.driven_m,
            bounds.inside_m,
            bounds.struck_m,
            bounds.quiet_n,
            self.far.jump_m,
            self.far.step_m,
            self.far.fastest_m_per_s,
        )
        own_samples = (f"{bounds.pushed_samples}u", f"{bounds.lost_samples}u")
        watched = (f"{self.watchdog}ul", f"{fade_samples(device)}ul", *own_samples)
        whole = (*watched, f"{self.most}u", f"{int(self.feels_force)}u")
        body = "".join(f"    {entry},\n" for entry in (*map(precision.literal, numbers), *whole))
        kind = "static const" if self.name == "DEVICE" else "const"
        return f"{kind} avc_coupling_end_t AVC_COUPLING_{self.name} = {{\n{body}}};\n"


@dataclass(frozen=True)
class PairCode:
    """What the C of a coupling to one kind of end has of its own: its ends, its calls and what these keep."""

    other: str
    ends: list[_End]
    calls: str
    clear: str = ""


@singledispatch
def pair_code(end: End, coupling: Coupling, precision: Precision, words: dict[str, str]) -> PairCode:  # noqa: ARG001
    """Return what the C of a coupling to an end has of its own.

    Raises:
        UnsupportedError: no C is known of this kind of end.
    """
    raise not_known(end, "C")


@pair_code.register(Follower)
def _follower_code(
    end: Follower,  # noqa: ARG001
    coupling: Coupling,
    precision: Precision,  # noqa: ARG001
    words: dict[str, str],
) -> PairCode:
    return PairCode("the other of two devices", _both_ends(coupling), _FOLLOWER.format(**words))


@pair_code.register(Simulation)
def _simulation_code(end: Simulation, coupling: Coupling, precision: Precision, words: dict[str, str]) -> PairCode:
    clear = "".join(f"    coupling->{force}_n = {words['zero']};\n" for force in ("to_tool", "handed"))
    calls = _engine_c(end, words, precision.literal(end.position_scale))
    return PairCode("the tool of a simulation", [_device_end(coupling, end)], calls, clear)


def _device_end(coupling: Coupling, tool: Simulation) -> _End:
    """Return the device of an engine: its gains, how far a tool may jump, m, and after how many samples it is lost."""
    device = coupling.problem.device
    fastest = SensorBounds.of(device).fastest_m_per_s * tool.position_scale
    # A tool may move as far in a step of the engine as in a sample.
    jump_m = fastest * max(*tool.step_s, device.sample_time_s)
    watchdog = MISSED_STEPS * math.ceil(max(tool.step_s) / device.sample_time_s - ROUNDING)
    return _End(
        name="DEVICE",
        device=device,
        gains=coupling.gains,
        scales=(1 / tool.position_scale, tool.force_scale),
        far=_Reach(jump_m, 0.0, fastest),
        watchdog=watchdog,
        feels_force=tool.exchange == "held-force",
    )


def _both_ends(coupling: Coupling) -> list[_End]:
    """Return leader and follower: gains, how far the other end may jump between messages, m, and when it is lost."""
    leader, follower = coupling.problem.device, coupling.follower
    to_follower_s, to_leader_s = follower.delays_s[-1]
    late = 2 * follower.jitter
    position, force = follower.position_scale, follower.force_scale

    def end(
        name: str, device: Device, opposite: Device, gains: ToolGains, scales: tuple[float, float], delay_s: float
    ) -> _End:
        silence_s = _MESSAGES * max(device.sample_time_s, opposite.sample_time_s) + late * delay_s
        watchdog = math.ceil(silence_s / device.sample_time_s - ROUNDING)
        # After a longer silence any message number is accepted.
        longest_s = (watchdog + fade_samples(device)) * device.sample_time_s + delay_s
        most = math.ceil(longest_s / opposite.sample_time_s) + 1
        fastest = SensorBounds.of(opposite).fastest_m_per_s
        step = 2 * (opposite.encoder_resolution_m or 0.0)
        reach = _Reach(fastest * opposite.sample_time_s, step, fastest + step / opposite.sample_time_s)
        return _End(name, device, gains, scales, reach, watchdog, most)

    of_leader = end("LEADER", leader, follower, coupling.gains, (1 / position, force), to_leader_s)
    of_follower = end("FOLLOWER", follower, leader, coupling.at_follower, (position, 1 / force), to_follower_s)
    return [replace(of_leader, feels_force=follower.architecture == "position-force"), of_follower]


def _engine_c(tool: Simulation, words: dict[str, str], scale: str) -> str:
    """Return the calls of a device with an engine: forces without what its integrator solves, or the target."""
    names = ("force_n",) if tool.exchange == "held-force" else ("position_m", "velocity_m_per_s")
    made = {
        "given": ", ".join(f"{words['real']} tool_{name}" for name in names),
        "passed": ", ".join(f"tool_{name}" for name in names),
        "tool": "\n".join(f"    tool.{name} = tool_{name};" for name in names),
    }
    calls = _ENGINE.format(**words, **made)
    moving = f"{scale} * coupling->own.velocity_m_per_s"
    relative_velocity = f"({moving} - tool_velocity_m_per_s)"
    if tool.solved == "spring and damper":
        calls += _TARGET.format(**words, scale=scale)
    else:
        speed = f"({moving})" if tool.solved == "damper" else relative_velocity
        calls += _PULL.format(**words, scale=scale, which="tool_force", speed=speed, kept="to_tool_n")
    if tool.solved != "nothing" and tool.exchange == "held-force":
        calls += _PULL.format(**words, scale=scale, which="handed_force", speed=relative_velocity, kept="handed_n")
    return calls
