"""`help(avc)` helps, every call takes a problem by name, and Python refuses what the command refuses."""

import doctest
import inspect

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.files.problem_file import as_problem

SOFT = avc.load_problem("soft").changed(frequency={"points": 12})


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in avc.__all__ if name != "figures"])
def test_every_name_shows_a_call_that_does_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(getattr(avc, name))
    examples = doctest.DocTestParser().get_examples(text)
    assert any(f"avc.{name}" in example.source or name[0].isupper() for example in examples)
    for example in examples:
        compile(example.source, name, "single")
    found = doctest.DocTestParser().get_doctest(text, {"avc": avc}, name, name, 0)
    told = []
    assert doctest.DocTestRunner().run(found, out=told.append).failed == 0, "".join(told)


@pytest.mark.slow
def test_a_problem_is_taken_as_it_is_by_name_and_by_path():
    assert as_problem(SOFT) is SOFT
    by_name = as_problem("soft")
    assert as_problem(avc.catalogue_path("soft")) == as_problem(str(avc.catalogue_path("soft"))) == by_name
    gains = avc.solve("soft", "exact")
    assert avc.certify("soft", gains).document() == avc.certify(by_name, gains).document()
    assert avc.zwidth("soft").document() == avc.zwidth(by_name).document()
    compared = [avc.compare(problem, ("closed-form", "exact")).to_dict() for problem in ("soft", by_name)]
    np.testing.assert_equal(*compared)
