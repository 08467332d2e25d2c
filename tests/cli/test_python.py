"""`help(avc)` helps, every call takes a problem by name, and Python refuses what the command refuses."""

import doctest
import functools
import inspect
from types import SimpleNamespace

import pytest

import avc_casadi as avc

LONG = ("mass_width", "recommend_admittance", "recommend_force_feedback")
"""Calls that take seconds and that several examples make with the same argument."""
ONCE = {name: functools.cache(getattr(avc, name)) for name in LONG}
AVC = SimpleNamespace(**{name: getattr(avc, name) for name in avc.__all__} | ONCE)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in avc.__all__ if name != "figures"])
def test_every_name_shows_a_call_that_does_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    value = getattr(avc, name)
    text = inspect.getdoc(value)
    examples = doctest.DocTestParser().get_examples(text)
    error = inspect.isclass(value) and issubclass(value, avc.AvcError)
    assert error or any(f"avc.{name}" in example.source or name[0].isupper() for example in examples)
    for example in examples:
        compile(example.source, name, "single")
    found = doctest.DocTestParser().get_doctest(text, {"avc": AVC}, name, name, 0)
    told = []
    assert doctest.DocTestRunner().run(found, out=told.append).failed == 0, "".join(told)
