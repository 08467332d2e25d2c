"""`help(avc)` helps, every call takes a problem by name, and Python refuses what the command refuses."""

import doctest
import inspect
import pydoc
from pathlib import Path

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi._util.json_values import json_text
from avc_casadi.cli import main
from avc_casadi.files.gain_file import gain_document
from avc_casadi.files.problem_file import as_problem
from avc_casadi.model.gains import GainTable

SOFT = avc.load_problem("soft").changed(frequency={"points": 12})


def test_the_page_of_help_shows_the_five_calls():
    text = pydoc.render_doc(avc, renderer=pydoc.plaintext)
    for call in ("avc.solve(", "avc.certify(", "avc.compare(", "avc.simulate(", "avc.zwidth("):
        assert call in text.partition("PACKAGE CONTENTS")[0]


def test_the_names_are_sorted_and_complete():
    public = [name for name in dir(avc) if not name.startswith("_")]
    assert avc.__all__ == sorted(avc.__all__) == public
    assert dir(avc) == sorted(dir(avc))


@pytest.mark.thorough
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


def test_the_methods_are_named_in_the_signature():
    assert inspect.signature(avc.solve).parameters["method"].annotation == "MethodName"
    assert "MethodName" in inspect.signature(avc.compare).parameters["methods"].annotation


@pytest.mark.parametrize(
    ("call", "hint"),
    [
        (lambda: avc.solve(SOFT, "shedule"), "'shedule' is no method, did you mean schedule?"),
        (lambda: avc.compare(SOFT, ("closed-form", "exakt")), "'exakt' is no method, did you mean exact?"),
        (lambda: avc.load_problem("figur5"), "near: figure5"),
    ],
)
def test_a_mistyped_name_is_answered_with_the_near_one(call, hint):
    with pytest.raises(avc.InputError) as error:
        call()
    assert hint in str(error.value)
    assert "command line" not in str(error.value)


@pytest.mark.parametrize("call", [avc.solve, avc.compare, avc.simulate, avc.screen, avc.zwidth])
def test_an_unknown_keyword_is_pythons_own_error(call):
    with pytest.raises(TypeError, match="unexpected keyword argument 'metod'"):
        call("soft", metod="exact")


@pytest.mark.thorough
def test_a_problem_is_taken_as_it_is_by_name_and_by_path():
    assert as_problem(SOFT) is SOFT
    by_name = as_problem("soft")
    assert as_problem(avc.catalogue_path("soft")) == as_problem(str(avc.catalogue_path("soft"))) == by_name
    gains = avc.solve("soft", "exact")
    assert avc.certify("soft", gains) == avc.certify(by_name, gains)
    assert avc.zwidth("soft") == avc.zwidth(by_name)
    assert avc.compare("soft", ("closed-form", "exact")) == avc.compare(by_name, ("closed-form", "exact"))


def test_gains_of_another_sample_time_are_refused_by_every_call():
    gains = avc.solve(SOFT, "exact")
    faster = SOFT.changed(device={"sample_time_s": 5e-4})
    for call in (avc.certify, avc.simulate, avc.screen):
        with pytest.raises(avc.InputError, match=r"sample_time_s: is 0\.001, but .* is 0\.0005"):
            call(faster, gains)


SAME_WORDS = [
    (("compare", "soft", "--mine=-1,5"), "mine", lambda: avc.compare("soft", mine=(-1.0, 5.0))),
    (("compare", "soft", "--mine=inf,5"), "mine", lambda: avc.compare("soft", mine=(np.inf, 5.0))),
    (("simulate", "soft", "--screen", "--tolerance=1.5"), "tolerance", lambda: avc.screen("soft", tolerance=1.5)),
    (("simulate", "soft", "--screen", "--tolerance=nan"), "tolerance", lambda: avc.screen("soft", tolerance=np.nan)),
    (("simulate", "soft", "--seed=-3"), "seed", lambda: avc.simulate("soft", seed=-3)),
    (("solve", "soft", "--tolerance=7"), "tolerance", lambda: avc.solve("soft", tolerance=7)),
    (("zwidth", "soft", "--method=exakt"), "method", lambda: avc.solve("soft", "exakt")),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("arguments", "key", "call"), SAME_WORDS, ids=[" ".join(row[0]) for row in SAME_WORDS])
def test_python_and_the_command_refuse_in_the_same_words(arguments, key, call, capsys):
    with pytest.raises(avc.InputError) as error:
        call()
    (fault,) = error.value.faults
    assert fault.key == key
    assert main(list(arguments)) == 2
    assert f"--{key}: {fault.message}" in capsys.readouterr().err


def test_gains_without_a_start_are_refused_in_the_same_words(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    gains = avc.solve("hard/infeasible-box", "exact")
    with pytest.raises(avc.InputError) as error:
        avc.simulate("hard/infeasible-box", gains)
    (fault,) = error.value.faults
    Path("gains.json").write_text(json_text(gain_document(gains)))
    assert main(["simulate", "hard/infeasible-box", "--gains", "gains.json"]) == 1
    assert fault.message in capsys.readouterr().err
    with pytest.raises(avc.InputError, match="no row with gains"):
        GainTable.of(gains)
