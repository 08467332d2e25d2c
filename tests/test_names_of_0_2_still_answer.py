"""Rooms of release 0.2 still give their names, with a warning that says where they stand now."""

from importlib import import_module

import pytest

NAMES = {
    "avc_casadi.problem": ("load_problem", "Device", "Hands", "Scene"),
    "avc_casadi.coupling": ("Gains", "NO_COUPLING", "reduce_rows"),
    "avc_casadi.loop": ("loop_at", "hand_set", "series"),
    "avc_casadi.certificate": ("certify", "deployable", "zwidth"),
    "avc_casadi.scene": ("simulate", "Run"),
    "avc_casadi.trial": ("settling_study", "exact_interval"),
    "avc_casadi.design": ("solve", "METHODS"),
    "avc_casadi.design.pointwise": ("solve_exact",),
    "avc_casadi.identification": ("read_logs",),
    "avc_casadi.diagnosis": ("diagnose",),
    "avc_casadi.excitation": ("plan_excitation",),
    "avc_casadi.recommendation": ("Recommendation",),
    "avc_casadi.study.comparison": ("compare",),
    "avc_casadi.proof": ("HandsProof",),
}


@pytest.mark.parametrize("room", NAMES)
def test_room_gives_its_names_and_says_where_they_stand(room):
    module = import_module(room)
    for name in NAMES[room]:
        with pytest.warns(DeprecationWarning, match=rf"{room}\.{name} stands in avc_casadi\.") as told:
            found = getattr(module, name)
        home = str(told[0].message).split(" stands in ")[1].split(" since")[0]
        assert getattr(import_module(home), name) is found


def test_old_figures_are_the_package_of_today():
    with pytest.warns(DeprecationWarning, match=r"present\.figures"):
        found = import_module("avc_casadi.figures").save_figure
    assert found is import_module("avc_casadi.present.figures").save_figure


def test_what_never_was_is_an_error_without_a_warning():
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        import_module("avc_casadi.problem").nothing  # noqa: B018
    with pytest.raises(ModuleNotFoundError):
        import_module("avc_casadi.nothing")


@pytest.mark.parametrize("room", ["accuracy", "estimators", "reference", "table1"])
def test_a_study_is_answered_with_where_it_stands(room):
    with pytest.raises(ModuleNotFoundError, match="tests/benchmarks/studies of the source distribution"):
        import_module(f"avc_casadi.study.{room}")
