"""`avc new` writes what was typed, in any unit that fits, and the reader of all files reads it back."""

import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

import avc_casadi
from avc_casadi.cli import main
from avc_casadi.files.new_problem import NewProblem

# What people write for a quantity, and how much it is of the unit of the file.
LINEAR = {
    "device.mass_kg": {"kg": 1, "g": 1e-3, "mg": 1e-6},
    "device.damping_ns_per_m": {"N.s/m": 1, "Ns/m": 1, "N s/mm": 1e3, "mN*s/m": 1e-3, "kg/s": 1},
    "device.encoder_resolution_m": {"m": 1, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "in": 0.0254},
    "device.max_force_n": {"N": 1, "mN": 1e-3, "kN": 1e3},
    "device.amplifier_bandwidth_hz": {"Hz": 1, "kHz": 1e3},
    "environment.stiffness_n_per_m": {"N/m": 1, "N/mm": 1e3, "kN/m": 1e3, "MN/m": 1e6, "N/cm": 1e2},
}
ROTARY = {
    "device.mass_kg": {"kg.m2": 1, "kg.m^2": 1, "g.cm2": 1e-7, "gcm2": 1e-7, "kg·m²": 1},
    "device.damping_ns_per_m": {"N.m.s/rad": 1, "mN.m.s/rad": 1e-3, "Nms/rad": 1, "N.m.s": 1},
    "device.encoder_resolution_m": {"rad": 1, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180},
    "device.max_force_n": {"N.m": 1, "Nm": 1, "mN.m": 1e-3, "N.cm": 1e-2},
    "environment.stiffness_n_per_m": {"N.m/rad": 1, "Nm/rad": 1, "N.m/deg": 180 / math.pi, "mN.m/rad": 1e-3},
}
TYPED = ["--mass", "120 g", "--wall", "3 kN/m"]


@st.composite
def answers(draw, units):
    values = draw(st.fixed_dictionaries({key: st.floats(1e-3, 0.9) for key in units}))
    named = {key: draw(st.sampled_from(sorted(of))) for key, of in units.items()}
    typed = {key: f"{value / units[key][named[key]]!r} {named[key]}" for key, value in values.items()}
    return values, typed


@given(answers(LINEAR))
def test_a_linear_device_is_read_back(tmp_path_factory, drawn):
    values, typed = drawn
    read = NewProblem(tmp_path_factory.getbasetemp() / "p.toml", typed=typed).problem()
    for key, value in values.items():
        table, _, name = key.partition(".")
        assert getattr(getattr(read, table), name) == pytest.approx(value, rel=1e-13)


@given(answers(ROTARY), st.floats(3e-3, 5))
def test_a_device_that_turns_is_read_back(tmp_path_factory, drawn, radius):
    values, typed = drawn
    typed["device.handle_radius_m"] = f"{1e3 * radius!r} mm"
    new = NewProblem(tmp_path_factory.getbasetemp() / "p.toml", motion="rotary", held="fingertip", typed=typed)
    read = new.problem()
    assert read.device.motion == "rotary"
    assert read.device.handle_radius_m == pytest.approx(radius, rel=1e-13)
    for key, value in values.items():
        table, _, name = key.partition(".")
        assert getattr(getattr(read, table), name) == pytest.approx(value, rel=1e-13)
    # A finger of 20 to 100 g at that radius is an inertia.
    assert read.hands.mass_kg == pytest.approx((0.02 * radius**2, 0.1 * radius**2), rel=1e-12)
    assert new.faults() == []


def test_options_write_the_numbers_that_were_typed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "wall.toml", *TYPED, "--delay", "2ms", "--rate", "2 kHz", "--encoder", "55 um"]) == 0
    capsys.readouterr()
    tables = tomllib.loads((tmp_path / "wall.toml").read_text(encoding="utf-8"))
    assert tables == {
        "device": {
            "mass_kg": 0.12,
            "damping_ns_per_m": 0.0,
            "sample_time_s": 5e-4,
            "delay_samples": 4,
            "encoder_resolution_m": 5.5e-5,
        },
        "environment": {"stiffness_n_per_m": 3000.0, "damping_ns_per_m": 0.0},
    }


def test_a_device_of_the_catalogue_keeps_what_was_not_typed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "a.toml", "--like", "phantom-touch", *TYPED]) == 0
    known = avc_casadi.load_device("phantom-touch").device
    found = avc_casadi.load_problem("a.toml").device
    assert (found.mass_kg, found.max_force_n, found.delay_samples) == (0.12, known.max_force_n, known.delay_samples)
    assert found.range.mass_kg is None
    assert found.range.damping_ns_per_m == known.range.damping_ns_per_m
    # A file of one's own stands relative to the problem.
    (tmp_path / "mine.toml").write_text("[device]\nmass_kg = 0.2\ndamping_ns_per_m = 1.0\n", encoding="utf-8")
    (tmp_path / "sub").mkdir()
    assert main(["new", "sub/b.toml", "--like", "mine.toml", "--wall", "1 N/mm"]) == 0
    assert avc_casadi.load_problem("sub/b.toml").device.mass_kg == 0.2
    capsys.readouterr()


def test_a_file_that_is_there_stays_unless_forced(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wall.toml").write_text("mine", encoding="utf-8")
    assert main(["new", "wall.toml", *TYPED]) == 2
    assert (tmp_path / "wall.toml").read_text(encoding="utf-8") == "mine"
    assert main(["new", "wall.toml", *TYPED, "--force"]) == 0
    assert avc_casadi.load_problem("wall.toml").device.mass_kg == 0.12
    capsys.readouterr()
