"""The gain of force feedback that is recommended, and what would allow a larger one."""

import pytest

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.files.admittance_file import load_sensor_problem
from avc_casadi.recommendation.force_feedback import recommend_force_feedback


@pytest.fixture(scope="module")
def found():
    return avc.recommend_force_feedback("admittance/lightened")


def margin(problem, gain):
    return avc.certify_force_feedback(problem, law={"force_feedback": {"gain": gain}}).disk_margin


@pytest.mark.slow
def test_its_gain_is_sound_and_one_that_is_four_per_cent_larger_is_not(found):
    gain = found.problem.law.gain
    assert found.passed
    assert found.certificate.disk_margin >= 0.2
    assert margin("admittance/lightened", 0.97 * gain) >= 0.2
    assert margin("admittance/lightened", 1.04 * gain) < 0.2


@pytest.mark.slow
def test_what_would_help_does(found):
    assert found.helps
    assert [larger.gain for larger in found.helps] == sorted((larger.gain for larger in found.helps), reverse=True)
    for larger in found.helps[:2]:
        tables = value = larger.value
        for key in reversed(larger.key.split(".")):
            tables = {key: value}
            value = tables
        changed = load_sensor_problem("admittance/lightened").changed(**tables)
        assert margin(changed, 0.97 * larger.gain) >= 0.2
        assert margin(changed, found.problem.law.gain) > found.certificate.disk_margin
        assert larger.gain > found.problem.law.gain


@pytest.mark.slow
def test_the_range_of_a_delay_moves_with_it_and_is_judged():
    stated = load_sensor_problem("admittance/lightened")
    late = stated.changed(device={"delay_samples": 4, "range": {"delay_samples": [2, 12]}})
    found = recommend_force_feedback(late)
    gain = found.problem.law.gain
    assert margin(stated.changed(device={"delay_samples": 12}), gain) >= 0.2
    assert margin(stated.changed(device={"delay_samples": 12}), 1.1 * gain) < 0.2
    assert margin(stated.changed(device={"delay_samples": 2}), 1.1 * gain) >= 0.2
    assert found.problem.device.range.delay_samples == (2, 12)


@pytest.mark.slow
def test_the_command_writes_the_file_with_the_gain(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["recommend", "admittance/lightened", "--out", "light.toml"]) == 0
    assert "apparent mass" in capsys.readouterr().out
    assert main(["certify", "light.toml"]) == 0
    assert load_sensor_problem("light.toml").law.gain > 1.0


def test_a_law_that_is_unstable_without_the_force_has_no_gain_to_run():
    stated = load_sensor_problem("admittance/lightened").changed(law={"stiffness_n_per_m": 1e8})
    found = recommend_force_feedback(stated)
    assert not found.passed
    assert found.certificate is None
    assert "no gain has a disk margin" in str(found)
    assert found.document()["deployable"] is False


def test_options_of_couplings_are_refused(capsys):
    assert main(["recommend", "admittance/lightened", "--stiffest"]) == 2
    assert "have no force sensor" in capsys.readouterr().err
    assert main(["recommend", "admittance/lightened", "--out", "c.json"]) == 2
    assert "allowed: .toml" in capsys.readouterr().err
