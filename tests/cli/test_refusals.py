"""A coupling that may not go into a device, or that the firmware cannot run: exit code 1, and no bad input."""

import pytest
from quick import first

import avc_casadi as avc
import avc_hardware
from avc_casadi.cli import main
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    "arguments",
    first(
        [
            "push c.json --port emulator",
            "push c.json --port emulator --unsafe",  # does not settle there
            "stream c.json --port emulator",
            "export c.json --c firmware",
            "certify c.json",
        ]
    ),
)
def test_an_unstable_coupling_is_refused_by_every_verb_that_deploys(arguments):
    problem = avc.load_problem("figure5").changed(frequency={"points": 10})
    avc.write_coupling(Coupling.from_schedule(problem, avc.solve(problem, "direct")), "c.json")
    assert main(arguments.split()) == 1


def test_an_export_replaces_an_export_and_no_file_of_anybody_else(tmp_path, capsys):
    made = Coupling.constant(avc.load_problem("figure5"), Gains(1.0, 10.0, 0.0), "mine")
    avc.write_coupling(made, "c.json")
    command = ["export", "c.json", "--c", ".", "--name", "main"]
    own = tmp_path / "main.c"
    own.write_text("int main(void) { return 0; }\n")
    assert main(command) == 2
    assert "--force" in capsys.readouterr().err
    assert own.read_text().startswith("int main")
    assert not (tmp_path / "main.h").exists()
    assert main([*command, "--force"]) == 0 == main(command)
    assert made.id in own.read_text()


@pytest.mark.parametrize("runtime", [Runtime(observer_mass_kg=0.15), Runtime(guard="energy-tank")])
@pytest.mark.parametrize("verb", ["push", "stream"])
def test_what_the_firmware_lacks_is_a_no(verb, runtime):
    made = Coupling.constant(avc.load_problem("figure5"), Gains(5.0, 1e3, 10.0), "mine", runtime)
    avc.write_coupling(made, "c.json")
    assert main([verb, "c.json", "--port", "emulator"]) == 1
    with pytest.raises(avc_hardware.FirmwareLacksError) as refused:
        avc_hardware.check_runs_on(made)
    assert isinstance(refused.value, avc.NotDeployableError)
    assert isinstance(refused.value, avc.UnsupportedError)
