"""Level L7 is there when it is asked for, says proved, refuted or open, and why a loop is open."""

import dataclasses
import functools
import json
import math
import signal

import numpy as np
import pytest
from avc_process import avc as command
from boxes_of_hands import brute_force
from drawn_loops import contradiction, drawn_loop
from hardware_bench import believer

import avc_casadi as avc
from avc_casadi.claims.certify import certify
from avc_casadi.claims.proof_levels import quickly_proved
from avc_casadi.claims.prove.held_device import HAND
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, prove_rest
from avc_casadi.cli import main
from avc_casadi.cli.console import Console
from avc_casadi.coupling import Coupling
from avc_casadi.model.device import Device
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime

SOFT = Gains(20.0, 8e3, 0.0)
STIFF = Gains(287.4, 2.913e6, 84.82)
RIGID = (math.inf, math.inf)
SPRING_OF_TWO = avc.load_problem("figure5").changed(
    environment={"stiffness_n_per_m": 5e3}, frequency={"start_hz": 1.0, "stop_hz": 30.0, "points": 2}
)


def coupling_of(gains=SOFT, contact="clip-last", runtime=None, problem="figure5", **changes):
    changes["coupling"] = {"contact": contact, "structure": "damped", "contact_damping_ns_per_m": (0.0, 1e3)}
    return Coupling.constant(avc.load_problem(problem).changed(**changes), gains, "by hand", runtime)


@functools.cache
def proved(coupling):
    return certify(coupling.problem, coupling, prove=True).levels


def outcome(coupling, level="L7"):
    return proved(coupling)[level]


@pytest.mark.thorough
def test_the_same_gains_are_proved_clipped_last_and_open_behind_the_gate():
    clipped, gated = outcome(coupling_of(STIFF)), outcome(coupling_of(STIFF, "gated"))
    assert (clipped.outcome, clipped.passed, clipped.word) == ("proved", True, "proved")
    assert (gated.outcome, gated.passed) == ("open", False)
    assert 'contact = "gated"' in gated.claim
    assert "without that it is proved" in gated.claim


@pytest.mark.thorough
def test_a_loop_that_is_unstable_in_contact_is_refuted_by_its_hand():
    coupling = coupling_of(Gains(0.0, 1e6))
    found = outcome(coupling)
    assert found.outcome == "refuted"
    document = found.detail["proofs"][0]
    assert document["unstable"]["spectral_radius"] > 1
    assert certify(coupling.problem, coupling).levels["L5"].passed is False


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("runtime", "word"),
    [
        (Runtime(observer_mass_kg=0.16), "observer between encoder steps"),
        (Runtime(guard="energy-tank"), "guard energy-tank"),
    ],
)
def test_what_is_not_linear_beside_the_gains_leaves_it_open_by_name(runtime, word):
    found = outcome(coupling_of(runtime=runtime))
    assert found.outcome == "open"
    assert word in found.claim


def test_an_observer_is_proved_without_its_dead_zone_and_open_with_it():
    observer = believer(0)
    runtime = Runtime(state_feedback=observer)
    coupling = coupling_of(Gains(0.0, 1e8), runtime=runtime, environment={"stiffness_n_per_m": 2e3})
    plain = type(observer)(**{**vars(observer), "dead_zone_m": 0.0})
    zone = type(observer)(**{**vars(observer), "dead_zone_m": 1e-5})
    box = {name: getattr(coupling.problem.hands, name) for name in HAND}
    found = {}
    for name, law in (("plain", plain), ("zone", zone)):
        whole = ContactLaw.of(coupling.problem, 0.0, 1e8, 0.0, law)
        found[name] = prove_rest(whole, "clip-last", coupling.problem.device, box)
    assert "dead zone of 1e-05" in found["zone"].sentence
    assert found["zone"].outcome == "open"
    assert (found["plain"].outcome == "proved") == (found["zone"].multiplier is not None)


@pytest.mark.thorough
def test_levels_stand_in_table_and_document_and_survive_json():
    coupling = coupling_of()
    whole = dataclasses.replace(certify(coupling.problem, coupling), levels=proved(coupling))
    document = json.loads(json.dumps(whole.document(), allow_nan=False))
    assert document["levels"]["L7"]["outcome"] == "proved"
    assert document["levels"]["L5"]["outcome"] is None
    assert len(whole.to_dict()["level"]) == 7
    again = Rest.from_document(document["levels"]["L7"]["proofs"][0])
    assert again.verified()


@pytest.mark.thorough
def test_rows_of_a_table_are_proved_one_by_one_and_changes_are_not():
    problem = avc.load_problem("figure5").changed(
        coupling={"contact": "clip-last"}, frequency={"start_hz": 1.0, "stop_hz": 30.0, "points": 2}
    )
    schedule = avc.solve(problem, "exact")
    found = proved(Coupling.of(problem, schedule))
    assert len(found["L7"].row_passed) == len(Coupling.of(problem, schedule).table)
    assert "nothing of gains that change" in found["L7"].claim


@pytest.mark.thorough
def test_the_command_proves_when_asked(tmp_path):
    coupling = coupling_of()
    file, out = tmp_path / "c.json", tmp_path / "proofs"
    avc.write_coupling(coupling, file)
    asked = ((), ("--prove", "--proof-out", str(out)))
    plain, found = (command("certify", str(file), *more, "--json") for more in asked)
    levels = [json.loads(done.stdout)["levels"] for done in (plain, found)]
    assert set(levels[1]) - set(levels[0]) == {"L7"}
    assert plain.returncode == found.returncode
    library = proved(coupling)
    for level, one in library.items():
        assert (levels[1][level]["outcome"] or "") == one.outcome
        assert levels[1][level]["claim"].split(":")[0] == one.claim.split(":")[0]
    files = {path.name: json.loads(path.read_text()) for path in out.iterdir()}
    assert set(files) == {"L7.json"}
    assert Rest.from_document(files["L7.json"]["proofs"][0]).verified()
    assert files["L7.json"]["problem"]["device"] == coupling.problem.device.model_dump(mode="json")


@pytest.mark.thorough
def test_files_of_proofs_are_only_written_where_proofs_are_asked_for(tmp_path):
    done = command("certify", "spring", "nothing.json", "--proof-out", str(tmp_path / "proofs"))
    assert done.returncode == 2
    assert b"--prove" in done.stderr
    assert not (tmp_path / "proofs").exists()


@pytest.mark.thorough
def test_ctrl_c_ends_a_search_for_proofs_as_itself_and_writes_nothing(tmp_path, monkeypatch, capsys):
    schedule = Coupling.of(SPRING_OF_TWO, avc.solve(SPRING_OF_TWO, "exact"))
    file, out = tmp_path / "c.json", tmp_path / "proofs"
    avc.write_coupling(schedule, file)

    def advance(_self, _done, _total, told=""):
        if told == "verified":
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Console, "advance", advance)
    assert main(["certify", str(file), "--prove", "--proof-out", str(out)]) == 130
    assert capsys.readouterr() == ("", "avc: interrupted\n")
    assert not out.exists()


@pytest.mark.thorough
def test_the_claim_says_which_device_it_covers():
    claim = outcome(coupling_of()).claim
    assert "of a rigid device, an ideal amplifier, 0 samples of delay; left out: dry friction (0.2), encoder" in claim
    keys = {"delay_samples": 0.5, "amplifier_bandwidth_hz": 900.0, "coulomb_friction_n": 0.2}
    keys["range"] = {"delay_samples": (0.25, 0.5), "coulomb_friction_n": (0.1, 0.3)}
    law = ContactLaw.of(coupling_of().problem, *RIGID, 10.0)
    found = prove_rest(
        dataclasses.replace(law, wall_stiffness_n_per_m=2e3),
        "clip-last",
        Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 2.0, **keys}),
        {"mass_kg": (0.1, 0.12), "damping_ns_per_m": (5.0, 6.0), "stiffness_n_per_m": (300.0, 320.0)},
    )
    assert found.outcome == "proved"
    assert "an amplifier of 900 Hz, 0.25 to 0.5 samples of delay; left out: dry friction (0.3)" in found.sentence


@pytest.mark.thorough
@pytest.mark.parametrize("device", [{"backlash_m": 1e-4}, {"range": {"backlash_m": (0.0, 1e-5)}}])
def test_nothing_is_proved_of_a_device_with_play(device):
    """Play is a hysteresis in the loop: what comes to rest without it may bounce for ever with it."""
    sure, coupling = coupling_of(), coupling_of(device=device)
    assert outcome(sure).outcome == "proved"
    level = outcome(coupling)
    assert level.outcome == "open"
    assert "play of" in level.claim
    assert "without that it is proved" in level.claim
    assert quickly_proved(sure)
    assert not quickly_proved(coupling)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("device", "b_p", "wall", "word"),
    [
        ({"amplifier_bandwidth_hz": 700.0}, 6.0, 4e3, "proved"),
        ({"resonance": {"frequency_hz": 200.0, "damping_ratio": 0.1, "mass_ratio": 0.4}}, 6.0, 4e3, "proved"),
        ({"amplifier_bandwidth_hz": 700.0}, 0.0, 2e5, "refuted"),
    ],
)
def test_what_is_said_of_a_device_that_is_not_rigid_agrees_with_brute_force(device, b_p, wall, word):
    """Beside it the spectral radius of the whole loop over a lattice of hands."""
    hands = {"mass_kg": [0.1, 0.12], "damping_ns_per_m": [6.0, 8.0], "stiffness_n_per_m": [300.0, 400.0]}
    coupling = coupling_of(Gains(0.0, 1e8, b_p), device=device, environment={"stiffness_n_per_m": wall}, hands=hands)
    found = outcome(coupling)
    assert found.outcome == word, found.claim
    radius = brute_force(coupling.problem, np.array([0.0]), np.array([1e8]), np.array([b_p]), 5)[0]
    assert (radius < 1) == (word == "proved")
    assert word == "refuted" or Rest.from_document(found.detail["proofs"][0]).verified()


@pytest.mark.one_of(2)
@pytest.mark.parametrize("seed", range(12))
def test_nothing_speaks_against_a_random_loop(seed):
    """Proved loops rest from random states; unstable hands run away: all in the simulator of its own."""
    assert contradiction(drawn_loop(seed, plain=True), seed) == ""


def test_a_file_with_levels_that_are_gone_is_read_and_judged_anew(tmp_path, capsys):
    coupling = coupling_of()
    document = certify(coupling.problem, coupling).document()
    gone = document["levels"]["L5"] | {"outcome": "proved", "common_lyapunov": {"pairs": 0}}
    levels = document["levels"] | {"L5": gone, "L8": gone, "L9": gone}
    file = tmp_path / "c.json"
    avc.write_coupling(coupling.with_certificate(document | {"levels": levels}), file)
    assert set(avc.read_coupling(file).certificate["levels"]) == set(levels)
    assert main(["certify", str(file), "--json"]) == 0
    assert '"L8"' not in capsys.readouterr().out
