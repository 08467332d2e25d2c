"""Answers on a terminal: quantities are read back within half a digit, rows align, marks and colours are as fits."""

import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avc_casadi._util.text import quantity
from avc_casadi.present.terminal import Mark, Page, Row

FACTORS = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
ROWS = [Row("Coupling", "a spring", Mark.PASS), Row("Limit", "none " * 40, Mark.FAIL), Row("Force", "8 N")]


@given(st.floats(1e-8, 1e11), st.sampled_from([1, -1]), st.integers(2, 5))
def test_a_quantity_is_read_back_within_half_of_its_last_digit(size, sign, digits):
    number, prefix = re.fullmatch(r"(-?[\d.]+) (n|u|m|k|M|G|)N/m", quantity(sign * size, "N/m", digits)).groups()
    assert float(number) * FACTORS[prefix] == pytest.approx(sign * size, rel=0.5001 * 10 ** (1 - digits))


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


def test_a_stream_that_takes_ascii_alone_gets_ascii():
    text = Page.of(Stream("ascii", terminal=False)).rendered("a · b", ROWS)
    assert text.isascii()
    assert "+ Coupling" in text
