"""A wait says what is done, and about how long the rest takes, by a clock that the test turns."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

import avc_casadi as avc
from avc_casadi._util.progress import Progress, Stages
from avc_casadi.cli.console import Console
from avc_casadi.design.pair_certificate import certify_pair
from avc_casadi.design.virtual_tool import search_of
from avc_casadi.files.coupling_file import read_coupling
from avc_casadi.model.ends import ToolGains
from avc_casadi.simulation.population.law_trial import try_law


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    turned = Clock()
    monkeypatch.setattr(time, "perf_counter", turned)
    return turned


def line(console: Console, clock: Clock) -> str:
    """What a refresh of the line prints now."""
    return console._counted(clock.now_s)


def test_before_the_first_part_is_done_a_wait_says_how_long_it_has_lasted(clock: Clock) -> None:
    console = Console(as_json=True)
    with console.step("recommend"):
        Stages(console, 4).begin("stiffest stable coupling")
        clock.now_s += 7.0
        assert line(console, clock) == "recommend ... 0 of 4 stiffest stable coupling; 7 s so far"


def test_after_it_the_rest_takes_as_long_as_the_pace_says_less_what_the_present_part_has_taken(clock: Clock) -> None:
    console = Console(as_json=True)
    with console.step("recommend"):
        stages = Stages(console, 4)
        stages.begin("one")
        clock.now_s += 6.0
        stages.begin("two")
        assert line(console, clock).endswith("1 of 4 two; about 18 s left")
        clock.now_s += 6.0
        stages.begin("three")
        assert line(console, clock).endswith("2 of 4 three; about 12 s left")
        clock.now_s += 5.0
        assert line(console, clock).endswith("2 of 4 three; about 7 s left")


def test_a_part_that_takes_longer_than_the_others_is_nearly_done_and_makes_the_pace_slower(clock: Clock) -> None:
    console = Console(as_json=True)
    with console.step("recommend"):
        stages = Stages(console, 3)
        stages.begin("one")
        clock.now_s += 6.0
        stages.begin("two")
        clock.now_s += 8.0
        assert line(console, clock).endswith("1 of 3 two; about 7 s left")
        stages.begin("three")
        clock.now_s += 30.0
        assert line(console, clock).endswith("2 of 3 three; 44 s so far")


def test_a_count_that_turns_out_longer_goes_on_and_a_new_one_begins_anew(clock: Clock) -> None:
    console = Console(as_json=True)
    with console.step("recommend"):
        stages = Stages(console, 1)
        stages.begin("one")
        clock.now_s += 5.0
        stages.begin("two")
        clock.now_s += 5.0
        stages.begin("three")
        assert line(console, clock).endswith("2 of 3 three; about 5 s left")
        console.advance(0, 100, "hands")
        clock.now_s += 4.0
        console.advance(50, 100, "hands")
        assert line(console, clock).endswith("50 of 100 hands; about 4 s left")


class Parts(Progress):
    """What is reported."""

    def __init__(self) -> None:
        self.reported: list[tuple[int, int, str]] = []

    def advance(self, done: int, total: int, part: str = "") -> None:
        self.reported.append((done, total, part))

    def counts_up_to(self, total: int) -> bool:
        """Whether each part is reported in its turn, of the same total."""
        return self.reported and [(done, of) for done, of, _ in self.reported] == [
            (number, total) for number in range(len(self.reported))
        ]


def test_each_search_of_the_ranges_of_a_pair_is_a_part_of_its_certificate() -> None:
    problem = avc.parse_problem(
        "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 1.0\ndelay_samples = 1\n"
        "[hands]\nmass_kg = [0.1, 0.2]\ndamping_ns_per_m = [1, 2]\nstiffness_n_per_m = [100, 200]\n"
        '[simulation]\nstep_s = 0.001\ntool_mass_kg = 0.1\nexchange = "held-force"\n'
    )
    search = search_of(problem.end, problem)
    parts = Parts()
    stages = Stages(parts, search.stages_of_verdict)
    gains = ToolGains(100.0, 1.0, 0.0)
    assert certify_pair(problem, gains, search, stages).stable
    assert search.fault(gains, stages) is None
    assert parts.counts_up_to(search.stages_of_verdict)
    # Gains that coincide are searched once: of the widest margin and the least ones there are more.
    assert len(parts.reported) > search.stages_of_verdict / 2


def test_each_motion_and_friction_of_a_law_is_a_part_of_its_trial() -> None:
    problem = avc.Problem(
        device={"mass_kg": 0.1, "damping_ns_per_m": 1.0, "coulomb_friction_n": 0.05},
        environment={"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0},
        law={"stiffness_n_per_m": 100.0, "damping_ns_per_m": 2.0, "integral_n_per_m_s": 100.0},
    )
    parts = Parts()
    try_law(problem, 2, progress=parts)
    assert parts.counts_up_to(10)
    first, second = (parts.reported[start : start + 5] for start in (0, 5))
    motions = ("press", "strike", "tap", "release", "long press")
    assert [part for *_, part in first] == [f"{motion}, declared friction" for motion in motions]
    assert [part for *_, part in second] == [f"{motion}, without friction" for motion in motions]


@pytest.mark.slow
def test_each_row_of_a_proof_is_a_part_of_it() -> None:
    coupling = read_coupling(Path(__file__).parents[1] / "goldens" / "couplings" / "adaptive-press-schedule.json")
    parts = Parts()
    avc.certify(coupling.problem, coupling, prove=True, progress=parts)
    rows = coupling.table.rows.shape[0]
    proved = [(done, of) for done, of, part in parts.reported if part.startswith("rows")]
    assert list(dict.fromkeys(proved)) == [(done, rows) for done in range(rows)]
    assert any("% of the next verified" in part for *_, part in parts.reported)


@pytest.mark.parametrize("velocity", [{"kind": "difference"}, {"kind": "window", "samples": 3}])
def test_limits_and_worst_cases_of_a_law_are_parts_of_its_certificate(velocity: dict[str, object]) -> None:
    problem = avc.Problem(
        device={"mass_kg": 0.1, "damping_ns_per_m": 1.0},
        environment={"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0},
        law={"stiffness_n_per_m": 100.0, "damping_ns_per_m": 2.0, "velocity": velocity},
    )
    parts = Parts()
    avc.certify_law(problem, remedies=False, progress=parts)
    # Of k, b, the window and all forces, then held and released; of a plain law each kind of them.
    assert parts.counts_up_to(6 if velocity["kind"] == "window" else 2)
    assert len(parts.reported) == parts.reported[0][1]
