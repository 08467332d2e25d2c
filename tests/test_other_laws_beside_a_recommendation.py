"""Walls of other laws: against the boundary of a loop written out here, and against each other."""

import itertools
import json
from types import SimpleNamespace

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.present.terminal import MOST_LINES
from avc_casadi.recommendation import baselines as _baselines
from avc_casadi.recommendation.baselines import baselines

MASS_KG, DAMPING, PERIOD_S = 0.15, 0.8, 1e-3
HANDS = {"mass_kg": [0.02, 0.3], "damping_ns_per_m": [1.0, 10.0], "stiffness_n_per_m": [50.0, 800.0]}


def wall_of(stiffness, damping=0.0, **device):
    wall = {"stiffness_n_per_m": stiffness, "damping_ns_per_m": damping}
    own = {"mass_kg": MASS_KG, "damping_ns_per_m": DAMPING, "sample_time_s": PERIOD_S, "delay_samples": 0}
    return avc.Problem.model_validate({"name": "bench", "device": own | device, "environment": wall, "hands": HANDS})


def stiffest_linear_wall():
    """Stiffest K that some B holds with every corner of the hands and released, by eigenvalues of one sample."""
    corners = [*itertools.product(*HANDS.values()), (0.0, 0.0, 0.0)]

    def radius(stiffness, damping):
        worst = 0.0
        for mass, rate, spring in corners:
            moved = MASS_KG + mass
            plant = np.zeros((3, 3))
            plant[0, 1], plant[1] = 1.0, [-spring / moved, -(DAMPING + rate) / moved, -1.0 / moved]
            halves, step = np.eye(3), np.eye(3)
            for order in range(1, 14):
                halves = halves @ plant * PERIOD_S / order
                step = step + halves
            # x, v and the last sample's x; the force is held over the sample.
            loop = np.zeros((3, 3))
            force = np.array([stiffness + damping / PERIOD_S, 0.0, -damping / PERIOD_S])
            loop[:2] = step[:2, :3] @ np.vstack([np.eye(3)[:2], force])
            loop[2, 0] = 1.0
            worst = max(worst, np.abs(np.linalg.eigvals(loop)).max())
        return worst

    dampings = np.linspace(0.0, 200.0, 41)
    low, high = 100.0, 1e6
    while high > 1.01 * low:
        middle = np.sqrt(low * high)
        low, high = (middle, high) if min(radius(middle, one) for one in dampings) < 1 else (low, middle)
    return low


@pytest.mark.parametrize("limit", [60.0, 330.0, 990.0, 2000.0])
def test_the_stiffest_wall_is_approached_to_a_fifth_from_below(limit, monkeypatch):
    """Hands settle up to a limit; 1 kN/m is asked for."""
    problem = wall_of(1000.0)
    law = _baselines._Law(problem, "backward difference", None, 10, 0)
    walls = {}

    def held(stiffness):
        walls[stiffness] = Coupling.constant(problem, Gains(0.0, 1e8, 1.0), "none")
        return walls[stiffness] if stiffness <= limit else None

    seen = []
    monkeypatch.setattr(law, "_held", held)
    monkeypatch.setattr(law, "_settled", lambda wall, count: seen.append(wall) or count)
    monkeypatch.setattr(_baselines, "shaken", lambda *_, **__: SimpleNamespace(errors=dict))
    monkeypatch.setattr(_baselines, "ripple_n", lambda *_: 0.0)
    found = law.stiffest()
    assert found.stiffness_n_per_m <= min(limit, 1000.0) < 1.2 * found.stiffness_n_per_m
    assert seen[-1] is walls[found.stiffness_n_per_m]


@pytest.mark.thorough
def test_the_difference_holds_walls_up_to_where_its_loop_is_stable():
    limit = stiffest_linear_wall()
    beyond = {one.law: one for one in baselines(wall_of(8 * limit), hands=40)}["backward difference"]
    assert beyond.settled_at_wall < beyond.hands
    # The last wall that holds is followed by one 2^(1/4) stiffer that some hand does not rest at, at three dampings.
    assert 0.45 * limit < beyond.stiffness_n_per_m < 1.05 * limit
    assert beyond.settled == beyond.hands


@pytest.mark.thorough
def test_every_law_renders_a_soft_wall_and_foaw_is_quieter_than_the_difference():
    found = {one.law: one for one in baselines(wall_of(300.0, 4.0, encoder_resolution_m=1e-5), hands=40)}
    assert set(found) >= {"backward difference", "first-order", "kalman", "foaw", "levant", "passivity controller"}
    for law, one in found.items():
        whole = one.stiffness_n_per_m == pytest.approx(300.0)
        assert whole or law == "static"
        assert one.settled == one.hands
    # The passive coupling stands in series with the wall.
    assert found["static"].stiffness_n_per_m < 300.0
    assert found["static"].error["1"] == pytest.approx(1 - found["static"].stiffness_n_per_m / 300.0, abs=0.1)
    assert found["foaw"].ripple_n < found["backward difference"].ripple_n


@pytest.mark.thorough
def test_the_page_has_a_row_a_law_and_the_document_all_numbers(tmp_path, capsys):
    path = tmp_path / "soft.toml"
    path.write_text(
        "[device]\nmass_kg = 0.15\ndamping_ns_per_m = 0.8\nsample_time_s = 0.001\n"
        "[environment]\nstiffness_n_per_m = 300.0\ndamping_ns_per_m = 0.0\n"
    )
    assert main(["recommend", str(path), "--compare", "--hands", "40"]) == 0
    text = capsys.readouterr().out
    assert len(text.strip().splitlines()) <= MOST_LINES
    for label in ("Recommended", "Difference", "Low pass", "PO/PC", "Static, passive"):
        assert label in text
    assert main(["recommend", str(path), "--compare", "--hands", "40", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    # Estimators that reckon with the steps of an encoder have none here.
    assert [one["law"] for one in document["baselines"]] == [
        "backward difference",
        "first-order",
        "passivity controller",
        "static",
    ]


def test_a_comparison_goes_with_a_recommendation_of_a_wall(capsys):
    assert main(["recommend", "soft", "--compare", "--stiffest"]) == 2
    assert "--compare" in capsys.readouterr().err
    assert main(["recommend", "tool/mujoco-500hz", "--compare"]) == 2
    assert "--compare" in capsys.readouterr().err


def test_a_damper_has_no_stiffness_to_compare(tmp_path, capsys):
    path = tmp_path / "damper.toml"
    path.write_text(
        "[device]\nmass_kg = 0.15\ndamping_ns_per_m = 0.8\nsample_time_s = 0.001\n"
        "[environment]\nstiffness_n_per_m = 0.0\ndamping_ns_per_m = 20.0\n"
    )
    assert main(["recommend", str(path), "--compare"]) == 2
    assert "no stiffness" in capsys.readouterr().err
