"""Laws of any pieces beside loops that are written out here sample by sample, and the limits that are told of them."""

import json
import math
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from sampled_wall import mechanics
from scipy import signal
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.cli import main
from avc_casadi.model.control_law import ControlLaw

NOBODY = (0.0, 0.0, 0.0)


def coefficients(item, period):
    """Numerator and denominator in 1/z of a filter, by SciPy."""
    if item.kind == "low-pass":
        poles = [-1] if item.order == 1 else np.exp(1j * np.pi * np.array([0.75, -0.75]))
        there = np.poly(np.exp(2 * np.pi * item.cutoff_hz * period * np.array(poles))).real
        return np.array([there.sum()]), there
    if item.kind == "transfer":
        below = np.array(item.denominator)
        return np.pad(item.numerator, (len(below) - len(item.numerator), 0)), below
    warped = 2 / period * math.tan(math.pi * item.frequency_hz * period)
    if item.kind == "notch":
        above, below = ([1, 2 * by * item.width * warped, warped**2] for by in (item.depth, 1.0))
    else:
        sine = math.sin(math.radians(item.phase_deg))
        ratio = math.sqrt((1 + sine) / (1 - sine))
        above, below = [ratio / warped, 1], [1 / (ratio * warped), 1]
    return signal.bilinear(above, below, 1 / period)


def velocity_coefficients(law, period):
    item = law.velocity
    if item.kind == "window":
        return np.array([1.0, *[0.0] * (item.samples - 1), -1.0]) / (item.samples * period), np.ones(1)
    difference = np.array([1.0, -1.0]) / period
    if item.kind == "difference":
        return difference, np.ones(1)
    above, below = coefficients(item, period)
    return np.convolve(above, difference), below


@dataclass
class Controller:
    """The law in time: SciPy's filters, one sample after the other, all states in one vector."""

    law: ControlLaw
    period: float
    outside: bool = False
    chains: list = field(default_factory=list)

    def __post_init__(self):
        law = self.law
        self.k, self.b, self.ki = law.stiffness_n_per_m, law.damping_ns_per_m, law.integral_n_per_m_s
        if self.outside:
            self.k = self.b = self.ki = 0.0
        damper = self.b + law.local_damping_ns_per_m
        above, below = velocity_coefficients(law, self.period)
        # Each part of the force is a transfer function of its own; the filters follow their sum.
        mass = np.array([1.0, -1.0]) * law.virtual_mass_kg / self.period
        size = max(len(above), 1)
        motion = np.convolve(np.pad(damper * above, (0, 1)) + np.convolve(mass, above), [1.0])
        assert len(motion) == size + 1
        self.parts = [(np.array([self.k]), np.ones(1)), (motion, below)]
        if self.ki:
            self.parts.append((np.array([self.ki * self.period]), np.array([1.0, -1.0])))
        self.after = [coefficients(item, self.period) for item in law.filters]
        self.sizes = [max(len(a), len(b)) - 1 for a, b in (*self.parts, *self.after)]
        self.states = sum(self.sizes)

    def step(self, state, x):
        """The force and the next state."""
        pieces = np.split(state, np.cumsum(self.sizes)[:-1])
        later, force = [], 0.0
        for (above, below), old in zip(self.parts, pieces, strict=False):
            (value,), new = filtered(above, below, x, old)
            force, later = force + value, [*later, new]
        for (above, below), old in zip(self.after, pieces[len(self.parts) :], strict=True):
            (force,), new = filtered(above, below, force, old)
            later.append(new)
        return force, np.concatenate(later)


def filtered(above, below, value, state):
    if not len(state):
        return np.array([above[0] / below[0] * value]), state
    return signal.lfilter(above, below, [value], zi=state)


def radius(device, hand, controller, springless=False):
    """The spectral radius of one sample of device and law as a matrix, the sample split where a force arrives."""
    a, b, measured = mechanics(device, hand)
    n, period = len(b), device.sample_time_s
    whole, late = int(device.delay_samples), device.delay_samples % 1

    def moved(duration):
        both = np.zeros((n + 1, n + 1))
        both[:n, :n], both[:n, n] = a * duration, b * duration
        return expm(both)[:n]

    before_arrival, after_arrival = moved(late * period), moved((1 - late) * period)

    def tick(state):
        x, line, inner = state[:n], state[n : n + whole + 1], state[n + whole + 1 :]
        force, inner = controller.step(inner, x[measured])
        forces = [force, *line]
        x = before_arrival @ [*x, forces[whole + 1]] if late else x
        x = after_arrival @ [*x, forces[whole]]
        return np.concatenate([x, forces[: whole + 1], inner])

    size = n + whole + 1 + controller.states
    poles = np.linalg.eigvals(np.stack([tick(unit) for unit in np.eye(size)], axis=1))
    if springless:  # it rests anywhere
        poles = np.delete(poles, np.abs(poles - 1).argmin())
    return np.abs(poles).max()


def worst(problem, law, hand, one_sided):
    places = [(False, law.stiffness_n_per_m == 0)] + [(True, True)] * one_sided
    return max(
        radius(
            problem.device, held, Controller(law, problem.device.sample_time_s, outside), not spring and held[2] == 0
        )
        for outside, springless in places
        for held in (hand, NOBODY)
        for spring in [not springless]
    )


def drawn(seed):
    """A device, a hand and a law whose pieces are drawn; stable more often than not."""
    draw = np.random.default_rng(seed)
    period, mass = 10 ** draw.uniform(-3.7, -2.7), 10 ** draw.uniform(-2, 0.3)
    delay = float(draw.choice([0, 1, 1.3, 2]))
    device = {"mass_kg": mass, "damping_ns_per_m": mass / period * 0.005, "sample_time_s": period}
    device["delay_samples"] = delay
    if draw.random() < 0.3:
        device["amplifier_bandwidth_hz"] = 0.3 / period
    hand = mass * draw.uniform(0.1, 2), mass / period * 10 ** draw.uniform(-3, -2), mass * draw.uniform(3, 30) ** 2
    damper = mass / period * 10 ** draw.uniform(-1.6, -1.0) / (1 + delay)
    spring = damper / period * 10 ** draw.uniform(-2.0, -1.2)
    law = {"stiffness_n_per_m": spring, "damping_ns_per_m": damper}
    velocities = [
        {"kind": "difference"},
        {"kind": "window", "samples": int(draw.integers(1, 6))},
        {"kind": "low-pass", "cutoff_hz": 0.15 / period, "order": int(draw.integers(1, 3))},
    ]
    law["velocity"] = velocities[draw.integers(3)]
    if draw.random() < 0.5:
        law["integral_n_per_m_s"] = spring * spring / damper * 10 ** draw.uniform(-2, -0.5)
    if draw.random() < 0.5:
        law["local_damping_ns_per_m"] = device["damping_ns_per_m"] * draw.uniform(-0.9, 2)
    if draw.random() < 0.5:
        law["virtual_mass_kg"] = mass * draw.uniform(-0.4, 0.15)
    filters = [
        {"kind": "notch", "frequency_hz": draw.uniform(0.1, 0.4) / period, "depth": 0.2, "width": 0.3},
        {"kind": "low-pass", "cutoff_hz": 0.25 / period, "order": int(draw.integers(1, 3))},
        {"kind": "lead", "frequency_hz": 0.1 / period, "phase_deg": 20.0},
        {"kind": "transfer", "numerator": [0.6, 0.2], "denominator": [1.0, -0.3, 0.1]},
    ]
    chosen = [item for item in filters if draw.random() < 0.3]
    law["filters"] = chosen or filters[:1]
    return device, hand, law, bool(draw.random() < 0.5)


def stated(seed):
    device, hand, law, walled = drawn(seed)
    names = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
    tables = {"device": device, "law": law, "hands": {name: [one, one] for name, one in zip(names, hand, strict=True)}}
    if walled:
        tables["environment"] = {"stiffness_n_per_m": 1e3, "damping_ns_per_m": 0.0}
    return tables, hand, walled


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_radii_and_intervals_are_those_of_the_loop_written_out(seed):
    tables, hand, walled = stated(seed)
    judged = avc.certify_law(tables)
    problem, law = judged.problem, judged.problem.law
    period = problem.device.sample_time_s
    for case, held in ((judged.held, hand), (judged.released, NOBODY)):
        assert case.spectral_radius == pytest.approx(radius(problem.device, held, Controller(law, period)), abs=1e-9)
    one_sided = walled and law.acts_outside
    assert (judged.free is not None) == one_sided
    if one_sided:
        free = max(
            radius(problem.device, held, Controller(law, period, True), held == NOBODY) for held in (hand, NOBODY)
        )
        assert judged.free.spectral_radius == pytest.approx(free, abs=1e-9) or judged.free.stable == (free < 1)
    for number in law.numbers(period):
        interval = judged.intervals[number.key]
        if interval is None or number.whole:
            continue
        for end, inward in zip(interval, (1, -1), strict=True):
            if end in (number.lowest, number.highest) or math.isinf(end):
                continue
            inside, outside = (law.with_number(number.path, end + share * inward * abs(end)) for share in (0.01, -0.01))
            assert worst(problem, inside, hand, one_sided) < 1, (number.key, end)
            assert worst(problem, outside, hand, one_sided) > 1, (number.key, end)


DEVICE = {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "delay_samples": 1}


def test_a_table_of_k_and_b_alone_is_the_plain_law():
    plain = avc.certify_law(
        {"device": DEVICE, "environment": {"stiffness_n_per_m": 0.0, "damping_ns_per_m": 0.0}},
        k=900.0,
        b=4.0,
        cutoff_hz=90.0,
    )
    law = {"stiffness_n_per_m": 900.0, "damping_ns_per_m": 4.0, "velocity": {"kind": "low-pass", "cutoff_hz": 90.0}}
    table = avc.certify_law({"device": DEVICE, "law": law})
    assert json.dumps(table.document()) == json.dumps(plain.document())
    assert str(table) == str(plain)
    assert "intervals" not in plain.document()


def system(dt=1e-3, **matrices):
    """k + b (1 - 1/z)/T as a state space with the attributes of python-control and SciPy."""
    k, b, period = 900.0, 4.0, 1e-3
    plain = {"A": [[0.0]], "B": [[1.0]], "C": [[-b / period]], "D": [[k + b / period]]}
    return SimpleNamespace(**(plain | matrices), dt=dt)


def test_a_discrete_system_is_judged_as_the_law_that_it_is():
    judged = avc.certify_law({"device": DEVICE, "law": {"stiffness_n_per_m": 1.0}}, law=system())
    plain = avc.certify_law({"device": DEVICE, "law": {"stiffness_n_per_m": 900.0, "damping_ns_per_m": 4.0}})
    assert judged.held.spectral_radius == pytest.approx(plain.held.spectral_radius, abs=1e-12)
    assert judged.held.margins.disk == pytest.approx(plain.held.margins.disk, rel=1e-9)
    assert judged.largest_common_gain == pytest.approx(min(case.margins.gain for case in plain.cases), rel=1e-5)
    of_scipy = signal.StateSpace([[0.0]], [[1.0]], [[-4e3]], [[4900.0]], dt=1e-3)
    assert avc.certify_law({"device": DEVICE, "law": {"stiffness_n_per_m": 1.0}}, law=of_scipy).passed == judged.passed
    assert isinstance(judged, LawCertificate)
    assert "discrete system of 1 states" in str(judged)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (system(dt=2e-3), "has dt = 0.002; allowed: 0.001 s"),
        (system(dt=True), "has dt = True"),
        (system(dt=None), "has dt = None"),
        (system(A=[[1.1]]), "pole of size 1.1"),
        (system(B=[[1.0, 2.0]], D=[[1.0, 2.0]]), "has 2 inputs and 1 outputs"),
        (3.0, "is a float"),
    ],
)
def test_another_system_is_refused(wrong, said):
    with pytest.raises(avc.InputError, match=said):
        avc.certify_law({"device": DEVICE, "law": {"stiffness_n_per_m": 1.0}}, law=wrong)


@pytest.mark.parametrize(
    ("law", "key", "said"),
    [
        ({"velocity": {"kind": "low-pass", "cutoff_hz": 9.0, "order": 3}}, "velocity.order", "is 3; allowed: 1, 2"),
        (
            {"integral_n_per_m_s": 5.0, "stiffness_n_per_m": 0.0, "damping_ns_per_m": 1.0},
            "integral_n_per_m_s",
            "spring",
        ),
        ({"virtual_mass_kg": -0.1}, "virtual_mass_kg", "loop gain of 0.833 at half the sample rate"),
        (
            {"filters": [{"kind": "transfer", "numerator": [1.0, 0.0], "denominator": [1.0]}]},
            "filters[0].numerator",
            "improper",
        ),
        (
            {"filters": [{"kind": "transfer", "numerator": [1.0], "denominator": [1.0, -1.0]}]},
            "filters[0].denominator",
            "pole of size 1, unstable",
        ),
        ({"filters": [{"kind": "notch", "frequency_hz": 500.0}]}, "filters[0].frequency_hz", "below 500 Hz"),
        ({"filters": [{"kind": "noch"}]}, "filters[0].kind", 'did you mean "notch"'),
        ({"stiffness_n_per_m": 0.0}, "stiffness_n_per_m", "every other gain"),
    ],
)
def test_faults_name_key_value_and_what_is_allowed(law, key, said):
    with pytest.raises(avc.InputError) as refused:
        avc.certify_law({"device": DEVICE, "law": {"stiffness_n_per_m": 100.0, **law}})
    assert f"law.{key}: " in str(refused.value)
    assert said in str(refused.value)
    assert any(way in str(refused.value) for way in ("allowed: ", "; give "))


def test_a_negative_local_damper_holds_down_to_the_devices_own(capsys):
    assert main(["certify", "figure5", "--k", "200", "--b", "2", "--b-p=-0.1", "--json"]) in (0, 1)
    found = json.loads(capsys.readouterr().out)
    device = avc.load_problem("figure5").device
    assert found["intervals"]["local_damping_ns_per_m"][0] == pytest.approx(-device.damping_ns_per_m, rel=1e-6)


def test_pieces_are_typed_and_stand_in_a_file(tmp_path, capsys):
    file = tmp_path / "servo.toml"
    file.write_text(
        '[device]\nmotion = "rotary"\nhandle_radius_m = 0.05\ninertia_kgm2 = 1e-3\ndamping_nms_per_rad = 1e-3\n'
        "[law]\nstiffness_nm_per_rad = 8.0\ndamping_nms_per_rad = 0.08\nintegral_nm_per_rad_s = 20.0\n",
        encoding="utf-8",
    )
    assert main(["certify", str(file), "--json"]) == 0
    stored = json.loads(capsys.readouterr().out)
    typed = ["--velocity", "window 3", "--notch", "150 Hz", "--ki", "10", "--virtual-mass=-1e-4"]
    assert main(["certify", str(file), *typed, "--json"]) == 0
    changed = json.loads(capsys.readouterr().out)
    assert stored["law"]["integral_nm_per_rad_s"] == 20.0
    assert changed["law"]["velocity"] == {"kind": "window", "samples": 3}
    assert changed["law"]["virtual_inertia_kgm2"] == -1e-4
    assert [item["kind"] for item in changed["law"]["filters"]] == ["notch"]
    assert main(["check", str(file)]) in (0, 1)
    assert "law (avc certify judges it, avc trial, simulate and export run it" in " ".join(
        capsys.readouterr().out.split()
    )


def test_a_verb_that_does_not_use_a_law_says_so(tmp_path, capsys):
    file = tmp_path / "wall.toml"
    file.write_text(
        "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\n[frequency]\npoints = 4\n"
        "[environment]\nstiffness_n_per_m = 500.0\ndamping_ns_per_m = 2.0\n"
        "[law]\nstiffness_n_per_m = 500.0\ndamping_ns_per_m = 2.0\n",
        encoding="utf-8",
    )
    for command in (["solve", str(file), "--method", "direct"], ["compare", str(file)], ["zwidth", str(file)]):
        main(command)
        said = " ".join(capsys.readouterr().out.split())
        assert "Not used" in said
        assert "law" in said.partition("Not used")[2]
