"""The virtual mass and damping that are recommended, and the region of those that a device can render."""

import math

import numpy as np
import pytest
from admittance_loop import PlainDevice, disk_margin, largest_pole
from quick import first

import avc_casadi as avc
from avc_casadi.claims.admittance import HandleAnalysis
from avc_casadi.claims.mass_spans import VelocityResponse, held_span, held_spans
from avc_casadi.cli import main
from avc_casadi.loops.handle import plants_of
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.model.admittance import virtual_mass_law
from avc_casadi.recommendation.admittance import effort_ns_per_m


@pytest.fixture(scope="module")
def found():
    return avc.recommend_admittance("admittance/cobot")


@pytest.fixture(scope="module")
def region():
    return avc.mass_width("admittance/cobot")


@pytest.mark.slow
def test_it_is_sound_and_no_lighter_law_nearby_is(found):
    assert found.passed
    assert 0.2 <= found.certificate.disk_margin < 0.23
    law, base = found.law, effort_ns_per_m(found.law)
    analysis = HandleAnalysis(found.problem)
    analysis.confirmed_margin(law)
    for angle in np.linspace(0.0, 2 * math.pi, 12, endpoint=False):
        mass, damping = law.mass_kg * 1.1 ** np.cos(angle), law.damping_ns_per_m * 1.1 ** np.sin(angle)
        near = law.model_copy(update={"mass_kg": float(mass), "damping_ns_per_m": float(damping)})
        if effort_ns_per_m(near) < 0.97 * base:
            assert analysis.rough_margin(near) < 0.2


@pytest.mark.slow
def test_the_least_of_the_files_numbers_is_on_the_edge(found):
    own = avc.load_admittance("admittance/cobot")
    for key, least in (("mass_kg", found.least_mass_kg), ("damping_ns_per_m", found.least_damping_ns_per_m)):
        margins = [
            avc.certify_admittance(own, law={key: factor * least}, remedies=False).disk_margin for factor in (0.9, 1.05)
        ]
        assert margins[0] < 0.2 < margins[1]


@pytest.mark.slow
def test_the_edge_of_the_region_is_where_certificates_turn(region):
    # Between these dampings a line may lie farther inside.
    chosen = [row for row in region.confirmed_rows if region.sound_least_kg[row] > 0]
    assert len(chosen) > 1
    for index in (chosen[0], chosen[-1]):
        damping = float(region.damping_ns_per_m[index])
        for mass, limit, is_beyond in (
            (region.least_kg[index], 0.0, False),
            (region.sound_least_kg[index], 0.2, False),
            (region.sound_largest_kg[index], 0.2, True),
        ):
            if not 0 < mass < math.inf:
                continue
            for factor in (0.95, 1.05):
                law = {"mass_kg": float(factor * mass), "damping_ns_per_m": damping}
                judged = avc.certify_admittance("admittance/cobot", law=law, remedies=False)
                if (factor > 1) != is_beyond:
                    assert judged.stable
                    assert judged.disk_margin >= limit
                else:
                    # A margin of the region is at most two per cent too large, so its edge lies inside by that.
                    assert not (judged.stable and judged.disk_margin >= 1.02 * limit)


@pytest.mark.slow
def test_below_the_least_damping_no_mass_is_stable(region):
    """The region tapers off to a tip: a scan of the masses that is coarser than the tip ended 9 % above it."""
    problem = avc.load_admittance("admittance/cobot")
    analysis = HandleAnalysis(problem)
    stable = {}
    for factor in (0.98, 1.005):
        laws = [
            {"mass_kg": float(mass), "damping_ns_per_m": factor * region.least_damping_ns_per_m}
            for mass in np.geomspace(0.6, 1.0, 150)
        ]
        # Margins at the corners alone sort out most laws; then searches of the ranges decide.
        hopeful = [law for law in laws if analysis.rough_margin(problem.law.admittance.model_copy(update=law))]
        stable[factor] = any(avc.certify_admittance(problem, law=law, remedies=False).stable for law in hopeful)
    assert stable == {0.98: False, 1.005: True}


@pytest.mark.slow
def test_the_lines_that_are_drawn_between_dampings_are_stable(region):
    """An edge bends both ways: a straight line between two points of it may leave the stable laws."""
    problem = avc.load_admittance("admittance/cobot")
    hand, contact = problem.hands, problem.contact
    springs = np.geomspace(hand.stiffness_n_per_m[0], hand.stiffness_n_per_m[1] + contact.stiffness_n_per_m[1], 9)
    dampings = np.add(hand.damping_ns_per_m, contact.damping_ns_per_m)
    sums = [(m, b, k) for m in hand.mass_kg for b in dampings for k in springs]
    sums += [(0.0, contact.damping_ns_per_m[0], k) for k in springs if k <= contact.stiffness_n_per_m[1]]
    assert np.isnan(region.least_kg).sum() < len(region.least_kg) / 2
    for edge in (region.least_kg, region.largest_kg):
        known = np.isfinite(edge) & (edge > 0)
        for row in np.flatnonzero(known[:-1] & known[1:])[::2]:
            for share in (0.3, 0.7):
                mass, damping = (
                    float(values[row] ** (1 - share) * values[row + 1] ** share)
                    for values in (edge, region.damping_ns_per_m)
                )
                law = with_law(problem, mass, damping)
                assert max(largest_pole(PlainDevice.of(law, *point)) for point in sums) < 1


def test_of_each_scan_the_longest_run_is_bisected():
    scan = np.geomspace(1.0, 128.0, 8)
    ends = np.array([[3.0, 50.0], [0.5, 5.0], [200.0, 300.0], [20.0, 500.0]])

    def holds(values, rows):
        return (values >= ends[rows, 0]) & (values <= ends[rows, 1])

    held = np.array([holds(scan, row) for row in range(4)])
    held[0, 0] = True
    spans = held_spans(held, holds, scan)
    assert spans.low == pytest.approx([3.0, 0.0, math.nan, 20.0], rel=1e-3, nan_ok=True)
    assert spans.high == pytest.approx([50.0, 5.0, math.nan, math.inf], rel=1e-3, nan_ok=True)
    assert (spans.low[[0, 3]] >= ends[[0, 3], 0]).all()
    assert (spans.high[:2] <= ends[:2, 1]).all()


@pytest.mark.slow
def test_the_region_is_drawn_and_printed(region, tmp_path):
    assert region.least_sound_damping_ns_per_m > region.least_damping_ns_per_m > 0
    path = tmp_path / "region.svg"
    avc.figures.save_figure(avc.figures.draw_mass_width(region), path)
    assert "virtual mass" in path.read_text(encoding="utf-8")
    assert "Sound from" in str(region)
    assert region.document()["sound_least_kg"]


@pytest.mark.slow
def test_the_file_that_is_written_has_the_law_and_is_deployable(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["recommend", "admittance/pedal", "--out", "pedal.toml"]) == 0
    said = capsys.readouterr().out
    assert "Least damping" in said
    assert main(["certify", "pedal.toml"]) == 0
    law = avc.load_admittance("pedal.toml").law.admittance
    assert (law.stiffness_n_per_m, law.cutoff_hz) == (8000.0, 60.0)


def test_the_margin_of_many_laws_is_that_of_each_loop():
    problem = avc.load_admittance("admittance/cobot")
    pairs = HandleAnalysis(problem).pairs[:6]
    response = VelocityResponse(pairs)
    period = problem.device.sample_time_s
    masses, dampings = np.array([0.9, 3.0, 12.0]), np.array([70.0, 120.0, 300.0])
    many = response.disk_margins(virtual_mass_law(masses, dampings, period, 40.0, 30.0))
    for mass, damping, margin in zip(masses, dampings, many, strict=True):
        loop = OpenLoop.around(plants_of(pairs), virtual_mass_law(mass, damping, period, 40.0, 30.0))
        assert margin == pytest.approx(2 / loop.swings().max(), rel=0.03)


def test_a_span_is_the_longest_run_with_its_ends():
    scan = np.geomspace(1e-2, 1e2, 33)
    inside = held_span(lambda x: ((x > 0.5) & (x < 7.0)) | (x > 80.0), scan)
    assert (inside.low, inside.high) == pytest.approx((0.5, 7.0), rel=1e-3)
    whole = held_span(lambda x: x > 0, scan)
    assert (whole.low, whole.high) == (0.0, math.inf)
    assert math.isnan(held_span(lambda x: x < 0, scan).low)


def test_options_of_walls_and_couplings_are_refused(capsys):
    assert main(["recommend", "admittance/cobot", "--stiffest"]) == 2
    assert "have no force sensor" in capsys.readouterr().err
    assert main(["recommend", "admittance/cobot", "--out", "c.json"]) == 2
    assert "allowed: .toml" in capsys.readouterr().err
    assert main(["recommend", "figure5", "--out", "c.toml"]) == 2
    assert "allowed: .json" in capsys.readouterr().err


@pytest.mark.slow
def test_a_sensor_of_coarse_steps_gets_a_damping_at_which_the_handle_rests():
    """One step of the sensor moves a free handle at f/B, noise at the rms of a simulated law: both below 5 mm/s."""
    coarse = avc.load_admittance("admittance/cobot").changed(
        device={"force_sensor": {"resolution_n": 1.0, "noise_rms_n": 1.5}}
    )
    found = avc.recommend_admittance(coarse)
    assert found.passed
    law, period_s = found.law, coarse.device.sample_time_s
    assert 1.0 / law.damping_ns_per_m < 5e-3
    keeps = math.exp(-2 * math.pi * law.cutoff_hz * period_s) if law.cutoff_hz else 0.0
    filtered = velocity = 0.0
    speeds = []
    for force in np.random.default_rng(3).normal(0.0, math.hypot(1.5, 1 / math.sqrt(12)), 200_000):
        filtered = keeps * filtered + (1 - keeps) * force
        velocity = (law.mass_kg * velocity + period_s * filtered) / (law.mass_kg + law.damping_ns_per_m * period_s)
        speeds.append(velocity)
    assert 3 * np.std(speeds[1000:]) < 5e-3 * 1.05


def pressing_arm(ratio):
    """An arm of 15 Hz whose sensor is damped by a ratio, in loose and firm hands that press against 20 kN/m."""
    sensor = {"stiffness_n_per_m": 2e5, "damping_ratio": ratio, "handle_mass_kg": 1.0}
    device = {"drive": "velocity", "drive_bandwidth_hz": 15.0, "sample_time_s": 2e-3, "delay_samples": 2}
    return avc.AdmittanceProblem.model_validate(
        {
            "device": {**device, "force_sensor": sensor},
            "law": {"admittance": {"mass_kg": 1.0, "damping_ns_per_m": 1.0}},
            "hands": {"mass_kg": [0.5, 2.0], "damping_ns_per_m": [5.0, 30.0], "stiffness_n_per_m": [100.0, 800.0]},
            "contact": {"stiffness_n_per_m": [0.0, 2e4], "damping_ns_per_m": 5.0},
        }
    )


def carried(pair):
    return tuple(float(value[0]) for value in (pair[1].mass_kg, pair[1].damping_ns_per_m, pair[1].stiffness_n_per_m))


def with_law(problem, mass, damping):
    return problem.changed(law={"admittance": {"mass_kg": float(mass), "damping_ns_per_m": float(damping)}})


@pytest.mark.parametrize("ratio", first([0.001, 0.02, 0.3]))
def test_a_margin_of_the_region_is_that_of_a_loop_on_a_very_fine_grid(ratio):
    problem = pressing_arm(ratio)
    pairs = HandleAnalysis(problem).pairs[::3]
    masses, dampings = np.array([36.0, 120.0, 400.0]), np.array([5000.0, 13_000.0, 900.0])
    found = VelocityResponse(pairs).disk_margins(virtual_mass_law(masses, dampings, problem.device.sample_time_s))
    for mass, damping, margin in zip(masses, dampings, found, strict=True):
        loops = [PlainDevice.of(with_law(problem, mass, damping), *carried(pair)) for pair in pairs]
        exact = min(disk_margin(loop) for loop in loops if largest_pole(loop) < 1)
        assert exact * (1 - 1e-6) <= margin <= 1.02 * exact


def drawn_sums(problem, count):
    """What the handle may carry: the corners of hands and contacts together, and points drawn between them."""
    drawn = np.random.default_rng(2)
    hands, contact = problem.hands, problem.contact
    sums = []
    for touched in (0, 1):
        ranges = [
            hands.mass_kg,
            np.add(hands.damping_ns_per_m, np.multiply(touched, contact.damping_ns_per_m)),
            np.add(hands.stiffness_n_per_m, np.multiply(touched, contact.stiffness_n_per_m)),
        ]
        sums += [(m, b, k) for m in ranges[0] for b in ranges[1] for k in ranges[2]]
        sums += [tuple(drawn.uniform(*interval) for interval in ranges) for _ in range(count)]
    return sums


@pytest.mark.slow
def test_the_drawn_edge_has_a_sound_margin_in_loops_on_a_very_fine_grid():
    problem = pressing_arm(0.002)
    region = avc.mass_width(problem)
    sums = drawn_sums(problem, 6)
    assert len(region.confirmed_rows) == 6
    for row in region.confirmed_rows[::2]:
        mass, damping = region.sound_least_kg[row], region.damping_ns_per_m[row]
        if mass:
            margins = [disk_margin(PlainDevice.of(with_law(problem, mass, damping), *point)) for point in sums]
            assert min(margins) >= 0.2
            lighter = [disk_margin(PlainDevice.of(with_law(problem, 0.95 * mass, damping), *point)) for point in sums]
            assert min(lighter) < 0.2


@pytest.mark.slow
def test_hands_between_the_ends_of_their_ranges_move_the_edge():
    """A light handle on a stiff sensor turns by more than half a turn in a sample: hands between are the worst."""
    sensor = {"stiffness_n_per_m": 876_000.0, "damping_ratio": 0.005, "handle_mass_kg": 0.0734}
    device = {"drive": "velocity", "drive_bandwidth_hz": 12.2, "sample_time_s": 4e-3, "delay_samples": 1}
    problem = avc.AdmittanceProblem.model_validate(
        {
            "device": {**device, "force_sensor": sensor},
            "law": {"admittance": {"mass_kg": 1.0, "damping_ns_per_m": 1.0}},
            "hands": {"mass_kg": [0.121, 0.258], "damping_ns_per_m": [7.9, 11.3], "stiffness_n_per_m": [21.0, 89.0]},
            "contact": {"stiffness_n_per_m": [0.0, 7000.0], "damping_ns_per_m": 6.3},
        }
    )
    region = avc.mass_width(problem)
    row = region.confirmed_rows[0]
    law = region.sound_least_kg[row] or region.sound_largest_kg[row], region.damping_ns_per_m[row]
    loops = [PlainDevice.of(with_law(problem, *law), mass, 7.9, 21.0) for mass in np.linspace(0.121, 0.258, 60)]
    assert max(largest_pole(loop) for loop in loops) < 1
    assert min(disk_margin(loop) for loop in loops) >= 0.2
