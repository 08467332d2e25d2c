"""Random loops that clip last: a device, gains about the edge of stability and a box of hands; and what speaks against
what is said of them, by a simulator that shares no code with the proof."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from clip_last_simulator import Simulator, at_rest

from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, prove_rest
from avc_casadi.model.device import Device

HANDS = 24
SECONDS = 2.0


@dataclass
class DrawnLoop:
    device: Device
    law: ContactLaw
    box: dict[str, tuple[float, float]]
    proof: Rest

    @property
    def gains(self) -> dict[str, float]:
        law = self.law
        return {
            "b": law.damping_ns_per_m,
            "k": law.stiffness_n_per_m,
            "b_p": law.contact_damping_ns_per_m,
            "b_e": law.wall_damping_ns_per_m,
            "k_e": law.wall_stiffness_n_per_m,
        }


def drawn_loop(seed: int, *, plain: bool = False) -> DrawnLoop:
    """Draw a loop and judge it; a plain one is rigid."""
    random = np.random.default_rng([14, seed])
    t = float(random.choice([2.5e-4, 5e-4, 1e-3, 2e-3]))
    keys: dict[str, Any] = {
        "mass_kg": float(random.uniform(0.03, 0.4)),
        "damping_ns_per_m": float(random.uniform(0.2, 4.0)),
        "sample_time_s": t,
        "delay_samples": float(random.choice([0, 0, 0, 1, 1, 2, 0.4, 1.3])),
    }
    if not plain and random.random() < 0.2:
        keys["resonance"] = {
            "frequency_hz": float(random.uniform(80, 250)),
            "damping_ratio": float(random.uniform(0.02, 0.2)),
            "mass_ratio": float(random.uniform(0.2, 0.7)),
        }
    if not plain and random.random() < 0.2:
        keys["amplifier_bandwidth_hz"] = float(random.uniform(0.2, 1.0) / t)
    device = Device.model_validate(keys)
    box = {}
    for name, low, high in (
        ("mass_kg", 0.02, 0.4),
        ("damping_ns_per_m", 1.0, 25.0),
        ("stiffness_n_per_m", 50.0, 1500.0),
    ):
        one, other = sorted(np.exp(random.uniform(np.log(low), np.log(high), 2)))
        box[name] = (float(one), float(other))
    light = device.mass_kg + box["mass_kg"][0]
    slow = 1 + 2 * device.delay_samples + (2 if device.resonance else 0)
    wall = float(np.exp(random.uniform(np.log(0.01), np.log(0.7)))) * light / t**2 / slow**1.3
    rigid = random.random() < 0.5
    law = ContactLaw(
        sample_time_s=t,
        damping_ns_per_m=np.inf if rigid else float(random.uniform(0.2, 3.0) * wall * t),
        stiffness_n_per_m=np.inf if rigid else float(random.uniform(0.3, 30.0) * wall),
        contact_damping_ns_per_m=0.0 if random.random() < 0.2 else float(random.uniform(0.1, 2.5) * wall * t),
        wall_damping_ns_per_m=0.0 if random.random() < 0.5 else float(random.uniform(0.0, 0.5) * wall * t),
        wall_stiffness_n_per_m=wall,
    )
    proof = prove_rest(law, "clip-last", device, box, most_cells=150_000, seed=seed)
    return DrawnLoop(device, law, box, proof)


def contradiction(loop: DrawnLoop, seed: int) -> str:
    """Return what speaks against the proof or its witness; empty where nothing does."""
    proof = loop.proof
    if proof.outcome == "proved":
        return _unsettled(loop, seed)
    if proof.unstable is not None:
        return "" if _runs_away(loop) else "the unstable hand does not run away"
    return ""


def _simulated(loop: DrawnLoop, hands: dict[str, Any], target: Any, limit: float | None = None) -> Simulator:
    return Simulator(loop.device.model_dump() | {"max_force_n": limit}, loop.gains, hands, target)


def _unsettled(loop: DrawnLoop, seed: int) -> str:
    random = np.random.default_rng([15, seed])
    ends = np.array(list(loop.box.values()))
    drawn = random.uniform(ends[:, 0], ends[:, 1], (HANDS, 3))
    for place in range(min(8, HANDS)):
        drawn[place] = [end[place >> number & 1] for number, end in enumerate(ends)]
    hands = dict(zip(loop.box, drawn.T, strict=True))
    depth = 10.0 ** random.uniform(-4, -1.5, HANDS) * random.choice([-1, 0, 1], HANDS)
    limit = float(random.choice([np.inf, 10.0, 3.0]))
    simulator = _simulated(loop, hands, depth, limit)
    count = len(depth)
    simulator.start(
        random.normal(0, 0.005, count),
        random.normal(0, 0.3, count),
        before=random.normal(0, 0.005, count),
        tool=random.normal(0, 0.005, count),
    )
    rest = at_rest(simulator, SECONDS)
    if not rest.all():  # slow ones get longer
        rest = at_rest(simulator, 10 * SECONDS)
    if not rest.all():  # at the edge of stability a loop takes minutes to halve its motion
        rest = _dies_away(simulator)
    return "" if rest.all() else f"hand {drawn[int(np.argmin(rest))].tolist()} does not settle"


def _dies_away(simulator: Simulator) -> np.ndarray:
    """Which hands are slow, or slower in every stretch than in the one before and by a twentieth in all."""
    samples = round(20 * SECONDS / simulator.device["sample_time_s"])
    peaks = np.array([np.abs(simulator.run(samples)[1]).max(axis=0) for _ in range(5)])
    slower = (np.diff(peaks, axis=0) < 0).all(axis=0) & (peaks[-1] < 0.95 * peaks[0])
    return (peaks[-1] < 1e-4) | slower


def _runs_away(loop: DrawnLoop) -> bool:
    """A hand that leans on the wall and is nudged: its motion grows until it leaves the wall."""
    unstable = loop.proof.unstable
    hands = {name: np.array([value]) for name, value in unstable.hand.items()}
    stiffness = 1 / (1 / loop.law.stiffness_n_per_m + 1 / loop.law.wall_stiffness_n_per_m)
    target = np.array([1.0])
    rest = target * hands["stiffness_n_per_m"] / (hands["stiffness_n_per_m"] + stiffness)
    simulator = _simulated(loop, hands, target)
    samples = round(min(2e5, 30 / (unstable.spectral_radius - 1)))
    start = np.full((1, int(loop.device.delay_samples) + 2), float(stiffness * rest[0]))
    joint = rest if loop.law.rigid else stiffness * rest / loop.law.wall_stiffness_n_per_m
    simulator.start(rest, np.array([1e-6]), tool=joint, under_way=start)
    if loop.device.amplifier_bandwidth_hz:
        simulator.state[:, -1] = stiffness * rest
    # In parts: most have run away long before the last. What grows too slowly for that grows as fast as it is told.
    peaks = []
    for _ in range(20):
        peaks.append(float(np.abs(simulator.run(samples // 20 + 1)[1]).max()))
        if peaks[-1] > 100 * 1e-6:
            return True
    told = 18 * (samples // 20 + 1) * np.log(unstable.spectral_radius)
    return bool(abs(np.log(peaks[-1] / peaks[1]) - told) < 0.1 * told)
