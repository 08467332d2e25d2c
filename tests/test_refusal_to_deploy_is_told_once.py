"""A coupling that may not go into a device: exit code 1, the reason once, and Python's own errors say what to give."""

import pytest

import avc_casadi as avc
import avc_hardware
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime

REASON = "linearly unstable with a hand"
DEPLOYING = (
    ("push", "c.json", "--port", "emulator"),
    ("stream", "c.json", "--port", "emulator"),
    ("export", "c.json", "--c", "firmware"),
    ("certify", "c.json"),
)


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def said(capsys, *arguments):
    code = main(list(arguments))
    out = capsys.readouterr()
    return code, out.out + out.err


@pytest.mark.parametrize("arguments", DEPLOYING, ids=lambda arguments: arguments[0])
def test_the_reason_stands_once(arguments, capsys):
    problem = avc.load_problem("figure5").changed(frequency={"points": 10})
    avc.write_coupling(Coupling.of(problem, avc.solve(problem, "direct")), "c.json")
    code, text = said(capsys, *arguments)
    assert code == 1
    assert text.count(REASON) == 1


@pytest.mark.parametrize(
    ("runtime", "words"),
    [
        (Runtime(observer_mass_kg=0.15), "it has no observer between encoder steps (runtime.observer_mass_kg)."),
        (Runtime(guard="energy-tank"), "it has no guard energy-tank (allowed: passivity-controller, or none)."),
    ],
    ids=["observer", "guard"],
)
@pytest.mark.parametrize("verb", ["push", "stream"])
def test_what_the_firmware_lacks_is_a_refusal_and_no_bad_input(verb, runtime, words, capsys):
    made = Coupling.constant(avc.load_problem("figure5"), Gains(5.0, 1e3, 10.0), "mine", runtime)
    avc.write_coupling(made, "c.json")
    code, text = said(capsys, verb, "c.json", "--port", "emulator")
    assert code == 1
    assert words in text
    with pytest.raises(avc_hardware.FirmwareLacksError) as refused:
        avc_hardware.check_runs_on(made)
    assert isinstance(refused.value, avc.NotDeployableError)
    assert isinstance(refused.value, avc.UnsupportedError)


CALLS = (
    avc.deployable,
    lambda coupling: avc.certify("soft", coupling),
    lambda coupling: avc.simulate("soft", coupling),
    lambda coupling: avc.screen("soft", coupling),
    lambda coupling: avc.write_coupling(coupling, "c.json"),
    lambda coupling: avc_hardware.push(coupling, "emulator"),
    lambda coupling: avc_hardware.stream(coupling, "emulator"),
    avc_hardware.tried_in_the_loop,
    avc_hardware.export_c,
    avc_hardware.check_runs_on,
)


class _Found:
    """Anything that carries a coupling, as a recommendation does."""

    coupling = None


@pytest.mark.parametrize(
    ("value", "words"),
    [("c.json", "avc.read_coupling('c.json')"), (_Found(), "its attribute `coupling`"), (3.0, "Coupling.of")],
    ids=["path", "recommendation", "number"],
)
@pytest.mark.parametrize("call", CALLS)
def test_what_is_no_coupling_is_answered_with_what_to_give(call, value, words):
    with pytest.raises(avc.InputError) as refused:
        call(value)
    (fault,) = refused.value.faults
    assert fault.key == "coupling"
    assert words in fault.message


def test_a_coupling_is_certified_as_its_gains_are():
    made = Coupling.constant(avc.load_problem("soft"), Gains(5.0, 1e3), "mine")
    assert avc.certify("soft", made) == avc.certify("soft", made.schedule)


@pytest.mark.thorough
def test_a_push_to_a_device_with_part_of_a_sample_of_delay_is_tried_too(capsys):
    """The firmware itself knows of no delay; the bench has it."""
    problem = avc.load_problem("figure5").changed(device={"delay_samples": 1.5})
    avc.write_coupling(Coupling.constant(problem, Gains(5.0, 1e3, 10.0), "mine"), "c.json")
    code, text = said(capsys, "push", "c.json", "--port", "emulator")
    assert code == 0
    assert "1 row on emulator" in text
    assert "✓ Read back    equal" in text
    assert "✓ In the loop  settles with a hand" in text


def test_the_hand_that_lets_go_is_called_so():
    problem = avc.load_problem("diverging").changed(hands={"let_go": True})
    verdict = avc.deployable(Coupling.of(problem, avc.solve(problem, "exact")))
    assert "linearly unstable when released" in verdict.sentence
    assert "hand of 0 kg" not in verdict.sentence
