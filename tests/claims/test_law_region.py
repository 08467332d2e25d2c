"""The region of two numbers of a law: at each value of the first, the interval of a certificate of the second."""

import json

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.claims.law_region import law_region
from avc_casadi.cli import main

LAW = {"stiffness_n_per_m": 400.0, "damping_ns_per_m": 4.0, "velocity": {"kind": "low-pass", "cutoff_hz": 90.0}}
PROBLEM = {
    "device": {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "delay_samples": 1},
    "law": LAW | {"filters": [{"kind": "notch", "frequency_hz": 150.0}]},
}


@pytest.mark.slow
def test_each_column_is_the_interval_of_a_certificate():
    region = law_region(PROBLEM, "cutoff_hz")
    assert region.over == "velocity.cutoff_hz"
    assert region.of == "stiffness_n_per_m"
    for place in (3, 14):
        changed = LAW | {"velocity": {"kind": "low-pass", "cutoff_hz": float(region.values[place])}}
        law = PROBLEM["law"] | {"velocity": changed["velocity"]}
        expected = avc.certify_law(PROBLEM | {"law": law}).intervals["stiffness_n_per_m"]
        np.testing.assert_allclose((region.least[place], region.largest[place]), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "key"), [("damping", "damping_ns_per_m"), ("filters[0].width", "filters[0].width"), ("cutoff", None)]
)
def test_a_number_is_named_by_its_key_or_the_last_part(name, key, monkeypatch):
    monkeypatch.setattr("avc_casadi.claims.law_region._VALUES", 1)
    assert law_region(PROBLEM, name).over == (key or "velocity.cutoff_hz")


def test_a_number_that_the_law_lacks_is_refused_with_those_that_it_has():
    with pytest.raises(avc.InputError, match=r"is 'ki', which is no number of the law; allowed: stiffness_n_per_m"):
        law_region(PROBLEM, "ki")
    with pytest.raises(avc.UnsupportedError, match=r"no table \[law\]"):
        law_region("figure5", "stiffness")


@pytest.mark.slow
def test_it_is_typed_and_drawn(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.toml").write_text(
        "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\n\n[law]\nstiffness_n_per_m = 400.0\n"
        'damping_ns_per_m = 4.0\nvelocity = { kind = "window", samples = 4 }\n',
        encoding="utf-8",
    )
    assert main(["zwidth", "p.toml", "--over", "samples", "--plot", "region.png", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["over"] == "velocity.samples"
    assert document["values"][0] == 1
    assert (tmp_path / "region.png").stat().st_size > 10_000
    assert main(["zwidth", "p.toml", "--over", "samples"]) == 0
    assert "stable k" in capsys.readouterr().out
