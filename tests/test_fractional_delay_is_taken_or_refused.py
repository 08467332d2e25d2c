"""A delay of part of a sample: judged where that is exact, refused by name where only whole samples are known."""

import numpy as np
import pytest
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi import UnsupportedError
from avc_casadi.claims.certify import certify
from avc_casadi.claims.deployable import deployable
from avc_casadi.claims.passivity.llewellyn import llewellyn_margin
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.claims.zwidth import llewellyn_table
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.design.scene_coupling import scene_coupling
from avc_casadi.loops.loop import Body
from avc_casadi.loops.sampled_loop import SampledLoop, passive_limit_n_per_m
from avc_casadi.loops.wall import frozen_parts, joint_rendering, linear_stability, wall
from avc_casadi.model.hands import Hand
from avc_casadi.model.sampled_plant import sampled_plant
from avc_casadi.model.schedule import Status
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.rendered import gain_schedule

T = 1e-3
HAND = Hand(np.array([0.05]), np.array([3.0]), np.array([800.0]))


def text_of(delay):
    text = f"[device]\nmass_kg=0.1\ndamping_ns_per_m=2\ndelay_samples={delay}\n[environment]\ndamping_ns_per_m=10\n"
    return text + "stiffness_n_per_m=1e5\n[frequency]\nstop_hz=400\npoints=5\n"


def problem(delay, **tables):
    return avc.parse_problem(text_of(delay)).changed(**tables)


def rows(case, b, k, contact=0.0):
    n = len(case.frequencies_hz())
    gains = tuple(np.full(n, value) for value in (b, k, contact))
    return gain_schedule(case, "file", gains, (Status.SOLVED,) * n)


def marched(case, b, k, contact, samples):
    """The loop in steps of a thousandth of a sample, the force arriving where the delay says."""
    device, wall, parts = case.device, case.environment, 1000
    m, damping = 0.15, 5.0
    step = expm(np.array([[0, 1, 0], [-800 / m, -damping / m, -1 / m], [0, 0, 0]]) * T / parts)[:2]
    late = round(device.delay_samples * parts)
    forces, state, before, joint, trace = [], np.array([1e-3, 0.0]), 1e-3, 0.0, []
    for sample in range(samples):
        b_e, k_e, x = wall.damping_ns_per_m, wall.stiffness_n_per_m, state[0]
        new = (b * (x - before) / T + k * x + (b + b_e) * joint / T) / ((b + b_e) / T + k + k_e)
        forces.append(b_e * (new - joint) / T + k_e * new + contact * (x - before) / T)
        before, joint = x, new
        trace.append(x)
        for part in range(parts):
            arrived = (sample * parts + part - late) // parts
            state = step @ np.array([*state, forces[arrived] if arrived >= 0 else 0.0])
    return np.array(trace)


@pytest.mark.parametrize("delay", [0.25, 0.6, 1.0, 1.7, 2.5])
def test_the_judged_loop_is_the_marched_one(delay):
    case = problem(delay)
    rendering = joint_rendering(case, *(np.array([gain]) for gain in (5.0, 2e4, 10.0)))
    matrix = wall(Body.of(sampled_plant(case.device, HAND)).flat(), rendering)[0]
    state, trace = np.zeros(len(matrix)), []
    state[[0, -2]] = 1e-3
    for _ in range(100):
        trace.append(state[0])
        state = matrix @ state
    np.testing.assert_allclose(trace, marched(case, 5.0, 2e4, 10.0, 100), rtol=0, atol=1e-9 * np.abs(trace).max())
    radius = linear_stability(case.device, frozen_parts(case, 5.0, 2e4), 10.0, HAND).radius[0, 0]
    assert radius == pytest.approx(np.abs(np.linalg.eigvals(matrix)).max(), abs=1e-9)


@pytest.mark.parametrize("whole", [1, 2, 3])
def test_stability_is_continuous_where_the_delay_becomes_whole(whole):
    def radius(delay):
        case = problem(delay)
        return linear_stability(case.device, frozen_parts(case, 5.0, 2e4), 10.0, HAND).radius[0, 0]

    assert radius(whole - 1e-3) == pytest.approx(radius(whole), abs=1e-3)
    assert radius(whole + 1e-3) == pytest.approx(radius(whole), abs=1e-3)
    assert radius(whole - 0.5) != pytest.approx(radius(whole), abs=1e-3)


@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("delay", [0.25, 0.5, 1.5])
def test_the_own_frequency_is_judged_with_the_fraction(model, delay):
    case = problem(delay, stability={"model": model})
    frequency = case.frequencies_hz()
    found = worst_margin(SampledLoop.of(case), 3.0, 9e3, 1.0, frequency, frequency)
    np.testing.assert_allclose(found.margin_ns_per_m, loop_at(case, frequency).perceived(3.0, 9e3, 1.0).real, rtol=1e-9)


def test_a_certificate_judges_what_it_can_and_says_what_it_cannot():
    case = problem(0.5, device={"damping_ns_per_m": 30.0})
    levels = certify(case, rows(case, 1.0, 50.0)).levels
    for level in ("L0", "L1", "L3", "L5"):
        assert levels[level].passed
    for level in ("L2", "L4"):
        assert not levels[level].passed
        assert levels[level].claim.startswith(f"Not judged: {level} with the paper's hold has no proof")
        assert "part of a sample of delay (device.delay_samples)" in levels[level].claim
    document = certify(case, rows(case, 1.0, 50.0)).document()
    assert document["passive_limit_n_per_m"] is None
    assert document["levels"]["L2"]["margin_ns_per_m"] is None
    assert document["levels"]["L3"]["margin_ns_per_m"] > 0


def test_pointwise_methods_agree_for_a_fractional_delay():
    case = problem(0.5)
    direct, exact = avc.solve(case, "direct"), avc.solve(case, "exact")
    assert direct.usable.any()
    np.testing.assert_allclose(direct.magnitude_error, exact.magnitude_error, rtol=1e-4, atol=1e-6)


def test_what_knows_whole_samples_only_says_so_by_name():
    case = problem(1.5)
    calls = (
        lambda: worst_margin(SampledLoop.of(case), 1.0, 1e3),
        lambda: llewellyn_margin(SampledLoop.of(case), 1.0, 1e3),
        lambda: llewellyn_table(case),
        lambda: avc.solve(case, "static"),
        lambda: avc.solve(case.changed(stability={"scope": "all"}), "schedule"),
    )
    for call in calls:
        with pytest.raises(UnsupportedError, match=r"device.delay_samples is 1.5: .* whole samples only") as refused:
            call()
        assert refused.value.key == "device.delay_samples"
    assert np.isnan(passive_limit_n_per_m(case.device))


@pytest.mark.thorough
def test_a_scene_that_names_no_coupling_gets_one_for_the_next_whole_sample(tmp_path, capsys):
    case = problem(1.5)
    assert "coupling" not in case.scene.model_fields_set
    found = scene_coupling(case)
    assert found.usable.all()
    np.testing.assert_array_equal(
        found.stiffness_n_per_m, avc.solve(case.changed(device={"delay_samples": 2}), "static").stiffness_n_per_m
    )
    (tmp_path / "p.toml").write_text(text_of(1.5))
    for options in ((), ("--screen",)):
        assert main(["simulate", str(tmp_path / "p.toml"), *options]) in {0, 1}
        assert "designed for 2 samples of delay, simulated with 1.5" in " ".join(capsys.readouterr().out.split())
    named = case.changed(scene={"coupling": "static"})
    with pytest.raises(UnsupportedError, match="whole samples only"):
        scene_coupling(named)


def test_a_coupling_for_a_fractional_delay_is_judged_for_deployment():
    case = problem(0.5, device={"damping_ns_per_m": 30.0}, hands={"let_go": True})
    assert deployable(Coupling.of(case, rows(case, 1.0, 50.0))).passed
