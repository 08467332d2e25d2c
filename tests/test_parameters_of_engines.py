"""`avc export --parameters`: the numbers are those of the coupling in each engine's units, and MuJoCo takes them."""

import json
import math

import pytest
from exported_tool import DEVICE, tool_coupling

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.cli.deploy import ENGINES as OF_THE_COMMAND
from avc_casadi.files.coupling_file import write_coupling
from avc_casadi.present.engines import ENGINES, TABLE, parameters, values_of

TOOL = "tool_mass_kg = 0.2\nstep_s = 0.002\n"
SCALED = f"{TOOL}position_scale = 10.0\nforce_scale = 0.5\n"
WHEEL = (
    '[device]\nmotion = "rotary"\nhandle_radius_m = 0.15\ninertia_kgm2 = 0.05\ndamping_nms_per_rad = 0.3\n'
    "delay_samples = 1\nmax_torque_nm = 8.0\n"
)
K, B = 2000.0, 15.0


# Scales of 10 and 0.5: K and B of the scene are those of the device over 5.
K_SCENE, B_SCENE, MASS = 400.0, 3.0, 0.2
WANTED = {
    "mujoco": {"K": 400.0, "B": 3.0, "-K (1 - d)/m": -1998.0, "-B (1 - d)/m": -14.985, "h": 0.002, "m": 0.2},
    "chai3d": {"K f": 200.0, "B p f": 15.0, "p": 10.0, "h": 0.002},
    "unity": {"K": 400.0, "B": 3.0, "m": 0.2, "h": 0.002},
    "sofa": {"K": 400.0, "B": 3.0, "B/K": 0.0075, "f": 0.5, "0": 0.0},
    "openhaptics": {"K p f/1000": 2.0, "B p f/1000": 0.015, "1/T": 1000.0},
    "imstk": {"K": 400.0, "B": 3.0, "p": 10.0, "f": 0.5},
    "ros2": {"K": 400.0, "B": 3.0, "B/(2 sqrt(K m))": 3.0 / (2 * math.sqrt(80.0)), "1": 1.0},
    "pybullet": {"K": 400.0, "B": 3.0, "h": 0.002, "0": 0.0},
}
UNITS = {"K": ("N/m", "N/mm"), "B": ("N.s/m", "N.s/mm"), "m": ("kg",), "h": ("s",), "1/T": ("Hz",), "B/K": ("s",)}


def rows(keys, engine, local=0.0, device=DEVICE):
    return parameters(tool_coupling(keys, K, B, local, device), engine).data["parameters"]


def numbers(keys, engine, local=0.0, device=DEVICE):
    """The value of each row by its formula."""
    return {one["formula"]: one["value"] for one in rows(keys, engine, local, device)}


@pytest.mark.parametrize("engine", ENGINES)
def test_rows_hold_the_numbers_of_the_coupling_in_the_units_of_the_engine(engine):
    found = numbers(SCALED, engine, local=7.0)
    assert {key: found[key] for key in WANTED[engine]} == pytest.approx(WANTED[engine])
    assert found["local B"] == 7.0
    made = [one["formula"].partition(" (")[0].lstrip("-").split(" ")[0] for one in rows(SCALED, engine)]
    assert {"K", "B"} <= set(made)
    for one in rows(SCALED, engine):
        assert one["place"]
        first = one["formula"].split(" ")[0] if "m)" not in one["formula"] and "/m" not in one["formula"] else ""
        assert one["unit"] in UNITS.get(first, ("", "N/m", "N"))


def test_every_engine_and_formula_of_the_table_is_known():
    assert {one["engine"] for one in TABLE} == set(ENGINES) == set(WANTED)
    assert {one["formula"] for one in TABLE} == set(values_of(tool_coupling(TOOL, K, B)))


WELD = """<mujoco><option gravity="0 0 0" timestep="0.002"/><worldbody><body name="hand" mocap="true"/>
<body name="tool"><freejoint/><geom type="sphere" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body>
</worldbody><equality><weld body1="tool" body2="hand" solref="{solref}" solimp="{solimp}"/></equality></mujoco>"""
SLIDE = """<mujoco><option gravity="0 0 0" timestep="0.002" integrator="{integrator}"/><worldbody><body name="tool">
<joint type="slide" axis="1 0 0" damping="{damping}"/><geom type="sphere" size="0.02" mass="0.2"/></body></worldbody>
</mujoco>"""


@pytest.mark.parametrize("keys", [TOOL, SCALED])
def test_weld_of_the_page_has_the_stiffness_of_the_coupling_in_mujoco(keys):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    told = numbers(keys, "mujoco")
    solref = f"{told['-K (1 - d)/m']} {told['-B (1 - d)/m']}"
    model = mujoco.MjModel.from_xml_string(WELD.format(solref=solref, solimp=f"{told['d']} {told['d']} 0.001"))
    data = mujoco.MjData(model)
    for _ in range(5000):
        data.xfrc_applied[model.body("tool").id, 0] = 1.0
        mujoco.mj_step(model, data)
    wanted = K if keys is TOOL else K / 5
    assert 1.0 / data.qpos[0] == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("integrator", ["semi-implicit", "implicit-damping"])
@pytest.mark.parametrize("keys", [TOOL, SCALED])
def test_line_of_the_page_is_spring_and_damper_in_mujoco(keys, integrator):
    """The line is run as it stands: the tool of a device at rest swings as a mass on the spring and the damper."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'avc-casadi[model]'")
    stated = f'{keys}integrator = "{integrator}"\n'
    document, told = parameters(tool_coupling(stated, K, B), "mujoco").data, numbers(stated, "mujoco")
    damping = told["B"] if integrator == "implicit-damping" else 0.0
    text = SLIDE.format(integrator=document["integrator"], damping=damping)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    scale = 1.0 if keys is TOOL else 10.0
    k, b = (K, B) if keys is TOOL else (K / 5, B / 5)
    place, speed, t, m = 0.0, 0.0, 0.002, 0.2
    for x, v in [(1e-3, 0.0)] * 50 + [(1e-3 + 1e-5 * j, 0.005) for j in range(50)]:
        seen = {"K": told["K"], "B": told["B"], "x": scale * x, "v": scale * v}
        exec(document["law"], {"data": data, "dof": 0, **seen})  # noqa: S102 - the line of our own page
        mujoco.mj_step(model, data)
        pull = k * (scale * x - place) + b * scale * v
        if integrator == "semi-implicit":
            speed += t / m * (pull - b * speed)
        else:
            speed = (m * speed + t * pull) / (m + t * b)
        place += t * speed
        assert data.qpos[0] == pytest.approx(place, abs=1e-7)
    assert abs(place) > 5e-4


def test_engine_with_another_integrator_is_told():
    stated = f'{TOOL}integrator = "implicit"\n'
    assert len(parameters(tool_coupling(TOOL, K, B), "sofa").data["traps"]) == 2
    assert len(parameters(tool_coupling(stated, K, B), "sofa").data["traps"]) == 1


@pytest.mark.parametrize("engine", ENGINES)
def test_fixed_place_and_device_that_turns_have_pages_too(engine, tmp_path, capsys):
    file = tmp_path / "c.json"
    for keys, device in (("step_s = 0.016", DEVICE), ("step_s = 0.002\ntool_inertia_kgm2 = 0.05", WHEEL)):
        write_coupling(tool_coupling(keys, 20.0, 0.3, device=device), file)
        if device is WHEEL and engine in ("chai3d", "sofa", "openhaptics"):
            assert main(["export", str(file), "--parameters", engine]) == 2
            capsys.readouterr()
            continue
        assert main(["export", str(file), "--parameters", engine]) == 0
        page = capsys.readouterr().out
        assert f"for {ENGINES[engine].title}" in page
        assert "nan" not in page
        if device is WHEEL:
            assert "20.0 N.m/rad" in page
            assert "N/m" not in page
            assert "N.s/m" not in page


def test_command_writes_c_and_one_document(tmp_path, capsys):
    file = tmp_path / "c.json"
    write_coupling(tool_coupling(TOOL, 500.0, 5.0), file)
    folder = tmp_path / "c"
    assert main(["export", str(file), "--c", str(folder), "--name", "knob", "--precision", "double", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["files"] == [str(folder / "knob.h"), str(folder / "knob.c")]
    assert "knob_step" in (folder / "knob.h").read_text()
    assert main(["export", str(file), "--parameters", "mujoco", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kind"] == "parameters"


def test_unstable_coupling_is_written_on_request_alone(tmp_path, capsys):
    file = tmp_path / "c.json"
    write_coupling(tool_coupling(f'{TOOL}exchange = "ahead"', 20000.0, 20.0), file)
    assert main(["export", str(file), "--c", str(tmp_path / "c")]) == 1
    assert "linearly unstable" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
    assert main(["export", str(file), "--c", str(tmp_path / "c"), "--unsafe"]) == 0
    assert main(["export", str(file), "--parameters", "mujoco"]) == 1
    out, err = capsys.readouterr()
    assert "linearly unstable" in err
    assert "qfrc_applied" not in out
    assert main(["export", str(file), "--parameters", "mujoco", "--unsafe"]) == 0
    assert "UNSAFE, written by request" in capsys.readouterr().out


@pytest.mark.parametrize("integrator", ["implicit-damping", "implicit"])
@pytest.mark.parametrize("engine", ENGINES)
def test_engine_that_does_not_solve_what_the_coupling_leaves_to_it_is_refused(engine, integrator):
    coupling = tool_coupling(f'{TOOL}integrator = "{integrator}"\n', K, B)
    if engine == "openhaptics" or integrator in ENGINES[engine].integrators:
        assert parameters(coupling, engine).data["parameters"]
        return
    with pytest.raises(avc.InputError, match=r"solves no .*say integrator = .* in \[simulation\] and make it again"):
        parameters(coupling, engine)


@pytest.mark.parametrize("mass", [0.005, 0.2])
def test_numbers_for_sofa_are_the_certified_step_in_its_implicit_solver(mass):
    """One spring in EulerImplicitSolver: (M + h (h + s) K) dv = h (f - (h + s) K v), s its rayleighStiffness."""
    told = numbers(f'tool_mass_kg = {mass}\nstep_s = 0.005\nintegrator = "implicit"\n', "sofa")
    k, reach, h = told["K"], 0.005 + told["B/K"], 0.005
    goal, rate, place, speed = 0.001, 0.02, 0.0004, -0.03
    pull = k * (goal - place) + B * rate
    after = speed + h * (pull - reach * k * speed) / (mass + h * reach * k)
    assert mass * (after - speed) / h == pytest.approx(K * (goal - place - h * after) + B * (rate - after), rel=1e-9)


@pytest.mark.parametrize(
    ("verb", "said"),
    [
        (("push", "c.json", "--port", "emulator"), "simulate, run, check and export know a [simulation]"),
        (("stream", "c.json", "--port", "emulator"), "simulate, run, check and export know a [simulation]"),
        (("trial", "c.json"), "simulate, run, check and export know a [simulation]"),
        (
            ("firmware", "c.json", "--board", "netduinoplus2", "--out", "o"),
            "simulate, run, check and export know a [simulation]",
        ),
        (("export", "c.json", "--c", "o", "--problem", "soft"), "--problem: does not apply to this coupling"),
        (("export", "w.json", "--parameters", "unity"), "--parameters: is of a coupling to a [simulation]"),
    ],
)
def test_verbs_that_cannot_take_it_say_what_does(verb, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_coupling(tool_coupling(TOOL, 500.0, 5.0), "c.json")
    problem = avc.load_problem("soft")
    avc.write_coupling(avc.Coupling.of(problem, avc.solve(problem, "static")), "w.json")
    assert main(list(verb)) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "o").exists()


def test_command_knows_the_engines():
    assert tuple(ENGINES) == OF_THE_COMMAND
    with pytest.raises(avc.InputError, match="allowed: mujoco"):
        parameters(tool_coupling(TOOL, K, B), "havok")
