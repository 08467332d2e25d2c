"""Mutants are code, repeat from a seed, and a rate is judged as the numbers allow; the fence names what there is."""

import ast
import re

import pytest
from mutate import ROOT, drawn, faults


@pytest.mark.slow
def test_mutants_are_code_and_repeat_from_a_seed():
    found = list(drawn(["avc_casadi/paper"], 40, "one"))
    assert found == list(drawn(["avc_casadi/paper"], 40, "one")) != list(drawn(["avc_casadi/paper"], 40, "two"))
    for one in found:
        whole = (ROOT / one.path).read_bytes()
        broken = whole[: one.start] + one.new + whole[one.end :]
        assert ast.dump(ast.parse(broken)) != ast.dump(ast.parse(whole))


def test_a_rate_is_judged_as_the_numbers_allow():
    assert list(faults({"a": [8, 12], "b": [2, 3]}, 0.8)) == []
    assert len(list(faults({"a": [350, 500]}, 0.8))) == 2  # the room, and all rooms
    assert [told.partition(":")[0] for told in faults({"a": [350, 500], "b": [4500, 5000]}, 0.8)] == ["a"]


def test_what_the_fence_names_is_there():
    named = re.findall(r"tests/[\w/]+\.\w+", (ROOT / ".ci" / "fence").read_text(encoding="utf-8"))
    assert [name for name in named if not (ROOT / name).exists()] == [] != named
