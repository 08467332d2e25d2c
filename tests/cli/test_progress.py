"""A wait says what is done, and about how long the rest takes, by a clock that the test turns."""

from __future__ import annotations

import time

import pytest

from avc_casadi._util.progress import Stages
from avc_casadi.cli.console import Console


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
