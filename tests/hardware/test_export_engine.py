"""The exported coupling to a simulation is the loop that was certified, on any compiler; faults end in less force."""

import math

import numpy as np
import pytest
from engine_simulator import EngineSimulator
from exported import C99, CLANG, CPP11
from exported_tool import DEVICE, ExportedLoop, ExportedTool, tool_coupling
from quick import first

import avc_casadi as avc
from avc_hardware import export_c

HAND = (0.3, 4.0, 300.0)
SAMPLES = 1000
T = 1e-3
# In which a force fades, in samples.
FADE = 50
TURNING = (
    '[device]\nmotion = "rotary"\nhandle_radius_m = 0.15\ninertia_kgm2 = 0.05\ndamping_nms_per_rad = 0.3\n'
    "delay_samples = 1\nmax_torque_nm = 8.0\n"
)
TOOL = "tool_mass_kg = 0.2\nstep_s = 0.002\n"


def target():
    times = T * np.arange(SAMPLES)
    return 0.02 * np.sin(2 * math.pi * 1.5 * times) * (times < 1)


@pytest.mark.parametrize(
    ("exchange", "late", "gains", "ratio", "scales", "device", "contact", "integrator"),
    first(
        [
            ("on-time", 0, (2000.0, 15.0, 0.0), 2, (1.0, 1.0), DEVICE, None, "semi-implicit"),
            ("on-time", 0, (2000.0, 15.0, 0.0), 1, (10.0, 0.1), DEVICE, (1000.0, 5.0), "semi-implicit"),
            ("on-time", 1, (900.0, 8.0, 1.0), 5, (0.5, 3.0), DEVICE, None, "explicit"),
            ("on-time", 0, (900.0, 8.0, 0.0), 1.5, (1.0, 1.0), DEVICE, None, "semi-implicit"),
            ("late", 0, (900.0, 8.0, 0.0), 4, (2.0, 5.0), DEVICE, (1000.0, 5.0), "semi-implicit"),
            ("ahead", 0, (150.0, 2.0, 2.0), 3, (10.0, 1.0), DEVICE, None, "semi-implicit"),
            ("ahead", 1, (150.0, 2.0, 2.0), 3, (1.0, 0.2), DEVICE, None, "semi-implicit"),
            ("held-force", 0, (300.0, 3.0, 4.0), 3, (4.0, 0.5), DEVICE, None, "semi-implicit"),
            ("held-force", 1, (300.0, 3.0, 4.0), 2, (1.0, 1.0), DEVICE, (1000.0, 5.0), "semi-implicit"),
            ("on-time", 0, (40.0, 0.6, 0.0), 2, (3.0, 0.5), TURNING, None, "semi-implicit"),
            ("held-force", 0, (20.0, 0.3, 0.5), 4, (1.0, 1.0), TURNING, None, "semi-implicit"),
            ("on-time", 0, (900.0, 8.0, 0.0), 5, (10.0, 0.1), DEVICE, (1000.0, 5.0), "implicit-damping"),
            ("late", 0, (500.0, 6.0, 0.0), 4, (2.0, 5.0), DEVICE, None, "implicit-damping"),
            ("held-force", 0, (300.0, 3.0, 4.0), 2, (1.0, 0.5), DEVICE, None, "implicit-damping"),
            ("on-time", 0, (900.0, 8.0, 0.0), 1.5, (0.5, 3.0), DEVICE, (1000.0, 5.0), "implicit"),
            ("ahead", 0, (900.0, 8.0, 0.0), 5, (10.0, 1.0), DEVICE, None, "implicit"),
            ("held-force", 1, (150.0, 3.0, 4.0), 2, (2.0, 1.0), DEVICE, None, "implicit"),
            ("on-time", 0, (40.0, 0.6, 0.0), 2, (3.0, 0.5), TURNING, None, "implicit-damping"),
            ("on-time", 0, (40.0, 0.6, 0.0), 2, (3.0, 0.5), TURNING, None, "implicit"),
            ("on-time", 1, (500.0, 8.0, 1.0), 5, (0.5, 3.0), DEVICE, (1000.0, 5.0), "exact"),
            ("held-force", 0, (300.0, 3.0, 4.0), 3, (4.0, 0.5), DEVICE, None, "exact"),
        ],
        10,
    ),
)
@pytest.mark.parametrize("substeps", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_exported_loop_is_the_plain_simulation(
    exchange, late, gains, ratio, scales, device, contact, integrator, substeps
):
    step = ratio * T
    keys = f'step_s = {step!r}\nexchange = "{exchange}"\nsteps_late = {late}\nintegrator = "{integrator}"\n'
    keys += f"substeps = {substeps}\n"
    keys += f"position_scale = {scales[0]}\n{'torque' if device is TURNING else 'force'}_scale = {scales[1]}\n"
    keys += "tool_inertia_kgm2 = 0.05\n" if device is TURNING else "tool_mass_kg = 0.2\n"
    coupling = tool_coupling(keys, *gains, device=device)
    stated = coupling.problem.device
    plant = (stated.mass_kg, stated.damping_ns_per_m, T, 1)
    mass = coupling.tool.tool_mass_kg[0]
    scale = coupling.tool.scale
    tuned = {"exchange": exchange, "steps_late": late, "integrator": integrator, "substeps": substeps}
    seen = None if contact is None else (scale * contact[0], scale * contact[1])
    simulator = EngineSimulator(plant, HAND, (scale * mass, scale * 0.5), step, contact=seen, **tuned)
    wanted = simulator.run(*gains[:2], SAMPLES, local=gains[2], target=target(), kick=0.2)
    loop = ExportedLoop(plant, HAND, (mass, 0.5), step, contact=contact, **tuned)
    found = loop.run_exported(ExportedTool(coupling), coupling.tool, SAMPLES, target=target(), kick=0.2)
    assert np.abs(wanted[0]).max() > 1e-3
    assert np.abs(found[0] - wanted[0]).max() < 1e-9
    assert np.abs(found[1] / scales[0] - wanted[1]).max() < 1e-9
    assert np.abs(found[2]).max() <= 8.0


# Mass of the tool, steps of the device in one of the engine, exchange, and what is recommended for it.


@pytest.mark.parametrize("compiler", [C99, CPP11, CLANG], ids=lambda one: one[0])
@pytest.mark.parametrize("precision", first(["single", "double"]))
@pytest.mark.parametrize("exchange", first(["on-time", "held-force"]))
def test_every_compiler_and_precision_gives_the_same_forces(compiler, precision, exchange):
    coupling = tool_coupling(f'{TOOL}exchange = "{exchange}"', 500.0, 5.0, 1.0)
    c = ExportedTool(coupling, compiler=compiler, precision=precision)
    reference = ExportedTool(coupling)
    rounding = 1e-5 if precision == "single" else 1e-12
    for k in range(300):
        x, place, speed = 0.01 * math.sin(0.03 * k), 0.008 * math.sin(0.03 * k - 0.2), 0.1 * math.cos(0.03 * k)
        given = (3 * math.sin(0.05 * k),) if exchange == "held-force" else (place, speed)
        assert c.step(x, *given) == pytest.approx(reference.step(x, *given), abs=8 * 100 * rounding)
        assert c.tool_force(place, speed) == pytest.approx(reference.tool_force(place, speed), abs=800 * rounding)


def at_rest(exchange="on-time", **simulation):
    """A coupling that has run for a while with the device 1 mm in front of the tool, and what the loop is given."""
    keys = "".join(f"{key} = {value}\n" for key, value in simulation.items())
    c = ExportedTool(tool_coupling(f'{TOOL}exchange = "{exchange}"\n{keys}', 1000.0, 5.0, 2.0))
    given = (1.0,) if exchange == "held-force" else (0.0, 0.0)
    c.init(0.001)
    for _ in range(FADE):
        c.tool_force(0.0, 0.0)
        force = c.step(0.001, *given)
    assert force == -1.0
    return c, given


@pytest.mark.parametrize("exchange", ["on-time", "held-force"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9, 0.5, -0.5, 0.005])
def test_single_bad_sample_changes_the_force_by_a_fiftieth(exchange, bad):
    c, given = at_rest(exchange)
    c.tool_force(0.0, 0.0)
    assert c.step(bad, *given) == pytest.approx(-1.0 + 1 / FADE)
    # What the engine is given is held too: no velocity of a jump reaches the tool.
    assert c.tool_force(0.0, 0.0) == pytest.approx(1.0 - 1 / FADE)
    assert c.step(0.001, *given) == -1.0


@pytest.mark.parametrize("exchange", ["on-time", "held-force"])
@pytest.mark.parametrize("bad", [9e-3, -9e-3, 4e-3])
def test_a_jump_behind_a_lost_sample_is_not_believed_either(exchange, bad):
    c, given = at_rest(exchange)
    for sample in (math.nan, 0.001 + bad):
        c.step(sample, *given)
    assert c.tool_force(0.0, 0.0) == pytest.approx(1.0 - 2 / FADE)


@pytest.mark.parametrize("exchange", ["on-time", "ahead", "held-force"])
@pytest.mark.parametrize("sample", [0, 1, 2, 6])
@pytest.mark.parametrize("bad", [9.8e-3, -9.8e-3, 4e-3, -1e-3, math.nan, -math.inf, 3e38])
def test_a_bad_sample_soon_after_the_start_gives_no_kick(exchange, sample, bad):
    """The spring alone would ask for 96 N: no tick gives more than a fiftieth of the limit."""
    c = ExportedTool(tool_coupling(f'{TOOL}exchange = "{exchange}"', 9786.0, 25.85, 2.0))
    c.begin()
    forces, tool, held = [], [], 0.0
    for k in range(40):
        c.sample(-0.028 + bad if k == sample else -0.028)
        if k % 2 == 0:
            tool.append(held := c.tool_force(-0.028, 0.0))
        forces.append(c.force(held) if exchange == "held-force" else c.force(-0.028, 0.0))
    assert np.abs(forces).max() <= 8.0 / FADE + 1e-9
    assert np.abs(tool).max() <= 9786.0 * 9.8e-3 / FADE


@pytest.mark.parametrize("exchange", ["on-time", "held-force"])
@pytest.mark.parametrize("bad", [1, 3])
def test_lost_damper_uncovers_no_spring(exchange, bad):
    """Drawn out of a tool at 0.25 m/s, damper against spring, with bad samples anywhere: no force grows by them."""
    coupling = tool_coupling(f'{TOOL}exchange = "{exchange}"', 9786.0, 25.85, 2.0)
    path = 1e-3 * np.minimum(np.arange(160) / 50, 1.0)
    path[100:] -= 0.25e-3 * np.arange(1, 61)
    for lost in range(98, 112):
        c, given = ExportedTool(coupling), (0.0,)
        forces = []
        for k, x in enumerate(path):
            c.sample(math.nan if lost <= k < lost + bad else x)
            if k % 2 == 0:
                given = (c.tool_force(0.0, 0.0),)
            forces.append(c.force(*(given if exchange == "held-force" else (0.0, 0.0))))
        given, last = np.array(forces[lost : lost + bad]), np.array(forces[lost - 1 : lost + bad - 1])
        assert np.all(given * last >= 0)
        assert np.all(np.abs(given) <= np.abs(last))
        # A fiftieth of the limit comes back in a sample; half as much is rounding.
        assert abs(forces[lost + bad]) <= abs(forces[lost + bad - 1]) + 1.5 * 8.0 / FADE


@pytest.mark.parametrize("exchange", ["on-time", "held-force"])
def test_device_that_is_elsewhere_is_believed_without_a_kick(exchange):
    """The position jumps by 30 mm and stays there: the force fades, the place is believed, the force comes back."""
    c, given = at_rest(exchange)
    forces = []
    for _ in range(4 * FADE):
        c.tool_force(0.0, 0.0)
        forces.append(c.step(0.031, *given))
    forces = np.array(forces)
    # The limit of the force comes back over the whole fade.
    assert np.abs(np.diff([-1.0, *forces])).max() <= 8.0 / FADE + 1e-9
    assert forces[FADE - 1] == 0
    assert np.all(np.diff(forces[:FADE]) >= 0)
    assert np.all(np.diff(forces[FADE:]) <= 0)
    assert forces[-1] == (-1.0 if exchange == "held-force" else -8.0)


@pytest.mark.parametrize("bad", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (0.0, 50.0), (0.4, 0.0), (1e30, 0)])
def test_engine_that_hands_out_nonsense_is_held_and_then_left(bad):
    c, given = at_rest()
    forces = []
    for _ in range(2 * FADE):
        c.tool_force(*bad)
        forces.append(c.step(0.001, *bad))
    assert np.allclose(forces[:FADE], -1.0 + np.arange(1, FADE + 1) / FADE)
    if bad == (0.4, 0.0):  # a tool that was set down elsewhere is found there
        assert np.all(np.diff(forces[FADE - 1 :]) >= 0)
        assert forces[-1] == pytest.approx(8.0)
    else:
        assert np.all(np.array(forces[FADE:]) == 0)
        for _ in range(FADE + 1):
            c.tool_force(*given)
            back = c.step(0.001, *given)
        assert back == -1.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_engine_whose_force_is_no_number_is_held_and_then_left(bad):
    c, _ = at_rest("held-force")
    forces = []
    for _ in range(2 * FADE):
        c.tool_force(0.0, 0.0)
        forces.append(c.step(0.001, bad))
    assert np.allclose(forces[:FADE], -1.0 + np.arange(1, FADE + 1) / FADE)
    assert np.all(np.array(forces[FADE:]) == 0)


@pytest.mark.parametrize("exchange", ["on-time", "late", "ahead", "held-force"])
def test_engine_that_hangs_lets_go_and_comes_back(exchange):
    c, given = at_rest(exchange)
    c.tool_force(0.0, 0.0)
    # Five steps of two samples are waited for.
    forces = [c.step(0.001, *given) for _ in range(10 + 2 * FADE)]
    assert forces[:10] == [-1.0] * 10
    assert np.allclose(forces[10 : 10 + FADE], -1.0 + np.arange(1, FADE + 1) / FADE)
    assert forces[10 + FADE :] == [0.0] * FADE
    back = []
    for _ in range(FADE + 1):
        c.alive()
        back.append(c.step(0.001, *given))
    assert np.all(np.diff(back) <= 0)
    assert abs(back[0]) <= 1 / FADE
    assert back[-1] == -1.0


@pytest.mark.parametrize("exchange", first(["on-time", "ahead", "held-force"]))
def test_loop_with_glitches_and_a_hanging_engine_settles(exchange):
    """Bad samples now and then, and an engine that hangs for 0.3 s: no force beyond the spring's, and rest after."""
    gains = (150.0, 2.0, 2.0)
    coupling = tool_coupling(f'{TOOL}exchange = "{exchange}"', *gains)
    loop = ExportedLoop((0.12, 0.8, T, 1), HAND, (0.2, 0.5), 2 * T, exchange=exchange)

    def glitch(k, x):
        return {0: math.nan, 40: x + 1.0, 80: math.inf}.get(k % 120, x) if k < 1000 else x

    silent = range(200, 350)
    runs = [
        loop.run_exported(ExportedTool(coupling), coupling.tool, 4000, target=np.zeros(4000), kick=0.2, **faults)
        for faults in ({}, {"glitch": glitch, "silent": silent})
    ]
    sound, faulty = runs
    assert np.isfinite(faulty).all()
    assert np.abs(faulty[2]).max() <= 1.5 * np.abs(sound[2]).max()
    assert np.abs(np.diff(faulty[0][-500:])).max() < 1e-6


def test_gains_that_are_not_stable_are_refused_or_written_down():
    coupling = tool_coupling(f'{TOOL}exchange = "ahead"', 20000.0, 20.0)
    with pytest.raises(avc.NotDeployableError, match="linearly unstable"):
        export_c(coupling)
    assert "UNSAFE, written by request" in export_c(coupling, unsafe=True)["avc_coupling.h"]
