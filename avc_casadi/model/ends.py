"""What is beyond a coupling: a wall in the device's own loop, a simulation with a tool, or a second device."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import Interval
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.device import Detent, Device

ToolIntegrator = Literal["semi-implicit", "explicit", "exact", "implicit-damping", "implicit"]
Exchange = Literal["on-time", "late", "ahead", "held-force"]
Clock = Literal["own", "device"]
"""What times the steps of an engine: a clock of its own, or the loop of the device, which starts each step."""

RIGID_N_PER_M = q.LARGEST_STIFFNESS_N_PER_M
"""A contact of this stiffness counts as rigid: the tool stops at it."""

_ROUNDING = 1e-9
"""Share by which a time may miss its limit by rounding, as of a rate typed in place of a time."""
_SAME_NUMBER = 1e-6
"""Share by which a step may miss a whole number of samples, as of one typed with few digits."""
MOST_LINK_SAMPLES = 64
"""Largest delay of a link between two devices, in samples, each way."""

LIGHTEST_TOOL_KG = 1e-9
HEAVIEST_TOOL_KG = 1e6
"""Ends of what a tool may weigh, in a file and in searches."""
LONGEST_STEP_S = 10.0
"""The longest that a step may last, in a file and in searches."""


def at_least_a_sample(device: Device) -> str:
    """Return what is allowed of a time that holds a sample of the device."""
    return f"allowed: device.sample_time_s = {t.shown(device.sample_time_s)} or more"


class End:
    """What is beyond a coupling, as plain data.

    A kind of end is a subclass. Each room has functions of an end, registered by this type with
    `functools.singledispatch`: a new kind of end is one function a room.
    """

    kind: ClassVar[str]
    """What documents call it."""
    required: ClassVar[str] = "a table"
    """What a problem file has to state of it, in words."""
    in_scenes: ClassVar[bool] = False
    """Whether `avc simulate` has it."""
    couples: ClassVar[bool] = True
    """Whether a coupling to it is a file of its own, with gains; else it is a law in the problem."""
    beside_wall: ClassVar[bool] = False
    """Whether its problem may have couplings to its wall too."""

    def document(self) -> dict[str, Any]:
        """Return the values that identify it, JSON values."""
        return dict(vars(self))

    @property
    def stiffest_contact_n_per_m(self) -> float:
        """The stiffest contact that it declares, in the device's units; 0 where that is rigid, or none is declared."""
        return 0.0

    def faults_beside(self, device: Device) -> Iterator[t.Finding]:  # noqa: ARG002 - each kind has its own
        """Yield what is wrong between its table and a device, each with its path in that table."""
        yield from ()


def not_known(end: End, what: str) -> UnsupportedError:
    """Return the error of a function of ends that none is registered for."""
    return UnsupportedError(f"{what} is not available for a coupling to a {end.kind}", key=end.kind)


@dataclass(frozen=True)
class Wall(End):
    """A damper and a spring that the device's own loop renders, with the detents in front of them."""

    kind: ClassVar[str] = "wall"
    in_scenes: ClassVar[bool] = True

    damping_ns_per_m: float
    stiffness_n_per_m: float
    detent: Detent | None = None


@dataclass(frozen=True)
class IntervalOf:
    """Validator of a number, or of [lowest, highest]; both become a pair."""

    one: q.Quantity
    unbounded: bool = False

    @property
    def allowed(self) -> str:
        """Return the allowed values."""
        return f"{self.one.allowed}, or [lowest, highest]"

    def __call__(self, value: Any) -> Interval:
        """Return the pair, or refuse it."""
        ends = value if isinstance(value, list | tuple) else (value, value)
        if len(ends) != 2:
            raise t.refusal(f"is {t.shown(value)}; allowed: a number, or a range [lowest, highest]")
        low, high = (self.one.highest if self.unbounded and end == math.inf else self.one(end) for end in ends)
        return q.ordered((low, high))


_Masses = Annotated[
    Interval, BeforeValidator(IntervalOf(q.Quantity("kg", LIGHTEST_TOOL_KG, HEAVIEST_TOOL_KG, zero=False)))
]
Dampings = Annotated[Interval, BeforeValidator(IntervalOf(q.Quantity("N.s/m", 1e-9, q.LARGEST_DAMPING_NS_PER_M)))]
Contacts = Annotated[Interval, BeforeValidator(IntervalOf(q.Quantity("N/m", 1e-9, RIGID_N_PER_M), unbounded=True))]
_Steps = Annotated[Interval, BeforeValidator(IntervalOf(q.Quantity("s", 1e-7, LONGEST_STEP_S, zero=False)))]
Scale = Annotated[float, BeforeValidator(q.Quantity("", 1e-6, 1e6, zero=False))]
_Late = Annotated[int, BeforeValidator(q.Whole(0, 8))]
_Substeps = Annotated[int, BeforeValidator(q.Whole(1, 64))]


class Simulation(t.Table, End):
    """The table [simulation]: a tool that an engine moves, joined to the device by a spring K and a damper B."""

    kind: ClassVar[str] = "simulation"
    required: ClassVar[str] = "a table with step_s, and tool_mass_kg where the engine moves a tool"
    in_scenes: ClassVar[bool] = True

    # Every T the device holds -(K (x - x_s) + B (v - v_s)), s the newest data of the tool, and every step the engine
    # moves the tool by K (x - x_t) + B (v - v_t), x the newest sample of the device.
    tool_mass_kg: _Masses | None = None
    step_s: _Steps
    tool_damping_ns_per_m: Dampings = (0.0, 0.0)
    integrator: ToolIntegrator = "semi-implicit"
    substeps: _Substeps = 1
    exchange: Exchange = "on-time"
    steps_late: _Late = 0
    clock: Clock = "own"
    contact_stiffness_n_per_m: Contacts = (0.0, RIGID_N_PER_M)
    contact_damping_ns_per_m: Dampings | None = None
    position_scale: Scale = 1.0
    force_scale: Scale = 1.0
    stiffness_n_per_m: q.Stiffness | None = None

    @property
    def scale(self) -> float:
        """Ratio of mass, damping or stiffness at the device to that of the scene."""
        return self.position_scale * self.force_scale

    @property
    def queued(self) -> int:
        """Number of engine steps for which its outputs are queued."""
        return self.steps_late + (self.exchange == "late")

    @property
    def solved(self) -> Literal["nothing", "damper", "spring and damper"]:
        """What of the coupling the engine's integrator solves for its new state, and no force on the tool may hold."""
        if self.tool_mass_kg is None or not self.integrator.startswith("implicit"):
            return "nothing"
        return "damper" if self.integrator == "implicit-damping" else "spring and damper"

    def implicit_part(self, stiffness: Any, damping: Any) -> tuple[Any, Any]:
        """Return what of K and B each internal step solves anew; the force of the rest is held over all of them."""
        solved = self.solved
        return stiffness * (solved == "spring and damper"), damping * (solved != "nothing")

    @property
    def damped_locally(self) -> bool:
        """Whether a damper of the device's local loop belongs to the coupling."""
        # A held force is a step late; a state ahead of its force takes K (N + 1) T/2 from a released device's damping.
        ahead = self.exchange == "ahead" and self.integrator != "implicit" and self.tool_mass_kg is not None
        return self.exchange == "held-force" or ahead

    @property
    def rigid(self) -> bool:
        """Whether its contact may be rigid."""
        return self.contact_stiffness_n_per_m[1] >= RIGID_N_PER_M

    @property
    def stiffest_contact_n_per_m(self) -> float:
        """The stiffest contact that it declares, in the device's units; 0 where that is rigid."""
        return 0.0 if self.rigid else self.scale * self.contact_stiffness_n_per_m[1]

    @property
    def constraint(self) -> bool:
        """Whether its contact is a constraint: the tool is free or stands still, as no stiffness is declared."""
        return self.contact_stiffness_n_per_m[0] in (0.0, RIGID_N_PER_M) and self.rigid

    def document(self) -> dict[str, Any]:
        """Return its values; substeps and a clock, which older files do not have, only where they are no default."""
        defaults = {key for key in ("substeps", "clock") if getattr(self, key) == type(self).model_fields[key].default}
        return self.model_dump(mode="json", exclude=defaults)

    def keys_with_step(self, step_s: Interval, sample_time_s: float) -> dict[str, Any]:
        """Return its keys with another step: on a clock of its own, where the device's loop cannot start that."""
        return {"step_s": step_s, "clock": self.clock if _all_whole(step_s, sample_time_s) else "own"}

    def faults_beside(self, device: Device) -> Iterator[t.Finding]:
        """Yield a step that is shorter than a sample of the device, or that the device's loop cannot start."""
        shortest, longest = self.step_s
        stated = t.shown(shortest if shortest == longest else self.step_s)
        if shortest < device.sample_time_s * (1 - _ROUNDING):
            yield ("step_s",), f"is {stated}; {at_least_a_sample(device)}"
        elif self.clock == "device" and not _all_whole(self.step_s, device.sample_time_s):
            whole = f"a whole number of device.sample_time_s = {t.shown(device.sample_time_s)}"
            yield (
                ("step_s",),
                f'is {stated}; allowed: {whole}, as clock = "device"; leave clock out for any step',
            )


def _all_whole(step_s: Interval, sample_time_s: float) -> bool:
    """Return whether the shortest and the longest step of a range last a whole number of samples."""
    return all(whole_samples(end_s, sample_time_s) for end_s in step_s)


def whole_samples(step_s: float, sample_time_s: float) -> int:
    """Return how many samples a step lasts; 0 where that is no whole number."""
    ratio = step_s / sample_time_s
    return round(ratio) if math.isclose(ratio, round(ratio), rel_tol=_SAME_NUMBER) else 0


@dataclass(frozen=True)
class ToolGains:
    """K, B and the damper of each local loop towards ground, in the device's units of position and force."""

    stiffness_n_per_m: float
    damping_ns_per_m: float
    local_damping_ns_per_m: float = 0.0

    # Actual over commanded force of device and follower; no field, so that documents of gains have three keys.
    motors = (1.0, 1.0)

    def times(self, factor: float, motor: int | None = None) -> ToolGains:
        """Return K and B multiplied by a factor; or as they are, with the force of one motor (0, 1) multiplied."""
        stiffness, damping = self.stiffness_n_per_m, self.damping_ns_per_m
        if motor is None:
            return replace(self, stiffness_n_per_m=factor * stiffness, damping_ns_per_m=factor * damping)
        first, second = self.motors
        motors = (first, factor * second) if motor else (factor * first, second)
        return _OnMotors(stiffness, damping, self.local_damping_ns_per_m, motors)

    def at_scale(self, factor: float) -> ToolGains:
        """Return K, B and the local damper multiplied by a factor, in the remote end's units."""
        return replace(self.times(factor), local_damping_ns_per_m=factor * self.local_damping_ns_per_m)


@dataclass(frozen=True)
class _OnMotors(ToolGains):
    motors: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True)
class ToolState:
    """A virtual tool with all values set, in the device's units of position and force."""

    mass_kg: float
    damping_ns_per_m: float
    contact_stiffness_n_per_m: float
    contact_damping_ns_per_m: float

    @property
    def fixed(self) -> bool:
        """Whether the tool is fixed."""
        return math.isinf(self.mass_kg) or math.isinf(self.contact_stiffness_n_per_m)


def tool_states(tool: Simulation, contact_stiffness_n_per_m: float) -> list[ToolState]:
    """Return the corners of a tool's mass and dampers in a contact of the scene, N/m, in the device's units.

    A tool without mass is fixed. Light ones come first.
    """
    if tool.tool_mass_kg is None:
        return [ToolState(math.inf, 0.0, math.inf, 0.0)]
    dampers: list[float | None] = [None]
    if tool.contact_damping_ns_per_m is not None:
        dampers = [*sorted(set(tool.contact_damping_ns_per_m))]
    corners = (
        tool_at(tool, mass, damping, contact_stiffness_n_per_m, damper)
        for mass in sorted(set(tool.tool_mass_kg))
        for damping in sorted(set(tool.tool_damping_ns_per_m))
        for damper in dampers
    )
    return list(dict.fromkeys(corners))


def tool_at(
    tool: Simulation,
    mass_kg: float,
    damping_ns_per_m: float,
    contact_stiffness_n_per_m: float,
    contact_damping_ns_per_m: float | None = None,
) -> ToolState:
    """Return a tool in contact, in the device's units; all numbers are the scene's.

    A contact without a damper of its own is damped critically, 2 sqrt(k m); a rigid one is infinite.
    """
    stiffness, damper = contact_stiffness_n_per_m, contact_damping_ns_per_m
    if stiffness >= RIGID_N_PER_M:
        stiffness = math.inf
    if stiffness == 0 or math.isinf(stiffness):
        damper = 0.0
    elif damper is None:
        damper = 2 * math.sqrt(stiffness * mass_kg)
    return ToolState(*(tool.scale * value for value in (mass_kg, damping_ns_per_m, stiffness, damper)))


_Row = tuple[Any, Any, Any]


def tool_step(
    integrator: ToolIntegrator, t: Any, mass: Any, drag: Any, stiffness: Any, doublings: int = 10
) -> tuple[_Row, _Row]:
    """Return the rows (by position, velocity, held force) of new position and velocity after an internal step t, s.

    The tool has mass, drag and a spring to ground; the integrator is explicit, semi-implicit, implicit or exact.
    """
    if integrator == "exact":
        return _motion(t, mass, drag / mass, stiffness / mass, doublings)
    solved = mass
    if integrator.startswith("implicit"):
        solved = mass + t * drag + (t * t * stiffness if integrator == "implicit" else 0.0)
    kept = mass if integrator.startswith("implicit") else mass - t * drag
    speed = -t * stiffness / solved, kept / solved, t / solved
    if integrator == "explicit":
        return (1.0, t, 0.0), speed
    return (1 + t * speed[0], t * speed[1], t * speed[2]), speed


def _motion(t: Any, mass: Any, drag: Any, stiffness: Any, doublings: int) -> tuple[_Row, _Row]:
    """Return the rows of new position and velocity after a step t of m x'' + d x' + k x = F, F held, exactly.

    `drag` and `stiffness` are over the mass. Taylor's series of a short step, then its double, so many times.
    """
    t = t / 2**doublings
    # After a kick: where it swings, how fast, and the way under it, by Taylor's series; then twice the time, each time.
    swing = t
    rate = 1.0
    way = t * t / 2
    before, term = 0.0, t
    for order in range(1, 18):
        before, term = term, -(drag * t * order * term + stiffness * t * t * before) / (order * (order + 1))
        swing = swing + term
        rate = rate + (order + 1) * term / t
        way = way + t * term / (order + 2)
    for _ in range(doublings):
        place = rate + drag * swing
        way, square = (place + 1) * way + swing * swing, swing * swing
        swing, rate = swing * (place + rate), rate * rate - stiffness * square
    return (rate + drag * swing, swing, way / mass), (-stiffness * swing, rate, swing / mass)


Architecture = Literal["position-position", "position-force"]
ForceSent = Literal["commanded", "measured"]

_Delays = Annotated[Interval, BeforeValidator(IntervalOf(q.Quantity("s", 1e-6, 10)))]


class Follower(Device, End):
    """The table [follower]: all keys of [device], the link to it, and its environment."""

    kind: ClassVar[str] = "follower"
    beside_wall: ClassVar[bool] = True
    required: ClassVar[str] = "a table with the keys of [device] and delay_s"

    delay_s: _Delays = (0.0, 0.0)
    return_delay_s: _Delays | None = None
    jitter: q.Share = 0.0
    lost_share: q.Share = 0.0
    architecture: Architecture = "position-position"
    force: ForceSent = "commanded"
    contact_stiffness_n_per_m: Contacts = (0.0, RIGID_N_PER_M)
    # None: a tenth of the critical one; every delayed damper destabilises a stiff contact that rings undamped.
    contact_damping_ns_per_m: Dampings | None = None
    position_scale: Scale = 1.0
    force_scale: Scale = 1.0
    stiffness_n_per_m: q.Stiffness | None = None

    @property
    def scale(self) -> float:
        """Ratio of mass, damping or stiffness at the leader to that of the follower."""
        return self.position_scale * self.force_scale

    @property
    def rigid(self) -> bool:
        """Whether its environment may be rigid."""
        return self.contact_stiffness_n_per_m[1] >= RIGID_N_PER_M

    @property
    def stiffest_contact_n_per_m(self) -> float:
        """The stiffest contact that it declares, in the device's units; 0 where that is rigid."""
        return 0.0 if self.rigid else self.scale * self.contact_stiffness_n_per_m[1]

    @property
    def ways_s(self) -> tuple[Interval, Interval]:
        """Ranges of the delay to the follower and of that back."""
        return self.delay_s, self.return_delay_s or self.delay_s

    @property
    def delays_s(self) -> list[tuple[float, float]]:
        """Pairs of delays, to the follower and back: the shortest and the longest both ways."""
        forth, back = self.ways_s
        return sorted({(forth[0], back[0]), (forth[1], back[1])})

    def document(self) -> dict[str, Any]:
        """Return its values."""
        return self.model_dump(mode="json")

    def faults_beside(self, device: Device) -> Iterator[t.Finding]:
        """Yield another motion, no mass to couple, and delays of too many samples."""
        if self.motion != device.motion:
            yield ("motion",), f'is {t.shown(self.motion)}; allowed: "{device.motion}", as [device]'
        if min(self.range.mass_kg or (self.mass_kg,)) == 0:
            message = (
                "is 0, or its range begins at 0; allowed: above 0, because a follower that touches nothing needs a mass"
            )
            yield ("mass_kg",), message
        # Every pending sample is a state: long delays take minutes, then memory.
        longest = MOST_LINK_SAMPLES * min(device.sample_time_s, self.sample_time_s)
        for key in ("delay_s", "return_delay_s"):
            delay = getattr(self, key)
            if delay is not None and delay[1] > longest * (1 + _ROUNDING):
                # A coupling that stays stable over so long a link moves slowly beside it: a slower loop loses nothing.
                enough_s = delay[1] / MOST_LINK_SAMPLES
                allowed = f"allowed: at most {MOST_LINK_SAMPLES} samples, {q.plain(longest)} s"
                why = "because each delayed sample is a state of the loop"
                advice = f"judge the link with sample_time_s = {enough_s:.3g} or more of both devices"
                message = f"is {t.shown(delay)}; {allowed}, {why}; {advice}"
                yield (key,), message

    def at_leader(self) -> Device:
        """Return the follower in the leader's units of position and force."""
        keys = {key: getattr(self, key) for key in Device.model_fields if key in self.model_fields_set}
        ranges = self.range
        forces, lengths = self.force_scale, 1 / self.position_scale
        scales = {
            **dict.fromkeys(("mass_kg", "damping_ns_per_m"), self.scale),
            **dict.fromkeys(("coulomb_friction_n", "max_force_n"), forces),
            **dict.fromkeys(("encoder_resolution_m", "position_noise_rms_m", "backlash_m"), lengths),
        }
        for key, factor in scales.items():
            if (value := getattr(self, key)) is not None:
                keys[key] = factor * value
        known = {
            key: tuple(factor * end for end in ends)
            for key, factor in scales.items()
            if (ends := getattr(ranges, key)) is not None
        }
        keys["range"] = ranges.model_copy(update=known)
        return Device.model_validate(keys)


def mujoco_contact_n_per_m(mass_kg: float, load_n: float) -> float:
    """Return load over depth, N/m, of a static contact with MuJoCo's own solref and solimp, for a tool of a mass.

    The depth d solves load = m (i/(0.95 x 0.02))^2 d/(1 - i), i the impedance at d.
    """
    low, high = 0.0, 1.0
    for _ in range(100):
        depth = 0.5 * (low + high)
        share = min(depth / 1e-3, 1.0)
        impedance = 0.9 + 0.05 * (2 * share**2 if share <= 0.5 else 1 - 2 * (1 - share) ** 2)
        force = mass_kg * (impedance / (0.95 * 0.02)) ** 2 * depth / (1 - impedance)
        low, high = (depth, high) if force < load_n else (low, depth)
    return load_n / high
