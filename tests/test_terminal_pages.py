"""Answers on a terminal: quantities are read back within half a digit, rows align, marks and colours are as fits."""

import io
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi._util.quantity import percent, quantity
from avc_casadi.present.terminal import Mark, Page, Row

FACTORS = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
ROWS = [Row("Coupling", "a spring", Mark.PASS), Row("Limit", "none " * 40, Mark.FAIL), Row("Force", "8 N")]


@given(st.floats(1e-8, 1e11), st.sampled_from([1, -1]), st.integers(2, 5))
def test_a_quantity_is_read_back_within_half_of_its_last_digit(size, sign, digits):
    number, prefix = re.fullmatch(r"(-?[\d.]+) (n|u|m|k|M|G|)N/m", quantity(sign * size, "N/m", digits)).groups()
    assert float(number) * FACTORS[prefix] == pytest.approx(sign * size, rel=0.5001 * 10 ** (1 - digits))


@pytest.mark.parametrize(
    ("value", "unit", "told"),
    [
        (99040.0, "N/m", "99.0 kN/m"),
        (999.6, "N/m", "1.00 kN/m"),
        (0.12, "kg", "120 g"),
        (1.5, "kg", "1.50 kg"),
        (3e-5, "kg.m2", "30.0 mg.m2"),
        (0.0, "N", "0 N"),
        (-4e-13, "N.s/m", "below 0.001 nN.s/m"),
        (math.inf, "N/m", "unbounded"),
        (None, "N", "-"),
        (2.5e-5, "m", "25.0 um"),
    ],
)
def test_quantities_have_prefixes_and_three_digits(value, unit, told):
    assert quantity(value, unit) == told


def test_shares_are_percentages():
    assert [percent(share) for share in (1.0, 0.992, 0.14, 0.00027, None)] == [
        "100 %",
        "99.2 %",
        "14 %",
        "0.027 %",
        "-",
    ]


def test_of_too_many_rows_those_that_say_least_are_left_out_unless_they_are_marked():
    rows = [Row(f"row {number}", "one", Mark.CAUTION if number == 3 else Mark.NONE) for number in range(13)]
    spare = ["row 2", "row 3", "row 5", "row 7"]
    labels = [line[4:10].strip() for line in Page().rendered("what", rows, ["avc list"], spare).splitlines()[2:-2]]
    assert labels == [row.label for row in rows if row.label not in {"row 2", "row 5"}]
    assert Page().rendered("what", rows[:11], ["avc list"], spare) == Page().rendered("what", rows[:11], ["avc list"])


def test_rows_stand_below_each_other_and_long_ones_below_themselves():
    lines = Page(width=60).rendered("what", ROWS, ["avc list"]).splitlines()
    assert lines[0] == "what"
    assert max(len(line) for line in lines) <= 60
    begins = {line.index(text) for line, text in zip(lines[2:], ["a spring", "none", "none"], strict=False)}
    assert len(begins) == 1
    assert [line[2] for line in lines if line.strip() and line[2:3] in "✓✗"] == ["✓", "✗"]
    assert lines[-1] == "  next: avc list"


class Stream(io.StringIO):
    def __init__(self, encoding="utf-8", *, terminal=True):
        super().__init__()
        self._encoding, self._terminal = encoding, terminal

    encoding = property(lambda self: self._encoding)

    def isatty(self):
        return self._terminal


def test_marks_have_a_colour_on_a_terminal_alone_and_never_with_no_color(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert "\x1b[32m✓" in Page.of(Stream()).rendered("", ROWS)
    assert "\x1b" not in Page.of(Stream(terminal=False)).rendered("", ROWS)
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in Page.of(Stream()).rendered("", ROWS)


def test_a_stream_that_takes_ascii_alone_gets_ascii():
    text = Page.of(Stream("ascii", terminal=False)).rendered("a · b", ROWS)
    assert text.isascii()
    assert "+ Coupling" in text
