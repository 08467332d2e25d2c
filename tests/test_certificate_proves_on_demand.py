"""Levels L7 to L9 are there when they are asked for, say proved, refuted or open, and why a loop is open."""

import json

import numpy as np
import pytest
from avc_process import avc as command
from clip_last_simulator import Simulator
from hardware_bench import believer

import avc_casadi as avc
from avc_casadi.certificate import certify, levels_table, prove, with_proofs
from avc_casadi.coupling import Coupling, Gains, Runtime
from avc_casadi.proof import HAND, ContactLaw, Rest, prove_rest, same_gains, wall_gap

SOFT = Gains(20.0, 8e3, 0.0)
STIFF = Gains(287.4, 2.913e6, 84.82)


def coupling_of(gains=SOFT, contact="clip-last", runtime=None, problem="figure5", **changes):
    changes["coupling"] = {"contact": contact, "structure": "damped", "contact_damping_ns_per_m": (0.0, 1e3)}
    return Coupling.constant(avc.load_problem(problem).changed(**changes), gains, "by hand", runtime)


def outcome(coupling, level="L7"):
    return prove(coupling)[level]


def test_the_same_gains_are_proved_clipped_last_and_refuted_behind_the_gate():
    clipped, gated = outcome(coupling_of(STIFF)), outcome(coupling_of(STIFF, "gated"))
    assert (clipped.outcome, clipped.passed, clipped.word) == ("proved", True, "proved")
    assert (gated.outcome, gated.passed) == ("refuted", False)
    assert "bounces for ever" in gated.claim
    orbit = Rest.from_document(json.loads(json.dumps(gated.detail["proofs"][0]))).orbit
    assert orbit.enclosed


def test_a_gated_coupling_without_orbit_is_open_and_the_gate_is_named():
    found = outcome(coupling_of(contact="gated"))
    assert found.outcome == "open"
    assert 'contact = "gated"' in found.claim


def test_a_loop_that_is_unstable_in_contact_is_refuted_by_its_hand():
    coupling = coupling_of(Gains(0.0, 1e6))
    found = outcome(coupling)
    assert found.outcome == "refuted"
    document = found.detail["proofs"][0]
    assert document["unstable"]["spectral_radius"] > 1
    assert certify(coupling.problem, coupling).levels["L5"].passed is False


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


def test_levels_stand_in_table_and_document_and_survive_json():
    coupling = coupling_of()
    whole = with_proofs(certify(coupling.problem, coupling), prove(coupling))
    document = json.loads(json.dumps(whole.document(), allow_nan=False))
    assert document["levels"]["L7"]["outcome"] == "proved"
    assert document["levels"]["L5"]["outcome"] is None
    text = levels_table(document).text()
    assert "proved" in text
    assert len(whole.to_dict()["level"]) == 9
    again = Rest.from_document(document["levels"]["L7"]["proofs"][0])
    assert again.verified()


def test_rows_of_a_table_are_proved_one_by_one_and_switching_is_not():
    problem = avc.load_problem("figure5").changed(
        coupling={"contact": "clip-last"}, frequency={"start_hz": 1.0, "stop_hz": 30.0, "points": 2}
    )
    schedule = avc.solve(problem, "exact")
    found = prove(Coupling.of(problem, schedule))
    assert len(found["L7"].row_passed) == len(Coupling.of(problem, schedule).table)
    assert "nothing of gains that change" in found["L7"].claim
    assert found["L9"].outcome == "open"


def test_the_command_proves_when_asked(tmp_path):
    coupling = coupling_of()
    file = tmp_path / "c.json"
    avc.write_coupling(coupling, file)
    plain, proved = (command("certify", str(file), *more, "--json") for more in ((), ("--prove",)))
    levels = [set(json.loads(done.stdout)["levels"]) for done in (plain, proved)]
    assert levels[1] - levels[0] == {"L7", "L8", "L9"}
    assert plain.returncode == proved.returncode


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
