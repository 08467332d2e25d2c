"""A kind of end that the package does not know: a spring to ground on both sides, by one registered function a room.

The coupling K, B leads to a point without mass on a spring to ground, which pulls as well as it pushes.
"""

from contextlib import nullcontext
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi._errors import UnsupportedError
from avc_casadi._util.json_values import json_text
from avc_casadi.cli.ends import law_certified
from avc_casadi.coupling import Coupling
from avc_casadi.design.virtual_tool import EndSearch, Scale, ToolSearchOptions, search_of
from avc_casadi.files.coupling_file import coupling_document
from avc_casadi.loops.loop import Body, Loop, turn_of
from avc_casadi.loops.loop_family import LoopFamily, Pattern
from avc_casadi.loops.spectrum import ClosedLoops
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.ends import End, ToolGains
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Problem
from avc_casadi.present.row import Value
from avc_casadi.present.rows.subject import end_line
from avc_casadi.recommendation.recommendation import NoPair, PairRecommendation
from avc_casadi.recommendation.rendered import NominalEnd, nominal_end
from avc_casadi.simulation.population.other_ends import try_end
from avc_casadi.simulation.population.trial import Trial

SPRING_N_PER_M, GAINS = 800.0, ToolGains(300.0, 1.5)
SAMPLES = 20_000


class GroundedSpring(t.Table, End):
    """The table [spring]."""

    kind: ClassVar[str] = "spring"

    stiffness_n_per_m: q.Stiffness

    def document(self):
        return self.model_dump(mode="json")


class SpringProblem(Problem):
    """A problem with one table more."""

    spring: GroundedSpring | None = None


@dataclass(frozen=True)
class GroundedLoop:
    """A device, its position a sample ago and the point p: K (x - p) + B (x' - p') = k p, by backward differences."""

    body: Body
    spring_n_per_m: float

    @property
    def loop(self):
        return Loop(plant=self.body.size, last=1, point=1)

    def rows(self, gains):
        """Return position, new point and force, positive against +x, as rows of the state."""
        loop, per_s = self.loop, 1 / self.body.sample_time_s
        k, b = gains.stiffness_n_per_m, gains.damping_ns_per_m * per_s
        position = self.body.output_row @ loop["plant"]
        step, point = position - loop["last"][0], loop["point"][0]
        place = (k * position + b * (step + point)) / (k + b + self.spring_n_per_m)
        return position, place, self.spring_n_per_m * place + gains.local_damping_ns_per_m * per_s * step

    def closed(self, gains):
        position, place, force = self.rows(gains)
        plant = self.body.next_state(self.loop["plant"], np.broadcast_to(force, (*self.body.b.shape[:-1], len(force))))
        maps = self.loop.event(plant=plant, last=position[None], point=place[None])
        return ClosedLoops(maps, np.zeros((0, self.loop.size)))

    def force_per_metre(self, gains, frequency_hz):
        """Return k p over x: the spring in series with K + B s, s of the backward difference."""
        s = (1 - 1 / turn_of(frequency_hz, self.body.sample_time_s)) / self.body.sample_time_s
        coupling = gains.stiffness_n_per_m + gains.damping_ns_per_m * s
        return coupling * self.spring_n_per_m / (coupling + self.spring_n_per_m) + gains.local_damping_ns_per_m * s


@dataclass(frozen=True)
class SpringCase:
    """A hand of a loop."""

    hand: dict


def grounded(problem, hands):
    return GroundedLoop(Body.of(sampled_plant(problem.device, hands)).flat(), problem.end.stiffness_n_per_m)


class SpringSearch(EndSearch):
    """The search with the corners of [hands], and released."""

    def __init__(self, problem):
        self.hands = with_released(hand_corners(problem.hands))
        loop, time_s = grounded(problem, self.hands), problem.device.sample_time_s
        pattern = Pattern(loop.closed, time_s, 1, lambda row: SpringCase(self.hands.values(row)))
        self.loops = LoopFamily([pattern], [])
        options = ToolSearchOptions(dampers=9)
        super().__init__(self.loops, Scale.of(problem, time_s), options, problem.robustness.gain_margin)

    @property
    def loop_count(self):
        return len(self.hands)


# One function of a room each.


@search_of.register
def _search(end: GroundedSpring, problem):  # noqa: ARG001
    return SpringSearch(problem)


@try_end.register
def _try(end: GroundedSpring, problem, gains, people, seed, *, screen):  # noqa: ARG001
    maps = grounded(problem, people).closed(gains).maps
    state = np.zeros((len(people), maps.shape[-1], 1))
    state[:, :2] = 0.01
    rests = np.abs(np.linalg.matrix_power(maps, SAMPLES) @ state).max(axis=(1, 2)) < 1e-6
    series = 1 / (1 / gains.stiffness_n_per_m + 1 / end.stiffness_n_per_m)
    return Trial(seed, {"release": rests}, np.full(len(people), series), np.zeros(len(people)))


@nominal_end.register
def _nominal(end: GroundedSpring, problem):
    driven = Body.motion_source(problem.device.sample_time_s)
    return NominalEnd(*(GroundedLoop(driven, spring) for spring in (end.stiffness_n_per_m, 1e9)), moves=False)


@end_line.register
def _line(end: GroundedSpring):
    return "spring to ground", Value(end.stiffness_n_per_m, "stiffness")


def problem(spring_n_per_m=SPRING_N_PER_M):
    device = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "sample_time_s": 1e-3}
    return SpringProblem(name="spring", device=device, spring={"stiffness_n_per_m": spring_n_per_m})


def test_its_table_is_the_end_and_brings_no_wall():
    stated = problem()
    assert stated.end == stated.spring
    assert stated.end_table == "spring"
    assert stated.wall.stiffness_n_per_m == 0
    with pytest.raises(avc.InputError, match=r"is given with \[simulation\]"):
        stated.changed(simulation={"step_s": 0.01})


def test_without_a_function_a_room_says_what_is_not_known():
    class Nothing(End):
        kind = "nothing"

    with pytest.raises(UnsupportedError, match="nothing"):
        search_of(Nothing(), problem())


def test_it_is_recommended_printed_and_written():
    found = avc.recommend(problem(), hands=20)
    assert isinstance(found, PairRecommendation)
    assert found.deployable
    assert found.trial.all_settle
    data = found.data()
    assert data["end"] == "spring"
    k = found.coupling.gains.stiffness_n_per_m
    assert data["pair"]["loops"] == len(with_released(hand_corners(found.problem.hands)))
    # Beside the device's own impedance the slow handle meets both springs in series.
    at_rest = 1 / (1 / k + 1 / SPRING_N_PER_M)
    driven = GroundedLoop(Body.motion_source(1e-3), SPRING_N_PER_M)
    assert abs(driven.force_per_metre(found.coupling.gains, 1e-3)) == pytest.approx(at_rest, rel=1e-3)
    assert "spring to ground 800 N/m" in str(found)
    document = coupling_document(found.coupling)
    assert document["end"] == "spring"
    assert document["problem_file"]["spring"] == {"stiffness_n_per_m": SPRING_N_PER_M}
    assert json_text(data, found.problem.units)


def test_its_limit_is_that_of_a_lifted_loop():
    """Before a stiff spring all hands decay below the limit in the time domain, and above it one grows."""
    stated = problem(1e6)
    search = search_of(stated.end, stated)
    limit = search.stiffest()
    assert limit.stiffness_n_per_m > 0
    for factor, stable in ((0.95, True), (1.05, False)):
        maps = search.loops.patterns[0].closed(limit.times(factor)).maps
        grown = np.linalg.matrix_power(maps, SAMPLES) @ np.ones(maps.shape[-1])
        assert (np.abs(grown).max() < 1) == stable


def test_where_no_hand_settles_there_is_a_reason_and_no_coupling(monkeypatch):
    def unsettled(end, problem, gains, people, seed, *, screen):  # noqa: ARG001
        none = np.zeros(len(people))
        return Trial(seed, {"release": none > 0}, none, none)

    monkeypatch.setattr("avc_casadi.recommendation.pair.try_end", unsettled)
    found = avc.recommend(problem(), hands=4)
    assert isinstance(found, NoPair)
    assert (found.coupling, found.deployable) == (None, False)
    assert "release" in found.reason
    assert found.data()["pair"]["stiffest"]["stiffness_n_per_m"] == found.pair.stiffest.stiffness_n_per_m


def test_one_s_own_gains_are_certified():
    """The identifier of a coupling is of the spring too."""
    stated = problem()
    made = Coupling.to_end(stated, GAINS)
    softer = Coupling.to_end(stated.changed(spring={"stiffness_n_per_m": 400.0}), GAINS)
    assert made.end == stated.spring
    assert made.id != softer.id
    args, console = SimpleNamespace(cutoff_hz=None, problem="spring.toml"), SimpleNamespace(step=nullcontext)
    rows = law_certified(stated.end, stated, {"k": 300.0, "b": 1.5}, args, console).rows
    assert {"Deployable", "Coupling", "Stability", "Worst loop"} <= {row.label for row in rows}


def test_options_of_walls_are_refused():
    with pytest.raises(avc.InputError, match="stiffest"):
        avc.recommend(problem(), stiffest=True)
