"""Method `static`: the best constant coupling under its condition, against brute force and closed forms."""

import numpy as np
import pytest

from avc_casadi import parse_problem
from avc_casadi.claims.certify import certify
from avc_casadi.claims.passivity.llewellyn import largest_llewellyn_stiffness, llewellyn_margin
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.design.constant.static import static_coupling
from avc_casadi.design.methods import solve
from avc_casadi.loops.sampled_loop import SampledLoop
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.realism import relative_errors


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


@pytest.mark.thorough
@pytest.mark.one_of(3)
@pytest.mark.parametrize("model", ["paper", "sampled-data"])
@pytest.mark.parametrize("condition", ["llewellyn", "all"])
@pytest.mark.parametrize(("delay", "objective"), [(0, "magnitude"), (1, "magnitude"), (0, "complex")])
def test_no_allowed_pair_of_a_grid_is_better(model, condition, delay, objective):
    case = problem(delay=delay, model=model, objective=objective)
    found = static_coupling(case, condition)
    assert found.found
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


@pytest.mark.thorough
def test_sampled_data_llewellyn_ends_at_the_passive_limit():
    found = static_coupling(problem(model="sampled-data"))
    assert found.stiffness_n_per_m == pytest.approx(2 * 2.0 / 1e-3, rel=1e-9)
    assert found.damping_ns_per_m == 0.0


@pytest.mark.thorough
def test_printed_hold_ends_on_the_edge_of_llewellyn():
    case = problem()
    found = static_coupling(case)
    edge = largest_llewellyn_stiffness(SampledLoop.of(case), found.damping_ns_per_m)[0]
    assert found.stiffness_n_per_m == pytest.approx(edge, rel=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("model", ["paper", "sampled-data"])
def test_certificate_confirms_the_design(model):
    case = problem(model=model)
    gains = solve(case, "static")
    assert np.ptp(gains.stiffness_n_per_m) == 0
    levels = certify(case, gains).levels
    assert levels["L4"].passed
    assert levels["L2" if model == "paper" else "L3"].passed  # any passive environment, so this one
    assert len(gains.notes) == 2


@pytest.mark.thorough
def test_damped_structure_uses_contact_damping_where_it_pays():
    box = "structure = 'damped'\ncontact_damping_ns_per_m = [0.0, 100.0]"
    plain, damped = static_coupling(problem(), "all"), static_coupling(problem(coupling=box), "all")
    assert damped.found
    assert damped.error <= plain.error * (1 + 1e-6)
