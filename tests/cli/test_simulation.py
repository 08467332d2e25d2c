"""certify, zwidth, simulate and check of a problem with [simulation], and of the file of its coupling."""

import json

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.design.tool_region import tool_region
from avc_casadi.files.coupling_file import write_coupling
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.model.ends import ToolGains

NAMES = ("tool/mujoco-500hz", "tool/unity-60hz", "tool/sofa-implicit", "tool/wheel-game-62hz")


def answer(capsys, *words):
    code = main([*words, "--json"])
    return code, json.loads(capsys.readouterr().out)


def coupling_file(folder, name, gains):
    path = folder / "c.json"
    write_coupling(Coupling.to_end(avc.load_problem(name), gains), path)
    return str(path)


def test_certificate_tells_stability_and_passivity_apart(tmp_path, capsys):
    """A soft pair is passive at the port; an explicit mass of 200 g grows with it, an implicit one rests."""
    pair = ToolGains(615.7, 0.2317)
    text = avc.catalogue_path("tool/mujoco-500hz").read_text().replace("step_s", 'clock = "device"\nstep_s')
    explicit = tmp_path / "explicit.toml"
    explicit.write_text(text)
    code, found = answer(capsys, "certify", coupling_file(tmp_path, str(explicit), pair))
    assert code == 1
    assert not found["stable"]
    assert found["passivity"]["passive"]
    assert not found["passivity"]["engine_is_implicit"]
    assert found["worst"]["tool"]["mass_kg"] == 0.2
    changed = tmp_path / "implicit.toml"
    text = text.replace('"semi-implicit"', '"implicit"').replace('"on-time"', '"ahead"')
    changed.write_text(f"{text}\n[robustness]\ngain_margin = 1\n")
    code, found = answer(capsys, "certify", str(changed), str(tmp_path / "c.json"))
    assert code == 0
    assert found["stable"]
    assert found["passivity"]["passive"]
    assert found["passivity"]["engine_is_implicit"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tool/unity-60hz", "tool/sofa-implicit"])
def test_region_is_stable_below_each_curve_and_not_above(name):
    """Its own points against the loops of another object, at 0.98 and 1.05 of each curve."""
    problem = avc.load_problem(name)
    region = tool_region(problem, summits=False)
    assert sum(curve.declared for curve in region.curves) == 1
    assert len(region.curves) >= 4
    local = problem.simulation.exchange == "held-force"
    mass, drag = problem.device.mass_kg, problem.device.damping_ns_per_m
    for curve in region.curves:
        changed = {} if curve.declared else {"simulation": {"step_s": curve.step_s}}
        loops = ToolLoops(problem.changed(**changed))
        for row in range(0, len(region.damping_ns_per_m), 12):
            limit, b = curve.stiffness_n_per_m[row], region.damping_ns_per_m[row]
            if limit == 0:
                continue
            beside = max(0.0, 2 * (limit * mass) ** 0.5 - drag) if local else 0.0
            assert loops.stable(ToolGains(0.98 * limit, b, beside))
            assert not loops.stable_over_ranges(ToolGains(1.05 * limit, b, beside))


@pytest.mark.slow
@pytest.mark.parametrize(("sample_time_s", "own_rate"), [(1e-3, True), (10e-3, False)])
def test_a_damper_in_the_devices_loop_says_at_which_rate_it_runs(sample_time_s, own_rate, tmp_path, capsys):
    """A game that commands the device once a step has no loop beside its own."""
    device = f"[device]\nmass_kg = 0.3\ndamping_ns_per_m = 0.5\nsample_time_s = {sample_time_s}\ndelay_samples = 1\n"
    game = tmp_path / "game.toml"
    game.write_text(f'{device}[simulation]\ntool_mass_kg = 0.2\nstep_s = 10e-3\nexchange = "held-force"\n')
    assert main(["recommend", str(game), "--hands", "10"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert ("its damper runs every 1.00 ms, faster than the engine" in printed) == own_rate
    assert ("damper in the device's loop" in printed) >= own_rate
