"""Levels L7 to L9 are there when they are asked for, say proved, refuted or open, and why a loop is open."""

import dataclasses
import functools
import json
import math
import signal

import numpy as np
import pytest
from avc_process import avc as command
from boxes_of_hands import brute_force
from clip_last_simulator import Simulator
from hardware_bench import believer

import avc_casadi as avc
from avc_casadi.claims.certificate import levels_table
from avc_casadi.claims.certify import certify
from avc_casadi.claims.proof_levels import quickly_proved
from avc_casadi.claims.prove.hands import HandsProof
from avc_casadi.claims.prove.held_device import HAND
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, prove_rest
from avc_casadi.claims.prove.walls import same_gains, wall_gap
from avc_casadi.cli import main
from avc_casadi.cli._console import Console
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
def test_the_same_gains_are_proved_clipped_last_and_refuted_behind_the_gate():
    clipped, gated = outcome(coupling_of(STIFF)), outcome(coupling_of(STIFF, "gated"))
    assert (clipped.outcome, clipped.passed, clipped.word) == ("proved", True, "proved")
    assert (gated.outcome, gated.passed) == ("refuted", False)
    assert "bounces for ever" in gated.claim
    orbit = Rest.from_document(json.loads(json.dumps(gated.detail["proofs"][0]))).orbit
    assert orbit.enclosed


@pytest.mark.thorough
def test_a_gated_coupling_without_orbit_is_open_and_the_gate_is_named():
    found = outcome(coupling_of(contact="gated"))
    assert found.outcome == "open"
    assert 'contact = "gated"' in found.claim


@pytest.mark.thorough
def test_a_loop_that_is_unstable_in_contact_is_refuted_by_its_hand():
    coupling = coupling_of(Gains(0.0, 1e6))
    found = outcome(coupling)
    assert found.outcome == "refuted"
    document = found.detail["proofs"][0]
    assert document["unstable"]["spectral_radius"] > 1
    assert certify(coupling.problem, coupling).levels["L5"].passed is False


@pytest.mark.thorough
def test_what_a_proof_costs_in_stiffness_stands_beside_an_open_one():
    coupling = coupling_of(Gains(287.4, 2.913e6, 62.0), environment={"stiffness_n_per_m": 8.9e4})
    law = ContactLaw.of(coupling.problem, *vars(coupling.table.at_rest).values())
    box = {name: getattr(coupling.problem.hands, name) for name in HAND}
    gap = wall_gap(same_gains(law), coupling.problem.device, box, 2e5, steps=8)
    assert 0 < gap.proved_n_per_m <= gap.promised_n_per_m <= gap.linear_n_per_m < 2e5
    softer = ContactLaw(**{**vars_of(law), "wall_stiffness_n_per_m": gap.proved_n_per_m})
    assert prove_rest(softer, "clip-last", coupling.problem.device, box, orbits=False).outcome == "proved"


def vars_of(law):
    return {name: getattr(law, name) for name in law.__dataclass_fields__}


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
        found[name] = prove_rest(whole, "clip-last", coupling.problem.device, box, orbits=False)
    assert "dead zone of 10 um" in found["zone"].sentence
    assert found["zone"].outcome in ("open", "refuted")
    assert (found["plain"].outcome == "proved") == (found["zone"].multiplier is not None)


@pytest.mark.thorough
def test_levels_stand_in_table_and_document_and_survive_json():
    coupling = coupling_of()
    whole = dataclasses.replace(certify(coupling.problem, coupling), levels=proved(coupling))
    document = json.loads(json.dumps(whole.document(), allow_nan=False))
    assert document["levels"]["L7"]["outcome"] == "proved"
    assert document["levels"]["L5"]["outcome"] == "proved"
    assert document["levels"]["L3"]["outcome"] is None
    text = levels_table(document).text()
    assert "proved" in text
    assert len(whole.to_dict()["level"]) == 9
    again = Rest.from_document(document["levels"]["L7"]["proofs"][0])
    assert again.verified()


@pytest.mark.thorough
def test_rows_of_a_table_are_proved_one_by_one_and_switching_is_not():
    problem = avc.load_problem("figure5").changed(
        coupling={"contact": "clip-last"}, frequency={"start_hz": 1.0, "stop_hz": 30.0, "points": 2}
    )
    schedule = avc.solve(problem, "exact")
    found = proved(Coupling.of(problem, schedule))
    assert len(found["L7"].row_passed) == len(Coupling.of(problem, schedule).table)
    assert "nothing of gains that change" in found["L7"].claim
    assert found["L9"].outcome == "open"


@pytest.mark.thorough
def test_the_command_proves_when_asked(tmp_path):
    coupling = coupling_of()
    file, out = tmp_path / "c.json", tmp_path / "proofs"
    avc.write_coupling(coupling, file)
    asked = ((), ("--prove", "--proof-out", str(out)))
    plain, found = (command("certify", str(file), *more, "--json") for more in asked)
    levels = [json.loads(done.stdout)["levels"] for done in (plain, found)]
    assert set(levels[1]) - set(levels[0]) == {"L7", "L8", "L9"}
    assert plain.returncode == found.returncode
    library = proved(coupling)
    for level, one in library.items():
        assert (levels[1][level]["outcome"] or "") == one.outcome
        assert levels[1][level]["claim"].split(":")[0] == one.claim.split(":")[0]
    files = {path.name: json.loads(path.read_text()) for path in out.iterdir()}
    assert set(files) == {"L5.json", "L7.json"}
    assert HandsProof.from_document(files["L5.json"]["proofs"][0]).replays()
    assert Rest.from_document(files["L7.json"]["proofs"][0]).verified()
    assert files["L5.json"]["problem"]["device"] == coupling.problem.device.model_dump(mode="json")


@pytest.mark.thorough
def test_files_of_proofs_are_only_written_where_proofs_are_asked_for(tmp_path):
    done = command("certify", "spring", "nothing.json", "--proof-out", str(tmp_path / "proofs"))
    assert done.returncode == 2
    assert b"--prove" in done.stderr
    assert not (tmp_path / "proofs").exists()


@pytest.mark.thorough
def test_ctrl_c_ends_a_search_for_proofs_as_itself_and_writes_nothing(tmp_path, monkeypatch, capsys):
    """It comes while cells are verified, and again while patterns of rows are looked at."""
    schedule = Coupling.of(SPRING_OF_TWO, avc.solve(SPRING_OF_TWO, "exact"))
    file, out = tmp_path / "c.json", tmp_path / "proofs"
    avc.write_coupling(schedule, file)
    for what in ("verified", "patterns of rows"):
        asked = []

        def advance(_self, _done, _total, told="", what=what, asked=asked):
            asked.append(told)
            if told == what:
                signal.raise_signal(signal.SIGINT)

        monkeypatch.setattr(Console, "advance", advance)
        assert main(["certify", str(file), "--prove", "--proof-out", str(out)]) == 130
        assert asked[-1] == what
        assert capsys.readouterr() == ("", "avc: interrupted\n")
        assert not out.exists()


@pytest.mark.thorough
def test_state_feedback_is_not_proved_and_says_why():
    runtime = Runtime(state_feedback=believer(0))
    coupling = coupling_of(Gains(0.0, 1e8), runtime=runtime, environment={"stiffness_n_per_m": 2e3})
    level = outcome(coupling, "L5")
    assert level.outcome == "open"
    assert "not proved: the enclosure knows gains, not an observer with state feedback" in level.claim


@pytest.mark.thorough
def test_the_claim_says_which_device_it_covers():
    claim = outcome(coupling_of()).claim
    assert (
        "of a rigid device, an ideal amplifier, 0 samples of delay; left out: dry friction (0.2 N), encoder (2e-06"
        in (claim)
    )
    keys = {"delay_samples": 0.5, "amplifier_bandwidth_hz": 900.0, "coulomb_friction_n": 0.2}
    keys["range"] = {"delay_samples": (0.25, 0.5), "coulomb_friction_n": (0.1, 0.3)}
    law = ContactLaw.of(coupling_of().problem, *RIGID, 10.0)
    found = prove_rest(
        ContactLaw(**{**vars_of(law), "wall_stiffness_n_per_m": 2e3}),
        "clip-last",
        Device.model_validate({"mass_kg": 0.1, "damping_ns_per_m": 2.0, **keys}),
        {"mass_kg": (0.1, 0.12), "damping_ns_per_m": (5.0, 6.0), "stiffness_n_per_m": (300.0, 320.0)},
    )
    assert found.outcome == "proved"
    assert "an amplifier of 900 Hz, 0.25 to 0.5 samples of delay; left out: dry friction (0.3 N)" in found.sentence


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
def test_ripple_is_a_bound_that_the_worst_noise_comes_near_to():
    """Noise that takes the sign of the impulse response backwards is the worst there is; random hands stay below."""
    coupling = coupling_of(STIFF)
    level = outcome(coupling, "L9")
    assert level.outcome == "proved"
    ripple = level.detail["ripple"]
    problem = coupling.problem
    gains = {"b": 287.4, "k": 2.913e6, "b_p": 84.82, "b_e": 10.0, "k_e": 1e5}
    hands = problem.hands
    ends = np.array([getattr(hands, name) for name in HAND])
    random = np.random.default_rng(0)
    drawn = np.concatenate([np.array([[0.05, 3.0, 800.0]]), random.uniform(ends[:, 0], ends[:, 1], (20, 3))])
    held = dict(zip(HAND, drawn.T, strict=True))
    samples, size = 1500, 1e-6

    def moved(noise):
        """Positions with an error of the sensor, pressed far into the wall."""
        device = problem.device.model_dump() | {"max_force_n": None}
        simulator = Noisy(device, gains, held, 0.5 + 0 * drawn[:, 0])
        stiffness = 1 / (1 / 2.913e6 + 1 / 1e5)
        rest = 0.5 * drawn[:, 2] / (drawn[:, 2] + stiffness)
        simulator.start(rest, 0 * rest, tool=stiffness * rest / 1e5)
        simulator.noise = noise
        position, _, force = simulator.run(samples)
        return position - rest, force - stiffness * rest

    class Noisy(Simulator):
        sample = 0

        def force(self):
            error = self.noise[self.sample]
            self.sample += 1
            self.state[:, 0] += error
            found = super().force()
            self.state[:, 0] -= error
            return found

    impulse = np.zeros((samples, len(drawn)))
    impulse[0] = size
    response, pushed = moved(impulse)
    worst = size * np.sign(response[::-1])
    bound = size * ripple["position_per_error"]
    reached = np.abs(moved(worst)[0]).max(axis=0)
    assert (reached <= bound).all()
    assert reached.max() > 0.75 * bound
    pushed = np.abs(moved(size * np.sign(pushed[::-1]))[1]).max(axis=0)
    assert (pushed <= size * ripple["force_per_error_n_per_m"]).all()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("device", "b_p", "wall", "word"),
    [
        ({"amplifier_bandwidth_hz": 700.0}, 6.0, 4e3, "proved"),
        ({"resonance": {"frequency_hz": 200.0, "damping_ratio": 0.1, "mass_ratio": 0.4}}, 6.0, 4e3, "proved"),
        ({"amplifier_bandwidth_hz": 700.0}, 0.0, 2e5, "refuted"),
    ],
)
def test_what_excludes_no_zeros_is_linearly_stable_by_the_multiplier_of_rest(device, b_p, wall, word):
    """Beside it brute force: the spectral radius of the whole loop over a lattice of hands."""
    hands = {"mass_kg": [0.1, 0.12], "damping_ns_per_m": [6.0, 8.0], "stiffness_n_per_m": [300.0, 400.0]}
    coupling = coupling_of(Gains(0.0, 1e8, b_p), device=device, environment={"stiffness_n_per_m": wall}, hands=hands)
    levels = certify(coupling.problem, coupling, prove=True).levels
    assert levels["L5"].outcome == word, levels["L5"].claim
    radius = brute_force(coupling.problem, np.array([0.0]), np.array([1e8]), np.array([b_p]), 5)[0]
    assert (radius < 1) == (word == "proved")
    if word == "proved":
        (document,) = levels["L5"].detail["proofs"]
        assert Rest.from_document(document).verified()
        assert "by the multipliers of L7" in levels["L5"].claim
