"""What `avc recommend` answers on twenty problems, and how many of 400 hands settle on a plant that the tests own."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from avc_process import answered
from hardware_bench import export_c
from whole_device import WholeDevice, people, rests_as_tried

import avc_casadi as avc

HANDS, SEED = 400, 4711
_LINEAR = "mass_kg = {mass}\ndamping_ns_per_m = {damping}\ndelay_samples = {delay}\ncoulomb_friction_n = {friction}\n"
_LINEAR += "encoder_resolution_m = {encoder}\nmax_force_n = 8.0\n{more}"
_WALL = "[environment]\nstiffness_n_per_m = {wall}\ndamping_ns_per_m = 0.0\n"
_TURNED = "[environment]\nstiffness_nm_per_rad = {wall}\ndamping_nms_per_rad = 0.0\n"


def _device(wall: float, more: str = "", **changed: float) -> str:
    """The device of the README's wall.toml, some of its numbers others."""
    numbers = {"mass": 0.12, "damping": 0.8, "delay": 1, "friction": 0.1, "encoder": 2e-5} | changed
    return "[device]\n" + _LINEAR.format(more=more, **numbers) + _WALL.format(wall=wall)


def _named(device: str, wall: float, table: str = _WALL) -> str:
    return f'device = "{device}"\n' + table.format(wall=wall)


_MODE = "resonance = { frequency_hz = 150.0, damping_ratio = 0.05, mass_ratio = 0.4 }\n"
# A name of the catalogue (None), or the text of a problem file.
RECOMMENDATIONS: dict[str, str | None] = {
    "figure5": None,
    "knob": None,
    "reference-r1": None,
    "reference-r3": None,
    "ve3": None,
    "wall": _device(3000.0),
    "wall-of-1-kn-per-m": _device(1000.0),
    "wall-of-30-kn-per-m": _device(30000.0),
    "delay-0": _device(3000.0, delay=0),
    "delay-0-stiff": _device(20000.0, delay=0),
    "delay-half-a-sample": _device(3000.0, delay=0.5),
    "delay-2": _device(3000.0, delay=2),
    "coarse-encoder": _device(3000.0, encoder=2e-4),
    "light-without-friction": _device(2000.0, mass=0.05, friction=0.0),
    "resonance": _device(3000.0, _MODE),
    "lag-of-500-hz": _device(2000.0, "amplifier_bandwidth_hz = 500.0\n"),
    "ranges": _device(1500.0, "range = { mass_kg = [0.11, 0.13], damping_ns_per_m = [0.7, 0.9] }\n"),
    "falcon-near": _named("novint-falcon", 400.0),
    "teaching-far": _named("teaching-one-axis", 5000.0),
    "smartknob": _named("smartknob", 0.1, _TURNED),
}


def recommendation(case: str) -> dict[str, Any]:
    """Return what is recommended, how it feels, what it meets, and who settles in the trial and on the plant."""
    text = RECOMMENDATIONS[case]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if text is not None:
            (folder / f"{case}.toml").write_text(text, encoding="ascii")
        code, told = answered("recommend", case if text is None else f"{case}.toml", "--out", "c.json", cwd=folder)
        if "errors" in told:
            return {"exit_code": code, "errors": [one["key"] for one in told["errors"]]}
        coupling = told["coupling"]
        found: dict[str, Any] = {"exit_code": code, "deployable": told["deployable"]}
        found |= _designed(coupling) | _felt(told["felt"]) | _levels(told["certificate"]["levels"])
        trial = told["trial"]
        for key, counted in (
            ("settled", "at_rest"),
            ("settled_without_friction", "at_rest_without_friction"),
            ("quiet", "quiet"),
        ):
            found[key] = [trial[counted], trial["hands"]]
        return found | on_the_plant(avc.read_coupling(folder / "c.json"))


def _designed(coupling: dict[str, Any]) -> dict[str, Any]:
    runtime = coupling["runtime"]
    beside = [key for key in ("state_feedback", "guard") if runtime.get(key) is not None]
    gains = {key: value[0] for key, value in coupling["table"].items() if key != "frequency_hz"}
    return {"structure": coupling["structure"], "gains": gains, "what_runs": [coupling["method"], *beside]}


def _felt(felt: dict[str, Any]) -> dict[str, Any]:
    stiffness = next(value for key, value in felt.items() if key.startswith("stiffness_n"))
    return {"rendered": stiffness, "impedance_error": felt["complex_error"]}


def _levels(levels: dict[str, Any]) -> dict[str, Any]:
    return {
        "levels": {
            name: {
                "passed": one["pass"],
                "margin": next(value for key, value in one.items() if key.startswith("margin_n")),
                "frequency_hz": one["frequency_hz"],
            }
            for name, one in levels.items()
        }
    }


def on_the_plant(coupling: avc.Coupling) -> dict[str, Any]:
    """Return how many of 400 hands settle with the exported C, as declared and without dry friction."""
    device = coupling.problem.device
    bench, hands = WholeDevice(device, export_c(coupling)), people(coupling.problem.hands, HANDS - 8, SEED)
    counts = {"plant": None, "plant_without_friction": 0.0}
    return {key: [int(rests_as_tried(bench, device, hands, dry).sum()), HANDS] for key, dry in counts.items()}
