"""`avc simulate` and `avc simulate --screen`: the documented keys, exit codes, files and text."""

import json

import numpy as np
import pytest

from avc_casadi import load_problem, simulate
from avc_casadi.cli import main
from avc_casadi.model.gains import NO_COUPLING


def call(capsys, *arguments):
    code = main(list(arguments))
    return code, capsys.readouterr()


def test_the_limit_cycle_is_shown_with_the_guard_and_without(capsys, tmp_path):
    path = tmp_path / "cycle.npz"
    document = json.loads(
        call(capsys, "simulate", "scenes/teaching-limit-cycle", "--trace", str(path), "--json")[1].out
    )
    with np.load(path) as traces:
        late = traces["position_m"][-500:]
    assert document["position_peak_to_peak_m"] == pytest.approx(late.max() - late.min(), rel=1e-12)
    assert json.loads(path.with_suffix(".json").read_text())["position_peak_to_peak_m"] > 0
    text = call(capsys, "simulate", "scenes/teaching-limit-cycle")[1].out
    travel, beside = (line for line in text.splitlines() if "peak to peak" in line)
    assert float(travel.removesuffix("um peak to peak").split()[-1]) == pytest.approx(100, abs=5)
    problem = load_problem("scenes/teaching-limit-cycle")
    bare = problem.changed(scene={"effects": tuple(one for one in problem.scene.effects if one.kind != "guard")})
    alone = float(np.ptp(simulate(bare, NO_COUPLING).position_m[-500:]))
    assert document["without_guard"]["position_peak_to_peak_m"] == pytest.approx(alone, rel=1e-12)
    assert beside.split("  ")[-1].strip() == f"does not settle, {1e3 * alone:.2f} mm peak to peak"


def test_an_unstable_scene_ends_with_1(capsys):
    code, out = call(capsys, "simulate", "scenes/stiff-wall-uncoupled")
    assert code == 1
    assert "does not settle" in out.err
    assert "buzzes" in out.out


@pytest.mark.thorough
def test_against_others(capsys, tmp_path):
    plot = str(tmp_path / "a.png")
    arguments = "simulate", "scenes/stiff-wall-pressed", "--against", "none", "--plot", plot
    code, out = call(capsys, *arguments, "--json")
    document = json.loads(out.out)
    assert code == 0
    (bare,) = document["against"]
    assert (bare["coupling"], bare["outcome"], bare["buzzing"]) == ("none", "unstable", True)
    assert (document["coupling"], document["outcome"], document["buzzing"]) == ("static", "asymptotic", False)
    code, out = call(capsys, *arguments)
    assert "✗ With none      does not settle, buzzes" in out.out


def test_two_scenes_that_differ_in_one_effect(capsys, tmp_path):
    def explained(name, text):
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        return json.loads(call(capsys, "simulate", str(path), "--json")[1].out)

    head = "[device]\nmass_kg = 0.1\ndamping_ns_per_m = 2.0\n"
    head += "[environment]\ndamping_ns_per_m = 1.0\nstiffness_n_per_m = 1e3\n"
    head += '[scene]\ncoupling = "none"\n' + '[[scene.effects]]\nkind = "hand"\n[[scene.effects]]\nkind = "wall"\n'
    plain = explained("plain", head)
    late = explained("late", head + '[[scene.effects]]\nkind = "delay"\nsamples = 2\n')
    (delay,) = (effect for effect in late["effects"] if effect["kind"] == "delay")
    assert late["states"] - plain["states"] == delay["states"] == 2
    assert late["instructions"] - plain["instructions"] == delay["instructions"] > 0
    assert set(plain["absent"]) - set(late["absent"]) == {"delay"}


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (("simulate", "scenes/soft-tissue", "--seed", "-1"), "--seed"),
        (("simulate", "scenes/soft-tissue", "--trace", "run.csv"), "--trace"),
        (("simulate", "scenes/soft-tissue", "--screen", "--tolerance", "2"), "--tolerance"),
        (("simulate", "scenes/soft-tissue", "--against", "magic"), "--against"),
        (("simulate", "scenes/soft-tissue", "--against", "none,none,none,none"), "--against"),
        (("simulate", "no-such-scene"), "no-such-scene"),
    ],
)
def test_bad_arguments_end_with_2(capsys, arguments, key):
    code, out = call(capsys, *arguments)
    assert code == 2
    assert key in out.err
