"""Level L5: linear stability with the worst hand found in the ranges, without friction, at every corner of the device.

A search, not a proof: corners, draws and ascent; where the device has ranges, inside these too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.level_claims import (
    DelayTooLong,
    HandsClaim,
    NotJudged,
    ObserverClaim,
    UnstableBehindObserver,
    UnstableRows,
)
from avc_casadi.claims.level_detail import HandsDetail
from avc_casadi.claims.levels import LevelResult, RowMargins, Rows, Subject, level_result, unjudged
from avc_casadi.claims.worst_frequency import worst_margin
from avc_casadi.coupling import Coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import DRAWS, RADIUS_TOLERANCE, PlantFamily, WorstCase, plants_of
from avc_casadi.loops.search import ascend
from avc_casadi.loops.wall import (
    MAX_DELAY_SAMPLES,
    SampledLoop,
    closed,
    frozen_law,
    law_at_rest,
    linear_stability,
)
from avc_casadi.model.corners import linear_values
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand, hand_corners, hand_ranges
from avc_casadi.model.law import Law, Values
from avc_casadi.model.plant import SampledPlant
from avc_casadi.model.problem import Problem

# Of hands from which a search ascends for each row, and how far apart they lie, as a share of the box.
_STARTS = 4
_APART = 0.6
# Rows that the corners of the device do not refute, the worst ones, are searched inside its ranges.
_SEARCHED_ROWS = 4
# With less of the innovation or the force than this the hand alone decides.
_LEAST_SHARE = 0.01
_HAND = tuple(item.name for item in fields(Hand))


def worst_case_over_hands(
    family: PlantFamily, law: Law, *, draws: int = DRAWS, seed: int = 0, progress: Progress = SILENT
) -> list[WorstCase]:
    """Search for the worst hand of each of n laws at each corner of the device, and inside its ranges.

    A search at a corner ends where it refutes a law; of the worst law it goes on to the end.
    """
    first = family.drawn(draws, seed).held
    at_corners = [
        worst_on_device(family, device, law, first, enough=1.0, progress=progress) for device in family.devices
    ]
    worst = [max(cases, key=_radius) for cases in zip(*at_corners, strict=True)]
    if not worst:
        return worst
    refuted = max(range(len(worst)), key=lambda row: worst[row].radius)
    if worst[refuted].radius >= 1.0:
        worst[refuted] = worst_on_device(family, worst[refuted].device, law.pick([refuted]), first)[0]
    if not family.device_ranges or family.device.mass_kg + family.hand_ranges.mass_kg[1] == 0:
        return worst
    held = [row for row in range(len(worst)) if worst[row].radius < 1.0]
    for row in sorted(held, key=lambda row: -worst[row].radius)[:_SEARCHED_ROWS]:
        worst[row] = max(worst[row], family.worst_case(_leading_pole(law.pick(row))), key=_radius)
    return worst


def _radius(case: WorstCase) -> float:
    return case.radius


def _leading_pole(law: Law) -> Any:
    """Return the measure of a family: the leading pole of each loop of a law."""

    def measure(plant: SampledPlant, _: object) -> ComplexArray:
        return closed(Body.of(plant).flat(), law).leading

    return measure


def worst_on_device(
    family: PlantFamily, device: Device, law: Law, first: Hand, *, enough: float = np.inf, progress: Progress = SILENT
) -> list[WorstCase]:
    """Search the hands' ranges on one device for the largest spectral radius of each of n laws.

    Args:
        family: its ranges of hands are searched.
        device: without ranges.
        law: n laws.
        first: hands that are tried first; searches ascend from the worst ones of these.
        enough: radius from which on a law is refuted, and its search ends.
        progress: reported over the hands that are tried first.
    """
    # A constant coupling repeats one row.
    (count,) = law.shape
    numbers = (law.a, law.b, law.c, law.d)
    rows = np.concatenate([part.reshape(count, part.shape[1] * part.shape[2]) for part in numbers], axis=1)
    _, distinct, distinct_row = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    law = law.pick(distinct)
    tried = linear_stability(device, law, first, progress).pole
    places = np.array([first.mass_kg, first.damping_ns_per_m, first.stiffness_n_per_m])
    worst = np.abs(tried).argmax(axis=1)
    pole = tried[np.arange(len(distinct)), worst]
    place = places[:, worst]
    low, high = hand_ranges(family.hand_ranges).T[..., None]
    going = np.isfinite(pole) & (np.abs(pole) < enough) & (high > low).any()
    # The released device lies outside the ranges and is no initial guess.
    inside = ((places >= low) & (places <= high)).all(axis=0)
    shares = (places - low) / np.where(high > low, high - low, 1.0)
    starts = _worst_apart(np.where(inside, np.abs(tried), -np.inf), shares)
    _ascend_over_hands(
        device, law, (low, high), np.clip(shares, 0.0, 1.0)[:, starts], np.flatnonzero(going), (pole, place)
    )
    return [
        WorstCase(complex(pole[row]), device, dict(zip(_HAND, place[:, row].tolist(), strict=True)))
        for row in distinct_row.ravel()
    ]


def _ascend_over_hands(
    device: Device,
    law: Law,
    box: tuple[FloatArray, FloatArray],
    starts: FloatArray,
    going: IndexArray,
    worst: tuple[ComplexArray, FloatArray],
) -> None:
    """Ascend the spectral radius of rows of a law over hands, and write what is worse into `worst`.

    Args:
        device: the device.
        law: the laws of n rows.
        box: least and largest mass, damping and stiffness of the hands, (3, n, 1) each.
        starts: shares of the box at which ascents begin, (3, n, starts).
        going: rows that are searched.
        worst: leading pole and hand of each row, (n,) and (3, n).
    """
    low, high = box
    pole, place = worst

    def leading(rows: IndexArray, shares: FloatArray) -> ComplexArray:
        body = Body.of(plants_of([device], Hand(*(low + (high - low) * shares)))).flat()
        return closed(body, law.pick(rows)).leading

    count = starts.shape[2]
    at_once = max(1, 2_000_000 // (9 * count * (4 + math.ceil(device.delay_samples)) ** 2))
    for begin in range(0, len(going), at_once):
        rows = going[begin : begin + at_once]
        ends, values = ascend(leading, np.repeat(rows, count), starts[:, rows].reshape(len(low), -1))
        winner = np.abs(values).reshape(-1, count).argmax(axis=1) + np.arange(len(rows)) * count
        worse = np.abs(values[winner]) > np.abs(pole[rows])
        rows = rows[worse]
        winner = winner[worse]
        pole[rows] = values[winner]
        place[:, rows] = low + (high - low) * ends[:, winner]


def _worst_apart(radius: FloatArray, places: FloatArray) -> IndexArray:
    """Return the numbers of the worst hands of each row that lie apart, worst first, shape (rows, starts).

    `radius` is (rows, h), `places` the h hands (3, h) as shares of the box.
    """
    distance = np.abs(places[:, :, None] - places[:, None, :]).max(axis=0)
    left = radius.copy()
    chosen = []
    for _ in range(min(_STARTS, radius.shape[1])):
        worst = left.argmax(axis=1)
        chosen.append(worst)
        left = np.where(distance[worst] < _APART, -np.inf, left)
    return np.stack(chosen, axis=1)


def worst_case_behind_observer(coupling: Coupling) -> dict[str, WorstCase]:
    """Return the worst loops of a coupling with state feedback, over the ranges of hands and device.

    By claim: with every hand, released, whatever share of the innovation passes the dead zone, and whatever share of
    the force its clip leaves; of the last two the share stands among the values.
    """
    if coupling.runtime.state_feedback is None or not coupling.table.constant:
        raise UnsupportedError("state feedback is judged with constant gains only; make the gains constant")
    family = PlantFamily.of(coupling.problem)
    if family.largest_delay_samples > MAX_DELAY_SAMPLES:
        raise UnsupportedError(f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay")
    law = law_at_rest(coupling)

    def worst(side: PlantFamily, sector: str = "dead_zone", least_share: float = 1.0) -> WorstCase:
        def leading(plant: SampledPlant, values: Mapping[str, FloatArray]) -> ComplexArray:
            return closed(Body.of(plant).flat(), law.at_slopes(**{sector: values["share"]})).leading

        return side.worst_case(leading, share=(least_share, 1.0))

    held = worst(family)
    dead_zone = worst(family, "dead_zone", _LEAST_SHARE)
    clipped = [worst(side, "force_limit", _LEAST_SHARE) for side in (family, family.sides[-1])]
    # A search of more ranges may end in another maximum.
    return {
        "hands": held,
        "let-go": worst(family.sides[-1]),
        "dead-zone": max(held, dead_zone, key=_radius),
        "clip": max(held, *clipped, key=_radius),
    }


def hands_level(subject: Subject) -> LevelResult:
    """Return L5: the loop of each row is stable with every hand of the ranges, on the device as declared.

    Rows rank by spectral radius; the margin, N.s/m, is the device damping to spare at the worst one.
    """
    rows = subject.rows
    problem = subject.problem
    if subject.behind_feedback and subject.coupling is not None:
        return _feedback_level(rows, worst_case_behind_observer(subject.coupling))
    family = PlantFamily.of(problem)
    if family.largest_delay_samples > MAX_DELAY_SAMPLES:
        return unjudged(rows, "L5", "sampled-data", NotJudged(DelayTooLong(MAX_DELAY_SAMPLES)))
    law = frozen_law(problem, rows.b, rows.k, rows.contact)
    held = worst_case_over_hands(family, law, draws=subject.draws, seed=subject.seed, progress=subject.progress)
    released = worst_case_over_hands(family.released, law, draws=0)
    claim = HandsClaim(len(hand_corners(problem.hands)), subject.draws, subject.seed)
    radius = np.array([case.radius for case in held])
    # Rows rank by spectral radius; the margin in N.s/m is that of the worst one.
    margins = RowMargins(
        passed=np.array([case.stable for case in held], dtype=bool),
        margin=1.0 - radius,
        frequency_hz=np.array([case.frequency_hz for case in held]),
        tolerance=np.full(len(radius), RADIUS_TOLERANCE),
    )
    result = level_result(rows, "L5", "sampled-data", claim, margins)
    detail = _detail(subject, held, released)
    if result.row is None:
        return replace(result, detail=detail)
    number = int(np.count_nonzero(rows.present[: result.row]))
    worst = held[number]
    margin = damping_reserve(worst.device, law.pick([number]), Hand(**worst.hand))
    return replace(
        result,
        finding=claim if worst.stable else _unstable(rows, result.row, held, worst),
        margin_ns_per_m=margin,
        row_margin_ns_per_m=np.where(np.arange(len(rows.present)) == result.row, margin, np.nan),
        detail=replace(detail, worst_hand=worst.hand, worst_device=linear_values(worst.device)),
    )


def _detail(subject: Subject, held: list[WorstCase], released: list[WorstCase]) -> HandsDetail:
    """Return spectral radii with every hand and released, the hands that were tried, and the worst hand of each row."""
    rows = subject.rows
    radius = np.array([case.radius for case in held])
    return HandsDetail(
        spectral_radius=max((case.radius for case in held), default=None),
        released_spectral_radius=max((case.radius for case in released), default=None),
        released_passed=bool(released) and all(case.stable for case in released),
        hands=len(PlantFamily.of(subject.problem).corner_hands) + subject.draws,
        hands_seed=subject.seed,
        row_spectral_radius=rows.spread(radius),
        row_worst_hand={name: rows.spread(np.array([case.hand[name] for case in held])) for name in _HAND},
    )


def _unstable(rows: Rows, row: int, held: list[WorstCase], worst: WorstCase) -> UnstableRows:
    """Return why L5 is not met: how many rows are unstable or have no gains, and the worst loop."""
    return UnstableRows(
        failed=sum(not case.stable for case in held),
        rows=len(held),
        missing=len(rows.present) - len(held),
        worst_hz=float(rows.frequency_hz[row]),
        worst=worst,
    )


def _feedback_level(rows: Rows, cases: dict[str, WorstCase]) -> LevelResult:
    """Return L5 of a coupling with state feedback: all rows share the loop of its law, the worst of all cases.

    Cases are every hand, the dead zone and the clip of its force, and released.
    """
    name, worst = max(((name, cases[name]) for name in cases if name != "let-go"), key=lambda named: named[1].radius)
    released = cases["let-go"]
    finding = ObserverClaim() if worst.stable else UnstableBehindObserver(worst, clipped=name == "clip")
    count = len(rows.b)
    margins = RowMargins(
        passed=np.full(count, worst.stable),
        margin=np.full(count, 1 - worst.radius),
        frequency_hz=np.zeros(count),
        tolerance=np.full(count, RADIUS_TOLERANCE),
    )
    result = level_result(rows, "L5", "sampled-data", ObserverClaim(), margins)
    detail = HandsDetail(
        spectral_radius=worst.radius,
        released_spectral_radius=released.radius,
        released_passed=released.stable,
        hands=len(hand_corners(rows.problem.hands)),
        worst_hand=worst.hand,
        worst_share=worst.values["share"],
    )
    return replace(result, finding=finding, margin_ns_per_m=float("nan"), detail=detail)


def damping_reserve(device: Device, law: Law, hand: Hand) -> float:
    """Return the device damping to spare before the loop of a law with a hand is unstable, N.s/m, by bisection.

    It is negative where the loop is unstable: the damping that is missing; not a number where no damping helps.
    """

    def stable(shift: float) -> bool:
        damping = {"damping_ns_per_m": device.damping_ns_per_m + shift}
        radius = linear_stability(device.model_copy(update=damping), law, hand).radius
        return bool((radius < 1 - RADIUS_TOLERANCE).all())

    starts_stable = stable(0.0)
    available = device.damping_ns_per_m + hand.values(0)["damping_ns_per_m"]
    near = 0.0
    far = 1e-3 * (1.0 + available)
    sign = -1.0 if starts_stable else 1.0
    limit = available if starts_stable else 1e6
    while far < limit and stable(sign * far) == starts_stable:
        near = far
        far = 2 * far
    far = min(far, limit)
    if stable(sign * far) == starts_stable:
        return available if starts_stable else float("nan")
    while far - near > 1e-9 * (1.0 + far):
        middle = (near + far) / 2
        near, far = (middle, far) if stable(sign * middle) == starts_stable else (near, middle)
    return near if starts_stable else -far


@dataclass(frozen=True)
class ScopeSlack:
    """Slack of each row within its scope, shape (n,)."""

    slack: FloatArray
    frequency_hz: FloatArray

    @property
    def met(self) -> BoolArray:
        """Whether each row meets its scope strictly, without any tolerance."""
        return np.asarray(self.slack >= 0)


def scope_band_hz(problem: Problem, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest frequency, Hz, at which Re Z_h of each row is required, by the scope.

    all: 0 to Nyquist; band: the row's frequency over and times the factor; pointwise and hands: the frequency itself.
    """
    nyquist = 0.5 / problem.device.sample_time_s
    scope = problem.stability.scope
    factor = problem.stability.band_factor
    if scope == "all":
        return np.zeros_like(frequency_hz), np.full_like(frequency_hz, nyquist)
    if scope == "band":
        return np.asarray(frequency_hz / factor), np.minimum(frequency_hz * factor, nyquist)
    return frequency_hz, frequency_hz


def deciding_frequencies_hz(problem: Problem, frequency_hz: FloatArray) -> FloatArray | None:
    """Return frequencies at which Re Z_h >= margin implies the whole scope, shape (n, m); None if none are known."""
    scope = problem.stability.scope
    if scope == "pointwise":
        return frequency_hz[:, None]
    if scope == "hands" or problem.stability.model == "paper" or problem.device.delay_samples:
        return None
    low, high = scope_band_hz(problem, frequency_hz)
    return high[:, None] if scope == "all" else np.stack([low, high], axis=1)


def scope_slack(
    problem: Problem,
    frequency_hz: Values,
    damping_ns_per_m: Values,
    stiffness_n_per_m: Values,
    contact_damping_ns_per_m: Values = 0.0,
) -> ScopeSlack:
    """Return the slack of rows of gains in the scope of a problem, and the frequency, Hz, of the least one.

    It is the least Re Z_h less the margin, N.s/m, over the row's band; with scope hands it is 1 - spectral radius with
    the worst hand, on a device with the margin less damping.
    """
    given = (frequency_hz, damping_ns_per_m, stiffness_n_per_m, contact_damping_ns_per_m)
    hz, b, k, contact = (
        np.ravel(value) for value in np.broadcast_arrays(*(np.asarray(values, dtype=np.float64) for values in given))
    )
    margin = problem.stability.margin_ns_per_m
    if problem.stability.scope == "hands":
        law = frozen_law(problem, b, k, contact)
        most = 1 - RADIUS_TOLERANCE
        family = PlantFamily.of(problem)
        lean = problem.device.model_copy(update={"damping_ns_per_m": problem.device.damping_ns_per_m - margin})
        worst = worst_on_device(family, lean, law, family.drawn().held, enough=most)
        radius = np.array([case.radius for case in worst])
        return ScopeSlack(most - radius, np.array([case.frequency_hz for case in worst]))
    least = worst_margin(SampledLoop.of(problem), b, k, contact, scope_band_hz(problem, hz))
    sound = least.poles_stable & (least.dc_stiffness_n_per_m >= 0)
    slack = np.where(sound, least.margin_ns_per_m - margin, -np.inf)
    return ScopeSlack(slack, least.frequency_hz)
