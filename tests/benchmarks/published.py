"""Published conditions and figures beside our claims of stability and passivity, and where the two part.

python tests/benchmarks/published.py [OUT]

Each row: their formula or figure, ours, and mostly a second way that shares no code with the package: the energy that a
hand gets out of a held force. Overwrites OUT (default tests/benchmarks/results/published.json), which the page shows.
"""

from __future__ import annotations

import itertools
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from script_arguments import script_arguments
from studied import about, write_rows

import avc_casadi as avc
from avc_casadi.claims.handle_port import passivity
from avc_casadi.claims.zwidth import passive_walls
from avc_casadi.loops.stable_walls import stable_walls
from avc_casadi.model.admittance import AdmittanceDevice
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "oracle"))

from admittance import drawn  # noqa: E402
from admittance_loop import PlainDevice, PlainForceDevice, handle_impedance, largest_pole  # noqa: E402

RESULTS = HERE / "results" / "published.json"
T = 1e-3
Row = dict[str, Any]
Floats = NDArray[np.float64]

# Stability: the linear rule of Gil, Hulin and others

MASS, DAMPING = 0.1, 1.0
HANDS = {"released": (0.0, 0.0, 0.0), "held": (0.2, 5.0, 300.0)}
DELAYS = (0, 1, 2, 5, 10)
WALL_DAMPINGS = (0.0, 1.0, 5.0, 20.0, 50.0)


def rule() -> list[Row]:
    """Stiffest wall against (b + b_h + B)/(T/2 + t_d), by delay, hand and damping of the wall."""
    rows = []
    for who, hand in HANDS.items():
        held = Hand(*(np.array([value]) for value in hand))
        for delay in DELAYS:
            device = Device(mass_kg=MASS, damping_ns_per_m=DAMPING, sample_time_s=T, delay_samples=delay)
            ours = stable_walls([device], held, np.array(WALL_DAMPINGS)).first_n_per_m
            for damping, limit in zip(WALL_DAMPINGS, ours, strict=True):
                told = (DAMPING + hand[1] + damping) / ((0.5 + delay) * T)
                row = {"part": "rule", "hand": who, "delay_samples": delay, "damping_ns_per_m": damping}
                late = damping * (1 + delay) * T / (MASS + hand[0])
                row |= {"late_damper": late, "published_n_per_m": told, "ours_n_per_m": _number(limit)}
                rows.append(row)
    return rows


# Passivity of a held wall: Colgate and Schenkel, Brown, Diolaiti and others

LOSSY = 2.0
FILTERS_HZ = (None, 500.0, 50.0)


def passive() -> list[Row]:
    """Stiffest passive wall against the closed forms, with filtered velocity and with delay."""
    cases = [(damping, hz, 0) for damping in (0.0, 0.5, 1.5) for hz in FILTERS_HZ]
    cases += [(0.0, None, delay) for delay in DELAYS[1:]]
    rows = []
    for damping, hz, delay in cases:
        tau = 0.0 if hz is None else 1 / (2 * math.pi * hz)
        share = tau / (tau + T)
        device = Device(mass_kg=MASS, damping_ns_per_m=LOSSY, sample_time_s=T, delay_samples=delay)
        wall = passive_walls([device], np.array([damping]), "sampled-data", poles=(-share, 0.0))
        ours = float(wall.first_n_per_m[0])
        row = {"part": "passive", "damping_ns_per_m": damping, "filter_hz": hz, "delay_samples": delay}
        row |= {"published_n_per_m": (LOSSY - damping * T / (T + 2 * tau)) / ((0.5 + delay) * T), "ours_n_per_m": ours}
        rows.append(row | {"damping_by_energy_ns_per_m": energy_asks(ours, damping, share, delay)})
    return rows


def energy_asks(stiffness: float, damping: float, share: float, delay: int) -> float:
    """Damping that keeps a hand from gaining energy, N.s/m: the hand moves straight between samples.

    Of all motions with the same samples a straight one loses least to the device. It goes through cos(theta k) at each
    of many theta; the held forces' work is summed, sample by sample.
    """
    samples, before = 4000, 400
    turns = np.concatenate([np.arange(1, 40), np.arange(40, samples // 2 + 1, 40)]) / samples
    x = np.cos(2 * np.pi * turns * np.arange(-before, samples + 1)[:, None])
    moved = np.diff(x, axis=0)
    # Position and velocity of the sample that ends each move; the force is held over the next.
    velocity = lfilter([1 - share], [1, -share], moved / T, axis=0)
    force = (stiffness * x[1:] + damping * velocity)[before - 1 - delay : -1 - delay]
    path = moved[before:]
    return float(np.max(-T * (force * path).sum(axis=0) / (path**2).sum(axis=0)))


# Encoder and dry friction: Abbott and Okamura, Diolaiti and others

FRICTIONS = ((0.05, 50e-6), (0.2, 50e-6), (0.2, 20e-6), (0.5, 400e-6))


def quantised() -> list[Row]:
    """Stiffest passive wall with encoder and dry friction: min(2 b/T, 2 f_c/Delta), and by a hand that taps."""
    rows = []
    for friction, step in FRICTIONS:
        region = avc.zwidth(problem(friction, step))
        ours = min(region.passive_spring_n_per_m, region.encoder_limit_n_per_m or math.inf)
        row = {"part": "quantised", "friction_n": friction, "step_m": step, "ours_n_per_m": ours}
        row |= {"published_n_per_m": min(2 * LOSSY / T, 2 * friction / step)}
        rows.append(row | {"tapping_n_per_m": tapping_allows(friction, step)})
    return rows


def problem(friction: float, step: float) -> avc.Problem:
    """Problem of a device with encoder and dry friction; the wall plays no part."""
    return avc.parse_problem(
        f"[device]\nmass_kg = {MASS}\ndamping_ns_per_m = {LOSSY}\ncoulomb_friction_n = {friction}\n"
        f"encoder_resolution_m = {step}\n[environment]\ndamping_ns_per_m = 0.0\nstiffness_n_per_m = 1e3\n"
    )


def tapping_allows(friction: float, step: float) -> float:
    """Stiffest spring of which a hand gets no energy that goes to and fro once in two samples, N/m.

    It starts at many places within a step of the encoder and goes any way, straight; force of the rounded position.
    """
    ways = np.geomspace(1e-6 * step, 1e4 * step, 1001)[:, None]
    place = (1 - np.geomspace(1e-7, 1, 100)) * step
    difference = step * (np.floor((place + ways) / step) - np.floor(place / step))
    lost = 2 * friction * ways + 2 * LOSSY * ways**2 / T
    gained = np.where(difference > 0, difference * ways, np.nan)
    return float(np.nanmin(lost / gained))


# A measured region: a haptic paddle

DEGREE = math.pi / 180
PADDLE_T, PADDLE_FILTER_HZ, PADDLE_STEP_DEG = 350e-6, 50.0, 0.024
MEASURED = {  # B in N.m.s/deg: K in N.m/deg, as the code that measured it has both
    0.000: (1.8, 5.4, 5.2, 3.0),
    0.002: (2.4, 5.8, 5.8, 4.0),
    0.004: (2.8, 5.8, 6.2, 4.0),
    0.006: (3.0, 5.4, 6.2, 3.8),
    0.008: (2.4, 4.8, 5.8, 3.2),
    0.010: (2.2, 4.4, 5.6, 2.4),
    0.012: (1.8, 2.4, 5.2, 2.0),
    0.014: (1.2, 1.6, 4.8, 1.2),
    0.016: (0.1, 0.8, 4.0, 0.8),
}
INERTIAS_KGM2 = (1e-4, 4e-4, 1e-3)
FINGERS = {"released": (0.0, 0.0, 0.0), "light": (2.5e-4, 1.5e-3, 0.25), "firm": (1.5e-3, 0.025, 2.5)}
PADDLE_DAMPING = 4.5e-5


def paddle() -> list[Row]:
    """Stiffest wall of a paddle by linear stability, over assumed inertias and fingers, beside what was measured."""
    damping = np.array(list(MEASURED)) / DEGREE
    tau = 1 / (2 * math.pi * PADDLE_FILTER_HZ)
    share = tau / (tau + PADDLE_T)
    limits: dict[str, list[list[float | None]]] = {}
    for who, finger in FINGERS.items():
        hand = Hand(*(np.array([value]) for value in finger))
        for inertia in INERTIAS_KGM2:
            device = Device(mass_kg=inertia, damping_ns_per_m=PADDLE_DAMPING, sample_time_s=PADDLE_T)
            found = stable_walls([device], hand, damping, (-share, 0.0)).first_n_per_m * DEGREE
            limits.setdefault(who, []).append([_number(value) for value in found])
    rows = []
    for place, (b, measured) in enumerate(MEASURED.items()):
        spans = {who: [each[place] for each in of] for who, of in limits.items()}
        jump = (measured[0] + (1 - share) * b / PADDLE_T) * PADDLE_STEP_DEG
        row = {"part": "paddle", "damping_nms_per_deg": b, "measured_nm_per_deg": measured, "stable_nm_per_deg": spans}
        rows.append(row | {"torque_of_a_step_nm": jump})
    return rows


# Passivity at the handle of admittance devices

GRIPS = {"rubber grip": (2e3, 0.5), "foam grip": (500.0, 1.0)}
"""Stiffness and damping ratio of two soft handles on the cobot of the catalogue."""
SCANNED = {"mass_kg": np.geomspace(1e-3, 1e4, 43), "damping_ns_per_m": np.geomspace(1.0, 1e8, 49)}
SECOND_WAY_HZ = np.geomspace(0.02, 1.0, 400)
"""Frequencies of the second way, as shares of half the sample rate."""


def admittance_devices() -> dict[str, avc.AdmittanceProblem]:
    """Ten devices with a law: two of the catalogue, six that are drawn at random, two with a soft handle."""
    cobot = avc.load_admittance("admittance/cobot")
    devices = {"cobot": cobot, "pedal": avc.load_admittance("admittance/pedal")}
    devices |= {f"drawn {index}": drawn(index) for index in range(6)}
    for name, (stiffness, ratio) in GRIPS.items():
        sensor = {"stiffness_n_per_m": stiffness, "damping_ratio": ratio}
        devices[name] = cobot.changed(device={"force_sensor": sensor})
    return devices


def at_handle() -> list[Row]:
    """Least mass and damping with every hand and contact of the file, beside those that are passive at the handle."""
    rows = []
    for name, stated in admittance_devices().items():
        ours = avc.certify_admittance(stated, remedies=False)
        device, law, sensor = stated.device, ours.law, stated.device.force_sensor
        lag = lag_s(device, law.cutoff_hz)
        row = {"part": "at_handle", "device": name, "mass_kg": law.mass_kg, "damping_ns_per_m": law.damping_ns_per_m}
        row |= {"sensor_n_per_m": sensor.stiffness_n_per_m, "sensor_ns_per_m": sensor.damping_ns_per_m, "lag_s": lag}
        row |= {"stable_kg": _ends(ours.mass_range_kg), "stable_ns_per_m": _ends(ours.damping_range_ns_per_m)}
        row |= {"from_hz": _number(ours.passivity.from_hz), "second_way": second_way(stated, ours.passivity.from_hz)}
        row |= {f"passive_{key}": passive_values(stated, key) for key in SCANNED}
        rows.append(row | {"any_mass_ns_per_m": (sensor.stiffness_n_per_m * lag) ** 2 / (4 * sensor.damping_ns_per_m)})
    return rows


def lag_s(device: AdmittanceDevice, cutoff_hz: float | None) -> float:
    """Delay of slow motion from the force to the velocity: that of delay, drive and low pass.

    The newest force counts in the virtual mass, which makes up for half a sample of hold.
    """
    order = 2 * device.drive_damping_ratio if device.drive_order == 2 else 1.0
    drive = order / (2 * math.pi * device.drive_bandwidth_hz)
    low_pass = device.sample_time_s / math.expm1(2 * math.pi * cutoff_hz * device.sample_time_s) if cutoff_hz else 0.0
    return device.delay_samples * device.sample_time_s + drive + low_pass


def passive_values(stated: avc.AdmittanceProblem, key: str) -> list[float] | None:
    """Least and largest value of a number of the law that is passive at the handle, of a scan; None: none is."""
    passive = [value for value in SCANNED[key].tolist() if _passive(stated, key, value)]
    return [passive[0], passive[-1]] if passive else None


def _passive(stated: avc.AdmittanceProblem, key: str, value: float) -> bool:
    assert stated.law is not None
    law = stated.law.admittance.with_number(key, value).law(stated.device.sample_time_s)
    return passivity([stated.device.with_values()], law).passive


def second_way(stated: avc.AdmittanceProblem, from_hz: float) -> bool:
    """Whether a loop that shares no code is passive below a frequency, and no longer just above it."""
    plain = PlainDevice.of(stated)
    half = 0.5 / stated.device.sample_time_s
    below = [handle_impedance(plain, share * min(from_hz, half)).real for share in SECOND_WAY_HZ * (1 - 1e-6)]
    return bool(min(below) > -1e-6 and (from_hz >= half or handle_impedance(plain, from_hz * (1 + 1e-6)).real < 0))


# Force feedback behind a transmission

TIMINGS = {"0.1 ms, no delay": (1e-4, 0), "1 ms, one sample": (1e-3, 1)}
TRANSMISSIONS = {"rigid": None, "30 % beyond": (60.0, 0.3), "half": (60.0, 0.5), "half, soft": (20.0, 0.5)}
TRANSMISSIONS |= {"75 % beyond": (60.0, 0.75)}
"""Frequency of a transmission, and the share of the mass between it and the sensor."""
GAINS = np.geomspace(0.02, 50.0, 120)
LARGEST_GAIN = 1e3
"""Largest gain of a file."""


def force_feedback() -> list[Row]:
    """Largest gain of force feedback: of an ideal loop, passive at the handle, and stable with hands and contacts."""
    rows = []
    for timing, (period, delay) in TIMINGS.items():
        for name, mode in TRANSMISSIONS.items():
            stated = lightened(period, delay, mode)
            ours = avc.certify_force_feedback(stated)
            passive = [gain for gain in GAINS.tolist() if _passive_gain(stated, gain)]
            failing = [gain for gain in GAINS.tolist() if gain not in passive]
            row = {"part": "force_feedback", "timing": timing, "transmission": name}
            row |= {"ideal": _number(ours.ideal_limit.gain), "stable": _ends(ours.gain_range)}
            row |= {"passive": max((gain for gain in passive if gain < min(failing, default=math.inf)), default=None)}
            rows.append(row | {"second_way": gain_by_second_way(stated, row["passive"], ours.gain_range)})
    return rows


def lightened(period: float, delay: int, mode: tuple[float, float] | None) -> avc.ForceFeedbackProblem:
    """A rail of 4 kg with a soft grip, with a transmission of a frequency and a share of the mass, or without."""
    device: dict[str, Any] = {"mass_kg": 4.0, "damping_ns_per_m": 8.0, "sample_time_s": period, "delay_samples": delay}
    if mode is not None:
        device["resonance"] = {"frequency_hz": mode[0], "damping_ratio": 0.02, "mass_ratio": mode[1]}
    sensor = {"stiffness_n_per_m": 2e4, "damping_ratio": 0.2, "handle_mass_kg": 0.3}
    return avc.ForceFeedbackProblem.model_validate(
        {
            "device": {**device, "force_sensor": sensor},
            "law": {"force_feedback": {"gain": 0.5}, "damping_ns_per_m": 20.0},
            "hands": {"mass_kg": [0.1, 1.0], "damping_ns_per_m": [3.0, 20.0], "stiffness_n_per_m": [100.0, 1000.0]},
            "contact": {"stiffness_n_per_m": [0.0, 1e4], "damping_ns_per_m": 5.0},
        }
    )


def _passive_gain(stated: avc.ForceFeedbackProblem, gain: float) -> bool:
    law = stated.changed(law={"force_feedback": {"gain": gain}}).law
    assert law is not None
    return passivity([stated.device], law.law(stated.device.sample_time_s)).passive


def gain_by_second_way(stated: avc.ForceFeedbackProblem, passive: float | None, stable: Any) -> bool:
    """Whether a loop that shares no code is passive at a gain, not at the next, and stable up to the largest one."""

    def plain(gain: float, *carried: float) -> PlainForceDevice:
        return PlainForceDevice.of(stated.changed(law={"force_feedback": {"gain": gain}}), *carried)

    def least(gain: float) -> float:
        half = 0.5 / stated.device.sample_time_s
        found = [handle_impedance(plain(gain), hz) for hz in np.geomspace(0.1, half, 1500)]
        return float(min(value.real / abs(value) for value in found))

    held = list(itertools.product((0.1, 1.0), (3.0, 20.0), (100.0, 1000.0)))
    pressed = [(mass, damping + 5.0, spring + 1e4) for mass, damping, spring in held]
    largest = min(0.98 * stable[1], LARGEST_GAIN)
    everything = [*held, *pressed, (0.0, 5.0, 1e4), (0.0, 0.0, 0.0)]
    inside = max(largest_pole(plain(largest, *carried)) for carried in everything) < 1
    if passive is None or passive == GAINS[-1]:
        return bool(inside)
    return bool(inside and least(passive) > -1e-6 and least(passive * GAINS[1] / GAINS[0]) < 0)


def _ends(stable: tuple[float, float] | None) -> list[float | None] | None:
    return None if stable is None else [_number(end) for end in stable]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def main() -> None:
    """Compute and write."""
    args = script_arguments(__doc__, out=RESULTS)
    made = about("python tests/benchmarks/published.py", 0)
    parts = (rule, passive, quantised, paddle, at_handle, force_feedback)
    rows = [row for part in parts for row in part()]
    write_rows(args.out, made, rows)


if __name__ == "__main__":
    main()
