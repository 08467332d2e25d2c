"""Method `static`: the best constant coupling under its condition, against brute force and closed forms."""

import numpy as np
import pytest
from scene_reference import scene_problem

from avc_casadi import parse_problem
from avc_casadi.claims.llewellyn import llewellyn_margin
from avc_casadi.claims.worst_frequency import worst_margin
from avc_casadi.design.static import static_coupling
from avc_casadi.design.tuned import tune_static
from avc_casadi.loops.wall import SampledLoop, frozen_law, linear_stability
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand, hand_set
from avc_casadi.model.problem import Frequency
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import relative_errors
from avc_casadi.simulation.scene import simulate_batch


def problem(b_d=2.0, delay=0, coupling="", objective="magnitude", **stability):
    table = "".join(f"{key}={value!r}\n" for key, value in stability.items())
    return parse_problem(
        f"[device]\nmass_kg=0.1\ndamping_ns_per_m={b_d}\nsample_time_s=1e-3\ndelay_samples={delay}\n"
        "[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n"
        "[boundaries.upper]\ndamping_ns_per_m=11.0\nstiffness_n_per_m=1.1e5\n"
        "[boundaries.lower]\ndamping_ns_per_m=7.0\nstiffness_n_per_m=0.8e5\n"
        f"[coupling]\n{coupling}\n[stability]\n{table}\n[realism]\nobjective='{objective}'\n"
        "[frequency]\nstart_hz=1.0\nstop_hz=400.0\npoints=40\n"
    )


def cost(case, b, k):
    loop = loop_at(case, case.frequencies_hz())
    errors = relative_errors(
        loop.perceived(b[:, None], k[:, None]), loop.target[None], case.realism.objective, case.realism.jnd
    )
    return np.sqrt(np.mean(errors**2, axis=1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "condition", "delay", "objective"),
    [
        ("paper", "llewellyn", 0, "magnitude"),
        ("paper", "all", 1, "magnitude"),
        ("sampled-data", "llewellyn", 1, "magnitude"),
        ("sampled-data", "all", 0, "complex"),
    ],
)
def test_no_allowed_pair_of_a_grid_is_better(model, condition, delay, objective):
    case = problem(delay=delay, model=model, objective=objective)
    found = static_coupling(case, condition)
    assert found.feasible
    loop = SampledLoop.of(case)
    b, k = (g.ravel() for g in np.meshgrid(np.r_[0, np.geomspace(0.01, 60, 60)], np.geomspace(100, 1e5, 60)))
    if condition == "llewellyn":
        margin = llewellyn_margin(loop, b, k)[0]
        own = llewellyn_margin(loop, found.damping_ns_per_m, found.stiffness_n_per_m)[0][0]
    else:
        margin = worst_margin(loop, b, k).margin_ns_per_m
        own = worst_margin(loop, found.damping_ns_per_m, found.stiffness_n_per_m).margin_ns_per_m[0]
    assert own == pytest.approx(found.margin_ns_per_m, abs=1e-12)
    assert own >= 0
    allowed = margin >= 0
    assert allowed.any()
    assert found.error <= cost(case, b[allowed], k[allowed]).min() * (1 + 1e-9)


@pytest.mark.slow
def test_sampled_data_llewellyn_ends_at_the_passive_limit():
    found = static_coupling(problem(model="sampled-data"))
    assert found.stiffness_n_per_m == pytest.approx(2 * 2.0 / 1e-3, rel=1e-9)
    assert found.damping_ns_per_m == 0.0


@pytest.mark.slow
def test_printed_hold_ends_on_the_edge_of_llewellyn():
    case = problem()
    found = static_coupling(case)
    around = found.stiffness_n_per_m * np.array([1 - 1e-9, 1 + 1e-9])
    inside, outside = llewellyn_margin(SampledLoop.of(case), found.damping_ns_per_m, around)[0]
    assert inside >= 0 > outside


SMALL = {"draws": 8}


def tuned_problem(structure="series", contact=0.0, objective="magnitude", effects=('kind = "hand"', 'kind = "wall"')):
    base = scene_problem(effects, scene="duration_s = 1.5\n")
    coupling = {
        "structure": structure,
        "damping_ns_per_m": (0.0, 300.0),
        "stiffness_n_per_m": (0.0, 1e6),
        "contact_damping_ns_per_m": (0.0, contact),
    }
    frequency = Frequency(start_hz=0.2, stop_hz=50.0, points=40)
    return base.changed(coupling=coupling, realism={"objective": objective}, frequency=frequency)


def error(case, gains):
    loop = loop_at(case, case.frequencies_hz())
    perceived = loop.perceived(*vars(gains).values())
    if case.realism.objective == "complex":
        return np.sqrt(np.mean(np.abs(perceived / loop.target - 1) ** 2))
    return np.sqrt(np.mean((np.abs(perceived) / np.abs(loop.target) - 1) ** 2))


@pytest.fixture(scope="module")
def series():
    return tuned_problem(), tune_static(tuned_problem(), **SMALL)


@pytest.fixture(scope="module")
def damped():
    case = tuned_problem("damped", 200.0, "complex")
    return case, tune_static(case, **SMALL)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["series", "damped"])
def test_tuned_gains_hold_for_hands_never_seen(name, request):
    case, found = request.getfixturevalue(name)
    draw = np.random.default_rng(99).uniform
    hands = Hand(draw(0.05, 0.3, 200), draw(3, 20, 200), draw(200, 800, 200))
    share = simulate_batch(case, hands, found.gains).stable.mean()
    assert share > 0.97
    assert simulate_batch(case, hand_set(case.hands, draws=8), found.gains).stable.all()
    assert found.error == pytest.approx(error(case, found.gains), rel=1e-9)


def test_gains_beyond_the_tuned_ones_are_unstable_or_farther_off(series):
    case, found = series
    hands = hand_set(case.hands, draws=8)
    for b in (0.8, 1.0, 1.25):
        for k in (1.3, 2.0):
            beyond = Gains(b * found.gains.damping_ns_per_m, k * found.gains.stiffness_n_per_m)
            law = frozen_law(case, beyond.damping_ns_per_m, beyond.stiffness_n_per_m)
            lean = case.device.model_copy(
                update={"damping_ns_per_m": case.device.damping_ns_per_m - found.reserve_ns_per_m}
            )
            linear = linear_stability(lean, law, hands).radius.max() < 1
            rests = linear and simulate_batch(case, hands, beyond).stable.all()
            assert not rests or error(case, beyond) > found.error


@pytest.mark.slow
def test_the_margin_is_kept_in_reserve():
    case = tuned_problem()
    careful = tune_static(case.changed(stability={"margin_ns_per_m": 4.0}), **SMALL)
    bold = tune_static(case.changed(stability={"margin_ns_per_m": 2.0}), **SMALL)
    hands = hand_set(case.hands)

    def stable_without(damping, found):
        law = frozen_law(case, found.gains.damping_ns_per_m, found.gains.stiffness_n_per_m)
        lean = case.device.model_copy(update={"damping_ns_per_m": case.device.damping_ns_per_m - damping})
        return linear_stability(lean, law, hands).radius.max() < 1

    assert (careful.reserve_ns_per_m, bold.reserve_ns_per_m) == (4.0, 2.0)
    assert stable_without(4.0, careful)
    assert stable_without(2.0, bold)
    assert not stable_without(4.0, bold)
    assert careful.error > bold.error
