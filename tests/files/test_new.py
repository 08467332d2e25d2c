"""`avc new` writes what was typed, in any unit that fits, and the reader of all files reads it back."""

import math
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from quick import first

import avc_casadi
import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.files.new_admittance import NewAdmittance
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


@pytest.mark.slow
@settings(max_examples=30)
@given(answers(LINEAR))
def test_a_linear_device_is_read_back(tmp_path_factory, drawn):
    values, typed = drawn
    read = NewProblem(tmp_path_factory.getbasetemp() / "p.toml", typed=typed).problem()
    for key, value in values.items():
        table, _, name = key.partition(".")
        assert getattr(getattr(read, table), name) == pytest.approx(value, rel=1e-13)


@pytest.mark.slow
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
    assert (
        main(
            ["new", "wall.toml", *TYPED, "--delay", "2ms", "--rate", "2 kHz", "--encoder", "55 um", "--wall-damping=0"]
        )
        == 0
    )
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


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["--rate", "500"], "--rate: is 500 without a unit, which means 500 s; give a unit: 500 Hz, or 2 ms"),
        (["--rate", "2"], "--rate: is 2 without a unit, which means 2 s; give a unit: 2 Hz, or 500 ms"),
        (["--encoder", "450"], "--encoder: is 450 without a unit, which means 450 m; give a unit: 55 um, 450 dpi"),
    ],
)
def test_a_number_without_a_unit_that_cannot_be_meant_in_si_units_is_refused(typed, said, tmp_path, capsys):
    file = tmp_path / "wall.toml"
    assert main(["new", str(file), *TYPED, *typed]) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert said in message
    assert message.count("--rate") + message.count("--encoder") == 1
    assert not file.exists()


def test_a_sample_time_without_a_unit_is_in_seconds(tmp_path, capsys):
    file = tmp_path / "wall.toml"
    assert main(["new", str(file), *TYPED, "--rate", "0.002"]) == 0
    capsys.readouterr()
    assert avc_casadi.load_problem(str(file)).device.sample_time_s == 0.002


def test_a_file_that_is_there_stays_unless_forced(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wall.toml").write_text("mine", encoding="utf-8")
    assert main(["new", "wall.toml", *TYPED]) == 2
    assert (tmp_path / "wall.toml").read_text(encoding="utf-8") == "mine"
    assert main(["new", "wall.toml", *TYPED, "--force"]) == 0
    assert avc_casadi.load_problem("wall.toml").device.mass_kg == 0.12
    capsys.readouterr()


POUND_INCH = 0.45359237 * 0.0254
# Sheets of ten kinds of device in their vendors' words, and what they are in SI units.
SHEETS = {
    "voice coil": ("--mass 45_g --max-force 8.2_N --encoder 0.5_um --damping 0.8_Ns/m", 0.045, 8.2, 5e-7),
    "belt stage": ("--mass 1.2_kg --max-force 60_N --encoder 4000_counts_per_10_mm", 1.2, 60.0, 2.5e-6),
    "screw": (
        "--mass 50_g.cm2,_pitch_10_mm --max-force 0.2_N.m,_pitch_5_mm --encoder 4096_counts,_pitch_5_mm",
        *(5e-6 * (2 * math.pi / 0.01) ** 2, 0.2 * 2 * math.pi / 5e-3, 5e-3 / 4096),
    ),
    "optical mouse": ("--mass 0.1_lb --max-force 0.3_kgf --encoder 450_dpi", 0.045359237, 2.941995, 0.0254 / 450),
    "geared motor": (
        "--inertia 33.5_gcm2 --max-torque 90_mNm,_gear_30:1 --encoder 2000_CPR,_gear_30",
        *(3.35e-6, 2.7, 2 * math.pi / 60_000),
    ),
    "servo": ("--inertia 300_g.cm2 --max-torque 13_kgf.cm --encoder 12_bit", 3e-5, 1.2748645, 2 * math.pi / 4096),
    "pedal": ("--inertia 0.3_kg.cm2 --max-torque 45_N.cm --encoder 0.088_deg", 3e-5, 0.45, math.radians(0.088)),
    "inch motor": (
        "--inertia 0.01_lb.in2 --max-torque 12_lbf.in --encoder 20_arcmin",
        *(0.01 * POUND_INCH * 0.0254, 12 * POUND_INCH * 9.80665, math.radians(1 / 3)),
    ),
    "ounce motor": (
        "--inertia 0.0014_ozf.in.s2 --max-torque 25_ozf.in --encoder 500_counts",
        *(0.0014 * POUND_INCH / 16 * 9.80665, 25 * POUND_INCH / 16 * 9.80665, 2 * math.pi / 500),
    ),
    "wheel": ("--inertia 0.02_kg_m^2 --max-torque 60_N --encoder 4000_counts_per_10_mm", 0.02, 1.2, 1.25e-4),
}


@pytest.mark.parametrize("sheet", first(SHEETS, 2))
def test_a_sheet_in_the_words_of_its_vendor_is_a_file_in_si_units(sheet, tmp_path, capsys):
    words, mass, force, step = SHEETS[sheet]
    turns = ["--radius", "20 mm"] if "--inertia" in words else []
    typed = [word.replace("_", " ") for word in words.split()]
    assert main(["new", str(tmp_path / "p.toml"), "--wall", "3 kN/m", *turns, *typed]) == 0
    capsys.readouterr()
    device = avc.load_problem(tmp_path / "p.toml").device
    found = device.mass_kg, device.max_force_n, device.encoder_resolution_m
    assert found == pytest.approx((mass, force, step), rel=1e-9)


@pytest.mark.parametrize(
    ("typed", "names"),
    [
        (["--force", "200 N"], ("--force", "--max-force")),
        (["--held", "foot"], ("--hand-mass: is missing", "--hand-stiffness")),
    ],
)
def test_a_value_that_is_none_names_its_option_and_what_to_write(typed, names, tmp_path, capsys):
    assert main(["new", str(tmp_path / "p.toml"), *TYPED, *typed]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in names), message


# `avc new --model` writes the range of masses at the tip: against a textbook's two links in closed form.

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")

CHAIN = """<mujoco><worldbody><body name="frame" euler="{tilt} 0 0"><body name="upper">
<joint name="shoulder" axis="0 0 1" {shoulder} damping="{d[0]}"/>
<inertial mass="{m[0]}" pos="{c[0]} 0 0" diaginertia="{i[0]} {i[0]} {i[0]}"/>
<body name="fore" pos="{l[0]} 0 0"><joint name="elbow" axis="0 0 1" {elbow} damping="{d[1]}"/>
<inertial mass="{m[1]}" pos="{c[1]} 0 0" diaginertia="{i[1]} {i[1]} {i[1]}"/>
<site name="tip" pos="{l[1]} 0 0"/></body></body></body></worldbody></mujoco>"""
LIMITS = {"shoulder": 'range="-60 60"', "elbow": 'range="40 140"'}


def arm(seed):
    """Lengths, masses, inertias, centres and dampings of two links."""
    draw = np.random.default_rng(seed)
    length = draw.uniform(0.1, 0.3, 2)
    return {
        "l": length,
        "m": draw.uniform(0.05, 0.4, 2),
        "c": length * draw.uniform(0.2, 0.8, 2),
        "i": draw.uniform(1e-4, 1e-3, 2),
        "d": draw.uniform(0.005, 0.05, 2),
    }


def matrices(link, shoulder, elbow):
    """Jacobian and mass matrix of two links in closed form, (poses, 2, 2) each."""
    (l1, l2), (m1, m2), (c1, c2), (i1, i2) = (link[key] for key in "lmci")
    m22 = i2 + m2 * c2**2
    m12 = m22 + m2 * l1 * c2 * np.cos(elbow)
    m11 = i1 + m1 * c1**2 + m2 * l1**2 + 2 * m12 - m22
    both = shoulder + elbow
    x, y = l2 * np.cos(both), l2 * np.sin(both)
    jacobian = np.array([[-l1 * np.sin(shoulder) - y, -y], [l1 * np.cos(shoulder) + x, x]])
    mass = np.array([[m11, m12], [m12, np.full_like(m12, m22)]])
    return np.moveaxis(jacobian, -1, 0), np.moveaxis(mass, -1, 0)


def poses(count, seed=1):
    draw = np.random.default_rng(seed)
    return np.radians(draw.uniform(-60, 60, count)), np.radians(draw.uniform(40, 140, count))


def written(folder, text):
    """The device of the problem that is written for a model."""
    (folder / "arm.xml").write_text(text)
    arguments = ["--model", str(folder / "arm.xml"), "--tip", "tip", "--wall", "3 kN/m"]
    assert main(["new", str(folder / "p.toml"), "--force", *arguments]) == 0
    return avc.load_problem(folder / "p.toml").device


@pytest.mark.parametrize(("seed", "tilt"), first([(0, 0), (1, 90), (2, 35)]))
def test_the_range_holds_every_pose_and_normal_and_little_more(seed, tilt, tmp_path):
    link = arm(seed)
    device = written(tmp_path, CHAIN.format(tilt=tilt, **LIMITS, **link))
    low, high = device.range.mass_kg
    jacobian, mass = matrices(link, *poses(1000))
    mobility = jacobian @ np.linalg.solve(mass, np.swapaxes(jacobian, 1, 2))
    angle = np.random.default_rng(2).uniform(0, np.pi, 1000)
    normal = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    free = 1 / np.einsum("pi,pij,pj->p", normal, mobility, normal)
    guided = np.einsum("pi,pij,pj->p", normal, np.linalg.inv(mobility), normal)
    assert low <= free.min()
    assert guided.max() <= high
    assert low <= device.mass_kg <= high
    jacobian, mass = matrices(link, *poses(40_000))
    principal = 1 / np.linalg.eigvalsh(jacobian @ np.linalg.solve(mass, np.swapaxes(jacobian, 1, 2)))
    assert low > 0.9 * principal.min()
    assert high < 1.1 * principal.max()
    # Of all joint speeds with one unit along n, the least loss: Lagrange's condition.
    lost = 1 / np.linalg.eigvalsh(jacobian / link["d"] @ np.swapaxes(jacobian, 1, 2))[:, -1]
    assert 0.9 * lost.min() < device.damping_ns_per_m <= lost[:1000].min()


@pytest.mark.parametrize("name", first(["shoulder", "elbow"]))
def test_a_joint_has_the_inertia_of_every_pose_and_little_more(name, tmp_path, capsys):
    """M_ii where the other joint stands still, 1/(M^-1)_ii where it yields, with the armature in both."""
    link, armature = arm(3), 2e-4
    drive = f'<actuator><position joint="{name}" kp="40" kv="1.5" gear="2"/></actuator></mujoco>'
    model = CHAIN.replace("</mujoco>", drive).format(tilt=0, **LIMITS, **link)
    model = model.replace(f'name="{name}" axis', f'name="{name}" armature="{armature}" axis')
    model = model.replace("<mujoco>", '<mujoco><option timestep="0.004" integrator="implicitfast"/>')
    (tmp_path / "arm.xml").write_text(model)
    file = tmp_path / "joint.toml"
    assert main(["new", str(file), "--model", str(tmp_path / "arm.xml"), "--joint", name]) == 0
    index = ["shoulder", "elbow"].index(name)
    _, mass = matrices(link, *poses(20_000))
    mass = mass + armature * np.eye(2)[index] * np.eye(2)[index][:, None]
    held, yielding = mass[:, index, index], 1 / np.linalg.inv(mass)[:, index, index]
    stated = avc.load_problem(file)
    low, high = stated.end.engine.tool_mass_kg
    assert 0.97 * yielding.min() < low <= yielding.min()
    assert held.max() <= high < 1.03 * held.max()
    assert not stated.units.linear
    assert stated.end.engine.step_s == (0.004, 0.004)
    assert stated.end.engine.integrator == "implicit-damping"
    assert (stated.law.stiffness_n_per_m, stated.law.damping_ns_per_m) == pytest.approx((160.0, 6.0))
    capsys.readouterr()
    assert main(["certify", str(file)]) in (0, 1)
    assert "Stable kp" in capsys.readouterr().out


def test_a_joint_of_a_model_is_a_known_hinge_or_slide(tmp_path, capsys):
    (tmp_path / "arm.xml").write_text(CHAIN.format(tilt=0, **LIMITS, **arm(3)))
    arguments = ["new", str(tmp_path / "joint.toml"), "--model", str(tmp_path / "arm.xml")]
    assert main([*arguments, "--joint", "elbows"]) == 2
    assert "no joint of the model; near: elbow" in capsys.readouterr().err
    assert main([*arguments, "--joint", "elbow", "--mass", "1 kg"]) == 2
    assert "--mass: " in capsys.readouterr().err
    assert main([*arguments[:2], "--joint", "elbow"]) == 2
    assert "--model: is missing" in capsys.readouterr().err


SHEET = {
    "device.drive_bandwidth_hz": {"Hz": 1, "kHz": 1e3},
    "device.max_speed_m_per_s": {"m/s": 1, "mm/s": 1e-3},
    "device.force_sensor.stiffness_n_per_m": {"N/m": 1, "N/um": 1e6},
    "device.force_sensor.handle_mass_kg": {"kg": 1, "g": 1e-3},
    "device.force_sensor.noise_rms_n": {"N": 1, "mN": 1e-3},
    "device.force_sensor.resolution_n": {"N": 1, "mN": 1e-3},
    "device.force_sensor.max_force_n": {"N": 1, "kN": 1e3},
}


@given(st.fixed_dictionaries({key: st.floats(1, 90) for key in SHEET}), st.data())
def test_an_admittance_device_is_read_back(tmp_path_factory, values, data):
    named = {key: data.draw(st.sampled_from(sorted(of))) for key, of in SHEET.items()}
    typed = {key: f"{value / SHEET[key][named[key]]!r} {named[key]}" for key, value in values.items()}
    typed |= {"contact.stiffness_n_per_m": "20 kN/m"}
    read = NewAdmittance(tmp_path_factory.getbasetemp() / "p.toml", typed=typed).problem()
    for key, value in values.items():
        table = read.device.force_sensor if "force_sensor" in key else read.device
        assert getattr(table, key.rpartition(".")[2]) == pytest.approx(value, rel=1e-13)
    # The stiffest contact includes every softer one; a damping that is not known is 0.
    assert read.contact.stiffness_n_per_m == (0.0, 2e4)
    assert read.contact.damping_ns_per_m == (0.0, 0.0)
    assert read.law is None


DRIVE = ["--drive", "velocity", "--drive-bandwidth", "15 Hz", "--handle-mass", "800 g"]
ARM = [*DRIVE, "--sensor-stiffness", "1 kN/mm"]


def test_the_file_of_an_admittance_device_marks_what_is_assumed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    contact = ["--contact", "1 to 20 kN/m", "--contact-damping", "5 N.s/m"]
    assert main(["new", "arm.toml", *ARM, "--rate", "500 Hz", "--delay", "4 ms", "--max-force", "200 N", *contact]) == 0
    assert "avc recommend arm.toml" in capsys.readouterr().out
    read, text = avc.load_admittance("arm.toml"), (tmp_path / "arm.toml").read_text()
    assert read.device.delay_samples == 2
    assert read.device.force_sensor.max_force_n == 200.0
    assert read.contact.stiffness_n_per_m == (1e3, 2e4)
    assert read.contact.damping_ns_per_m == (5.0, 5.0)
    assert "0.02, assumed" in text
    assert "# max_speed_m_per_s             # not known" in text
    assert main(["check", "arm.toml"]) == 0


@pytest.mark.parametrize("contact", [[], ["--contact", "20 kN/m", "--contact-damping", "5 N.s/m"]])
def test_a_forgotten_unit_of_an_admittance_device_is_a_warning(contact, tmp_path, capsys):
    file = tmp_path / "arm.toml"
    typed = ["--drive", "velocity", "--drive-bandwidth", "15 Hz", "--sensor-stiffness", "1 kN/mm"]
    assert main(["new", str(file), *typed, "--handle-mass", "800", *contact]) == 0
    warned = [line for line in capsys.readouterr().out.splitlines() if "! Warning" in line]
    assert [line.split()[2] for line in warned] == ["device.force_sensor.handle_mass_kg"]


def test_a_forgotten_unit_is_the_warning_that_check_gives(tmp_path, capsys):
    file = tmp_path / "wall.toml"
    warned = []
    for command in (["new", str(file), "--mass", "120", "--wall", "3 kN/m"], ["check", str(file)]):
        assert main(command) == 0
        warned.append([line.split() for line in capsys.readouterr().out.splitlines() if "! Warning" in line])
    assert warned[0] == warned[1]
    assert any("device.mass_kg" in line for line in warned[0])


def test_an_admittance_device_that_turns_has_its_own_options(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    turned = ["--drive", "velocity", "--radius", "150 mm", "--drive-bandwidth", "20 Hz", "--held", "fingertip"]
    sensor = ["--sensor-stiffness", "2 kN.m/rad", "--handle-inertia", "0.01 kg.m2", "--max-torque", "20 N.m"]
    assert main(["new", "wheel.toml", *turned, *sensor]) == 0
    read = avc.load_admittance("wheel.toml")
    assert read.device.force_sensor.handle_mass_kg == 0.01
    assert read.device.force_sensor.max_force_n == 20.0
    assert read.hands.mass_kg == pytest.approx((0.02 * 0.15**2, 0.1 * 0.15**2))
    assert not read.contact.touches
    assert "sample_time_s 1 kHz" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("typed", "option", "said"),
    [
        (["--drive", "velocity"], "--drive-bandwidth", "is missing"),
        ([*ARM, "--wall", "3 kN/m"], "--wall", "commanded a force"),
        ([*ARM, "--like", "falcon"], "--like", "commanded a force"),
        ([*ARM, "--held", "stylus"], "--held", "grip, wheel, fingertip, foot or other"),
        ([*ARM, "--contact", "soft"], "--contact", "stiffness_n_per_m"),
        ([*DRIVE, "--sensor-stiffness", "0 N/m"], "--sensor-stiffness", "allowed"),
        (["--max-speed", "1 m/s"], "--max-speed", "--drive velocity only"),
        ([*ARM, "--handle-inertia", "1 kg.m2"], "--handle-mass", "rotary"),
    ],
)
def test_options_of_the_other_drive_are_refused(tmp_path, capsys, typed, option, said):
    assert main(["new", str(tmp_path / "p.toml"), *typed]) == 2
    complaint = capsys.readouterr().err
    assert option in complaint
    assert said in complaint
    assert not (tmp_path / "p.toml").exists()
