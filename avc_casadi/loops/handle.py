"""The loops of a device with a force sensor: what its handle may carry, and the worst of it for any measure of a loop.

A handle is released, held by a hand, pressed against a contact by a hand, or leans on a contact alone. Its loop depends
on the sums alone: a mass, a damper and a spring to ground beyond the sensor. Each side is a box of these sums, with the
declared ranges of the device.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray, Interval
from avc_casadi.loops.contacts import Swing
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE, Measure
from avc_casadi.loops.search import Box, Ranges, ascend, everywhere, far_apart, worst_point
from avc_casadi.loops.wall import closed
from avc_casadi.model.admittance import Contact
from avc_casadi.model.driven import sampled_drive
from avc_casadi.model.hands import Hand, hand_ranges
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant
from avc_casadi.model.problem import Hands
from avc_casadi.model.sensed import SensorDevice, SensorProblem

Handle = Literal["held", "pressed", "leaning", "released"]
"""What the handle carries: a hand, a hand and a contact, a contact, nothing."""

Pair = tuple[SensorDevice, Hand]
"""A device without ranges, and the sums that its handle carries."""

_CARRIED = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
_NOTHING = ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
_SENSOR_BAND_RAD = math.pi / 4
"""Angle of a handle's swing in a sample over which a cell of masses reaches."""
_MOST_SENSOR_CELLS = 40
"""Most cells of masses: beyond, a stiff sensor before a light handle turns many times in a sample."""
_NEAR_TURNS_RAD = (-0.06, -0.02, 0.02, 0.06)
"""Angles about half turns at which cells end too."""
_ASCENTS_OF_A_LAW = 2
"""Places from which the swings of each of many laws are ascended."""
_SLOW_HZ = 2.0
"""A pole that turns more slowly is none of a swing."""
_OVERLAP = 1e-12
"""A range of sums narrower than this share is one value: it was made by rounding."""


@dataclass(frozen=True)
class WorstHandle:
    """Where in a side a measure of the loop is largest, as corners and a search of the ranges find it.

    Attributes:
        value: the measure there.
        device: without ranges.
        hand: the sums that the handle carries, by name.
    """

    value: complex
    device: SensorDevice
    hand: dict[str, float]

    @property
    def radius(self) -> float:
        """The modulus of the measure: the spectral radius of the loop."""
        return float(np.abs(self.value))

    @property
    def stable(self) -> bool:
        """Whether the loop is stable."""
        return self.radius < 1 - RADIUS_TOLERANCE

    @property
    def pair(self) -> Pair:
        """The device and the sums."""
        return self.device, Hand(**{key: np.array([value]) for key, value in self.hand.items()})


@dataclass(frozen=True, eq=False)
class HandleSide:
    """A device with its ranges, and the ranges of a hand and of a contact at its handle; all 0 where there is none."""

    handle: Handle
    device: SensorDevice
    hand: tuple[Interval, Interval, Interval]
    contact: tuple[Interval, Interval, Interval]

    @property
    def carried(self) -> Ranges:
        """The ranges of the sums, by name."""
        sums = {}
        for key, hand, contact in zip(_CARRIED, self.hand, self.contact, strict=True):
            low, high = hand[0] + contact[0], hand[1] + contact[1]
            sums[key] = (low, high if high > low * (1 + _OVERLAP) else low)
        return sums

    @cached_property
    def devices(self) -> list[SensorDevice]:
        """The devices at the corners of the declared ranges, each without ranges."""
        ends = {key: tuple(sorted(set(interval))) for key, interval in self.device.ranges.items()}
        return [self.device.with_values(**dict(zip(ends, ends_of, strict=True))) for ends_of in product(*ends.values())]

    @cached_property
    def held(self) -> Hand:
        """The corners of the sums."""
        corners = sorted(set(product(*self.carried.values())))
        return Hand(*np.array(corners, dtype=np.float64).T)

    @property
    def corner_pairs(self) -> list[Pair]:
        """Every corner of the device with every corner of the sums."""
        hands = [self.held.pick(slice(row, row + 1)) for row in range(len(self.held))]
        return list(product(self.devices, hands))

    @cached_property
    def box(self) -> Box:
        """The ranges of device, hand and contact that are searched, springs and masses in the bands of their swing.

        A handle on a spring swings by an angle between samples, and each turn of it is a band. A spring of 0 is a
        corner of its own: from the softest that counts on, springs are searched by their logarithm.
        """
        ranges = {**self.carried, **self.device.ranges}
        knots = self._sensor_knots()
        low, high = ranges["stiffness_n_per_m"]
        swing = self._swing
        soft = max(low, swing.softest_n_per_m)
        if high > 3 * soft:
            ranges["stiffness_n_per_m"] = (soft, high)
            if self._turns:
                knots["stiffness_n_per_m"] = swing.knots_n_per_m(soft, high)
        return Box(ranges, knots)

    def _sensor_knots(self) -> dict[str, FloatArray]:
        """Return masses between which the handle's swing on the sensor, sqrt(k_s/(m_s + m)) T, turns by an eighth.

        A sampled loop sees that angle modulo a turn, so that unstable masses lie in bands where it exceeds half of one.
        """
        sensor, (low, high) = self.device.force_sensor, self.carried["mass_kg"]

        def angle(mass: float) -> float:
            return math.sqrt(sensor.stiffness_n_per_m / (sensor.handle_mass_kg + mass)) * self.device.sample_time_s

        if not 0 < low < high or angle(low) < math.pi:
            return {}
        cells = min(max(math.ceil((angle(low) - angle(high)) / _SENSOR_BAND_RAD), 1), _MOST_SENSOR_CELLS)
        evenly = np.linspace(angle(low), angle(high), cells + 1)
        # About half turns and whole ones the swing looks fast or slow, and bands are narrow.
        turns = np.arange(1, math.floor(angle(low) / math.pi) + 1)[:_MOST_SENSOR_CELLS] * math.pi
        near = (turns[:, None] + np.array(_NEAR_TURNS_RAD)).ravel()
        angles = np.unique(np.append(evenly, near[(near < evenly[0]) & (near > evenly[-1])]))[::-1]
        per_mass = sensor.stiffness_n_per_m * self.device.sample_time_s**2
        masses = per_mass / angles**2 - sensor.handle_mass_kg
        masses[[0, -1]] = low, high
        return {"mass_kg": masses}

    @property
    def _turns(self) -> bool:
        """Whether a handle on the stiffest spring swings by half a turn in a sample, so that bands come again."""
        return self._swing.angle_rad(self.carried["stiffness_n_per_m"][1]) > math.pi

    @cached_property
    def _swing(self) -> Swing:
        """How the handle swings on a contact: the lightest it may be, with the least damping."""
        sensors = [device.force_sensor for device in self.devices]
        lightest = min(sensor.handle_mass_kg for sensor in sensors) + self.carried["mass_kg"][0]
        damping = min(sensor.damping_ns_per_m for sensor in sensors) + self.carried["damping_ns_per_m"][0]
        late = max(device.delay_samples for device in self.devices)
        decay = damping / (2 * lightest)
        return Swing(lightest, self.device.sample_time_s, late, decay_per_s=decay)

    def worst_case(self, measure: Measure) -> WorstHandle:
        """Return where in the ranges of sums and device a measure is largest, by a search of them all.

        A measure of several kinds is searched for the largest of each.
        """
        box = self.box

        def of_places(places: FloatArray) -> ComplexArray:
            values = box.values(places)
            return measure(self._plants_at(values), values)

        place, value = worst_point(of_places, len(box.sides), box.cells)
        kind = int(np.abs(value).argmax())
        values = {key: float(of_kinds[kind]) for key, of_kinds in box.values(place).items()}
        searched = WorstHandle(
            value=complex(value[kind]),
            device=self._device_at(values),
            hand={key: values[key] for key in _CARRIED},
        )
        corners = self.corner_pairs
        at_corners = np.abs(np.atleast_2d(measure(plants_of(corners), {}))).max(axis=0)
        worst = int(at_corners.argmax())
        if at_corners[worst] < searched.radius:
            return searched
        device, hand = corners[worst]
        return WorstHandle(complex(at_corners[worst]), device, hand.values(0))

    def unstable_laws(self, laws: Law) -> list[tuple[int, Pair]]:
        """Return which of n laws a search of the ranges finds unstable, by their number, with a plant of each.

        All laws are judged at the same places of the box; swings that are stable there are ascended from the worst.
        """
        box, period_s = self.box, self.device.sample_time_s

        def leading(rows: IndexArray | tuple[slice, None], places: FloatArray) -> ComplexArray:
            body = Body.of(self._plants_at(box.values(places))).flat()
            return _leading_of_kinds(closed(body, laws.pick(rows)).poles, period_s)

        places = everywhere(box.cells)
        poles = leading((slice(None), None), places)
        radii = np.abs(poles).max(axis=0)
        worst = {int(number): places[:, radii[number].argmax()] for number in np.flatnonzero(radii.max(axis=1) >= 1)}
        if box.sides:
            top = np.array(box.cells, dtype=np.float64)[:, None]
            apart = places / np.where(top > 1, 6.0, 1.0)
            starts = {
                number: far_apart(np.abs(swings), apart, _ASCENTS_OF_A_LAW)
                for number, swings in enumerate(poles[1])
                if number not in worst
            }
            numbers = np.repeat(list(starts), [len(columns) for columns in starts.values()]).astype(np.intp)
            columns = [column for of_law in starts.values() for column in of_law]
            if columns:
                tops, ends = ascend(lambda rows, at: leading(rows, at)[1], numbers, places[:, columns], top)
                unstable = np.flatnonzero(np.abs(ends) >= 1)
                worst |= {int(numbers[ascent]): tops[:, ascent] for ascent in unstable}
        return [(number, self._pair_at(place)) for number, place in worst.items()]

    def _pair_at(self, place: FloatArray) -> Pair:
        """Return device and sums at a place (sides,) of the box."""
        values = {key: float(value[0]) for key, value in self.box.values(place[:, None]).items()}
        return self._device_at(values), Hand(**{key: np.array([values[key]]) for key in _CARRIED})

    def _device_at(self, values: Mapping[str, float]) -> SensorDevice:
        return self.device.with_values(**{key: values[key] for key in self.device.ranges})

    def _plants_at(self, values: Mapping[str, FloatArray]) -> SampledPlant:
        """Return m plants, from values as of `Box.values`."""
        hands = [values[key] for key in _CARRIED]
        if not self.device.ranges:
            return sampled_drive([self.device], [Hand(*hands)])
        rows = range(len(hands[0]))
        devices = [self._device_at({key: float(column[row]) for key, column in values.items()}) for row in rows]
        return sampled_drive(devices, [Hand(*(column[row : row + 1] for column in hands)) for row in rows])

    def parts(self, hand: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
        """Return mass, damping and stiffness of a hand and of a contact whose sums are those of a `hand`.

        Both are as far into their ranges as the sum is into its own.
        """
        of_hand, of_contact = {}, {}
        for key, hand_ends, contact_ends in zip(_CARRIED, self.hand, self.contact, strict=True):
            low, high = self.carried[key]
            share = (hand[key] - low) / (high - low) if high > low else 0.0
            of_hand[key] = hand_ends[0] + share * (hand_ends[1] - hand_ends[0])
            of_contact[key] = contact_ends[0] + share * (contact_ends[1] - contact_ends[0])
        return of_hand, of_contact


@dataclass(frozen=True, eq=False)
class HandleFamily:
    """A device with all that its handle may carry: the plants that a law must be stable with."""

    device: SensorDevice
    sides: tuple[HandleSide, ...]

    @classmethod
    def of(cls, problem: SensorProblem) -> HandleFamily:
        """Return the plants of a problem."""
        return cls.between(problem.device, problem.hands, problem.contact)

    @classmethod
    def between(cls, device: SensorDevice, hands: Hands, contact: Contact) -> HandleFamily:
        """Return a device with hands and contacts of ranges."""
        sides = [HandleSide("held", device, _ranges_of(hands), _NOTHING)]
        if contact.touches:
            sides += cls.touching(device, hands, contact)
        return cls(device, (*sides, HandleSide("released", device, _NOTHING, _NOTHING)))

    @staticmethod
    def touching(device: SensorDevice, hands: Hands, contact: Contact) -> list[HandleSide]:
        """Return the sides with a contact: with a hand that presses the handle against it, and without."""
        touched = ((0.0, 0.0), contact.damping_ns_per_m, contact.stiffness_n_per_m)
        pressed = HandleSide("pressed", device, _ranges_of(hands), touched)
        return [pressed, HandleSide("leaning", device, _NOTHING, touched)]

    def plants(self, pairs: Sequence[Pair]) -> SampledPlant:
        """Return the plants of pairs."""
        return plants_of(pairs)


def leading_poles(law: Law) -> Measure:
    """Return the leading poles of loops: of all, and of those that swing.

    A slow pole near 1, of a handle that creeps, would hide narrow bands in which another one grows.
    """

    def of_plants(plant: SampledPlant, _: object) -> ComplexArray:
        return _leading_of_kinds(closed(Body.of(plant).flat(), law).poles, plant.sample_time_s)

    return of_plants


def _leading_of_kinds(poles: ComplexArray, sample_time_s: float) -> ComplexArray:
    """Return of poles (..., s) the leading one of all, and of those that swing or are unstable, shape (2, ...)."""
    slow = np.abs(np.angle(poles)) < 2 * math.pi * _SLOW_HZ * sample_time_s
    kinds = np.stack([poles, np.where(slow & (np.abs(poles) < 1), 0.5 * poles, poles)])
    largest = np.abs(kinds).argmax(axis=-1)[..., None]
    return np.asarray(np.take_along_axis(kinds, largest, axis=-1)[..., 0])


def _ranges_of(hands: Hands) -> tuple[Interval, Interval, Interval]:
    mass, damping, stiffness = ((low, high) for low, high in hand_ranges(hands).tolist())
    return mass, damping, stiffness


def plants_of(pairs: Sequence[Pair]) -> SampledPlant:
    """Return the plants of pairs of a device and what its handle carries."""
    return sampled_drive([device for device, _ in pairs], [hand for _, hand in pairs])
