"""Force feedback: loops against ones that are written out a second time, the ideal limit of a transmission, limits."""

import math

import numpy as np
import pytest
from admittance_loop import PlainForceDevice, growth, handle_impedance, largest_pole, swings

import avc_casadi as avc
from avc_casadi.claims.force_feedback import IdealLimit
from avc_casadi.claims.handle_port import HandleLoop
from avc_casadi.claims.law_limits import BeyondLimit, LimitSide
from avc_casadi.loops.handle import HandleFamily, plants_of
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed
from avc_casadi.model.hands import Hand
from avc_casadi.present import rows
from avc_casadi.present.row import Mark

CARRIED = ((0.0, 0.0, 0.0), (0.6, 8.0, 500.0), (2.0, 5.0, 2e4), (0.0, 20.0, 1e6))


def rail(law, **device):
    """A rail of 4 kg with a soft grip, in a hand that may press against 10 kN/m."""
    sensor = {"stiffness_n_per_m": 2e4, "damping_ratio": 0.2, "handle_mass_kg": 0.3, **device.pop("sensor", {})}
    usual = {"mass_kg": 4.0, "damping_ns_per_m": 8.0, "sample_time_s": 5e-4, "delay_samples": 1}
    return {
        "device": {"drive": "force", **usual, **device, "force_sensor": sensor},
        "law": law,
        "hands": {"mass_kg": [0.1, 1.0], "damping_ns_per_m": [3.0, 20.0], "stiffness_n_per_m": [100.0, 1000.0]},
        "contact": {"stiffness_n_per_m": [0.0, 1e4], "damping_ns_per_m": 5.0},
    }


def radius(problem, mass_kg, damping, stiffness):
    carried = Hand(np.array([mass_kg]), np.array([damping]), np.array([stiffness]))
    body = Body.of(plants_of([(problem.device, carried)])).flat()
    return float(closed(body, problem.law.law(problem.device.sample_time_s)).radius[0])


def drawn(index):
    """A device and a law, drawn at random."""
    random = np.random.default_rng([2911, index])

    def even(low, high):
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    device = {
        "mass_kg": even(0.05, 20.0),
        "damping_ns_per_m": random.choice([0.0, even(0.1, 20.0)]),
        "sample_time_s": float(random.choice([2.5e-4, 1e-3, 2e-3])),
        "delay_samples": float(random.choice([0.0, 1.0, random.uniform(0.1, 3.0)])),
        "sensor": {"stiffness_n_per_m": even(3e3, 3e6), "handle_mass_kg": even(0.02, 1.0)},
    }
    if random.random() < 0.5:
        device["amplifier_bandwidth_hz"] = even(50.0, 2000.0)
    if random.random() < 0.5:
        device["resonance"] = {"frequency_hz": even(20.0, 200.0), "damping_ratio": 0.03, "mass_ratio": even(0.1, 0.9)}
    law = {"force_feedback": {"gain": even(0.1, 10.0)}, "damping_ns_per_m": even(1.0, 40.0)}
    if random.random() < 0.5:
        law["force_feedback"]["cutoff_hz"] = even(5.0, 300.0)
    if random.random() < 0.5:
        law["stiffness_n_per_m"] = even(10.0, 2000.0)
        law["local_damping_ns_per_m"] = even(0.1, 5.0)
    return avc.ForceFeedbackProblem.model_validate(rail(law, **device))


@pytest.mark.parametrize("index", range(20))
def test_the_loop_is_that_of_a_second_program(index):
    problem = drawn(index)
    for carried in CARRIED:
        plain = PlainForceDevice.of(problem, *carried)
        assert radius(problem, *carried) == pytest.approx(largest_pole(plain), abs=1e-9)


@pytest.mark.parametrize("index", range(12))
def test_the_impedance_at_the_handle_is_that_of_a_loop_with_the_push_as_a_state(index):
    problem = drawn(index)
    period, plain = problem.device.sample_time_s, PlainForceDevice.of(problem)
    port = HandleLoop(problem.device, problem.law.law(period))
    hz = np.array([2.0, 7.0, 31.0, 0.37 / period])
    for found, frequency in zip(port.impedance(2 * math.pi * hz * period), hz.tolist(), strict=True):
        assert found == pytest.approx(handle_impedance(plain, frequency), rel=1e-8)


@pytest.mark.parametrize("gain", [1.0, 60.0])
def test_the_growth_is_that_of_a_simulation(gain):
    law = {"force_feedback": {"gain": gain, "cutoff_hz": 200.0}, "damping_ns_per_m": 20.0}
    problem = avc.ForceFeedbackProblem.model_validate(rail(law, amplifier_bandwidth_hz=1000.0))
    carried = (0.1, 5.0, 1e4)
    simulated = growth(PlainForceDevice.of(problem, *carried), 12_000)
    assert radius(problem, *carried) == pytest.approx(simulated, abs=1e-4)


@pytest.mark.slow
def test_the_largest_gain_is_one_of_the_whole_range():
    law = {"force_feedback": {"gain": 1.0, "cutoff_hz": 200.0}, "damping_ns_per_m": 20.0, "stiffness_n_per_m": 300.0}
    stated = avc.certify_force_feedback(rail(law, range={"mass_kg": [3.0, 5.0], "delay_samples": [0.5, 1.5]}))
    low, high = stated.gain_range
    assert low == 0.0
    drawn_from = np.random.default_rng(1)

    def worst(gain):
        changed = stated.problem.changed(law={"force_feedback": {"gain": gain}})
        sizes = []
        for side in HandleFamily.of(changed).sides:
            boxes = list(side.carried.values())
            ends = [(a, b, c) for a in boxes[0] for b in boxes[1] for c in boxes[2]]
            points = [tuple(drawn_from.uniform(*box) for box in boxes) for _ in range(20)]
            devices = [changed.device.with_values(mass_kg=m, delay_samples=d) for m in (3.0, 5.0) for d in (0.5, 1.5)]
            for device in devices:
                known = changed.model_copy(update={"device": device})
                sizes += [largest_pole(PlainForceDevice.of(known, *point)) for point in (*ends, *points)]
        return max(sizes)

    assert worst(0.99 * high) < 1
    assert worst(1.01 * high) > 1


@pytest.mark.parametrize("share", [0.3, 0.5, 0.75])
@pytest.mark.parametrize(("factor", "passive"), [(0.93, True), (1.07, False)])
def test_behind_a_transmission_an_ideal_loop_is_passive_down_to_the_mass_that_carries_the_sensor(
    share, factor, passive
):
    """Half of the device's mass where the transmission halves it, as Colgate and Hogan are cited. 1 MHz is ideal."""
    resonance = {"frequency_hz": 60.0, "damping_ratio": 3e-3, "mass_ratio": share}
    sensor = {"stiffness_n_per_m": 1e6, "damping_ratio": 0.0}
    device = {"sample_time_s": 1e-6, "delay_samples": 0, "damping_ns_per_m": 0.5, "resonance": resonance}
    # The sum 1 + g counts, as 4 kg/(1 + g) is the apparent mass.
    law = {"force_feedback": {"gain": factor / share - 1}}
    problem = avc.ForceFeedbackProblem.model_validate(rail(law, **device, sensor=sensor))
    limit = IdealLimit.of(problem)
    assert limit.apparent_mass_kg == pytest.approx(4.0 * share)
    assert limit.gain == pytest.approx(1 / share - 1)
    port = HandleLoop(problem.device, problem.law.law(1e-6))
    about = 2 * math.pi * np.linspace(58.8, 61.2, 400) * 1e-6
    assert bool((port.impedance(about).real >= 0).all()) == passive


@pytest.mark.slow
def test_half_the_mass_of_a_device_with_a_transmission_swings_on_a_contact():
    """A complaint that comes again: a quarter of the mass grows on a stiff contact, 70 % of it does not."""
    resonance = {"frequency_hz": 30.0, "damping_ratio": 0.02, "mass_ratio": 0.5}
    device = {"resonance": resonance, "sample_time_s": 1e-4, "delay_samples": 1}

    def stable(gain):
        law = {"force_feedback": {"gain": gain}, "damping_ns_per_m": 20.0}
        return avc.certify_force_feedback(rail(law, **device)).stable

    assert stable(1 / 0.7 - 1)
    assert not stable(3.0)


@pytest.mark.slow
def test_a_slow_hand_moves_the_mass_over_one_plus_the_gain():
    law = {"force_feedback": {"gain": 1.5, "cutoff_hz": 200.0}, "damping_ns_per_m": 20.0}
    stated = avc.certify_force_feedback(rail(law))
    assert stated.apparent_mass_kg == pytest.approx(4.0 / 2.5)
    plain = PlainForceDevice.of(stated.problem)
    hz = 0.5
    moved = handle_impedance(plain, hz)
    assert moved.imag / (2 * math.pi * hz) == pytest.approx(4.0 / 2.5 + 0.3, rel=0.05)
    assert moved.real == pytest.approx((8.0 + 20.0) / 2.5, rel=0.05)


@pytest.mark.slow
def test_the_gain_is_the_cause_where_the_rest_of_the_law_is_stable_without_it():
    law = {"force_feedback": {"gain": 46.0, "cutoff_hz": 200.0}, "damping_ns_per_m": 20.0}
    stated = avc.certify_force_feedback(rail(law, amplifier_bandwidth_hz=1000.0))
    assert stated.beyond == BeyondLimit(LimitSide.ABOVE, "force_feedback.gain", 46.0, stated.gain_range[1])
    assert stated.intervals["force_feedback.cutoff_hz"][0] > 200.0
    soft = avc.certify_force_feedback(rail({"damping_ns_per_m": 2e4}))
    assert (soft.beyond.side, soft.beyond.key) == (LimitSide.ABOVE, "damping_ns_per_m")
    assert "Stable gain" not in str(soft)
    assert "Ideal loop" not in str(soft)


@pytest.mark.slow
def test_a_low_pass_that_no_cutoff_makes_unstable_has_no_limit():
    law = {"force_feedback": {"gain": 0.02, "cutoff_hz": 200.0}, "damping_ns_per_m": 20.0}
    stated = avc.certify_force_feedback(rail(law))
    assert stated.intervals["force_feedback.cutoff_hz"] == (-math.inf, math.inf)
    low_pass = next(row for row in rows.force_feedback.certificate(stated).rows if row.label == "Stable low pass")
    assert low_pass.values == ("any",)


def test_check_names_what_lies_above_half_the_sample_rate_and_what_is_assumed():
    law = {"force_feedback": {"gain": 1.0, "cutoff_hz": 1500.0}, "damping_ns_per_m": 20.0}
    tables = rail(law, amplifier_bandwidth_hz=3000.0)
    del tables["hands"]
    problem = avc.ForceFeedbackProblem.model_validate(tables)
    named = [doubt.split(" ")[0] for doubt in rows.force_feedback.doubts_of(problem)]
    assert named == ["device.amplifier_bandwidth_hz", "law.force_feedback.cutoff_hz"]
    marks = {row.label: row.mark for row in rows.force_feedback.checked(problem, "rail.toml").rows}
    assert marks["Hands"] is Mark.CAUTION


@pytest.mark.slow
def test_a_device_without_a_wall_knows_its_noise_and_prints_its_rows():
    law = {"force_feedback": {"gain": 2.0}, "damping_ns_per_m": 20.0}
    stated = avc.certify_force_feedback(rail(law, sensor={"noise_rms_n": 0.1}, position_noise_rms_m=1e-6))
    assert stated.noise_n == pytest.approx(math.hypot(0.2, math.sqrt(2) * 20.0 / 5e-4 * 1e-6))
    text = str(stated)
    assert "Stable gain" in text
    assert "Ideal loop" in text
    assert stated.document()["gain_range"][0] == 0.0


@pytest.mark.slow
def test_force_feedback_that_rings_is_a_caution_with_the_changes_that_damp_it():
    light = avc.certify_force_feedback("admittance/lightened")
    worst = light.least_damped
    ratios, hz = swings(
        PlainForceDevice.of(light.problem, *map(sum, zip(worst.hand.values(), worst.contact.values(), strict=True)))
    )
    assert light.rings
    assert worst.law_damping_ratio < 0.2
    assert (ratios.min(), hz[ratios.argmin()]) == pytest.approx(
        (worst.law_damping_ratio, worst.law_damping_ratio_hz), rel=0.3
    )
    answer = rows.force_feedback.certificate(light)
    marks = {row.label: row.mark for row in answer.rows}
    assert marks["Deployable"] == marks["Damping ratio"] == Mark.CAUTION
    (remedy,) = light.damped_by
    assert remedy.key == "law.damping_ns_per_m"
    damped = avc.certify_force_feedback("admittance/lightened", law={"damping_ns_per_m": remedy.value})
    assert not damped.rings
    assert damped.damped_by == ()
    assert damped.disk_margin >= 0.2
