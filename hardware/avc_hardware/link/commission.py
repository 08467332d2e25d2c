"""Commissioning: check the wiring of a device by a hand and by a small pulse, and set the position of its wall.

There is no force until the encoder is known to count up on the way into the wall. The pulse is open-loop, within limits
of force, speed and travel that the device monitors by itself. Faults are latched on the device, which then takes no
table; correct wiring ends with a low force limit for the first touch.

The response of a device to a pulse, by mass, damping and dry friction, gives its duration and its least force.

The pulse is one period of a sine. From rest, with t = omega time, speed u in F/(m omega), beta = damping/(m omega) and
phi = friction/F the way into the wall obeys

    u' = sin(t) - phi - beta u    from sin(t) = phi on, until u = 0

a linear equation: u is the sum of the response to the sine, the response to the friction, and a decaying part.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi import Fault, InputError, LinkError
from avc_casadi._util.units import METRE, MM, NEWTON, NS_PER_M, in_its_units
from avc_casadi.identification.excitation.plan import Plan, speed_window
from avc_casadi.identification.excitation.signal import FULL, Signal
from avc_hardware.emulator.bench import WiredBench, Wiring
from avc_hardware.link import messages as m
from avc_hardware.link.bytes import ByteLink
from avc_hardware.link.connection import DEFAULT_BAUD, EMULATOR, Connection, open_link
from avc_hardware.link.device import DeviceStatus
from avc_hardware.link.excite import ExcitationLog, excite_over
from avc_hardware.link.faults import WIRED_WRONGLY, DeviceFault
from avc_hardware.link.messages import Kind
from avc_hardware.link.monitor import pause, watch
from avc_hardware.link.settings import Limits, limit_over

if TYPE_CHECKING:
    from avc_casadi.model.device import Device as DeclaredDevice
    from avc_hardware.link.device import Device


__all__ = ["LEAST_COUNTS", "Moved"]

# Travel of a pulse at the hand, and encoder counts above which a device has moved.
_WAY_M, LEAST_COUNTS = 1e-3, 5
# A pulse is planned for so many times these counts; one below that at any duration is too weak.
_PLANNED, _ACCEPTED = 4, 2
_SHORTEST_S, _LONGEST_S = 0.02, 1.0
# Only the excess over dry friction moves the device: a fifth of the force, with a margin for a little more friction.
_OVER_FRICTION = 1.25
_TIMES, _HALVINGS = 1000, 50


def _most(nominal: float, stated: tuple[float, float] | None) -> float:
    return nominal if stated is None else max(nominal, *stated)


@dataclass(frozen=True)
class Moved:
    """The device under a pulse: as declared, each value at the least favourable end of its range.

    Attributes:
        mass_kg: what the hand moves.
        damping_ns_per_m: viscous.
        friction_n: dry.
        reach_m: travel of the hand per unit of position: 1, or the handle radius of a rotary device.
    """

    mass_kg: float
    damping_ns_per_m: float
    friction_n: float
    reach_m: float = 1.0

    @classmethod
    def of(cls, declared: DeclaredDevice) -> Moved:
        """Return it with the upper end of each range, where one is given."""
        ends = declared.range
        return cls(
            _most(declared.mass_kg, ends.mass_kg),
            _most(declared.damping_ns_per_m, ends.damping_ns_per_m),
            _most(declared.coulomb_friction_n, ends.coulomb_friction_n),
            declared.metres_per_unit,
        )

    def way_m(self, force_n: float, seconds: float) -> float:
        """Return the travel of a pulse into the wall, from rest; 0 where friction holds the device."""
        if force_n <= self.friction_n:
            return 0.0
        rad_s = 2 * math.pi / seconds
        friction, damping = self.friction_n / force_n, self.damping_ns_per_m / (self.mass_kg * rad_s)
        start = math.asin(friction)
        since = np.linspace(0.0, 2 * math.pi - start, _TIMES)
        time = start + since
        left = np.exp(-damping * since)
        sine = damping * np.sin(time) - np.cos(time) - left * (damping * math.sin(start) - math.cos(start))
        dry = -np.expm1(-damping * since) / damping if damping > 0 else since
        speed = np.maximum(sine / (1 + damping**2) - friction * dry, 0.0)
        return force_n / (self.mass_kg * rad_s**2) * float(speed.mean() * since[-1])

    def seconds(self, force_n: float, metres_per_count: float) -> float:
        """Return the duration of a pulse with the travel, or the longest one."""
        wanted_m = max(_WAY_M / self.reach_m, _PLANNED * LEAST_COUNTS * metres_per_count)
        low, high = _SHORTEST_S, _LONGEST_S
        for _ in range(_HALVINGS):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self.way_m(force_n, middle) >= wanted_m else (middle, high)
        return high

    def least_n(self, metres_per_count: float) -> float:
        """Return the least force of a visible pulse: above the friction, and far enough at the longest duration.

        Args:
            metres_per_count: of the encoder; 0 considers the friction alone.
        """
        above_friction_n = _OVER_FRICTION * self.friction_n
        wanted_m = _ACCEPTED * LEAST_COUNTS * metres_per_count

        def enough(force_n: float) -> bool:
            return self.way_m(force_n, _LONGEST_S) >= wanted_m

        if wanted_m == 0 or (above_friction_n > 0 and enough(above_friction_n)):
            return above_friction_n
        low, high = above_friction_n, max(2 * above_friction_n, 1e-6)
        while not enough(high):
            low, high = high, 2 * high
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        return high


INTO_WALL = "1. push it by hand INTO the wall, the way in which it shall be stopped, {far} or more; hold it there"
BACK = "2. draw it back to where the face of the wall shall be, and hold it still there"
HANDS_OFF = "3. hands off: in {wait:g} s a pulse of {force:g} {unit} for {time:.0f} ms, into the wall and back"
# Parameters of the steps: polling rate, stillness, patience, pause before the pulse.
_RATE_HZ, _STILL_S, _PATIENCE_S, _WAIT_S = 100.0, 0.5, 30.0, 2.0
# Still: within this share of the requested travel.
_STILL = 0.05
# The pulse's limits of speed and travel at the hand, and the firmware's range of speed limits in the device's unit.
_SPEED_M_PER_S, _TRAVEL_M, _MOST_RATE = 0.3, 0.01, 10.0
_FIRST_TOUCH = 0.1
# Travel of the hand: counts that show stillness, the default, and the largest on a desk.
_LEAST_WAY_COUNTS, _USUAL_WAY_M, _LONGEST_WAY_M = 20, 5e-3, 0.1


@dataclass(frozen=True)
class Commissioned:
    """Result of commissioning.

    Attributes:
        port: as given.
        found: faults of the wiring, latched on the device; none where it is correct.
        sentence: the same as text.
        by_hand_m: travel of the encoder on the way into the wall, by its own sign.
        pulse_n: force of the pulse.
        pulse_m: travel of the device along +position; NaN where there was none.
        zero: whether position 0 was set to where the device was held.
        limits: at run time, from now on.
    """

    port: str
    found: DeviceFault
    sentence: str
    by_hand_m: float
    pulse_n: float
    pulse_m: float
    zero: bool
    limits: Limits

    def document(self) -> dict[str, Any]:
        """Return the figures: JSON values only."""
        pulse_m = self.pulse_m if math.isfinite(self.pulse_m) else None
        found = {"found": [fault.word for fault in self.found], "limits": vars(self.limits), "pulse_m": pulse_m}
        return vars(self) | found


@in_its_units
def commission(
    declared: DeclaredDevice,
    port: str | ByteLink,
    *,
    force_n: float | None = None,
    first_touch_n: float | None = None,
    by_hand_m: float | None = None,
    on_bench: Wiring = Wiring.RIGHT,
    baud: int = DEFAULT_BAUD,
    on_step: Callable[[str], None] = lambda _: None,
    on_silence: Callable[[str], None] | None = None,
) -> Commissioned:
    """Check the signs of encoder and motor, set position 0, and limit the force for a first touch.

    A running coupling is removed; after that a push finds a device limited to ``first_touch_n`` until `set_limits`
    raises it.

    Args:
        declared: the device: its mass, friction and force give the duration of the pulse.
        port: device path, pyserial URL, ``usb:NUMBER``, ``emulator``, or an open link.
        force_n: of the pulse, at least 1.25 times the dry friction, and enough for a visible travel against the
            damping; default three times the friction, at least a tenth of the device's force.
        first_touch_n: force limit at the end; default a tenth of the device's force.
        by_hand_m: least travel of the hand into the wall, 20 counts of the encoder to 0.1 m at the hand; default 5 mm
            there.
        on_bench: wiring of the emulated board, whose hand follows the instructions.
        baud: rate of a serial port.
        on_step: receives the next instruction to the operator.
        on_silence: called once with the awaited answer and the time, where the device does not answer at once.

    Raises:
        InputError: a force or a travel out of range, all at once.
        LinkError: no device, other faults latched, or the hand did not follow the instructions.
        MissingExtraError: ``emulator`` without its extra.
    """
    moved_by = Moved.of(declared)
    by_hand_m = _USUAL_WAY_M / moved_by.reach_m if by_hand_m is None else by_hand_m
    _check_asked(force_n, moved_by, by_hand_m)
    if port == EMULATOR:
        link: ByteLink = WiredBench(declared, on_bench, way_m=2 * by_hand_m).board()
    else:
        link = open_link(port, baud=baud)
    with Connection(link, baud=baud, on_silence=on_silence) as connection:
        device = connection.device
        most = device.max_force_n
        least_n = moved_by.least_n(device.metres_per_count)
        pulse_n = force_n or min(max(3 * moved_by.friction_n, _FIRST_TOUCH * most, least_n), most)
        touch_n = first_touch_n or _FIRST_TOUCH * most
        _check_of_device(device, pulse_n, touch_n, moved_by, by_hand_m)
        limits = Limits(touch_n, device.lowered_speed_m_per_s, device.lowered_energy_j)
        _begin(connection, limits)
        result = Commissioned(link.name, DeviceFault(0), "", 0.0, pulse_n, math.nan, False, limits)
        on_step(INTO_WALL.format(far=f"{1e3 * by_hand_m:g} {MM}"))
        moved = _by_hand(connection, lambda way: abs(way) >= by_hand_m, by_hand_m)
        if abs(moved) < by_hand_m:
            if abs(moved) > 2 * device.metres_per_count:
                raise LinkError(
                    f"{link.name}: moved by {1e3 * moved:.3g} {MM} only in {_PATIENCE_S:g} s; commission again, and "
                    f"push it {1e3 * by_hand_m:g} {MM} into the wall"
                )
            said = "the encoder showed no movement (or nobody moved the device)"
            return _wrong(connection, replace(result, by_hand_m=moved), DeviceFault.STUCK, said)
        result = replace(result, by_hand_m=moved)
        if moved < 0:
            said = f"the encoder counted down, by {-1e3 * moved:.3g} {MM}, on the way into the wall"
            return _wrong(connection, result, DeviceFault.ENCODER_REVERSED, said)
        on_step(BACK)
        back = _by_hand(connection, lambda way: way <= -by_hand_m / 2, by_hand_m)
        if back > -by_hand_m / 2:
            raise LinkError(f"{link.name}: nobody drew it back in {_PATIENCE_S:g} s; commission again")
        connection.run(connection.session.ask(Kind.ZERO, b"", m.Zeroed))
        # An earlier commissioning's limits do not apply to this pulse.
        limit_over(connection, replace(limits, force_n=max(pulse_n, touch_n)))
        plan = pulse_plan(moved_by, device, pulse_n)
        on_step(HANDS_OFF.format(wait=_WAIT_S, force=pulse_n, unit=NEWTON, time=1e3 * plan.seconds))
        connection.run(pause(_WAIT_S))
        log = excite_over(connection, plan)
        limit_over(connection, limits)
        result = replace(result, zero=True, pulse_m=_answer(log))
        if abs(result.pulse_m) <= LEAST_COUNTS * device.metres_per_count:
            return _wrong(connection, result, DeviceFault.MOTOR_DEAD, f"a pulse of {pulse_n:g} {NEWTON} moved nothing")
        if result.pulse_m < 0:
            said = f"a pulse of {pulse_n:g} {NEWTON} into the wall moved it {-1e3 * result.pulse_m:.3g} {MM} out of it"
            return _wrong(connection, result, DeviceFault.MOTOR_REVERSED, said)
    said = (
        f"encoder and motor agree: the hand moved it {1e3 * moved:.3g} {MM} into the wall, a pulse of {pulse_n:g} "
        f"{NEWTON} {1e3 * result.pulse_m:.3g} {MM}. Position 0, the face of the wall, is where it was held, until it "
        "starts anew"
    )
    return replace(result, sentence=said)


def _check_asked(force_n: float | None, moved_by: Moved, by_hand_m: float) -> None:
    """Refuse impossible arguments, before a port is opened."""
    faults = []
    longest_m = _LONGEST_WAY_M / moved_by.reach_m
    if force_n is not None and not force_n >= moved_by.least_n(0.0):
        faults.append(_weak(force_n, moved_by, 0.0))
    if not 0 < by_hand_m <= longest_m:
        message = (
            f"{by_hand_m:g} {METRE}; allowed: {_LEAST_WAY_COUNTS} counts of the encoder to {longest_m:g} {METRE}: a "
            f"hand pushes the device so far and holds it still; {_USUAL_WAY_M / moved_by.reach_m:g} {METRE} tells the "
            "sign as well"
        )
        faults.append(Fault("", None, "by_hand_m", message))
    if faults:
        raise InputError(faults)


def _weak(force_n: float, moved_by: Moved, metres_per_count: float) -> Fault:
    least_n = moved_by.least_n(metres_per_count)
    damped = f" and a damping of {moved_by.damping_ns_per_m:g} {NS_PER_M}" if least_n > moved_by.least_n(0.0) else ""
    # Three digits, rounded up: the printed value is allowed.
    grain = 10.0 ** (math.floor(math.log10(least_n)) - 2)
    least_n = math.ceil(least_n / grain - 1e-6) * grain
    message = (
        f"{force_n:g} {NEWTON} against a dry friction of {moved_by.friction_n:g} {NEWTON}{damped}; allowed: "
        f"{least_n:g} {NEWTON} or more, as the device gives it: a weaker pulse moves nothing, which would be taken for "
        "a dead motor"
    )
    return Fault("", None, "force_n", message)


def _check_of_device(device: Device, pulse_n: float, touch_n: float, moved_by: Moved, by_hand_m: float) -> None:
    """Refuse arguments impossible for this device, before it is touched."""
    most, step_m = device.max_force_n, device.metres_per_count
    faults = [
        Fault("", None, key, f"{value:g} {NEWTON}; allowed: above 0, at most the device's {most:g} {NEWTON}")
        for key, value in (("force_n", pulse_n), ("first_touch_n", touch_n))
        if not 0 < value <= most
    ]
    if pulse_n <= most and pulse_n < moved_by.least_n(step_m):
        faults.append(_weak(pulse_n, moved_by, step_m))
    longest_m = _LONGEST_WAY_M / moved_by.reach_m
    if by_hand_m < _LEAST_WAY_COUNTS * step_m:
        message = (
            f"{by_hand_m:g} {METRE}; allowed: {_LEAST_WAY_COUNTS * step_m:g} to {longest_m:g} {METRE}: one count of "
            f"this encoder is {step_m:g} {METRE}, and {_LEAST_WAY_COUNTS} of them tell a hand that holds still from "
            "one that moves"
        )
        faults.append(Fault("", None, "by_hand_m", message))
    if faults:
        raise InputError(faults)


def _begin(connection: Connection, limits: Limits) -> None:
    """Remove the running coupling, so that there is no force, and the findings of an earlier commissioning."""
    name, ask = connection.link.name, connection.session.ask
    status = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
    others = DeviceFault(status.faults) & ~(WIRED_WRONGLY | DeviceFault.STUCK)
    if others:
        raise LinkError(f"{name}: the device has latched faults ({others.word}); clear them first: avc device --clear")
    if status.faults:
        connection.run(ask(Kind.CLEAR, m.clear(status.faults), m.ClearAsked))
    connection.run(ask(Kind.ZERO, b"", m.Zeroed))
    limit_over(connection, limits)


def _by_hand(connection: Connection, far: Callable[[float], bool], asked_m: float) -> float:
    """Wait until the device has moved far enough and stands still; return its travel, also if that never came."""
    start: float | None = None
    way = furthest = 0.0
    recent: deque[float] = deque(maxlen=round(_STILL_S * _RATE_HZ))
    end = connection.link.now_s() + _PATIENCE_S
    for sample in watch(connection, _RATE_HZ):
        start = sample.position_m if start is None else start
        way = sample.position_m - start
        furthest = max(furthest, way, key=abs)
        recent.append(way)
        still = len(recent) == recent.maxlen and max(recent) - min(recent) <= _STILL * asked_m
        if (far(way) and still) or connection.link.now_s() >= end:
            break
    connection.run(connection.session.ask(Kind.SUBSCRIBE, m.subscribe(0, 0), m.Subscribed))
    return way if far(way) else furthest


def pulse_plan(moved_by: Moved, device: Device, force_n: float) -> Plan:
    """Plan one period of a sine: a free mass moves one way and stands still at its end."""
    speed_m_per_s = min(_SPEED_M_PER_S / moved_by.reach_m, _MOST_RATE)
    seconds = moved_by.seconds(force_n, device.metres_per_count)
    ticks = max(round(seconds / device.sample_time_s), 8)
    return Plan(
        kind="multisine",
        sample_time_s=device.sample_time_s,
        metres_per_count=device.metres_per_count,
        ticks=ticks,
        ramp_ticks=1,
        max_force_n=force_n,
        max_speed_m_per_s=speed_m_per_s,
        max_travel_m=_TRAVEL_M / moved_by.reach_m,
        spring_n_per_m=0.0,
        damper_ns_per_m=0.0,
        window=speed_window(device.metres_per_count, device.sample_time_s, speed_m_per_s),
        signal=Signal(step=(round(2**32 / ticks),), phase=(0,), amplitude=(FULL,)),
    )


def _answer(log: ExcitationLog) -> float:
    """Return the largest travel along +position since the pulse began, m."""
    way = log.position_m - log.position_m[0]
    return float(way[np.argmax(np.abs(way))])


def _wrong(connection: Connection, found: Commissioned, fault: DeviceFault, said: str) -> Commissioned:
    """Latch the findings on the device, so that no coupling gives a force."""
    ask = connection.session.ask
    connection.run(ask(Kind.LATCH, m.latch(fault), m.ClearAsked))
    connection.run(pause(5 * connection.device.sample_time_s))
    if not fault & connection.run(ask(Kind.STATUS, b"", DeviceStatus)).faults:
        raise LinkError(f"{found.port}: {said}, and the device did not latch it; switch it off")
    (advice,) = fault.advice
    return replace(found, found=fault, sentence=f"{said}. {advice}")
