"""Each edit of the mutation run still finds its text, makes another program of it and names tests that exist."""

import ast

import pytest
from benchmarks.mutation_run import ROOT, areas, edits


@pytest.mark.slow
@pytest.mark.parametrize("area", areas())
def test_every_old_text_stands_exactly_once_and_its_edit_is_another_program(area):
    stale, same = [], []
    for edit in edits(area):
        mutant = edit.mutant()
        if mutant is None:
            stale.append(f"{edit.path} does not hold it once: {edit.old}")
            continue
        whole = (ROOT / edit.path).read_bytes()
        broken = whole[: mutant.start] + mutant.new + whole[mutant.end :]
        same += [edit.new] if ast.dump(ast.parse(whole)) == ast.dump(ast.parse(broken)) else []
    assert not stale, f"refresh tests/benchmarks/mutations/{area}.toml"
    assert not same


@pytest.mark.parametrize("area", areas())
def test_listed_tests_exist_and_every_edit_says_what_it_breaks(area):
    missing = set()
    for edit in edits(area):
        assert edit.tests
        assert edit.why
        for listed in edit.tests:
            file, _, name = listed.partition("::")
            there = (ROOT / file).exists() and f"def {name}" in (ROOT / file).read_text(encoding="utf-8")
            missing |= set() if there else {listed}
    assert not missing


def test_every_part_of_the_core_has_edits():
    core = {"certificates", "coupling", "equations", "hardware", "runtime", "scene", "schedule"}
    assert set(areas()) == core | {"identify", "other_ends", "recommend"}
    assert all(len(edits(area)) >= 10 for area in areas())
