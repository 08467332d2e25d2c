"""One walk turns results into JSON: names of fields, or the keys that a result lists; what is not finite is null."""

import json
import math
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import ClassVar

import numpy as np

from avc_casadi._util.json_values import Document, plain


class Verdict(Enum):
    """A word of a document."""

    GOOD = "good"


@dataclass(frozen=True)
class Inner:
    """A dataclass without keys of its own; what it keeps beside its fields is no part of it."""

    force_n: float
    verdict: Verdict = Verdict.GOOD

    @cached_property
    def doubled(self):
        """A value that is computed once."""
        return 2 * self.force_n


@dataclass(frozen=True)
class Outer(Document):
    """A document with a renamed key, a computed one, one that may be left out and one that may be null."""

    JSON_KEYS: ClassVar = (("pass", "passed"), "rows", "inner", "note", "limit")
    JSON_LEFT_OUT: ClassVar = frozenset({"note"})

    passed: np.bool_
    inner: tuple[Inner, ...]
    note: str | None = None
    limit: float | None = None
    table: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def rows(self):
        """Number of inner values."""
        return len(self.inner)


def test_a_document_has_the_keys_that_it_lists_in_their_order():
    inner = Inner(math.inf), Inner(np.float64(2.0))
    assert inner[1].doubled == 4.0
    document = Outer(np.bool_(True), inner, table={"x": np.zeros(2)}).document()
    assert list(document) == ["pass", "rows", "inner", "limit"]
    assert document["inner"] == [{"force_n": None, "verdict": "good"}, {"force_n": 2.0, "verdict": "good"}]
    assert document["pass"] is True
    assert document["limit"] is None
    assert json.loads(json.dumps(document, allow_nan=False)) == document


def test_a_document_inside_another_value_keeps_its_keys():
    outer = Outer(np.bool_(False), (), note="said")
    assert plain({"outer": [outer]}) == {
        "outer": [{"pass": False, "rows": 0, "inner": [], "note": "said", "limit": None}]
    }
