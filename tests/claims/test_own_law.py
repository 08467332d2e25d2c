"""A law of one's own beside loops that are written out here from the physics, and five published cases."""

import functools
import json
import math
import operator

import numpy as np
import pytest
from quick import first
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import dlti

import avc_casadi as avc
from avc_casadi.claims.impedance import PortMechanics
from avc_casadi.cli import main
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.model.ends import ToolGains


@functools.cache
def moved(plant, hand):
    """Position and velocity after a sample, from those before and the held force."""
    mass, damping, period, _ = plant
    m, d, spring = mass + hand[0], damping + hand[1], hand[2]
    return expm(period * np.array([[0, 1, 0], [-spring / m, -d / m, 1 / m], [0, 0, 0]]))[:2]


def closed(law, plant, hand, factor=1.0, more=0):
    """The loop: position, velocity, position before, filtered velocity, forces under way.

    The force that reaches the device is `factor` times what is asked for, `more` samples later.
    """
    (k, b, cutoff), (_, _, period, delay), moves = law, plant, moved(tuple(plant), tuple(hand))
    late, pole = delay + more, 0.0 if cutoff is None else math.exp(-2 * math.pi * cutoff * period)
    loop = np.zeros((4 + late, 4 + late), dtype=complex)
    loop[:2, :2], loop[2, 0] = moves[:, :2], 1.0
    loop[3, [0, 2, 3]] = (1 - pole) / period, -(1 - pole) / period, pole
    force = b * loop[3].copy()
    force[0] += k
    if late:
        loop[4], loop[np.arange(5, 4 + late), np.arange(4, 3 + late)] = force, 1.0
        loop[:2, -1] -= factor * moves[:, 2]
    else:
        loop[:2] -= factor * np.outer(moves[:, 2], force)
    return loop


def radius(law, plant, hand, **how):
    loop = closed(law, plant, hand, **how)
    if law[0] == hand[2] == 0:  # a loop of steps alone: its place changes nothing
        step = np.eye(len(loop))
        step[0, 2] = -1.0
        loop = np.delete(np.delete(step @ loop @ np.linalg.inv(step), 2, 0), 2, 1)
    return np.abs(np.linalg.eigvals(loop)).max()


def least_damped(law, plant, hand):
    poles = np.linalg.eigvals(closed(law, plant, hand))
    turns = np.abs(np.angle(poles))
    rates = np.log(poles[(turns > 1e-6) & (turns < math.pi - 1e-6) & (np.abs(poles) > 1e-9)]) / plant[2]
    if not len(rates):
        return 1.0, 0.0
    ratios = -rates.real / np.abs(rates)
    return ratios.min(), abs(rates[ratios.argmin()].imag) / (2 * math.pi)


def settled_s(law, plant, hand):
    """Time from an impact to the last depth beyond 2 % of the largest."""
    values, vectors = np.linalg.eig(closed(law, plant, hand))
    samples = np.arange(min(10**6, math.log(1e-4) / math.log(np.abs(values).max())))
    weights = vectors[0] * np.linalg.inv(vectors)[:, 1]
    depth = np.abs(weights @ values[:, None] ** samples)
    return plant[2] * (1 + np.flatnonzero(depth > 0.02 * depth.max()).max())


def loop_gain(law, plant, hand, turn):
    """Force over force at z = exp(j turn), part by part."""
    (k, b, cutoff), (_, _, period, delay), z = law, plant, np.exp(1j * turn)
    (xx, xv, x), (vx, vv, v) = moved(tuple(plant), tuple(hand))
    pole = 0.0 if cutoff is None else math.exp(-2 * math.pi * cutoff * period)
    position = ((z - vv) * x + xv * v) / ((z - xx) * (z - vv) - xv * vx)
    return (k + b * (1 - 1 / z) / period * (1 - pole) / (1 - pole / z)) * position / z**delay


def tables(plant, low, high):
    mass, damping, period, delay = plant
    device = {"mass_kg": mass, "damping_ns_per_m": damping, "sample_time_s": period, "delay_samples": delay}
    names = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
    hands = {name: [one, other] for name, one, other in zip(names, low, high, strict=True)}
    wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": 0.0}
    return {"device": device, "environment": wall, "hands": hands}


def drawn(seed):
    """A rigid device, a hand, and a law that is stable on it more often than not."""
    draw = np.random.default_rng(seed)
    mass, period, delay = 10 ** draw.uniform(-2, 1), 10 ** draw.uniform(-3.7, -2), int(draw.integers(0, 4))
    plant = mass, mass / period * 10 ** draw.uniform(-4, -1.5), period, delay
    hand = mass * draw.uniform(0.1, 2), mass / period * 10 ** draw.uniform(-4, -2), mass * draw.uniform(1, 30) ** 2
    cutoff = None if draw.random() < 0.6 else 10 ** draw.uniform(-1.5, -0.5) / period
    damper = mass / period * 10 ** draw.uniform(-2.5, -0.3 - 0.2 * delay)
    law = damper / period * 10 ** draw.uniform(-2.5, 0.1) / (1.5 + delay), damper, cutoff
    return law, plant, hand


@pytest.mark.parametrize("seed", first(range(100), 2))
def test_every_number_is_that_of_the_written_down_loop(seed):
    law, plant, hand = drawn(seed)
    found = avc.certify_law(tables(plant, hand, hand), k=law[0], b=law[1], cutoff_hz=law[2], remedies=False)
    for case, held in ((found.held, hand), (found.released, (0.0, 0.0, 0.0))):
        assert case.spectral_radius == pytest.approx(radius(law, plant, held), abs=1e-9)
        ratio, hz = least_damped(law, plant, held)
        assert (case.damping_ratio, case.damping_ratio_hz) == pytest.approx((ratio, hz), rel=1e-9, abs=1e-9)
        assert case.stable == (case.spectral_radius < 1)
        if not case.stable:
            assert (case.margins.gain, case.margins.phase_deg, case.margins.disk) == (1, 0, 0)
            continue
        assert case.settling_s == pytest.approx(settled_s(law, plant, held), rel=1e-2)
        margins = case.margins
        if math.isfinite(margins.gain):
            up = brentq(lambda g: radius(law, plant, held, factor=g) - 1, margins.gain / 1.001, margins.gain * 1.001)  # noqa: B023
            assert margins.gain == pytest.approx(up, rel=1e-9)
        grid = np.unique(np.concatenate([np.geomspace(1e-4, math.pi, 3000), np.linspace(1e-3, math.pi, 2000)]))
        phases, delays = [math.inf], [math.inf]
        for place in np.flatnonzero(np.diff(abs(loop_gain(law, plant, held, grid)) > 1)):
            ends = grid[place], grid[place + 1]
            turn = brentq(lambda turn: math.log(abs(loop_gain(law, plant, held, turn))), *ends, xtol=1e-14)  # noqa: B023
            lag = (np.angle(loop_gain(law, plant, held, turn)) + math.pi) % (2 * math.pi)
            phases.append(math.degrees(min(lag, 2 * math.pi - lag)))
            delays.append(lag / turn)
        assert (margins.phase_deg, margins.delay_samples) == pytest.approx((min(phases), min(delays)), rel=1e-7)
        size = lambda turn, held=held: abs((1 - (at := loop_gain(law, plant, held, turn))) / (1 + at))  # noqa: E731
        coarse = size(grid[::10])
        top = max(1, min(int(coarse.argmax()), len(coarse) - 2))
        near = grid[::10][top - 1], grid[::10][top + 1]
        peak = minimize_scalar(lambda turn: -size(turn), bounds=near, method="bounded", options={"xatol": 1e-13})  # noqa: B023
        assert margins.disk == pytest.approx(2 / max(-peak.fun, coarse.max()), rel=1e-9)
        assert size(2 * math.pi * margins.disk_hz * plant[2]) == pytest.approx(2 / margins.disk, rel=1e-9)


@pytest.mark.parametrize(("force", "damping", "holds"), [(0.4, 2.0, True), (0.4, 0.0, False), (2.0, 2.0, False)])
def test_detents_add_their_steepest_slope_to_a_law(force, damping, holds):
    """In the wall to its spring, with and without them; outside it they act alone, and must be stable there."""
    plant, hand = (0.1, 0.05, 1e-3, 1), (0.1, 1.0, 400.0)
    stated = tables(plant, hand, hand)
    stated["environment"]["stiffness_n_per_m"] = 100.0
    stated["detent"] = {"force_n": force, "pitch_m": 0.004, "damping_ns_per_m": damping}
    slope = 2 * math.pi * force / 0.004
    found = avc.certify_law(stated, k=300.0, b=3.0, limits=False)
    bare = avc.certify_law(stated | {"detent": None}, k=300.0, b=3.0, limits=False)
    nobody = (0.0, 0.0, 0.0)
    for case, held in ((found.held, hand), (found.released, nobody)):
        slopes = [((300.0, 3.0, None), held), ((300.0 + slope, 3.0 + damping, None), held)]
        assert case.spectral_radius == pytest.approx(max(radius(law, plant, hand) for law, hand in slopes), abs=1e-9)
    alone = max(radius((slope, damping, None), plant, held) for held in (hand, nobody))
    assert found.detent.radius == pytest.approx(alone, abs=1e-9)
    assert (alone < 1) == holds == found.passed
    assert bare.passed


@pytest.mark.parametrize("mass", [0.2, 0.4])
def test_the_phase_margin_of_a_virtual_mass_is_against_a_lead(mass):
    """Its -L leads where |L| rises to 1, below the resonance of the hand: more lead there makes the loop unstable."""
    period, pole = 1e-3, 0.7
    plant, hand = (0.12, 0.8, period, 1), (0.1, 1.0, 400.0)
    acceleration = np.poly1d([1.0, -2.0, 1.0]) * (1 - pole) * (mass / period**2)
    law = dlti(acceleration.coeffs, [1.0, -pole, 0.0], dt=period)
    margins = avc.certify_law(tables(plant, hand, hand), law=law.to_ss(), limits=False).held.margins

    def gain(turn):
        z = np.exp(1j * turn)
        return acceleration(z) / (z * (z - pole)) * loop_gain((1.0, 0.0, None), plant, hand, turn)

    turns = np.geomspace(1e-3, math.pi, 400_000)
    size = abs(gain(turns))
    crossed = turns[np.flatnonzero(np.diff(size > 1))]
    phase_deg = np.degrees(np.angle(-gain(crossed)))
    nearest = abs(phase_deg).argmin()
    assert phase_deg[nearest] < 0
    assert margins.phase_deg == pytest.approx(abs(phase_deg[nearest]), rel=1e-3)
    assert margins.phase_hz == pytest.approx(crossed[nearest] / (2 * math.pi * period), rel=1e-3)


@pytest.mark.parametrize("seed", first(range(8), 2))
def test_the_limits_of_k_and_b_are_where_the_loop_begins_to_grow(seed):
    law, plant, hand = drawn(seed)
    found = avc.certify_law(tables(plant, hand, hand), k=law[0], b=law[1], cutoff_hz=law[2], remedies=False)
    hands = hand, (0.0, 0.0, 0.0)

    def worst(k, b):
        return max(radius((k, b, law[2]), plant, one) for one in hands)

    most, allowed = found.largest_stiffness_n_per_m, found.damping_range_ns_per_m
    if most:
        assert worst(0.9999 * most, law[1]) < 1 < worst(1.0001 * most, law[1])
    if allowed is None:
        scan = np.geomspace(1e-4, 3, 300) * plant[0] / plant[2]
        assert min(worst(law[0], b) for b in scan) > 1
        return
    low, high = allowed
    assert max(worst(law[0], b) for b in np.linspace(low * 1.0001 + 1e-9, high * 0.9999, 20)) < 1
    assert worst(law[0], 1.0001 * high) > 1
    assert low == 0 or worst(law[0], 0.9999 * low) > 1


def test_of_a_range_of_hands_none_is_worse_than_what_is_told():
    plant, low, high = (0.1, 0.5, 1e-3, 1), (0.05, 3.0, 200.0), (0.3, 20.0, 800.0)
    law = (3000.0, 12.0, None)
    found = avc.certify_law(tables(plant, low, high), k=law[0], b=law[1])
    draw = np.random.default_rng(0)
    hands = [[*draw.uniform(low, high)] for _ in range(300)] + [
        (m, d, k) for m in (0.05, 0.3) for d in (3.0, 20.0) for k in (200.0, 800.0)
    ]
    assert found.held.spectral_radius >= max(radius(law, plant, hand) for hand in hands) - 1e-12
    assert found.held.spectral_radius == pytest.approx(radius(law, plant, list(found.held.hand.values())), abs=1e-9)
    assert found.held.damping_ratio <= min(least_damped(law, plant, hand)[0] for hand in hands) + 1e-12


@pytest.mark.slow
def test_what_would_help_does():
    plant, low, high = (0.12, 0.8, 1e-3, 1), (0.05, 3.0, 200.0), (0.3, 20.0, 800.0)
    problem = avc.Problem(**tables(plant, low, high))
    found = avc.certify_law(problem, k=9000.0, b=2.0)
    assert not found.passed
    assert found.remedies
    for remedy in found.remedies:
        law = {"k": 9000.0, "b": 2.0}
        names = {"stiffness_n_per_m": "k", "damping_ns_per_m": "b", "cutoff_hz": "cutoff_hz"}
        law |= {names[key]: value for key, value in remedy.changes.items() if key in names}
        device = {key: value for key, value in remedy.changes.items() if key not in names}
        cured = avc.certify_law(problem.changed(device=device), **law)
        assert cured.passed
        assert cured.disk_margin == pytest.approx(remedy.disk_margin, rel=0.1)


# What others published of devices that turn: device, law, how the answer begins, and in what range the right b lies.
WRIST = {"inertia_kgm2": 0.02, "damping_nms_per_rad": 0.05, "sample_time_s": 2.5e-3, "delay_samples": 1}
COBOT = {"inertia_kgm2": 0.5, "damping_nms_per_rad": 1.0, "sample_time_s": 5e-3, "delay_samples": 2}
COUNT = math.radians(40) / 870
PEDAL = {"inertia_kgm2": 0.004, "damping_nms_per_rad": 0.002, "sample_time_s": 2e-3, "encoder_resolution_rad": COUNT}
GAME = {"inertia_kgm2": 0.06, "damping_nms_per_rad": 0.1, "sample_time_s": 1 / 60, "delay_samples": 1}
FREE = {"inertia_kgm2": 1e-3, "damping_nms_per_rad": 0.0, "sample_time_s": 1e-3}
PUBLISHED = {
    "an arm's wrist at 400 Hz: kd too high": (WRIST, {"k": 60.0, "b": 9.0}, "b 9.00 N.m.s/rad is above its largest"),
    "a cobot at 200 Hz, two samples late": (COBOT, {"k": 250.0, "b": 2.0}, "2 samples of delay at 200 Hz"),
    "a damper behind a noisy encoder": (PEDAL | {"position_noise_rms_rad": 0.7 * COUNT}, {"b": 0.12}, "noise of the"),
    "a bump stop of a game at 60 Hz": (GAME, {"k": 230.0, "b": 0.5}, "1 sample of delay at 60 Hz"),
    "D T/J = 3": (FREE, {"b": 3.0}, "b 3.00 N.m.s/rad is above its largest, 1.99 N.m.s/rad, "),
    "D T/J = 3, everywhere": (FREE, {"b_p": 3.0}, "b_p 3.00 N.m.s/rad is above its largest outside the wall, 1.99 "),
}


QUICK = ("an arm's wrist at 400 Hz: kd too high", "a damper behind a noisy encoder", "D T/J = 3, everywhere")


@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in PUBLISHED]
)
def test_a_published_law_gets_its_verdict_and_the_reason(name):
    device, law, reason = PUBLISHED[name]
    text = "".join(f"{key} = {value}\n" for key, value in device.items())
    wall = "[environment]\nstiffness_nm_per_rad = 0.0\ndamping_nms_per_rad = 0.0\n"
    problem = avc.parse_problem(f"[device]\nmotion = 'rotary'\nhandle_radius_m = 0.1\n{text}{wall}")
    found = avc.certify_law(problem, **law)
    assert reason in found.reason
    plant = operator.attrgetter("mass_kg", "damping_ns_per_m", "sample_time_s", "delay_samples")(problem.device)
    place = avc.parse_problem(
        f"[device]\nmotion = 'rotary'\nhandle_radius_m = 0.1\n{text}[simulation]\nstep_s = {plant[2]}"
    )
    pair = ToolGains(*(law.get(key, 0.0) for key in ("k", "b", "b_p")))
    assert ToolLoops(place).stable_over_ranges(pair) == (found.held.stable and found.released.stable)
    hands = [list(one.hand.values()) for one in (found.held, found.released)]

    def stable(b):
        whole = law.get("k", 0.0), b + law.get("b_p", 0.0), None
        return max(radius(whole, plant, hand) for hand in hands) < 1

    assert found.stable == stable(law.get("b", 0.0))
    if "noise" in reason:
        assert found.noise_n == pytest.approx(law["b"] / plant[2] * math.sqrt(2 * (0.49 + 1 / 12)) * COUNT, rel=1e-9)
        return
    assert not found.passed
    low, high = found.damping_range_ns_per_m or (math.inf, 0.0)
    for b in np.geomspace(1e-3, 3, 200) * plant[0] / plant[2]:
        assert stable(b) == (low < b < high)


@pytest.mark.parametrize(
    ("integrator", "m", "b", "h"),
    [
        # Each integrator with one tool; with the others it takes longer.
        pytest.param(integrator, *tool, marks=() if place == which else pytest.mark.slow)
        for which, integrator in enumerate(["semi-implicit", "implicit-damping", "explicit"])
        for place, tool in enumerate([(0.01, 1.0, 0.005), (0.2, 30.0, 0.002), (1e-3, 0.05, 0.01)])
    ],
)
def test_k_and_b_to_an_engine_are_judged_with_the_engine(integrator, m, b, h, tmp_path, capsys):
    """A tool that is driven to a device which stands still is a servo of the engine alone, with a limit on paper."""
    limit = {"explicit": b / h}.get(integrator, (4 * m + 2 * h * b * (-1 if integrator[0] == "s" else 1)) / h**2)
    still = f"[device]\nmass_kg = 1e6\ndamping_ns_per_m = 1e6\nsample_time_s = {h}\n"
    engine = f'[simulation]\ntool_mass_kg = {m}\nstep_s = {h}\nintegrator = "{integrator}"\n'
    file = tmp_path / "servo.toml"
    file.write_text(still + engine, encoding="utf-8")
    for share in (0.98, 1.02):
        main(["certify", str(file), "--k", str(share * limit), "--b", str(b), "--json"])
        assert json.loads(capsys.readouterr().out)["stable"] == (share < 1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "laws", [((300, 3, 0), (3e5, 3, 1)), pytest.param(((0, 3, 0), (0, 300, 1)), marks=pytest.mark.slow)]
)
def test_k_and_b_to_a_follower_are_judged_with_it(laws, tmp_path, capsys):
    file = tmp_path / "pair.toml"
    device = "mass_kg = 0.12\ndamping_ns_per_m = 0\n"  # both together keep their speed
    hands = "[hands]\nmass_kg = [0.1, 0.1]\ndamping_ns_per_m = [5.0, 5.0]\nstiffness_n_per_m = [400.0, 400.0]\n"
    file.write_text(f"[device]\n{device}[follower]\n{device}{hands}", encoding="utf-8")
    for k, b, code in laws:
        assert main(["certify", str(file), "--k", str(k), "--b", str(b)]) == code
    assert "follower" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("mass", "k", "b", "ratio", "hz"),
    [(0.0049167, 100.0, 2.0, 0.343, 89.5), (0.00361, 14.25, 0.907, 0.713, 58.3)],
)
def test_the_damping_ratio_is_that_of_a_pair_and_not_of_a_pole_that_alternates(mass, k, b, ratio, hz):
    """Two joints at 1 kHz, one sample late; the first has a real pole below 0 of a smaller ratio than its pair."""
    joint = tables((mass, 0.0, 1e-3, 1), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    released = avc.certify_law(joint, k=k, b=b, remedies=False).released
    assert released.damping_ratio == pytest.approx(ratio, abs=6e-4)
    assert released.damping_ratio_hz == pytest.approx(hz, abs=0.06)


@pytest.mark.parametrize(("k", "stable"), first([(800.0, True), (30e3, False)]))
def test_without_limits_the_verdict_is_the_same_and_no_limit_is_stated(k, stable):
    whole = avc.certify_law("spring", k=k, b=2.0, remedies=False)
    quick = avc.certify_law("spring", k=k, b=2.0, remedies=False, limits=False)
    assert quick.stable == whole.stable == stable
    assert quick.cases == whole.cases
    assert not quick.limited
    assert quick.document()["largest_stiffness_n_per_m"] is None
    assert quick.reason == (whole.reason if stable else "unstable")


def test_what_a_law_renders_is_that_at_the_handle_at_rest_and_in_motion():
    mass, share, hz, ratio = 0.2, 0.3, 60.0, 0.05
    device = {"mass_kg": mass, "damping_ns_per_m": 0.0, "sample_time_s": 1e-4, "encoder_at": "motor"}
    device |= {"resonance": {"frequency_hz": hz, "damping_ratio": ratio, "mass_ratio": share}}
    nothing = {"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0}
    k = 3000.0
    found = avc.certify_law({"device": device, "environment": nothing}, k=k, b=1.0, remedies=False)
    plant = found.problem.device
    motor = PortMechanics(plant).motor

    handle_kg = share * mass
    for frequency_hz, rendered in found.rendered_n_per_m.items():
        s = 2j * math.pi * frequency_hz
        at_motor = motor.mass_kg * s**2 + k + 1.0 * s
        structure = motor.stiffness_n_per_m + motor.damping_ns_per_m * s
        total = handle_kg * s**2 + structure * at_motor / (structure + at_motor)
        assert rendered == pytest.approx(abs(total - mass * s**2), rel=2e-3)
        assert rendered == pytest.approx(found.static_stiffness_n_per_m, rel=0.2)
    assert motor.mass_kg == pytest.approx((1 - share) * mass)
    assert found.static_stiffness_n_per_m < 0.9 * k


LAWS_OVER_STEPS = [
    {"damping_ns_per_m": 5.0},
    {"stiffness_n_per_m": 400.0, "damping_ns_per_m": 5.0, "velocity": {"kind": "low-pass", "cutoff_hz": 80.0}},
    {"stiffness_n_per_m": 400.0, "damping_ns_per_m": 5.0, "velocity": {"kind": "kalman", "bandwidth_hz": 60.0}},
]


@pytest.mark.parametrize("law", first(LAWS_OVER_STEPS))
@pytest.mark.parametrize("step", first([2e-6, 2e-4]))
def test_encoder_steps_give_a_force_in_motion_that_is_felt_or_not_without_any_noise(law, step):
    """A device that creeps over steps: the force less that of the same law without steps, by brute force."""
    device = {"mass_kg": 0.1, "damping_ns_per_m": 0.5, "encoder_resolution_m": step}
    wall = {"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0}
    problem = avc.Problem(device=device, environment=wall, law=law)
    result = avc.certify_law(problem, limits=False, remedies=False)
    assert (result.noise_n, result.quiet) == (0.0, True)

    space = problem.law.law(problem.device.sample_time_s)
    # Each sample moves on by an irrational share of many steps: an error is anywhere in its step.
    position = step * math.sqrt(2) * 7.0 * np.arange(20_000)
    errors = step * np.round(position / step) - position
    state, force = np.zeros((space.states, 1)), np.zeros(position.size)
    for tick, error in enumerate(errors):
        force[tick] = (space.c @ state).item() + space.d.item() * error if space.states else space.d.item() * error
        state = space.a @ state + space.b * error
    spread = float(np.std(force[2000:]))
    # Errors of neighbouring samples are no white noise, which makes more or less of them.
    assert spread / 2.5 < result.step_noise_n < 2.5 * spread

    shown = str(result)
    felt = result.step_noise_n > 0.05
    assert felt == (step > 1e-5)
    (line,) = (line for line in shown.splitlines() if "Force noise" in line)
    assert ("rms in motion, felt" if felt else "rms in motion, not felt") in line
    assert line.lstrip().startswith("!") == felt
