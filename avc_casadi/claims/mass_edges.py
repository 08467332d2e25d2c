"""The edges of the masses that are stable and sound over the damping, each point and each line between confirmed.

A scan at the corners of the ranges finds the masses at each damping. Searches then judge the laws that are drawn: what
refuses one of them counts for it and its neighbours, whose ends are found anew. A line between two dampings need not
lie inside an edge that bends: laws on it are judged too, and where one is refused, the edge is drawn as a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.claims.admittance import HandleAnalysis
from avc_casadi.claims.mass_spans import JudgedLaws, MassSpans, Spans, VelocityResponse, held_spans
from avc_casadi.loops.handle import Pair, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.margins import SOUND_DISK, OpenLoop
from avc_casadi.model.admittance import VirtualImpedance
from avc_casadi.model.law import Law

# How often an end is searched that plants refuse.
_SEARCHES = 5
# An edge is drawn so far inside, as a share: a search finds a worst plant to this, and no picture shows it.
_INSIDE = 1e-3
# A disk margin at a plant of the ranges is at most two per cent too large.
_SOUND_ROUGHLY = 1.02 * SOUND_DISK
# Places between two dampings at which a line is judged, as shares of the way.
_ON_A_LINE = (0.1, 0.25, 0.5, 0.75, 0.9)
# How far a line is bent inwards, as the share at its middle of the way from a straight one to a step.
_BENDS = (0.0, 0.1, 0.3, 1.0)
# What stands for the bend of a step, of one set back inwards, and of a line that is not drawn.
_STEP = 2.0
_SET_BACK = 3.0
_NOT_DRAWN = 4.0
_SET_BACK_BY = 1.1
"""Factor by which a step is set back: an edge may peak between two dampings of about the same masses."""
_NEAR_A_STEP = 0.02
"""How near to a damping a step is, as a share of the way."""
# Where a scan met no end, a line leads to so many times its last mass.
_BEYOND = 3.0
# The least damping is bisected to this share of the way between two dampings of the region.
_DAMPING_PRECISION = 1 / 256
# The masses of the region taper off to a tip at the least damping: they are scanned in so many, from those at the
# damping above, and as far beyond these by a factor.
_MASSES_OF_A_TIP = 48
_BEYOND_MASSES = 1.2


@dataclass(frozen=True, eq=False)
class Laws:
    """Masses of laws, and where their dampings lie among those of the region: 1.5 is halfway from the second on."""

    masses_kg: FloatArray
    places: FloatArray

    def pick(self, index: BoolArray | IndexArray) -> Laws:
        """Return some of them."""
        return Laws(self.masses_kg[index], self.places[index])


@dataclass(frozen=True, eq=False)
class MassEnds:
    """Places of dampings, and the ends of the masses that are stable and sound there, shape (n,)."""

    places: FloatArray
    stable: Spans
    sound: Spans


class MassEdges:
    """The ends of the region at each damping, and the least dampings, for plants that searches add to."""

    def __init__(self, analysis: HandleAnalysis, base: VirtualImpedance) -> None:
        self.analysis = analysis
        self.base = base
        self.spans = MassSpans.of(analysis, base)
        self.masses = self.spans.scales.masses_kg
        self.dampings = self.spans.scales.dampings_ns_per_m
        rows, masses = len(self.dampings), len(self.masses)
        self._searched = [side for side in analysis.family.sides if side.handle != "released"]
        self._everywhere: list[VelocityResponse] = []
        self._nearby: list[Pair] = []
        self._nearby_at = np.zeros(0)
        self._held = JudgedLaws(np.ones((rows, masses), dtype=bool), np.ones((rows, masses), dtype=bool))
        self._count_everywhere(self.spans.response)

    def span(self, rows: IndexArray, *, sound: bool) -> Spans:
        """Return the masses that hold at some of the dampings, as the plants so far show it."""

        def holds(masses: FloatArray, chosen: IndexArray) -> BoolArray:
            judged = self._judged(Laws(masses, rows[chosen].astype(np.float64)))
            return judged.sound if sound else judged.stable

        held = self._held.sound if sound else self._held.stable
        spans = held_spans(held[rows], holds, self.masses)
        low, high = spans.low * (1 + _INSIDE), spans.high / (1 + _INSIDE)
        # What is narrower than that is no span that is drawn.
        known = low <= high
        return Spans(np.where(known, low, math.nan), np.where(known, high, math.nan))

    def confirm_sound(self, row: int) -> None:
        """Search the ranges at the ends of the sound masses of a damping, until no plant refuses them."""
        rows = np.array([row])
        for low in (True, False):
            for _ in range(_SEARCHES):
                span = self.span(rows, sound=True)
                mass = float((span.low if low else span.high)[0])
                if math.isnan(mass) or not self._refused(mass, float(self.dampings[row]), sound=True):
                    break

    def least_damping(self, *, sound: bool) -> float:
        """Return the least damping with a mass, which searches confirm; not a number without any."""
        least = math.nan
        for _ in range(_SEARCHES):
            law = self._least_damped(sound=sound)
            if law is None:
                return math.nan
            mass, least = law
            if not self._refused(mass, least, sound=sound):
                break
        return least

    def settle(self) -> None:
        """Judge the laws at all ends by searches; plants that refuse one count for its damping and the neighbours."""
        rows = np.arange(len(self.dampings))
        for _ in range(_SEARCHES):
            refusing = self._search(self._at_ends(rows))
            if not refusing:
                return
            self._count_nearby(refusing)
            places = np.array([place for place, _ in refusing])
            rows = np.flatnonzero(np.abs(np.arange(len(self.dampings))[:, None] - places).min(axis=1) <= 1)
        # What no search has confirmed is not drawn.
        open_places = {round(place) for place, _ in self._search(self._at_ends(rows))}
        self._held.stable[list(open_places)] = self._held.sound[list(open_places)] = False

    def edges(self) -> MassEnds:
        """Return the ends at every damping, and between two of them those of a line that is confirmed."""
        rows = np.arange(len(self.dampings))
        ends = np.array([[span.low, span.high] for span in (self.span(rows, sound=False), self.span(rows, sound=True))])
        lines = _Lines(ends, self.masses, np.zeros(ends[..., 1:].shape))
        refused = np.ones(lines.bends.shape, dtype=bool)
        for bend in (*_BENDS, _STEP, _SET_BACK):
            lines.bends[refused] = bend
            refused = self._refused_between(lines.laws(_ON_A_LINE), refused)
        lines.bends[refused] = _NOT_DRAWN
        places, drawn = lines.drawn()
        return MassEnds(places, Spans(*drawn[0]), Spans(*drawn[1]))

    def dampings_at(self, places: FloatArray) -> FloatArray:
        """Return the dampings at places."""
        return np.asarray(np.exp(np.interp(places, np.arange(len(self.dampings)), np.log(self.dampings))))

    def _laws(self, laws: Laws) -> Law:
        return self.spans.laws(laws.masses_kg, self.dampings_at(laws.places))

    def _at_ends(self, rows: IndexArray) -> Laws:
        """Return the laws at the ends of the masses of some dampings; where the scan met no end, its last one."""
        spans = [self.span(rows, sound=sound) for sound in (False, True)]
        masses = np.concatenate([end for span in spans for end in (span.low, span.high)])
        laws = Laws(np.clip(masses, self.masses[0], self.masses[-1]), np.tile(rows.astype(np.float64), 4))
        laws = laws.pick(np.isfinite(laws.masses_kg))
        _, different = np.unique(np.stack([laws.masses_kg, laws.places]), axis=1, return_index=True)
        return laws.pick(different)

    def _search(self, laws: Laws) -> list[tuple[float, Pair]]:
        """Return places of laws that searches of the ranges find unstable, with a plant of each."""
        state_spaces = self._laws(laws)
        return [
            (float(laws.places[number]), pair)
            for side in self._searched
            for number, pair in side.unstable_laws(state_spaces)
        ]

    def _judged(self, laws: Laws) -> JudgedLaws:
        """Return which laws hold with the plants so far: all that count everywhere, and those of places nearby."""
        state_spaces = self._laws(laws)
        stable, sound = np.ones(len(laws.places), dtype=bool), np.ones(len(laws.places), dtype=bool)
        for response in self._everywhere:
            judged = response.judged(state_spaces)
            stable, sound = stable & judged.stable, sound & judged.sound
        if self._nearby:
            judged = self._judged_nearby(state_spaces, laws.places)
            stable, sound = stable & judged.stable, sound & judged.sound
        return JudgedLaws(stable, sound)

    def _judged_nearby(self, law: Law, places: FloatArray) -> JudgedLaws:
        """Return which laws hold with the plants of places nearby."""
        laws, plants = np.nonzero(np.abs(places[:, None] - self._nearby_at) <= 1)
        stable, sound = np.ones(len(places), dtype=bool), np.ones(len(places), dtype=bool)
        if not laws.size:
            return JudgedLaws(stable, sound)
        loops = OpenLoop.of_bodies(self._nearby_bodies.axes(plants), law.pick(laws))
        inside = loops.closed.radius < 1
        np.logical_and.at(stable, laws, inside)
        np.logical_and.at(sound, laws, inside & (loops.swings() <= 2 / _SOUND_ROUGHLY))
        return JudgedLaws(stable, sound)

    def _count_everywhere(self, response: VelocityResponse) -> None:
        """Let plants count at every damping."""
        self._everywhere.append(response)
        self._narrow(lambda laws: response.judged(self._laws(laws)))

    def _count_nearby(self, refusing: Sequence[tuple[float, Pair]]) -> None:
        """Let plants that refuse laws count for dampings nearby."""
        self._nearby += [pair for _, pair in refusing]
        self._nearby_at = np.append(self._nearby_at, [place for place, _ in refusing])
        self._nearby_bodies = Body.of(plants_of(self._nearby)).flat()
        self._narrow(lambda laws: self._judged_nearby(self._laws(laws), laws.places))

    def _narrow(self, judge: Callable[[Laws], JudgedLaws]) -> None:
        """Judge the masses of the scan that hold so far."""
        rows, columns = np.nonzero(self._held.stable)
        judged = judge(Laws(self.masses[columns], rows.astype(np.float64)))
        self._held.stable[rows, columns] &= judged.stable
        self._held.sound[rows, columns] &= judged.sound

    def _least_damped(self, *, sound: bool) -> tuple[float, float] | None:
        """Return mass and damping of the law of the least damping: from the first damping with a mass downwards."""
        held = self._held.sound if sound else self._held.stable
        with_mass = np.flatnonzero(held.any(axis=1))
        if not with_mass.size:
            return None
        first = int(with_mass[0])
        columns = np.flatnonzero(held[first])

        def held_masses(place: float, about: FloatArray) -> FloatArray:
            """Return the masses that hold at a place, of a scan from about the least to the largest of some masses."""
            scan = np.geomspace(about[0] / _BEYOND_MASSES, about[-1] * _BEYOND_MASSES, _MASSES_OF_A_TIP)
            scan = scan[(self.masses[0] <= scan) & (scan <= self.masses[-1])]
            judged = self._judged(Laws(scan, np.full(len(scan), place)))
            return np.asarray(scan[judged.sound if sound else judged.stable])

        place, best = float(first), self.masses[columns]
        # A tip that is narrower than the scan of the region's masses shows in the finer one.
        while place > 0 and (masses := held_masses(place - 1, best)).size:
            place, best = place - 1, masses
        other = max(place - 1, 0.0)
        while place - other > _DAMPING_PRECISION:
            middle = 0.5 * (place + other)
            masses = held_masses(middle, best)
            if masses.size:
                place, best = middle, masses
            else:
                other = middle
        return float(best[len(best) // 2]), float(self.dampings_at(np.array([place]))[0])

    def _refused(self, mass_kg: float, damping_ns_per_m: float, *, sound: bool) -> bool:
        """Return whether a search refuses a law; where the scan met no end, that of its first or last mass."""
        mass = float(np.clip(mass_kg, self.masses[0], self.masses[-1]))
        law = self.base.model_copy(update={"mass_kg": mass, "damping_ns_per_m": damping_ns_per_m})
        worse = self.analysis.refusing(law, sound=sound)
        if worse:
            self._count_everywhere(VelocityResponse(worse))
        return bool(worse)

    def _refused_between(self, laws: Laws, only: BoolArray) -> BoolArray:
        """Return which of some lines are refused, of laws (kinds, ends, lines, places on them), if any is there."""
        of_sound = np.zeros(laws.masses_kg.shape, dtype=bool)
        of_sound[1] = True
        chosen = np.isfinite(laws.masses_kg) & only[..., None]
        on_lines = laws.pick(chosen)
        judged = self._judged(on_lines)
        kept = np.where(of_sound[chosen], judged.sound, judged.stable)
        hopeful = np.flatnonzero(kept)
        state_spaces = self._laws(on_lines.pick(hopeful))
        for side in self._searched:
            kept[[hopeful[number] for number, _ in side.unstable_laws(state_spaces)]] = False
        refused = np.zeros(chosen.shape, dtype=bool)
        refused[chosen] = ~kept
        return np.asarray(refused.any(axis=-1))


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines between the ends of neighbouring dampings, in the logarithms of mass and damping.

    Attributes:
        ends: the least and the largest masses that are stable, and those that are sound, shape (2, 2, dampings).
        masses: of the scan; masses beyond its first and last stand for ends that it did not meet. Laws are judged, and
            drawn, between these two.
        bends: how far each line is bent inwards, shape (2, 2, dampings - 1): its middle lies this share of the way
            from a straight line to the larger of two least masses, or to the smaller of two largest ones.
    """

    ends: FloatArray
    masses: FloatArray
    bends: FloatArray

    def at(self, share: float) -> FloatArray:
        """Return the masses at a share of the way between two dampings, of each line."""
        logarithms = np.log(np.clip(self.ends, self.masses[0] / _BEYOND, self.masses[-1] * _BEYOND))
        before, after = logarithms[..., :-1], logarithms[..., 1:]
        inner = np.stack([np.maximum(before, after)[:, 0], np.minimum(before, after)[:, 1]], axis=1)
        middle = 0.5 * (before + after)
        middle += self.bends * (inner - middle)
        bent = before + 2 * share * (middle - before) if share <= 0.5 else middle + (2 * share - 1) * (after - middle)
        further = math.log(_SET_BACK_BY) * np.array([1.0, -1.0])[:, None] * (self.bends == _SET_BACK)
        drawn = np.exp(np.where(self.bends >= _STEP, inner + further, bent))
        start = self.ends[..., :-1]
        endless = (start == self.ends[..., 1:]) & ((start == 0) | np.isinf(start))
        return np.where(endless, start, np.clip(drawn, self.masses[0], self.masses[-1]))

    def laws(self, shares: Sequence[float]) -> Laws:
        """Return the laws on lines at shares of the way, shape (2, 2, lines, shares)."""
        masses = np.stack([self.at(share) for share in shares], axis=-1)
        places = np.arange(self.bends.shape[-1], dtype=np.float64)[:, None] + np.array(shares)
        return Laws(np.clip(masses, self.masses[0], self.masses[-1]), np.broadcast_to(places, masses.shape))

    def drawn(self) -> tuple[FloatArray, FloatArray]:
        """Return places and ends with those between two dampings where a line is bent, a step or not drawn.

        A mass that is not sound may be stable, but one that is not stable is not sound.
        """
        gap = np.logical_or.accumulate((self.bends == _NOT_DRAWN).any(axis=1), axis=0)[:, None]
        places, columns = [0.0], [self.ends[..., 0]]
        for line in range(self.bends.shape[-1]):
            bends = self.bends[..., line]
            shares = [0.5] if ((bends > 0) & (bends < _STEP)).any() else []
            shares += [_NEAR_A_STEP, 1 - _NEAR_A_STEP] if (bends >= _STEP).any() else []
            for share in sorted(shares):
                places.append(line + share)
                columns.append(np.where(gap[..., line], math.nan, self.at(share)[..., line]))
            places.append(line + 1.0)
            columns.append(self.ends[..., line + 1])
        return np.array(places), np.stack(columns, axis=-1)
