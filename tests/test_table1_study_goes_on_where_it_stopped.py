"""A long study keeps every finished cell, and is not mixed with another one."""

import json

import pytest
from studied import run_campaign


class Listener:
    def __init__(self):
        self.seen = []

    def advance(self, *told):
        self.seen.append(told)


def test_finished_cells_are_not_repeated(tmp_path):
    path, calls = tmp_path / "study.json", []

    def cell(name, *, fails=False):
        def compute():
            calls.append(name)
            if fails:
                raise KeyboardInterrupt
            return {"name": name}

        return compute

    with pytest.raises(KeyboardInterrupt):
        run_campaign({"a": cell("a"), "b": cell("b", fails=True), "c": cell("c")}, path, {"seed": 1})
    assert json.loads(path.read_text())["cells"] == {"a": {"name": "a"}}
    told = Listener()
    found = run_campaign({name: cell(name) for name in "abc"}, path, {"seed": 1}, told)
    assert calls == ["a", "b", "b", "c"]
    assert told.seen == [(2, 3, "b"), (3, 3, "c")]
    assert found == json.loads(path.read_text())
    assert list(found["cells"]) == ["a", "b", "c"]


def test_another_study_is_refused(tmp_path):
    path = tmp_path / "study.json"
    run_campaign({"a": lambda: {"x": 1.0}}, path, {"seed": 1})
    with pytest.raises(ValueError, match="another study"):
        run_campaign({"a": lambda: {"x": 2.0}}, path, {"seed": 2})


def test_not_a_number_never_reaches_the_file(tmp_path):
    path = tmp_path / "study.json"
    with pytest.raises(ValueError, match="JSON"):
        run_campaign({"a": lambda: {"x": float("nan")}}, path, {})
    assert not path.exists()
