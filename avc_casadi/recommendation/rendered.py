"""What a coupling renders: impedance in a frequency sweep, contact onset and its end, rebound, ripple, and plots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Any, ClassVar, Protocol, Self

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi.claims.impedance import (
    HandExcitation,
    below_quarter_rate,
    handle_impedance,
    rendered,
    stiffness_at_handle,
)
from avc_casadi.coupling import Coupling
from avc_casadi.loops.engine import EngineLoop, clocks
from avc_casadi.loops.follower import Link, Touch, link_clocks
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import OpenLoop, damping_ratios
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.model.device import DeviceRange
from avc_casadi.model.ends import RIGID_N_PER_M, End, Follower, Simulation, ToolGains, not_known, tool_states
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Hold, Press
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import QUIET
from avc_casadi.simulation.population.motions import at_handle
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.setup import FRICTION, Setup, prepare, traces

STRIKES_M_PER_S = (0.1, 0.4)
"""Approach speeds of exploration and of a strike."""
SLOW_M_PER_S = (0.02, 0.05)
"""Speeds of ripple: at higher ones the encoder steps are more frequent and less detectable."""
NOTICED_N = 0.1
"""Detectable force."""
REACHED_M = 0.01
"""Depth to which the hand is led, at the handle."""
PRESSED_S = 1.0
"""Duration of a press before the hand withdraws; after it an observer with slow modes is nearly at rest."""
WITHDRAWN_M = 0.01
"""Distance outside the wall to which the hand withdraws, at the handle: from there a press of the trial begins."""
WITHDRAWN_S = 0.5
"""Duration of the withdrawal: brisk, within the voluntary motion of a hand."""
NOTICED_LATE_S = 0.02
"""Least time between two touches whose order is perceived, here between the face and the end of its force: 20 to
60 ms (Hirsh and Sherrick, Journal of Experimental Psychology 1961; Yamamoto and Kitazawa, Scholarpedia 2015)."""
FACES = 16
"""Places of the wall's face within an encoder step; twice as many change what is found by some per cent at most."""


_MANY = 0.1
"""Share of the hands from which many notice a ripple."""


@dataclass(frozen=True)
class FrequencySweep:
    """Impedance rendered to a handle excited about a mean depth."""

    depth_m: float
    amplitude_m: float
    frequency_hz: FloatArray  # shape (n,), as of all below; those under a quarter of the sample rate
    stiffness_n_per_m: FloatArray  # |Z_h - Z_d| omega, rendered beside the device
    error: FloatArray  # |Z_h - Z|/|Z| with the physical wall Z = m s + b_d + b_e + k_e/s

    def by_frequency(self, values: FloatArray) -> dict[float, float]:
        """Return values by their frequencies, Hz."""
        return dict(zip(self.frequency_hz.tolist(), values.tolist(), strict=True))


def frequency_sweep(
    coupling: Coupling, rendered_n_per_m: float, frequency_hz: Sequence[float] | FloatArray = (1.0, 10.0, 50.0)
) -> FrequencySweep:
    """Return the impedance rendered to the excited handle in the wall, by describing function (Gelb 1968).

    A sine moves the handle by an amplitude, m, at each frequency, Hz; the force at that frequency is what counts. A few
    rounds make the motion of the sensor agree with the force.
    """
    device = coupling.problem.device
    heard = below_quarter_rate(device, np.array(frequency_hz))
    excitation = HandExcitation.of(device, stiffness_at_handle(device, rendered_n_per_m))
    # The sensor of a flexible device moves by another amplitude than its handle, as the force decides.
    depth_m, share = (
        HandExcitation.of(device, rendered_n_per_m).depth_m,
        handle_impedance(device, complex(rendered_n_per_m), heard)[1],
    )
    for _ in range(5):
        force, before = _force_in_sweep(coupling, depth_m, excitation.amplitude_m * np.abs(share), heard), share
        share = handle_impedance(device, force, heard)[1]
        if np.allclose(share, before, rtol=0.01):
            break
    return FrequencySweep(excitation.depth_m, excitation.amplitude_m, heard, *rendered(coupling.problem, force, heard))


def _force_in_sweep(coupling: Coupling, depth_m: float, amplitude_m: FloatArray, each_hz: FloatArray) -> ComplexArray:
    """Return commanded force over measured position for imposed sines of the sensor, N/m, complex, shape (n,).

    The sensor goes to `depth_m`, then swings by `amplitude_m` at each frequency; both signals are weighed by a Hann
    window and compared at that frequency.
    """
    ramp_s = 0.25  # into the wall
    settled_s = 2.0  # until the transient has decayed
    end_s = 4.0  # of the record
    period = coupling.problem.device.sample_time_s
    time = period * np.arange(round(end_s / period) + 1)
    ramp = depth_m * np.clip(time / ramp_s, 0.0, 1.0)
    last = slice(round(settled_s / period), None)
    stiffnesses = []
    for hz, moved_m in zip(each_hz, amplitude_m, strict=True):
        goes = ramp + moved_m * np.sin(2 * np.pi * hz * np.maximum(time - ramp_s, 0.0))
        position, force = (part[last] for part in _led(coupling, goes, float(np.max(each_hz))))
        wave = np.exp(-2j * np.pi * hz * time[:-1][last]) * np.hanning(len(position))
        stiffnesses.append(((force - force.mean()) @ wave) / ((position - position.mean()) @ wave))
    return np.array(stiffnesses)


def _led(
    coupling: Coupling, position_m: FloatArray, fastest_hz: float = 0.0, *, exact: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return measured position, m, and commanded force, N, for an imposed motion of the sensor; an ideal actuator.

    `fastest_hz` is the fastest sine of the motion; `exact` leaves the encoder's steps out.
    """
    # What lies between command and handle is linear and computed analytically.
    changed: dict[str, Any] = {"delay_samples": 0, "max_force_n": None}
    if exact:
        changed["encoder_resolution_m"] = 0.0
    position, force = _imposed(coupling, position_m, changed, fastest_hz)
    return position[0], force[0]


def _imposed(
    coupling: Coupling, position_m: FloatArray, changed: dict[str, Any], fastest_hz: float = 0.0, faces: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Return the sensor's position and the force after delay and amplifier, (faces, samples), for an imposed motion.

    `changed` are values of the device that differ; the last position of the motion has no sample of its own.
    The wall's face lies in the middle of an encoder step; of several faces each lies elsewhere. An imposed motion
    leaves no part to mass, resonance and dry friction.
    """
    device = coupling.problem.device
    rigid: dict[str, Any] = {
        "coulomb_friction_n": 0.0,
        "amplifier_bandwidth_hz": None,
        "resonance": None,
        "encoder_at": "motor",
        "range": DeviceRange(),
    }
    setup = Setup.of(coupling, device.model_copy(update=rigid | changed)).without("guard")
    setup = replace(setup, steps_anywhere=faces > 1)
    # The motion is imposed by a mass far beyond the device's force, on a spring much faster than the motion.
    fast = 2 * math.pi * max(20.0 * fastest_hz, 30.0)
    mass = 1e7 * (device.mass_kg + coupling.problem.hands.mass_kg[1])
    hand = Hand(
        mass_kg=np.full(faces, mass),
        damping_ns_per_m=np.full(faces, 2 * mass * fast),
        stiffness_n_per_m=np.full(faces, mass * fast**2),
    )
    samples = len(position_m) - 1
    t = device.sample_time_s
    scene, parameters, inputs_at_rest = prepare(setup, hand, Hold(end_m=0.0), samples * t)
    inputs = inputs_at_rest.copy()
    inputs[scene.inputs.index("target_position_m")] = position_m[:-1]
    inputs[scene.inputs.index("target_velocity_m_per_s")] = np.diff(position_m) / t
    run = execute(scene, parameters, inputs)
    position = run["position_m"]
    # Without a wall no force is commanded.
    return position, run.get("force_n", np.zeros_like(position))


def contact_onset_m(coupling: Coupling) -> dict[float, float | None]:
    """Return the depth, m, at which a force of `NOTICED_N` sets in, by the speed of the hand, m/s.

    None where it does not within `REACHED_M`. A stiff grip goes into the wall at each of the speeds of a strike.
    """
    from_m, radius = -0.04, coupling.problem.device.metres_per_unit
    # A grip stiff enough that the wall does not slow the hand.
    hand = Hand(np.array([1.0]), np.array([600.0]), np.array([1e5])).at_handle(radius)
    onsets: dict[float, float | None] = {}
    for speed in STRIKES_M_PER_S:
        press = Press(start_m=from_m / radius, end_m=REACHED_M / radius, speed_m_per_s=speed / radius)
        (run,) = traces(Setup.of(coupling), hand, press, (REACHED_M - from_m) / speed)
        pushed = np.flatnonzero(run.force_n[0] / radius > NOTICED_N)
        onsets[speed / radius] = float(run.depth_m[0, pushed[0]]) if len(pushed) else None
    return onsets


@dataclass(frozen=True)
class LeavingContact:
    """Force that still acts after a press, while the device is outside the wall."""

    outside_m: float  # the farthest place outside at which more than `NOTICED_N` acts; 0 where none does
    lasting_s: float  # from the face until no more than that acts; noticed from `NOTICED_LATE_S` on
    force_n: float  # the largest one outside, noticed or not
    withdrawn_s: float = WITHDRAWN_S  # duration of the withdrawal


def leaving_contact(coupling: Coupling) -> LeavingContact:
    """Return the force that still acts outside the wall while a firm hand withdraws the handle after a press.

    A press to x_p, by half of a firm press or of the force limit and to 10 mm at most, rests for `PRESSED_S`. Then the
    hand withdraws with the least jerk (Flash and Hogan, Journal of Neuroscience 1985) to x_o = `WITHDRAWN_M` outside,
    with s = t/T_w from 0 to 1 and T_w = `WITHDRAWN_S`:

        x(t) = x_p - (x_p + x_o) (10 s^3 - 15 s^4 + 6 s^5)

    A spring and damper stops at the face, or a delay behind it. An observer's estimate may lag behind the hand, so
    that its wall still pushes: outwards, as the force is clipped at 0. It is watched as long again. The wall's face
    may lie anywhere between two encoder steps: each number is the largest of `FACES` places.
    """
    device = coupling.problem.device
    period_s, radius = device.sample_time_s, device.metres_per_unit
    depth_m = min(HandExcitation.of(device, coupling.static_stiffness_n_per_m).depth_m, REACHED_M / radius)
    entering_s = 0.25
    leaves_s = entering_s + PRESSED_S
    time_s = period_s * np.arange(round((leaves_s + 2 * WITHDRAWN_S) / period_s) + 1)
    share = np.clip((time_s - leaves_s) / WITHDRAWN_S, 0.0, 1.0)
    withdrawn = share**3 * (10 - 15 * share + 6 * share**2)
    motion_m = depth_m * np.minimum(time_s / entering_s, 1.0) - (depth_m + WITHDRAWN_M / radius) * withdrawn
    position_m, force_n = _imposed(coupling, motion_m, {}, faces=FACES if device.encoder_resolution_m else 1)
    outside = (position_m < 0) & (time_s[:-1] > leaves_s)
    noticed = outside & (force_n > NOTICED_N * radius)
    # The last noticed force is held until the next sample.
    samples = np.arange(position_m.shape[-1])
    lasting = np.where(noticed, samples + 1, 0).max(axis=-1) - outside.argmax(axis=-1)
    return LeavingContact(
        outside_m=float(np.where(noticed, -position_m, 0.0).max()),
        lasting_s=period_s * max(0, int(lasting.max())),
        force_n=float(np.where(outside, force_n, 0.0).max()),
    )


@dataclass(frozen=True)
class Creep:
    """What a hand feels that creeps in the wall, too slowly to open the dead zone of a law."""

    speed_m_per_s: float  # slower ones
    play_m: float  # way of the device, from where it turns back, that the force does not answer
    play_n: float  # what the wall would have answered


def creep(coupling: Coupling) -> Creep | None:
    """Return the play of a closed dead zone, 2 d, and the speed from which it opens; None without a dead zone.

    At a steady speed v the range of recent positions is v T kept/(1 - kept).
    """
    law = coupling.runtime.state_feedback
    if law is None or law.dead_zone_m == 0:
        return None
    play_m = 2 * law.dead_zone_m
    fastest = law.opens_m * (1 - law.kept) / (law.kept * coupling.sample_time_s) if law.kept > 0 else math.inf
    return Creep(fastest, play_m, play_m * coupling.static_stiffness_n_per_m)


def rebound(coupling: Coupling, *, at_face: bool = False) -> dict[float, float]:
    """Return exit speed of the released device's handle over its approach speed, by that, m/s.

    With `at_face` it is over the speed at the wall's face. The larger of with and without dry friction counts.
    """
    setup, radius = Setup.of(coupling), coupling.problem.device.metres_per_unit
    setups = (setup, setup.without(FRICTION)) if setup.rough else (setup,)
    shares: dict[float, float] = {}
    for rim_m_per_s in STRIKES_M_PER_S:
        speed = rim_m_per_s / radius
        shares[speed] = max(float(_strikes(case, speed, at_face=at_face).max()) for case in setups)
    return shares


def _strikes(setup: Setup, speed_m_per_s: float, *, at_face: bool, strikes: int = 32, steps: int = 200) -> FloatArray:
    """Return exit over approach speed of each strike, the wall's face anywhere between two encoder steps, (strikes,).

    The device starts away from the wall, so fast that with friction and damping it arrives at `speed_m_per_s`.
    """
    device = setup.problem.device
    friction_n = device.coulomb_friction_n if setup.rough else 0.0
    far = 0.03 / device.metres_per_unit  # enough for an observer to know the speed before the wall
    # Back from the wall: m v dv/dx = -(friction + b v).
    start = speed_m_per_s
    for _ in range(steps):
        start += far / steps * (friction_n / start + device.damping_ns_per_m) / device.mass_kg
    released = Hand(*(np.zeros(strikes),) * 3)
    scene, parameters, inputs = prepare(setup, released, Hold(start_m=-far, end_m=-far), far / speed_m_per_s + 0.5)
    moving = [start if name.endswith("_velocity_m_per_s") else 0.0 for name in scene.states]
    run = execute(replace(scene, initial=scene.initial + moving), parameters, inputs)
    inside, handle = run.get("measured_m", run["position_m"]) > 0, run.get("handle_m_per_s", run["velocity_m_per_s"])
    # Forces under way push it beyond the face too.
    left = inside.any(axis=1, keepdims=True) & ~np.logical_or.accumulate(inside[:, ::-1], axis=1)[:, ::-1]
    came = handle[np.arange(strikes), np.maximum(inside.argmax(axis=1) - 1, 0)] if at_face else speed_m_per_s
    return np.asarray(np.where(left, -handle, 0.0).max(axis=1) / came)


@dataclass(frozen=True)
class Ripple:
    """Force ripple from encoder quantisation on a handle in steady motion in the wall."""

    force_n: dict[float, float]  # rms by speed of the device, the lowest first
    hands: int  # simulated at the lowest speed
    quiet: int  # of them, below the vibrotactile detection threshold

    @property
    def in_slow_motion_n(self) -> float:
        """Rms force ripple at the lowest speed."""
        return self.force_n[min(self.force_n)]

    @property
    def many_vibrate(self) -> bool:
        """Whether more than a tenth of the hands may notice the ripple."""
        return self.hands - self.quiet > _MANY * self.hands


def ripple(coupling: Coupling, seed: int = 0) -> Ripple:
    """Return the force ripple of slow motion in the wall: its rms, N, prescribed, and how many hands feel none.

    Hands move their targets slowly; those count whose vibration is below the threshold of touch.
    """
    radius, drawn_s = coupling.problem.device.metres_per_unit, 1.5
    speeds = [speed / radius for speed in SLOW_M_PER_S]
    prescribed_n = {speed: _ripple_n(coupling, speed) for speed in speeds}
    hands = people_of(coupling.problem.hands, 16, seed)
    drawn = Press(start_m=0.0, end_m=2 * speeds[0] * drawn_s, speed_m_per_s=speeds[0])
    vibrations = [part.vibration for part in traces(Setup.of(coupling), hands, drawn, drawn_s)]
    return Ripple(prescribed_n, len(hands), int((np.concatenate(vibrations) < QUIET).sum()))


def _ripple_n(coupling: Coupling, speed_per_s: float) -> float:
    """Return the rms force, N, that encoder steps add on a handle in prescribed motion in the wall."""
    device = coupling.problem.device
    if device.encoder_resolution_m == 0:
        return 0.0
    period = device.sample_time_s
    led_s = 1.0
    counts_s = 0.5  # the last part
    faster = 0.2  # by which the speed rises
    time = period * np.arange(round(led_s / period) + 1)
    goes = speed_per_s * time * (1 + faster * (time / (2 * led_s) - 0.5))
    last = slice(-max(8, round(counts_s / period)), None)
    added = _led(coupling, goes)[1][last] - _led(coupling, goes, exact=True)[1][last]
    line = np.polynomial.Polynomial.fit(time[:-1][last], added, 1)
    return float(np.std(added - line(time[:-1][last])))


@dataclass(frozen=True, eq=False)
class Deployed:
    """Responses of a coupling with h corners of the hands, to plot."""

    coupling: Coupling
    frequency_sweep: FrequencySweep
    hands: Hand
    worst: int  # the hand with the least damped loop
    press_s: FloatArray
    press_m: FloatArray  # of each hand, with every declared effect simulated, (h, n)
    loop: OpenLoop  # broken at the actuator, with the corners, then released
    frequency_hz: FloatArray
    gain: ComplexArray  # L, (h + 1, f)
    struck_s: FloatArray
    struck_m: FloatArray  # of the linear loop after impact, (h + 1, m)


def deployed(coupling: Coupling) -> Deployed:
    """Return the responses of a coupling that are plotted: sweep, presses of the corner hands, loop gain and impact."""
    problem = coupling.problem
    device, period = problem.device, problem.device.sample_time_s
    hands = PlantFamily.of(problem).held
    loop = OpenLoop.of(coupling)
    settled_s = loop.settling_s()
    samples = int(np.clip(1.2 * settled_s[np.isfinite(settled_s)].max(initial=0.0) / period, 50, 5000))
    turn = loop.turns()
    # The wall's face lies at mid-step of the encoder, as in a scene.
    setup = replace(Setup.of(coupling), steps_anywhere=False)
    presses = traces(setup, hands, at_handle(Press(), device), 1.0)
    pressed = np.concatenate([run.position_m if run.handle_m is None else run.handle_m for run in presses])
    hz = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0, 70.0, 100.0)
    return Deployed(
        coupling=coupling,
        frequency_sweep=frequency_sweep(coupling, coupling.static_stiffness_n_per_m, hz),
        hands=hands,
        worst=int(damping_ratios(loop.poles[:-1]).min(axis=1).argmin()),
        press_s=np.asarray(period * np.arange(pressed.shape[-1])),
        press_m=pressed,
        loop=loop,
        frequency_hz=turn / (2 * np.pi * period),
        gain=loop.gain(turn),
        struck_s=np.asarray(period * np.arange(samples)),
        struck_m=loop.impact(STRIKES_M_PER_S[0] / device.metres_per_unit, samples),
    )


@dataclass(frozen=True)
class RenderedPoint:
    """Impedance at the handle at one frequency, of device and coupling to a tool or a follower."""

    frequency_hz: float
    mass_kg: float | None  # in free motion, Im(Z)/omega; None where nothing moves
    drag_ns_per_m: float  # in free motion, Re(Z); where nothing moves, without the coupling
    free_error: float | None  # from that of device and tool as one body, over its |Z|
    stiffness_n_per_m: float  # against a rigid object, |F/x| beside the device as one body
    contact_error: float  # from that of the device on a spring K, over its |Z|


@dataclass(frozen=True)
class RenderedPair(Document):
    """What a spring and damper to another end renders at the handle.

    Attributes:
        stiffness_n_per_m: at rest on a rigid object; None without a spring.
        on_stiffest_contact_n_per_m: at rest on the stiffest declared contact; None where none is declared.
        points: impedance by frequency.
    """

    JSON_KEYS: ClassVar = ("stiffness_n_per_m", "on_stiffest_contact_n_per_m", ("at", "points"))

    stiffness_n_per_m: float | None
    on_stiffest_contact_n_per_m: float | None
    points: tuple[RenderedPoint, ...]

    @classmethod
    def of(cls, coupling: Coupling, points: tuple[RenderedPoint, ...]) -> Self:
        """Return what a coupling renders, N/m: K, K in series with the stiffest contact, and points by frequency."""
        device = coupling.problem.device
        k = coupling.gains.stiffness_n_per_m
        contact = coupling.end.stiffest_contact_n_per_m
        in_series = 1 / (1 / k + 1 / contact) if k and contact else None
        return cls(
            stiffness_n_per_m=stiffness_at_handle(device, k) if k else None,
            on_stiffest_contact_n_per_m=None if in_series is None else stiffness_at_handle(device, in_series),
            points=points,
        )


class DrivenEnd(Protocol):
    """An end with a coupling, in one contact, as the force that it gives to a moving device."""

    def force_per_metre(self, gains: ToolGains, frequency_hz: float) -> complex:
        """Return the force of the coupling over the motion of the device."""


@dataclass(frozen=True)
class NominalEnd:
    """What is rendered of an end: it moves freely or it is held, with its mass and damping in free motion."""

    free: DrivenEnd
    held: DrivenEnd
    moves: bool
    mass_kg: float = 0.0
    damping_ns_per_m: float = 0.0


@singledispatch
def nominal_end(end: End, problem: Problem) -> NominalEnd:  # noqa: ARG001
    """Return what is rendered of an end on the nominal device.

    Raises:
        UnsupportedError: of this kind of end that is not known.
    """
    raise not_known(end, "what a hand feels")


@nominal_end.register
def _heaviest_tool(engine: Simulation, problem: Problem) -> NominalEnd:
    t = problem.device.sample_time_s
    free, rigid = (tool_states(engine, contact)[-1] for contact in (0.0, RIGID_N_PER_M))
    clock, driven = clocks(max(engine.step_s), t, engine.clock)[-1], Body.motion_source(t)
    mass, damping = (0.0, 0.0) if free.fixed else (free.mass_kg, free.damping_ns_per_m)
    moving, held = (EngineLoop(driven, clock, engine, [state]) for state in (free, rigid))
    return NominalEnd(moving, held, not free.fixed, mass, damping)


@nominal_end.register
def _nominal_follower(follower: Follower, problem: Problem) -> NominalEnd:
    far, nothing = follower.at_leader(), np.zeros(2)
    t = problem.device.sample_time_s
    touched = sampled_plant(far.model_copy(update={"range": DeviceRange()}), Hand(nothing, nothing, nothing))
    touch = Touch.of(touched, np.array([0.0, np.inf]), nothing)
    link = link_clocks(t, far.sample_time_s, *follower.delays_s[-1])[-1]
    moving, held = (Link(Body.motion_source(t), touch.axes(place), link, follower) for place in (0, 1))
    return NominalEnd(moving, held, moves=True, mass_kg=far.mass_kg, damping_ns_per_m=far.damping_ns_per_m)


def rendered_band(problem: Problem, gains: ToolGains) -> tuple[tuple[RenderedPoint, ...], float, float]:
    """Return the impedance over the band of hand motion and perception, and mass and damping of both ends as one."""
    device, far = problem.device, nominal_end(problem.end, problem)
    rendered_impedance = rendered_pair(problem, gains, np.geomspace(0.3, 100.0, 80).tolist())
    return rendered_impedance, device.mass_kg + far.mass_kg, device.damping_ns_per_m + far.damping_ns_per_m


def rendered_pair(
    problem: Problem, gains: ToolGains, frequencies_hz: Sequence[float] = (1.0, 10.0)
) -> tuple[RenderedPoint, ...]:
    """Return mass, damping and stiffness at the handle at each frequency, with their errors: free and held.

    Of the nominal device with the heaviest tool or the follower. Frequencies, Hz, above a quarter of the sample rate
    are left out.
    """
    device, far = problem.device, nominal_end(problem.end, problem)

    def at(frequency_hz: float) -> RenderedPoint:
        """Return that in free motion and in rigid contact."""
        hz, s = np.array([frequency_hz]), 2j * np.pi * frequency_hz
        moved, contact = (
            handle_impedance(device, end.force_per_metre(gains, frequency_hz), hz)[0][0] for end in (far.free, far.held)
        )
        alone = device.mass_kg * s + device.damping_ns_per_m
        wanted = alone + gains.stiffness_n_per_m / s
        stiffness, error = float(abs((contact - alone) * s)), float(abs(contact - wanted) / abs(wanted))
        if not far.moves:
            drag = device.damping_ns_per_m + gains.local_damping_ns_per_m
            return RenderedPoint(frequency_hz, None, drag, None, stiffness, error)
        body = alone + far.mass_kg * s + far.damping_ns_per_m
        free_error = float(abs(moved - body) / abs(body))
        return RenderedPoint(frequency_hz, float(moved.imag / abs(s)), float(moved.real), free_error, stiffness, error)

    return tuple(at(hz) for hz in frequencies_hz if hz * device.sample_time_s < 0.25)
