"""A proposed wall does not ring: by the eigenvalues of loops written out here, and in the words of the answer."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from quick import first
from scipy.linalg import expm

import avc_casadi as avc
from avc_casadi.cli import main
from avc_casadi.present.rows.recommend import recommendation, verdict

LEAST_RATIO = 0.2
SETTLED_S = 0.3


def poles_of_contact(device, hand, k: float, b: float) -> np.ndarray:
    """Poles of mass, hand, whole samples of delay and -(k x + b (x - x before)/T), one sample after another."""
    period, delay = device.sample_time_s, int(device.delay_samples)
    mass = device.mass_kg + hand[0]
    motion = np.array(
        [[0.0, 1.0, 0.0], [-hand[2] / mass, -(device.damping_ns_per_m + hand[1]) / mass, 1 / mass], [0] * 3]
    )
    step = expm(motion * period)
    size = 3 + delay  # position, velocity, position before, forces on their way
    loop = np.zeros((size, size))
    force = np.zeros(size)
    force[[0, 2]] = -(k + b / period), b / period
    acts = np.eye(size)[-1] if delay else force
    loop[:2, :2] = step[:2, :2]
    loop[:2] += np.outer(step[:2, 2], acts)
    loop[2, 0] = 1.0
    if delay:
        loop[3] = force
        loop[4:, 3:-1] = np.eye(delay - 1)
    return np.linalg.eigvals(loop)


def worst(device, hands, k: float, b: float) -> tuple[float, float]:
    """The smallest damping ratio of a swinging pair, and the longest time to 2 %."""
    ratios, settled = [1.0], [0.0]
    corners = [(m, d, s) for m in hands.mass_kg for d in hands.damping_ns_per_m for s in hands.stiffness_n_per_m]
    for hand in [*corners, (0.0, 0.0, 0.0)]:
        poles = poles_of_contact(device, hand, k, b)
        poles = poles[np.abs(poles) > 1e-9]
        rates = np.log(poles.astype(complex)) / device.sample_time_s
        swings = (np.abs(poles.imag) > 1e-9) & (np.abs(poles) > 1e-3)
        ratios += (-rates.real / np.abs(rates))[swings].tolist()
        settled.append(math.log(50) / -rates.real.max())
    return min(ratios), max(settled)


def drawn_words(index: int) -> list[str]:
    random = np.random.default_rng([91, index])
    mass = 10 ** random.uniform(-1.5, 0.3)
    period = 10 ** random.uniform(-3.5, -2.7)
    stiffness = random.uniform(0.02, 0.12) * mass / period**2 / (1 + 2 * (delay := int(random.integers(0, 4))))
    return [f"--mass={mass:.4g}", f"--rate={1 / period:.5g} Hz", f"--delay={delay}", f"--wall={stiffness:.4g}"]


@pytest.mark.parametrize("index", first(range(12)))
def test_a_proposed_damper_leaves_no_ringing_in_loops_written_out(index: int, tmp_path: Path, capsys) -> None:
    file = tmp_path / "drawn.toml"
    assert main(["new", str(file), *drawn_words(index)]) == 0
    assert "--wall-damping 0" in capsys.readouterr().out
    assert "--wall-damping 0" in file.read_text(encoding="utf-8")
    problem = avc.load_problem(file)
    wall = problem.environment
    ratio, settled_s = worst(problem.device, problem.hands, wall.stiffness_n_per_m, wall.damping_ns_per_m)
    bare_ratio, _ = worst(problem.device, problem.hands, wall.stiffness_n_per_m, 0.0)
    assert ratio >= LEAST_RATIO > bare_ratio
    assert settled_s < SETTLED_S


def test_a_damper_that_was_typed_is_kept_and_none_is_none(tmp_path: Path, capsys) -> None:
    for typed, damping in (("0", 0.0), ("3 N.s/m", 3.0)):
        file = tmp_path / "typed.toml"
        assert main(["new", str(file), "--force", "--mass=100 g", "--wall=1 kN/m", f"--wall-damping={typed}"]) == 0
        assert "roposed" not in capsys.readouterr().out + file.read_text(encoding="utf-8")
        assert avc.load_problem(file).environment.damping_ns_per_m == damping


@pytest.mark.slow
@pytest.mark.parametrize(("wall", "damped"), [({"damping_ns_per_m": 0.0}, False), ({"damping_ns_per_m": 17.0}, True)])
def test_a_coupling_that_rings_is_a_caution_with_its_remedy_and_the_first_sentence_says_so(wall, damped) -> None:
    problem = avc.load_problem("soft").changed(
        device={"mass_kg": 0.159, "damping_ns_per_m": 0.0}, environment={"stiffness_n_per_m": 1000.0, **wall}
    )
    found = avc.recommend(problem, hands=10)
    answer = recommendation(found)
    (shown,) = (row for row in answer.rows if row.label == "Damping ratio")
    sentence, good = verdict(found, answer.rows)
    assert good
    assert (shown.mark.name == "CAUTION") is not damped
    assert ("damping ratio" in sentence) is not damped
    remedy = answer.data["damped_wall"]
    assert (remedy is None) is damped
    if remedy is not None:
        assert f"{remedy['damping_ns_per_m']:.3g}" in shown.text(problem.units)
        ratio, _ = worst(problem.device, problem.hands, remedy["stiffness_n_per_m"], remedy["damping_ns_per_m"])
        assert remedy["damping_ratio"] == pytest.approx(ratio, rel=0.01)
        assert (
            remedy["damping_ratio"]
            >= LEAST_RATIO
            > min(of["damping_ratio"] for of in answer.data["transient"].values())
        )
