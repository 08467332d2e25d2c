"""Joints that an engine moves beside a loop that is written out step by step."""

import math

import numpy as np
import pytest
from lifted_joint import map_of_step, radius
from quick import first

import avc_casadi as avc
from avc_casadi.loops.joint import JointFamily, JointGains

INTEGRATORS = ("semi-implicit", "explicit", "exact", "implicit-damping", "implicit")


def joint(**keys):
    return {"simulation": {"tool_mass_kg": 0.01, "step_s": 0.005, **keys}}


def drawn(seed):
    """A joint, its gains and how the engine moves it, most of them not far from their limit."""
    rng = np.random.default_rng(seed)
    mass, step_s = 10 ** rng.uniform(-4, 1), 10 ** rng.uniform(-3.5, -1.5)
    integrator = INTEGRATORS[seed % 5]
    late, substeps = int(rng.integers(0, 3)), int(rng.integers(1, 5))
    difference = bool(rng.integers(0, 2)) and not integrator.startswith("implicit")
    kp = mass * (rng.uniform(0.1, 1.5) / step_s / (1 + late)) ** 2
    kd = mass / step_s * rng.uniform(0.05, 1.2) / (1 + late)
    drag = rng.uniform(0, 0.2) * mass / step_s
    how = {"integrator": integrator, "late": late, "substeps": substeps, "difference": difference}
    return (mass, drag, step_s, kp, kd), how


def of_engine(mass, drag, step_s, *, integrator, late, substeps, spring=0.0):
    contact = {"contact_stiffness_n_per_m": (spring, spring), "contact_damping_ns_per_m": 0.0} if spring else {}
    return joint(
        tool_mass_kg=mass,
        tool_damping_ns_per_m=drag,
        step_s=step_s,
        integrator=integrator,
        steps_late=late,
        substeps=substeps,
        **contact,
    )


@pytest.mark.parametrize("seed", range(40))
def test_the_poles_are_those_of_a_loop_in_time(seed):
    (*body, kp, kd), how = drawn(seed)
    difference = how.pop("difference")
    spring = 0.3 * kp if seed % 3 == 0 else 0.0
    family = JointFamily(avc.Problem(**of_engine(*body, **how, spring=spring), name="joint").end.engine)
    ours = family.loops(JointGains(kp, kd, difference))
    expected = {at: radius(*body, kp, kd, **how, difference=difference, spring=at) for at in (0.0, spring)}
    for free, value in zip(ours.free, ours.radius, strict=True):
        assert value == pytest.approx(expected[0.0 if free else spring], rel=1e-9)


@pytest.mark.parametrize("seed", first(range(10), 4))
def test_its_limits_are_those_of_a_loop_in_time(seed):
    """At 0.99 of an end the loop decays, at 1.01 it grows, for each number of the joint."""
    (mass, drag, step_s, kp, kd), how = drawn(seed)
    difference = how.pop("difference")
    found = avc.certify_joint(of_engine(mass, drag, step_s, **how), kp, kd, difference=difference)

    def grows(**change):
        values = {"mass_kg": mass, "drag": drag, "step_s": step_s, "kp": kp, "kd": kd, **change}
        return radius(*values.values(), **how, difference=difference) >= 1

    assert found.stable == (not grows())
    limits = {"kp": found.stiffness_n_per_m, "kd": found.damping_ns_per_m}
    limits |= {"step_s": found.step_s, "mass_kg": found.mass_kg}
    bounds = (0.0, math.inf, 1e-7, 10.0, 1e-9, 1e6)
    for name, ends in limits.items():
        for end, inside in zip(ends or (), (1.01, 0.99), strict=False):
            if end not in bounds:
                assert not grows(**{name: end * inside}), (name, end)
                assert grows(**{name: end * (2 - inside)}), (name, end)


@pytest.mark.slow
def test_values_of_two_joints_are_right():
    """kp < 2 (2 I + h kd)/h^2 of implicit-damping; and a drive with an encoder a sample late."""
    mujoco = avc.certify_joint(joint(integrator="implicit-damping"), kp=5000.0, kd=18.97)
    assert mujoco.stiffness_n_per_m[1] == pytest.approx(2 * (2 * 0.01 + 0.005 * 18.97) / 0.005**2, rel=1e-6)
    assert round(mujoco.stiffness_n_per_m[1]) == 9188
    drive = joint(tool_mass_kg=0.00361, step_s=1e-3, integrator="exact", steps_late=1)
    late = avc.certify_joint(drive, kp=14.25, kd=0.907, difference=True)
    assert late.damping_ratio == pytest.approx(0.713, abs=5e-4)
    assert late.damping_ratio_hz == pytest.approx(58.3, abs=0.05)


def test_its_disk_margin_is_that_of_the_open_loop():
    """2/max |(1 - L)/(1 + L)| of L(z) = (kp + kd (1 - 1/z)/T) P(z)/z, of a drive with an encoder."""
    mass, step_s, kp, kd = 0.00361, 1e-3, 14.25, 0.907
    z = np.exp(1j * np.geomspace(1e-4, np.pi, 200_000))
    plant = step_s**2 / (2 * mass) * (z + 1) / (z - 1) ** 2
    gain = (kp + kd * (1 - 1 / z) / step_s) * plant / z
    expected = 2 / np.abs((1 - gain) / (1 + gain)).max()
    drive = joint(tool_mass_kg=mass, step_s=step_s, integrator="exact", steps_late=1)
    assert avc.certify_joint(drive, kp=kp, kd=kd, difference=True).disk_margin == pytest.approx(expected, rel=2e-3)


def test_the_worst_mass_and_step_of_the_ranges_decide():
    """Light joints limit kd, long steps both; between the corners nothing is worse."""
    found = avc.certify_joint(joint(tool_mass_kg=[0.003, 0.01], step_s=[0.002, 0.005]), kp=20.0, kd=0.5)
    rng = np.random.default_rng(1)
    kd = found.damping_ns_per_m[1]
    for mass, step_s in rng.uniform((0.003, 0.002), (0.01, 0.005), (200, 2)):
        assert radius(mass, 0.0, step_s, 20.0, 0.99 * kd) < 1
    assert radius(0.003, 0.0, 0.005, 20.0, 1.01 * kd) > 1


def well_damped(mass, step_s, kp, kd, **how):
    poles = np.linalg.eigvals(map_of_step(mass, 0.0, step_s, kp, kd, **how)).astype(complex)
    poles = poles[np.abs(poles) > 1e-9]
    alternates = np.abs(np.angle(poles)) > np.pi - 1e-6
    swings = (np.abs(np.angle(poles)) > 1e-6) & ~alternates
    rates = np.log(poles[swings])
    ratio = (-rates.real / np.abs(rates)).min(initial=1.0)
    return np.abs(poles).max() < 1 and ratio >= 0.7 - 1e-9 and np.abs(poles[alternates]).max(initial=0.0) < 0.4


@pytest.mark.parametrize("how", first([{}, {"late": 1}, {"integrator": "exact", "substeps": 4}]))
def test_no_stiffer_kp_is_as_well_damped_and_robust(how):
    """Of a grid of kd at a kp 2 % larger none has a damping ratio of 0.7 with each mass and a disk margin of 0.3."""
    masses, step_s = (0.003, 0.01), 0.002
    keys = {"late": "steps_late"}
    stated = joint(tool_mass_kg=masses, step_s=step_s, **{keys.get(key, key): value for key, value in how.items()})
    best = avc.recommend_joint(stated).stiffest
    kp, kd = best.gains.kp, best.gains.kd
    assert best.disk_margin >= 0.3
    assert all(well_damped(mass, step_s, kp, kd, **how) for mass in masses)
    factors = (1 + 0.15 * np.exp(1j * np.linspace(0, np.pi, 90))) / (1 - 0.15 * np.exp(1j * np.linspace(0, np.pi, 90)))
    for larger in kd * np.geomspace(0.3, 10, 120):
        damped = all(well_damped(mass, step_s, 1.02 * kp, larger, **how) for mass in masses)
        robust = damped and all(
            np.abs(np.linalg.eigvals(complex_map(mass, step_s, 1.02 * kp, larger, factor, how))).max() < 1
            for mass in masses
            for factor in factors
        )
        assert not robust


def complex_map(mass, step_s, kp, kd, factor, how):
    """The map is linear in the gains of an engine that solves for none of them."""
    base, one = (map_of_step(mass, 0.0, step_s, scale * kp, scale * kd, **how) for scale in (0.0, 1.0))
    return base + factor * (one - base)


def test_a_required_frequency_is_that_of_the_heaviest_joint():
    found = avc.recommend_joint(joint(tool_mass_kg=[0.003, 0.01]), frequency_hz=3.0).at_frequency
    assert math.sqrt(found.gains.kp / 0.01) / (2 * math.pi) == pytest.approx(3.0)
    assert found.damping_ratio == pytest.approx(0.7, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exchange": "late"}, "exchange: is of a tool that a device moves"),
        ({"tool_mass_kg": None}, "tool_mass_kg: is missing"),
        ({"position_scale": 2.0}, "position_scale: is of a tool that a device moves"),
    ],
)
def test_what_is_no_part_of_a_joint_is_refused(change, message):
    keys = {"tool_mass_kg": 0.01, "step_s": 0.005, **change}
    table = {key: value for key, value in keys.items() if value is not None}
    with pytest.raises(avc.InputError, match=message):
        avc.certify_joint({"simulation": table}, kp=1.0, kd=1.0)


def test_gains_are_of_the_table_or_given():
    stated = joint() | {"law": {"stiffness_n_per_m": 20.0, "damping_ns_per_m": 0.5}}
    assert avc.certify_joint(stated).gains == JointGains(20.0, 0.5)
    assert avc.certify_joint(stated, kp=30.0).gains == JointGains(30.0, 0.5)
    with pytest.raises(avc.InputError, match="is missing, and there is no table"):
        avc.certify_joint(joint())
    with pytest.raises(avc.InputError, match="integral_n_per_m_s: is no part of the law of a joint"):
        avc.certify_joint(joint() | {"law": {"stiffness_n_per_m": 1.0, "integral_n_per_m_s": 1.0}})
    with pytest.raises(avc.InputError, match="solves for the velocity itself"):
        avc.certify_joint(joint(integrator="implicit-damping"), kp=1.0, kd=1.0, difference=True)


def test_a_file_of_a_joint_is_read_and_written():
    text = "[simulation]\ntool_inertia_kgm2 = [0.003, 0.01]\nstep_s = 0.005\nsteps_late = 1\n"
    stated = avc.parse_problem(text)
    assert not stated.units.linear
    assert avc.parse_problem(avc.dump_problem(stated)) == stated
    assert stated.changed(simulation={"step_s": 0.002}).end.engine.step_s == (0.002, 0.002)
    with pytest.raises(avc.UnsupportedError, match="is a joint that an engine moves"):
        avc.recommend(stated)


@pytest.mark.parametrize("kd", first([2.0, 0.01]))
def test_a_joint_that_any_damper_damps_is_stable_from_no_damper_on(kd):
    joint = {"simulation": {"tool_inertia_kgm2": 0.005, "step_s": 1e-3, "integrator": "semi-implicit"}}
    low, high = avc.certify_joint(joint, kp=100.0, kd=kd).damping_ns_per_m
    assert 0.0 < low <= 1.1e-6 * kd  # the least that is judged: not where rounding leaves the root
    assert high == pytest.approx(9.95, rel=1e-6)
