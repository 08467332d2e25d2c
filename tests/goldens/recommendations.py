"""What `avc recommend` answers on twenty problems, and how many of 400 hands settle on a plant that the tests own."""

from __future__ import annotations

import ctypes
import itertools
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from avc_process import answered
from goldens.exported_c import compiled, exported

PLANT = Path(__file__).resolve().parents[1] / "oracle" / "whole_device.c"
HANDS, SEED = 400, 4711
# A hand has settled where motor and handle stay below this over the last half second of each motion, at the handle.
SETTLED_M_PER_S, SECONDS, TAIL_S = 5e-3, 3.25, 0.5
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


def _doubles(names: str) -> type[ctypes.Structure]:
    return type("Doubles", (ctypes.Structure,), {"_fields_": [(name, ctypes.c_double) for name in names.split()]})


# The structs of whole_device.c, in its order.
_Device = _doubles("mass damping time delay friction encoder bandwidth limit resonance ratio share dropped")
_Deed = _doubles("mass damping stiffness weight start velocity speed end centre swing frequency until")
_Found = _doubles("motor_speed handle_speed force motor handle most")


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
        exported(folder / "c.json", folder)
        return found | on_the_plant(coupling["problem_file"], folder)


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


def on_the_plant(problem: dict[str, Any], folder: Path, seconds: float = SECONDS) -> dict[str, Any]:
    """Return how many of 400 hands settle with the exported C in `folder`, as declared and without dry friction.

    Each is judged over the last half second of each motion, of which hands move for 1.8 s. A device that turns moves in
    rad and N.m: the same equations, lengths at the rim divided by its radius.
    """
    library = compiled(folder, (str(PLANT),))
    device, box = problem["device"], problem["hands"]
    radius = device.get("handle_radius_m", 1.0)
    hands = _people([_ending(box, *names) for names in (("mass_kg", "inertia_kgm2"), _DAMPING, _STIFFNESS)])
    declared = _numbers(device)
    counts = {}
    for key, changed in (("plant", {}), ("plant_without_friction", {"friction": 0.0})):
        truth = _Device(**(declared | changed))
        counts[key] = [sum(_settles(library, truth, hand, radius, seconds) for hand in hands), HANDS]
    return counts


_DAMPING, _STIFFNESS = ("damping_ns_per_m", "damping_nms_per_rad"), ("stiffness_n_per_m", "stiffness_nm_per_rad")


def _ending(table: dict[str, Any], linear: str, rotary: str, otherwise: Any = 0.0) -> Any:
    return table.get(linear, table.get(rotary, otherwise))


def _numbers(device: dict[str, Any]) -> dict[str, float]:
    """Without a mode the plant is one rigid body; without a bandwidth its amplifier follows within a step."""
    mode = device.get("resonance") or {}
    return {
        "mass": _ending(device, "mass_kg", "inertia_kgm2"),
        "damping": _ending(device, *_DAMPING),
        "time": device["sample_time_s"],
        "delay": device["delay_samples"],
        "friction": _ending(device, "coulomb_friction_n", "coulomb_friction_nm"),
        "encoder": _ending(device, "encoder_resolution_m", "encoder_resolution_rad"),
        "bandwidth": device.get("amplifier_bandwidth_hz") or 1e9,
        "limit": _ending(device, "max_force_n", "max_torque_nm", math.inf),
        "resonance": mode.get("frequency_hz", 0.0),
        "ratio": mode.get("damping_ratio", 0.0),
        "share": mode.get("mass_ratio", 0.0),
    }


def _people(box: list[list[float]]) -> list[tuple[float, ...]]:
    """The corners of [hands], then its inside, 400 in all."""
    ends = np.array(box)
    inside = np.random.default_rng(SEED).uniform(ends[:, 0], ends[:, 1], (HANDS - 8, 3))
    return [*itertools.product(*box), *map(tuple, inside.tolist())]


def _settles(library: ctypes.CDLL, device: Any, hand: tuple[float, ...], radius: float, seconds: float) -> bool:
    """Whether a hand rests after it reached in, after it struck again three times, and after it grasped at the face."""
    mass, damping, stiffness = hand
    body = {"mass": mass, "damping": damping, "stiffness": stiffness, "end": 0.01 / radius}
    reach = {"start": -0.01 / radius, "speed": 0.07 / radius}
    again = {"centre": 0.01 / radius, "swing": 0.015 / radius, "frequency": 2.0, "until": 0.02 / 0.07 + 1.5}
    samples, tail = round(seconds / device.time), round(TAIL_S / device.time)
    for motion in (reach, reach | again, {}):
        found = _Found()
        deed = _Deed(**(body | motion))
        library.whole_device(ctypes.byref(device), ctypes.byref(deed), samples, tail, ctypes.byref(found))
        if not max(found.motor_speed, found.handle_speed) * radius < SETTLED_M_PER_S:
            return False
    return True
