"""The trade-off study: certificates hold what each design asked for, and more freedom never costs."""

import json

import numpy as np
import pytest
from schedule_problems import changed, figure5
from studies.pareto.command import _text
from studies.pareto.figure import draw_pareto

from avc_casadi.claims.stability.scope import scope_slack
from avc_casadi.cli import main
from avc_casadi.design.comparison.pareto import study_pareto, variants
from avc_casadi.design.schedule.solver import solve_schedule
from avc_casadi.files.problem_document import dump_problem
from avc_casadi.files.problem_file import load_problem
from avc_casadi.paper.loop import loop_at
from avc_casadi.present.figures.layout import save_figure


@pytest.fixture(scope="module")
def study():
    return study_pareto(figure5(points=12))


@pytest.mark.thorough
def test_every_design_is_certified_for_what_it_asks(study):
    levels = {"pointwise": "L0", "band": "L1", "all": "L2", "hands": "L5"}
    assert {point.study for point in study.points} == {"scope", "slope", "contact"}
    for point in study.points:
        assert point.rows_without_gains == 0, point
        assert point.passed[levels[point.scope]], point


@pytest.mark.thorough
def test_more_freedom_never_costs():
    for variant in variants(figure5(points=12)):
        if variant.study == "scope" and not variant.constant:
            adaptive, constant = (cost(solve_schedule(variant.problem, constant=c)) for c in (False, True))
            assert adaptive <= constant * (1 + 1e-6), variant.label
    rising = [
        cost(solve_schedule(variant.problem, constant=variant.constant))
        for variant in variants(figure5(points=12))
        if variant.study == "slope"
    ]
    assert rising == sorted(rising, reverse=True)


def cost(gains):
    return float(gains.notes[0].split()[1].rstrip(":"))


@pytest.mark.thorough
@pytest.mark.parametrize(("scope", "model"), [("band", "sampled-data"), ("all", "paper"), ("pointwise", "paper")])
def test_constant_gains_are_the_best_of_a_fine_grid(scope, model):
    problem = figure5(points=20, stability={"scope": scope, "model": model}, schedule={"slope_penalty": 0.0})
    gains = solve_schedule(problem, constant=True)
    assert np.ptp(gains.damping_ns_per_m) == np.ptp(gains.stiffness_n_per_m) == 0
    frequency = problem.frequencies_hz()
    weight = np.convolve(np.diff(np.log(frequency)), [0.5, 0.5])
    weight /= weight.sum()
    b, k = (grid.ravel() for grid in np.meshgrid(np.geomspace(1e-2, 1e4, 60), np.geomspace(1e2, 1e7, 60)))
    loop = loop_at(problem, frequency[:, None])
    error = weight @ (1 - np.abs(loop.perceived(b, k)) / np.abs(loop.target)) ** 2
    best = np.inf
    for chosen in np.array_split(np.argsort(error), 60):
        rows = (np.repeat(gain[chosen], 20) for gain in (b, k))
        slack = scope_slack(problem, np.tile(frequency, len(chosen)), *rows).slack
        met = (slack >= 0).reshape(-1, 20).all(axis=1)
        if met.any():
            best = error[chosen][met].min()
            break
    assert cost(gains) <= best * (1 + 1e-9)
    assert scope_slack(problem, frequency, gains.damping_ns_per_m, gains.stiffness_n_per_m).met.all()


@pytest.mark.thorough
def test_document_is_json_and_figure_is_drawn(study, tmp_path):
    document = json.loads(json.dumps(study.document(), allow_nan=False))
    assert document["schema"] == "avc-pareto/1"
    assert len(document["points"]) == len(study.points)
    save_figure(draw_pareto(study), tmp_path / "pareto.svg")
    drawn = (tmp_path / "pareto.svg").read_text()
    assert "<svg" in drawn


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("name", ["hard/infeasible-box", "hard/free-space"])
def test_nothing_to_draw_or_nothing_to_gain(name, tmp_path):
    found = study_pareto(changed(load_problem(name), frequency={"points": 3}))
    save_figure(draw_pareto(found), tmp_path / "pareto.png")
    scopes = found.of("scope", constant=False)
    document = found.document()["points"]
    if name == "hard/free-space":
        assert max(point.complex_error for point in scopes) < 1e-9
    else:
        assert {point.rows_without_gains for point in scopes} == {3}
        assert {point["complex_error"] for point in document if point["study"] == "scope"} == {None}


@pytest.mark.thorough
def test_verb(tmp_path, capsys):
    (tmp_path / "p.toml").write_text(dump_problem(changed(load_problem("soft"), frequency={"points": 4})))
    assert main(["study", "pareto", str(tmp_path / "p.toml"), "--plot", str(tmp_path / "p.png"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["problem"] == "p"
    assert (tmp_path / "p.png").stat().st_size > 10_000


@pytest.mark.thorough
def test_text_tells_every_design(study):
    text = _text(study.document(), "drawn.png")
    assert "levels met" in text
    assert text.count("adaptive") + text.count("constant") >= len(study.points)
    assert text.endswith("drawn: drawn.png")
