"""The plants that a law must hold: a device and hands of declared ranges, at the corners of these and inside.

`PlantFamily.of(problem)` is what every claim about "every hand" quantifies over. It knows the corners, the released
device, the boxes of values that are searched, and the worst case of any measure of a loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.loops.search import Box, Ranges, worst_point
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges, device_with, devices_with
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_corners, hand_ranges, hand_set, with_released
from avc_casadi.model.perturbed import perturbed_devices
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Hands, Problem

RADIUS_TOLERANCE = 1e-10
"""Eigenvalues of these matrices are right to about 1e-12; slower decay than this is indistinguishable from none."""

DRAWS = 24
"""Hands that are drawn within the ranges, beside their corners."""

Measure = Callable[[SampledPlant, Mapping[str, FloatArray]], ComplexArray]
"""A number of each of m loops, of largest modulus in the worst case, from m plants and the values of their ranges."""

_HAND = tuple(f"hand.{item.name}" for item in fields(Hand))


@dataclass(frozen=True)
class WorstCase:
    """Where in a family a measure of the loop is largest, as corners and a search of the ranges find it.

    Attributes:
        value: the measure there: the leading pole of the loop, or the size of something.
        device: without ranges.
        hand: its values by name, all 0 where the device is released.
        values: those of further ranges that were searched, by name.
    """

    value: complex
    device: Device
    hand: dict[str, float]
    values: dict[str, float] = field(default_factory=dict)

    @property
    def radius(self) -> float:
        """The modulus of the measure: the spectral radius of the loop."""
        return float(np.abs(self.value))

    @property
    def pair(self) -> tuple[Device, Hand]:
        """The device and the hand."""
        return self.device, Hand(**{name: np.array([value]) for name, value in self.hand.items()})

    @property
    def frequency_hz(self) -> float:
        """The frequency of a leading pole."""
        return float(np.abs(np.angle(self.value))) / (2 * math.pi * self.device.sample_time_s)

    @property
    def stable(self) -> bool:
        """Whether the loop is stable."""
        return self.radius < 1 - RADIUS_TOLERANCE


@dataclass(frozen=True, eq=False)
class PlantFamily:
    """A device with its declared ranges, the ranges of its hands, and the hands that are tried at their corners.

    Attributes:
        device: with its ranges.
        hand_ranges: the ranges that are searched, `[hands]` of a problem.
        held: the hands that are tried before a search, without the released device.
    """

    device: Device
    hand_ranges: Hands
    held: Hand

    @classmethod
    def of(cls, problem: Problem) -> PlantFamily:
        """Return the plants of a problem; those of the last problems are kept."""
        return _family_of(problem)

    @classmethod
    def between(cls, device: Device, hand_ranges: Hands) -> Self:
        """Return a device with the hands of ranges, tried at the corners of these."""
        return cls(device, hand_ranges, hand_corners(hand_ranges.model_copy(update={"let_go": False})))

    @cached_property
    def devices(self) -> list[Device]:
        """The devices at the corners of the declared ranges, each without ranges."""
        return device_corners(self.device, LINEAR_KEYS)

    @cached_property
    def hands(self) -> Hand:
        """The hands that are tried, then the released device."""
        return with_released(self.held)

    @cached_property
    def corner_hands(self) -> Hand:
        """The corners of the hands' ranges, before them the released device where they let go."""
        return hand_corners(self.hand_ranges)

    @cached_property
    def sampled(self) -> SampledPlant:
        """Each corner of the device with each hand, the last one released."""
        return sampled_plant(self.devices, self.hands)

    @cached_property
    def device_ranges(self) -> Ranges:
        """The declared ranges of the device that a linear loop depends on, by key."""
        return device_ranges(self.device, LINEAR_KEYS)

    @cached_property
    def box(self) -> Ranges:
        """The ranges of a hand, by key such as ``hand.mass_kg``, then those of the device."""
        low, high = hand_ranges(self.hand_ranges).T.tolist()
        return {**dict(zip(_HAND, zip(low, high, strict=True), strict=True)), **self.device_ranges}

    @cached_property
    def released(self) -> PlantFamily:
        """The same device without a hand."""
        released = dict.fromkeys((item.name for item in fields(Hand)), (0.0, 0.0))
        return self.between(self.device, self.hand_ranges.model_copy(update=released))

    @property
    def varies(self) -> bool:
        """Whether the ranges of the hands hold more than one hand."""
        return any(low < high for low, high in hand_ranges(self.hand_ranges).tolist())

    @property
    def sides(self) -> tuple[PlantFamily, ...]:
        """The family held, and released where the device has a mass."""
        return (self, self.released) if self.device.mass_kg else (self,)

    @property
    def largest_delay_samples(self) -> float:
        """The longest delay of a device."""
        return max(device.delay_samples for device in self.devices)

    @property
    def heaviest_kg(self) -> float:
        """The largest mass that moves."""
        return max(device.mass_kg for device in self.devices) + float(np.max(self.hands.mass_kg))

    def drawn(self, draws: int = DRAWS, seed: int = 0) -> Self:
        """Return the family with hands drawn within the ranges tried too, and released where these let go."""
        return replace(self, held=hand_set(self.hand_ranges, draws=draws, seed=seed))

    def plants(self, pairs: Sequence[tuple[Device, Hand]]) -> SampledPlant:
        """Return the plants of pairs of a device without ranges and a hand."""
        return sampled_plant([device for device, _ in pairs], [hand for _, hand in pairs])

    def worst_case(self, measure: Measure, **more: tuple[float, float]) -> WorstCase:
        """Return where in the ranges of device, hand and more a measure of the loop is largest, by a search of all.

        `measure` takes sampled plants at m points, and the values there, to complex numbers whose size counts; `more`
        names further ranges, as of a sector.
        """
        box = Box({**self.box, **more})

        def of_places(places: FloatArray) -> ComplexArray:
            values = box.values(places)
            return measure(_plants_at(self.device, values), values)

        place, value = worst_point(of_places, len(box.sides))
        values = box.values(place)
        return WorstCase(
            value=complex(value[0]),
            device=held_plant(self.device, values)[0][0],
            hand=hand_at(values, 0),
            values={name: float(values[name][0]) for name in more},
        )


# Every loop, claim and candidate of a problem asks for the same plants.
@lru_cache(maxsize=16)
def _family_of(problem: Problem) -> PlantFamily:
    return PlantFamily.between(problem.device, problem.hands)


# Every law of a problem is judged on the same perturbed plants.
@lru_cache(maxsize=4)
def perturbed_plants(problem: Problem) -> SampledPlant:
    """Return each perturbed device of a problem, which has some, with each hand, the last one released."""
    return sampled_plant(perturbed_devices(problem), PlantFamily.of(problem).hands)


def hand_at(values: Mapping[str, FloatArray], place: int) -> dict[str, float]:
    """Return one of m hands by name, from values as of `Box.values`."""
    return {key.removeprefix("hand."): float(values[key][place]) for key in _HAND}


def held_plant(device: Device, values: Mapping[str, FloatArray]) -> tuple[list[Device], SampledPlant]:
    """Return m devices of the declared ranges, each in its own hand, from values as of `Box.values`."""
    ranges = device_ranges(device, LINEAR_KEYS)
    if not ranges:
        return [device] * len(values[_HAND[0]]), _plants_at(device, values)
    return devices_with(device, {key: values[key] for key in ranges}), _plants_at(device, values)


def _plants_at(device: Device, values: Mapping[str, FloatArray]) -> SampledPlant:
    """Return the plants of `held_plant`: at once, as one device whose values are arrays over the hands.

    Unlike delays arrive in unlike parts of a sample: those are devices apart.
    """
    hands = [values[key] for key in _HAND]
    changed = {key: values[key] for key in device_ranges(device, LINEAR_KEYS)}
    if "delay_samples" in changed:
        devices = devices_with(device, changed)
        return sampled_plant(devices, [Hand(*row) for row in np.array(hands).T.tolist()])
    return sampled_plant(device_with(device, changed) if changed else device, Hand(*hands))


def plants_of(devices: Sequence[Device], hands: Hand) -> SampledPlant:
    """Return every device with every hand; a rigid one without any mass is of first order, another not a number.

    Without a mass b dx/dt + k x = F decays by exp(-k t/b), and a force moves it by (1 - exp(-k t/b))/k.
    """
    masses = np.array([device.mass_kg for device in devices])[:, None] + np.asarray(hands.mass_kg)
    light = np.broadcast_to(masses == 0, (len(devices), len(hands)))
    if not light.any():
        return sampled_plant(devices, hands)
    heavy = [replace(hands, mass_kg=np.where(row, 1.0, hands.mass_kg)) for row in light]
    plant = sampled_plant(devices, heavy)
    drag = np.array([device.damping_ns_per_m for device in devices])[:, None]
    late = np.array([device.delay_samples % 1 for device in devices])[:, None]
    k = np.broadcast_to(np.asarray(hands.stiffness_n_per_m, dtype=np.float64), light.shape)
    b = np.broadcast_to(drag + hands.damping_ns_per_m, light.shape)
    period_s = plant.sample_time_s
    whole = _creep(k, b, period_s)
    newest = _creep(k, b, (1 - late) * period_s)
    first = np.zeros_like(plant.matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        first[..., 0, 0] = np.exp(-k * period_s / b) if plant.matrix.shape[-1] == 2 else np.nan
        older = whole - newest  # not a number where nothing holds a body without mass
    return replace(
        plant,
        matrix=np.where(light[..., None, None], first, plant.matrix),
        new=_pushed(light, newest, plant.new),
        old=_pushed(light, older, plant.old),
    )


def _creep(k: FloatArray, b: FloatArray, time_s: float | FloatArray) -> FloatArray:
    """Return the compliance after a time of a spring and damper without mass, in m/N."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(k > 0, -np.expm1(-k * time_s / b) / k, time_s / b))


def _pushed(light: BoolArray, creep: FloatArray, heavy: FloatArray) -> FloatArray:
    """Return force columns, those of plants without mass moved by their creep; positive against +x."""
    column = np.zeros_like(heavy)
    column[..., 0] = -creep
    return np.asarray(np.where(light[..., None], column, heavy))
