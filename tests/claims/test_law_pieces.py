"""Laws of any pieces beside loops that are written out here sample by sample, and the limits that are told of them."""

import json
import math
from types import SimpleNamespace

import pytest
from law_in_time import NOBODY, Controller, disk_margin, radius, stated, worst
from scipy import signal

import avc_casadi as avc
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.cli import main


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_radii_and_intervals_are_those_of_the_loop_written_out(seed):
    tables, hand, walled = stated(seed)
    judged = avc.certify_law(tables)
    problem, law = judged.problem, judged.problem.law
    period = problem.device.sample_time_s
    for case, held in ((judged.held, hand), (judged.released, NOBODY)):
        controller = Controller(law, period)
        assert case.spectral_radius == pytest.approx(radius(problem.device, held, controller), abs=1e-9)
        if case.stable:
            assert case.margins.disk == pytest.approx(disk_margin(problem.device, held, controller), rel=1e-8)
    one_sided = walled and law.acts_outside
    assert (judged.free is not None) == one_sided
    if one_sided:
        free = max(
            radius(problem.device, held, Controller(law, period, True), held == NOBODY) for held in (hand, NOBODY)
        )
        assert judged.free.spectral_radius == pytest.approx(free, abs=1e-9) or judged.free.stable == (free < 1)
    for number in law.numbers(period, problem.lightest_kg):
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


def test_a_window_is_stable_at_every_count_of_its_interval_and_not_at_the_next():
    hand = (0.05, 1.0, 50.0)
    names = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
    held = {name: [value, value] for name, value in zip(names, hand, strict=True)}
    law = {"stiffness_n_per_m": 900.0, "damping_ns_per_m": 6.0, "velocity": {"kind": "window", "samples": 3}}
    found = avc.certify_law({"device": DEVICE, "hands": held, "law": law})
    (low, high) = found.intervals["velocity.samples"]
    assert low == 1
    assert 8 < high < 30
    unstable = [
        samples
        for samples in range(1, int(high) + 2)
        if worst(found.problem, found.law.with_number(("velocity", "samples"), samples), hand, False) >= 1
    ]
    assert unstable == [high + 1]


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
        (system(dt=True), "has dt"),
        (system(dt=None), "has dt"),
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


@pytest.mark.slow
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


@pytest.mark.slow
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
