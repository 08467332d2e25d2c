"""The K-B region: closed forms, sampling theorems of the field, and the order of the claims."""

from functools import cache

import numpy as np
import pytest

from avc_casadi import UnsupportedError, parse_problem
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.claims.zwidth import llewellyn_table, rendered_wall, zwidth
from avc_casadi.design.methods import solve
from avc_casadi.loops.sampled_loop import SampledLoop, fractions
from avc_casadi.loops.wall import linear_stability
from avc_casadi.model.hands import no_hand
from avc_casadi.model.schedule import Status
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.rendered import gain_schedule

T = 1e-3


def problem(b_d=2.0, delay=0, structure="series", extra=""):
    return parse_problem(
        f"[device]\nmass_kg=0.1\ndamping_ns_per_m={b_d}\nsample_time_s={T}\ndelay_samples={delay}\n{extra}"
        "[environment]\ndamping_ns_per_m=10.0\nstiffness_n_per_m=1e5\n"
        f"[coupling]\nstructure='{structure}'\n"
        f"contact_damping_ns_per_m=[0.0, {100.0 if structure == 'damped' else 0.0}]\n"
        "[boundaries.upper]\ndamping_ns_per_m=9.0\nstiffness_n_per_m=0.9e5\n"
        "[boundaries.lower]\ndamping_ns_per_m=7.0\nstiffness_n_per_m=0.7e5\n"
        "[frequency]\nstart_hz=1.0\nstop_hz=100.0\npoints=5\n"
    )


@cache
def region_of(b_d=2.0, delay=0, extra=""):
    return zwidth(problem(b_d, delay, extra=extra))


FRICTION = "coulomb_friction_n=0.2\nencoder_resolution_m=2e-6\n"


def curves(region):
    return {curve.key: curve.stiffness_n_per_m for curve in region.curves}


@pytest.mark.thorough
def test_passive_regions_without_delay_are_the_closed_forms():
    region = region_of()
    found, b = curves(region), region.damping_ns_per_m
    np.testing.assert_allclose(found["passive-paper"], 2 * (2.0 + b) / T, rtol=1e-6)
    expected = np.where(b < 2.0, 2 * (2.0 - b) / T, np.nan)  # Colgate and Schenkel: b_d > KT/2 + |B|
    np.testing.assert_allclose(found["passive-sampled-data"], expected, rtol=1e-6)
    assert found["passive-delayed"][0] == pytest.approx(2 * 2.0 / (3 * T), rel=1e-6)
    assert region.passive_limit_n_per_m == pytest.approx(2 * 2.0 / T)


@pytest.mark.thorough
def test_passive_walls_are_stable_and_the_papers_region_is_not():
    region = region_of()
    found = curves(region)
    for name in ("stable-released", "stable-hands"):
        inside = np.isfinite(found["passive-sampled-data"])
        assert (found["passive-sampled-data"][inside] <= found[name][inside] * (1 + 1e-6)).all()
    beyond = found["passive-paper"] > 1.1 * np.nan_to_num(found["stable-hands"])
    assert beyond.any()  # walls that the paper's hold calls passive and that no hand of the set keeps stable


@pytest.mark.thorough
def test_every_edge_is_an_edge():
    case = problem(delay=1)
    region = region_of(delay=1)
    found = curves(region)
    assert "passive-delayed" not in found
    for row in (0, 20, 30):
        b = region.damping_ns_per_m[row]
        for factor, inside in ((1 - 1e-6, True), (1 + 1e-6, False)):
            passive = worst_margin(
                SampledLoop(2.0, b, found["passive-sampled-data"][row] * factor, T, 1, "sampled-data"), np.inf, 1.0
            )
            stable_k = np.array([found["stable-released"][row] * factor])
            wall = fractions(SampledLoop(2.0, b, stable_k, T, 1, "sampled-data"), np.inf, 1.0)
            if np.isfinite(found["passive-sampled-data"][row]):
                assert passive.passive[0] == inside
            if np.isfinite(stable_k[0]):
                assert linear_stability(case.device, wall, 0.0, no_hand()).stable[0] == inside


@pytest.mark.thorough
def test_encoder_and_friction_bound():
    assert region_of().encoder_limit_n_per_m is None
    assert region_of(extra=FRICTION).encoder_limit_n_per_m == pytest.approx(2 * 0.2 / 2e-6)


@pytest.mark.parametrize("structure", ["series", "damped"])
def test_rendered_wall_is_what_the_row_renders(structure):
    case = problem(structure=structure)
    gains = solve(case, "exact")
    b, k = rendered_wall(case, gains)
    angle = loop_at(case, case.frequencies_hz()).angle
    s = 2 / T * np.asarray(angle.sin) * (np.asarray(angle.sin) + 1j * np.asarray(angle.cos))
    wall, coupling = 10.0 + 1e5 / s, gains.damping_ns_per_m + gains.stiffness_n_per_m / s
    rendered = wall * coupling / (wall + coupling) + gains.contact_damping_ns_per_m
    np.testing.assert_allclose(b + k / s, rendered, rtol=1e-9)


def test_llewellyn_table_scales_with_the_device():
    light, heavy = llewellyn_table(problem(0.5)), llewellyn_table(problem(5.0))
    np.testing.assert_allclose(light.paper, heavy.paper, rtol=1e-9, atol=1e-9)
    assert light.paper[0] == pytest.approx(8.0)
    assert light.sampled_data[0] == pytest.approx(2.0)
    with pytest.raises(UnsupportedError, match="damping_ns_per_m is 0"):
        llewellyn_table(problem(0.0))


def test_contact_damping_is_damping_of_the_rendered_wall():
    case = problem(structure="damped")
    n = len(case.frequencies_hz())
    walls = [
        rendered_wall(case, gain_schedule(case, "file", tuple(np.full(n, v) for v in gains), (Status.SOLVED,) * n))
        for gains in ((5.0, 4e3, 33.0), (5.0, 4e3, 0.0))
    ]
    np.testing.assert_allclose(walls[0][0] - walls[1][0], 33.0, rtol=1e-9)
    np.testing.assert_allclose(walls[0][1], walls[1][1], rtol=1e-9)
