"""Pieces of a law that are not linear, in its linear claim: beside loops in time that are written out here."""

import json
import math

import numpy as np
import pytest
from quick import first
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.cli import main

NOBODY = {"mass_kg": [0.0, 0.0], "damping_ns_per_m": [0.0, 0.0], "stiffness_n_per_m": [0.0, 0.0]}
DEVICE = {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "delay_samples": 1}


def free(law, **device):
    """A device that nobody holds, with a law that acts everywhere."""
    return {"device": {**DEVICE, **device}, "hands": NOBODY, "law": law}


def judged(law, **device):
    return avc.certify_law(free(law, **device))


def positions(problem, start_m, seconds, friction_n=0.0, start_m_per_s=0.0):
    """Positions at the samples, of difference velocity, in small steps of device and friction."""
    law, device = problem.law, problem.device
    period, parts = device.sample_time_s, 40
    compensation, mass = law.friction_compensation, device.mass_kg
    waiting = [0.0] * int(device.delay_samples)
    x, v, last, force, reached = start_m, start_m_per_s, start_m, 0.0, []
    step = period / parts
    for sample in range(int(seconds / period)):
        if sample % law.rate_divider == 0:
            speed = (x - last) / (period * law.rate_divider)
            last = x
            spring = math.copysign(max(abs(x) - law.dead_zone_m, 0.0), x)
            force = -law.stiffness_n_per_m * spring - (law.damping_ns_per_m + law.local_damping_ns_per_m) * speed
            if compensation is not None:
                force += compensation.force_n * min(max(speed / compensation.velocity_m_per_s, -1.0), 1.0)
        waiting.append(force)
        acting = waiting.pop(0)
        for _ in range(parts):
            push = acting - device.damping_ns_per_m * v
            if v == 0 and abs(push) <= friction_n:
                continue
            drag = friction_n * (math.copysign(1.0, v) if v else math.copysign(1.0, push))
            after = v + step * (push - drag) / mass
            after = 0.0 if friction_n and after * v < 0 else after
            x, v = x + step * (v + after) / 2, after
        reached.append(x)
        if start_m and abs(x) > 1e3 * start_m:
            break
    return np.array(reached)


def simulated(problem, start_m, seconds, friction_n=0.0):
    """Amplitude at the end over that at the start."""
    reached = np.abs(positions(problem, start_m, seconds, friction_n))
    return reached[-len(reached) // 8 :].max() / start_m


def test_friction_compensation_is_a_range_of_negative_dampers():
    law = {"stiffness_n_per_m": 300.0, "damping_ns_per_m": 3.0}
    push = {"friction_compensation": {"force_n": 0.05, "velocity_m_per_s": 0.05}}
    compensated = judged(law | push)
    steepest = judged(law | {"local_damping_ns_per_m": -1.0})
    assert compensated.released.spectral_radius == pytest.approx(steepest.released.spectral_radius, abs=1e-12)
    assert compensated.stable
    # Its largest force, without friction, is that at which all of the damping is compensated.
    largest = compensated.intervals["friction_compensation.force_n"][1]
    least_b_p = steepest.intervals["local_damping_ns_per_m"][0]
    assert largest == pytest.approx(-0.05 * least_b_p, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_law_that_is_called_stable_never_swings_without_friction(seed):
    """Of drawn compensations near their limit, the stable ones decay and those beyond it do not."""
    draw = np.random.default_rng(seed)
    law = {"stiffness_n_per_m": draw.uniform(50, 600), "damping_ns_per_m": draw.uniform(1.0, 4.0)}
    speed = draw.uniform(0.01, 0.05)
    law["friction_compensation"] = {"force_n": 0.02, "velocity_m_per_s": speed}
    largest = judged(law).intervals["friction_compensation.force_n"][1]
    for share in (0.9, 1.15):
        law["friction_compensation"]["force_n"] = share * largest
        found = judged(law)
        assert found.stable == (share < 1)
        small_m = 0.02 * speed / math.sqrt(law["stiffness_n_per_m"] / 0.12)
        decays = simulated(found.problem, small_m, 4.0) < 1
        assert decays == found.stable


@pytest.mark.slow
def test_a_dead_zone_is_a_range_of_springs_from_none():
    """A negative damper that the spring alone holds back is not stable where the spring is dead."""
    hand = {"mass_kg": [0.1, 0.1], "damping_ns_per_m": [0.1, 0.1], "stiffness_n_per_m": [100.0, 100.0]}
    law = {"stiffness_n_per_m": 800.0, "damping_ns_per_m": 2.0}
    whole = avc.certify_law({"device": DEVICE, "hands": hand, "law": law})
    dead = avc.certify_law({"device": DEVICE, "hands": hand, "law": law | {"dead_zone_m": 0.01}})
    none = avc.certify_law({"device": DEVICE, "hands": hand, "law": {"damping_ns_per_m": 2.0}})
    assert dead.held.spectral_radius == pytest.approx(
        max(whole.held.spectral_radius, none.held.spectral_radius), abs=1e-9
    )


@pytest.mark.parametrize("divider", [2, 5])
def test_a_slower_law_is_judged_over_its_own_period(divider):
    """The period of a law lifted sample by sample: poles to the period's power."""
    law = {"stiffness_n_per_m": 150.0, "damping_ns_per_m": 1.5, "rate_divider": divider}
    found = judged(law)
    period, slow = 1e-3, 1e-3 * divider
    both = np.zeros((3, 3))
    both[:2, :2], both[1, 2] = [[0, 1], [0, -0.8 / 0.12]], 1 / 0.12
    move = expm(both * period)[:2]

    def whole(state):
        x, waiting, last = state[:2], state[2], state[3]
        force = -150.0 * x[0] - 1.5 * (x[0] - last) / slow
        place = x[0]
        for _ in range(divider):
            x = move @ [*x, waiting]
            waiting = force
        return np.array([*x, waiting, place])

    poles = np.linalg.eigvals(np.stack([whole(unit) for unit in np.eye(4)], axis=1))
    assert found.released.spectral_radius == pytest.approx(np.abs(poles).max(), abs=1e-9)


@pytest.mark.slow
def test_a_slower_law_meets_the_longest_delay_of_the_range():
    """The delay is stated in samples of the device, though the law runs at every second of them."""
    law = {"stiffness_n_per_m": 150.0, "damping_ns_per_m": 1.5, "rate_divider": 2}

    def radius(delay, **ranges):
        device = DEVICE | {"delay_samples": delay, "range": ranges}
        return avc.certify_law({"device": device, "law": law}, limits=False, remedies=False).held.spectral_radius

    longest = radius(3.0)
    assert longest > radius(1.0) + 1e-4
    assert radius(1.0, delay_samples=[1.0, 3.0]) == pytest.approx(longest, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.03, 0.06, 0.09])
def test_the_swing_that_friction_brings_to_rest_is_that_of_a_simulation(damping):
    """75 g, 0.04 N, k 500, 1 kHz: within 8 % below it rests, above it swings on."""
    device = {"mass_kg": 0.075, "damping_ns_per_m": damping, "delay_samples": 0, "coulomb_friction_n": 0.04}
    device["range"] = {"coulomb_friction_n": [0.04, 0.06]}
    stated = free({"stiffness_n_per_m": 500.0}, **device)
    found = avc.certify_law(stated, lean_on_friction=True)
    assert not found.stable
    swing_m = found.friction.swing_m
    assert simulated(found.problem, 0.92 * swing_m, 3.0, friction_n=0.04) < 0.7
    assert simulated(found.problem, 1.08 * swing_m, 6.0, friction_n=0.04) > 1.0
    assert not avc.certify_law(stated).passed


@pytest.mark.parametrize(
    ("stiffness", "share", "rests"),
    first(
        [
            (0.0, 0.8, True),
            (0.0, 0.95, True),
            (0.0, 1.05, False),
            (0.0, 1.5, False),
            (0.1, 0.95, True),
            (0.1, 1.5, False),
        ]
    ),
)
def test_a_drift_rests_where_the_compensation_is_below_the_friction(stiffness, share, rests):
    """Without a spring, or with a soft one, the growing pole is real: a push of any speed is brought to rest."""
    friction_n = 0.4
    compensation = {"force_n": share * friction_n, "velocity_m_per_s": 0.02}
    law = {"stiffness_n_per_m": stiffness, "friction_compensation": compensation}
    known = {"coulomb_friction_n": friction_n, "range": {"coulomb_friction_n": [friction_n, friction_n]}}
    found = avc.certify_law(free(law, **known), lean_on_friction=True, limits=False)
    assert not found.stable
    assert found.passed == rests
    for speed in (0.1, 1.0):
        moved = positions(found.problem, 0.0, 4.0, friction_n, start_m_per_s=speed)[-500:]
        assert (np.ptp(moved) < 1e-9) == rests


@pytest.mark.slow
def test_half_of_a_declared_friction_counts_where_no_range_is_declared():
    law = {"stiffness_n_per_m": 500.0}
    device = {"mass_kg": 0.075, "damping_ns_per_m": 0.06, "delay_samples": 0, "coulomb_friction_n": 0.04}
    half = avc.certify_law(free(law, **device), lean_on_friction=True).friction
    assert half.friction_n == pytest.approx(0.02)
    none = avc.certify_law(free(law, **(device | {"coulomb_friction_n": 0.0})), lean_on_friction=True)
    assert none.friction.swing_m == 0
    assert not none.passed


def test_time_between_steps_is_judged_as_its_longest_window_and_as_a_difference():
    device = {"encoder_resolution_m": 1e-5}
    law = {"stiffness_n_per_m": 300.0, "damping_ns_per_m": 4.0}
    radii = {
        name: judged(law | {"velocity": velocity}, **device).released.spectral_radius
        for name, velocity in {
            "ticks": {"kind": "ticks", "timeout_s": 0.004},
            "window": {"kind": "window", "samples": 8},
            "difference": {"kind": "difference"},
        }.items()
    }
    assert radii["ticks"] in (radii["window"], radii["difference"])


@pytest.mark.slow
def test_it_is_typed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "wheel.toml"
    file.write_text(
        '[device]\nmotion = "rotary"\nhandle_radius_m = 0.15\ninertia_kgm2 = 0.02\ndamping_nms_per_rad = 0.02\n'
        "coulomb_friction_nm = 0.1\nposition_noise_rms_rad = 1e-5\n",
        encoding="utf-8",
    )
    typed = ["certify", "wheel.toml", "--k", "8", "--b", "0.1", "--friction-compensation", "0.02N.m, 1rad/s"]
    assert main([*typed, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["law"]["friction_compensation"] == {"torque_nm": 0.02, "velocity_rad_per_s": 1.0}
    assert main(typed) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "pushes with 20.0 mN.m, up to the least friction, 50.0 mN.m" in text
    assert "not felt (limit" in text
    assert main([*typed[:-1], "0.02 N.m", "--json"]) in (0, 1)
    document = json.loads(capsys.readouterr().out)
    assert document["law"]["friction_compensation"]["velocity_rad_per_s"] == pytest.approx(0.02 / 0.15)
    assert main([*typed[:-1], "much"]) == 2
    assert "--friction-compensation" in capsys.readouterr().err
    assert main(["certify", "figure5", "--k", "200", "--b", "2", "--b-p", "-0.1", "--json"]) in (0, 1)
    assert json.loads(capsys.readouterr().out)["law"]["local_damping_ns_per_m"] == -0.1
