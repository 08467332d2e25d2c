"""Where a law is judged: a device of the range, a hand, and a slope of each piece that is not linear."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Protocol

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.plant_family import Measure as PlantMeasure
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law, Sector
from avc_casadi.model.plant import SampledPlant, sampled_plant

# Slopes below this share of the steepest are searched at 0 alone, a corner: a spring that goes to 0 creeps ever more
# slowly, which is no instability.
_LEAST_SLOPE = 0.01

Measure = Callable[[OpenLoop], FloatArray]
"""A number of each loop, largest in the worst case."""


@dataclass(frozen=True, eq=False)
class LawPoint:
    """A device without ranges in a hand, with the share of its steepest slope of each nonlinear piece, by name."""

    device: Any
    hand: Hand
    slopes: Mapping[str, float] = field(default_factory=dict)


class PointCase(Protocol):
    """What a search of a side finds."""

    @property
    def radius(self) -> float:
        """The modulus of the measure."""

    @property
    def pair(self) -> Any:
        """The device and the hand."""


class PointSide(Protocol):
    """Plants of one box of ranges: in a hand, or released."""

    @property
    def devices(self) -> Sequence[Any]:
        """The corners of the device's ranges."""

    @property
    def held(self) -> Hand:
        """The hands that are tried before a search."""

    def worst_case(self, measure: PlantMeasure) -> PointCase:
        """Return where a measure is largest."""


@dataclass(frozen=True)
class WorstPoint:
    """Where a measure is largest, and the measure there."""

    point: LawPoint
    value: float


def slopes_at(points: Sequence[LawPoint], sectors: Sequence[Sector]) -> dict[str, FloatArray]:
    """Return the slopes of sectors at points, by name, each of shape (points,)."""
    return {
        sector.name: np.array([point.slopes.get(sector.name, sector.nominal) for point in points]) for sector in sectors
    }


def law_at(law: Law, slopes: Mapping[str, FloatArray], rows: slice | IndexArray, *axes: None) -> Law:
    """Return the linear law at slopes of some rows, which stand before so many new axes; itself without sectors."""
    if not law.sectors:
        return law
    return law.at_slopes(**{sector.name: slopes[sector.name][(rows, *axes)] for sector in law.sectors})


def around(law: Law, points: Sequence[LawPoint]) -> OpenLoop:
    """Return the loops of a law at points."""
    plant = sampled_plant([point.device for point in points], [point.hand for point in points])
    return OpenLoop.around(plant, law_at(law, slopes_at(points, law.sectors), slice(None)))


def corner_points(side: PointSide, sectors: Sequence[Sector]) -> list[LawPoint]:
    """Return every corner of the device with every corner of the hands, or none, and every end of the slopes."""
    hands = [side.held.pick(slice(row, row + 1)) for row in range(len(side.held))]
    names = [sector.name for sector in sectors]
    ends = product(*((sector.least, sector.most) for sector in sectors))
    slopes: list[dict[str, float]] = [dict(zip(names, corner, strict=True)) for corner in ends]
    return [LawPoint(device, hand, slope) for device, hand, slope in product(side.devices, hands, slopes)]


def worst(law: Law, side: PointSide, measure: Measure) -> WorstPoint:
    """Return device, hand and slopes of sectors, of a side of the ranges, at which a measure of the loop is largest."""

    def of_plants(plant: SampledPlant, values: Mapping[str, FloatArray]) -> ComplexArray:
        return measure(OpenLoop.around(plant, law_at(law, values, slice(None)))).astype(np.complex128)

    if not law.sectors:
        pair_case = side.worst_case(of_plants)
        return WorstPoint(LawPoint(*pair_case.pair), pair_case.radius)
    assert isinstance(side, PlantFamily)  # noqa: S101 - no other family has laws with sectors
    case = side.worst_case(
        of_plants, **{sector.name: (max(sector.least, _LEAST_SLOPE), sector.most) for sector in law.sectors}
    )
    return WorstPoint(LawPoint(*case.pair, case.values), case.radius)


def radius(loop: OpenLoop) -> FloatArray:
    """Return the spectral radius of each loop."""
    return loop.closed.radius
