"""The exported C is the scene's coupling: the bits of its expressions in either precision, on every compiler."""

import dataclasses
import functools
import math
import re

import numpy as np
import pytest
from exported import C99, CLANG, CLANG_CPP17, CPP11, WARNINGS, Exported
from exported_bench import BOARDS, Ran, ran
from exported_cases import drawn, motions, notched
from hardware_bench import bench_problem, coupling, export_c, require, with_gains
from hypothesis import example, given
from hypothesis import strategies as st
from reference_coupling import ReferenceCoupling

import avc_casadi as avc
from avc_casadi import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.emit import PRECISIONS

# Every kind of observer, guard, delay and estimator.
SEEDS = (0, 1, 2, 3, 5, 6, 7, 11, 16, 17, 21)


@functools.cache
def reference(seed: int, precision: str) -> FloatArray:
    made = drawn(seed)
    ways = motions(made)
    devices = ReferenceCoupling(made, len(ways), PRECISIONS[precision])
    return np.stack([devices.step(column) for column in ways.T], axis=1)


def check_bits(seed: int, compiler: tuple[str, ...], precision: str) -> None:
    made, expected = drawn(seed), reference(seed, precision)
    device = Exported(made, compiler=compiler, precision=precision)
    for way, forces in zip(motions(made), expected, strict=True):
        device.start()
        assert device.forces(way).tobytes() == forces.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_compiled_coupling_gives_the_bits_of_the_expressions(seed: int) -> None:
    for compiler in (C99, (CPP11, CLANG, CLANG_CPP17)[seed % 3]):
        check_bits(seed, compiler, "single")


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS[1::4])
def test_double_precision_gives_the_bits_of_the_expressions(seed: int) -> None:
    check_bits(seed, (C99, CPP11, CLANG, CLANG_CPP17)[seed // 4 % 4], "double")


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_force_is_a_number_within_its_limit_and_pushes(seed: int) -> None:
    made, forces = drawn(seed), reference(seed, "single")
    assert np.isfinite(forces).all()
    assert (forces[3][[40, 41, 90, 150, 151, 220, 300]] == 0).all()
    assert (forces[:3] > 0).any()
    if made.max_force_n is not None:
        assert np.abs(forces).max() <= np.float32(made.max_force_n)
    if made.runtime.guard is None:
        assert forces.min() >= 0


def test_fast_math_is_refused() -> None:
    require("gcc")
    with pytest.raises(AssertionError, match="compile without -ffast-math"):
        Exported(drawn(0), flags=(*WARNINGS, "-ffast-math"))


# Detents in the exported C: the bits of the scene's expressions, and the sine of their definition.

# Nothing beside the gains; a table; observer and tank; a controller; state feedback.
EXPORT_DETENTS_SEEDS = (0, 1, 2, 7, 16)


def forces_of(seed: int, precision: str = "single") -> np.ndarray:
    ways = motions(notched(seed))
    devices = ReferenceCoupling(notched(seed), len(ways), PRECISIONS[precision])
    return np.stack([devices.step(column) for column in ways.T], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", EXPORT_DETENTS_SEEDS)
def test_compiled_detents_have_the_bits_of_the_expressions(seed: int) -> None:
    compiler = (C99, CPP11, CLANG_CPP17)[seed % 3]
    device = Exported(notched(seed), compiler=compiler)
    for way, forces in zip(motions(notched(seed)), forces_of(seed), strict=True):
        device.start()
        assert device.forces(way).tobytes() == forces.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize(("board", "seed"), [("Cortex-M0", 0), ("ATmega328P", 2)])
def test_a_small_processor_has_the_same_bits(board: str, seed: int) -> None:
    ways = motions(notched(seed))[:, :60]
    assert ran(board, notched(seed), ways).forces.tobytes() == forces_of(seed)[:, :60].tobytes()


@pytest.mark.parametrize(("precision", "off"), [("single", 2e-5), ("double", 1e-12)])
@pytest.mark.parametrize("width", [1.0, 0.3])
def test_the_force_in_front_of_the_wall_is_that_of_the_definition(precision: str, off: float, width: float) -> None:
    pitch, centre = 2e-3, -3.3e-3
    made = dataclasses.replace(
        coupling(1),
        problem=coupling(1).problem.changed(
            detent={"force_n": 1.0, "pitch_m": pitch, "width": width, "centre_m": centre}
        ),
    )
    step = made.problem.device.encoder_resolution_m or 1e-6
    places = -step * np.round(np.linspace(1e-6, 0.05, 400) / step)
    from_valley = (places - centre) / pitch - np.round((places - centre) / pitch)
    expected = np.where(np.abs(from_valley) < width / 2, np.sin(2 * math.pi * from_valley / width), 0.0)
    near_an_edge = np.abs(np.abs(from_valley) - width / 2) < 1e-3
    forces = Exported(made, precision=precision).forces(places)
    # A valley is as far away as single precision tells a place some thousand times its distance.
    assert np.abs(forces - expected)[~near_an_edge].max() < off * 50 / width


# The exported C on an 8-bit AVR, two Cortex-M and a 64-bit RISC-V, emulated: the bits of the scene's expressions.

# Observer, tank and a table; state feedback and guard; state feedback without; the fused estimator with all of it.
SMALL, ALL = (2, 16, 21), 17
CASES = [(board, seed, 110) for board in BOARDS if board != "ATmega2560" for seed in SMALL]
CASES += [(board, ALL, 50) for board in BOARDS if board not in ("ATmega328P", "Cortex-M0")]


def checked(board: str, made: Coupling, ways: FloatArray) -> Ran:
    devices = ReferenceCoupling(made, len(ways))
    expected = np.stack([devices.step(column) for column in ways.T], axis=1)
    result = ran(board, made, ways)
    assert (result.forces > 0).any()
    assert result.forces.tobytes() == expected.tobytes()
    return result


@pytest.mark.slow
@pytest.mark.parametrize(("board", "seed", "samples"), CASES)
def test_forces_have_the_bits_of_the_expressions(board: str, seed: int, samples: int) -> None:
    made = drawn(seed)
    result = checked(board, made, motions(made)[:, :samples])
    assert result.state_bytes <= 512
    assert result.stack_bytes <= 1200


@pytest.mark.slow
def test_200_rows_fit_an_arduino_uno_and_stay_in_flash() -> None:
    """32 KB of flash, 2 KB of memory."""
    made = coupling(
        200,
        largest=(300.0, 1e5, 50.0),
        runtime=Runtime(estimator="zero-crossing", guard="passivity-controller"),
        encoder_resolution_m=2e-5,
    )
    result = checked("ATmega328P", made, motions(made)[:3, 50:130])
    assert result.flash_bytes > 200 * 5 * 4
    assert result.copied_bytes == 0
    assert result.program_bytes <= 32 * 1024
    assert result.state_bytes + result.stack_bytes <= 1024


# No text that reaches exported C becomes code.

PLAIN = with_gains(bench_problem((5.0, 5e3), max_force_n=8.0), 5.0, 4e3, 3.0)
TRIGRAPHS = {f"??{last}": meant for last, meant in zip("/=()'<!>-", "\\#[]^{|}~", strict=True)}
# A comment, or a string that holds no comment.
TOKEN = re.compile(r'"(?:\\.|[^"\\\n])*"|/\*.*?\*/|//[^\n]*', re.DOTALL)
HARD = ["*/", "/*", "*\\", "\\", "\n", "??/", "//", "\u2028", "\u202e", "{id}", "%s", '"']
# A problem takes no control characters; what else is read from files may hold any.
WHOLE = st.text(st.characters(exclude_categories=("Cc", "Cs")), max_size=4)
TEXTS = st.lists(st.sampled_from(HARD) | WHOLE, max_size=8).map("".join)
ANY = st.lists(st.sampled_from([*HARD, "\r", "\0"]) | st.text(max_size=4), max_size=8).map("".join)


def code(text: str) -> str:
    """What is left of C without its comments: of each line what stands between blanks."""
    for trigraph, character in TRIGRAPHS.items():
        text = text.replace(trigraph, character)
    joined = re.sub(r"\\[ \t]*\r?\n", "", text)
    bare = TOKEN.sub(lambda found: found[0] if found[0].startswith('"') else " ", joined)
    return " ".join(bare.split())


def named(title: str, method: str, file: str) -> dict[str, str]:
    """The exported files of the plain coupling under other names, as text by path."""
    other = PLAIN.problem.model_copy(update={"title": title, "name": file})
    return export_c(dataclasses.replace(by(method), problem=other))


def by(method: str) -> Coupling:
    return dataclasses.replace(PLAIN, schedule=dataclasses.replace(PLAIN.schedule, method=method))


@pytest.mark.slow
@given(title=TEXTS, method=ANY, file=TEXTS)
@example(title="*\\ int planted; /*", method="*/", file="??/\n*/")
@example(title="*\\/ int planted; /\\*", method="*?\u200b?//", file="\\")
def test_no_title_method_or_file_becomes_code(title: str, method: str, file: str) -> None:
    found, plain = named(title, method, file), named("a wall", "by hand", "bench")
    assert found.keys() == plain.keys()
    for place, text in found.items():
        assert text.isascii()
        assert code(text) == code(plain[place]), place


def test_a_planted_statement_is_seen_by_this_test() -> None:
    """A comment that ends early is code to `code`, in each way that C knows."""
    for text in ("/* a */ int planted; /* */", "/* a *??/\n/ int planted; /* */", "/* a *\\\n/ int planted; /* */"):
        assert code(text) == "int planted;"
    assert code('/* a */ char *text = "/* no comment */";') == 'char *text = "/* no comment */";'


@pytest.mark.parametrize("name", ["", "Soft", "2nd", "a b", "a*/", "x" * 21, "soft_", "int main"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="name: is "):
        export_c(PLAIN, name=name)


# The exported C in a simulator of its own: a mass, a hand and an encoder by their equations, nothing of the project.

SUBSTEPS = 8


class Bench:
    """m x'' = -b x' + k_h (x_h - x) + b_h (x_h' - x') - F, the hand's mass on the device, F held over a sample."""

    def __init__(self, mass_kg: float, damping: float, hand: tuple[float, float, float]) -> None:
        self.mass = mass_kg + hand[0]
        self.damping = damping
        self.hand_damping, self.hand_stiffness = hand[1:]
        self.x, self.v = -0.01, 0.0

    @staticmethod
    def target(time: float) -> tuple[float, float]:
        """From -10 mm to 10 mm at 70 mm/s, then at rest."""
        moving = time < 0.02 / 0.07
        return (-0.01 + 0.07 * time, 0.07) if moving else (0.01, 0.0)

    def rate(self, time: float, x: float, v: float, force: float) -> tuple[float, float]:
        x_h, v_h = self.target(time)
        hand = self.hand_stiffness * (x_h - x) + self.hand_damping * (v_h - v)
        return v, (hand - self.damping * v - force) / self.mass

    def pass_time(self, time: float, seconds: float, force: float) -> None:
        h = seconds / SUBSTEPS
        for step in range(SUBSTEPS):
            t, x, v = time + step * h, self.x, self.v
            a = self.rate(t, x, v, force)
            b = self.rate(t + h / 2, x + h / 2 * a[0], v + h / 2 * a[1], force)
            c = self.rate(t + h / 2, x + h / 2 * b[0], v + h / 2 * b[1], force)
            d = self.rate(t + h, x + h * c[0], v + h * c[1], force)
            self.x = x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
            self.v = v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])


def pressed(coupling: Coupling, hand: tuple[float, float, float], seconds: float = 2.5) -> tuple[float, float, float]:
    """Return the largest speed of the last half second, the stiffness felt then, and the largest force."""
    device = coupling.problem.device
    bench = Bench(device.mass_kg, device.damping_ns_per_m, hand)
    board = Exported(coupling)
    step, time_s = device.encoder_resolution_m, device.sample_time_s
    line = [0.0] * device.delay_samples
    forces, depths, speeds, most = [], [], [], 0.0
    for sample in range(round(seconds / time_s)):
        seen = step * math.floor(bench.x / step + 0.5) if step else bench.x
        line.append(board.step(seen))
        force = line.pop(0)
        bench.pass_time(sample * time_s, time_s, force)
        most = max(most, force)
        if sample * time_s > seconds - 0.5:
            forces.append(force)
            depths.append(bench.x)
            speeds.append(abs(bench.v))
    return max(speeds), sum(forces) / sum(depths), most


@functools.cache
def tuned(name: str) -> Coupling:
    problem = avc.load_problem(name)
    return Coupling.of(problem, avc.solve(problem, "static-tuned"))


HANDS = [(0.05, 3.0, 200.0), (0.175, 11.5, 500.0), (0.3, 20.0, 800.0)]


@pytest.mark.slow
@pytest.mark.parametrize("hand", HANDS, ids=["light", "middle", "heavy"])
@pytest.mark.parametrize("name", ["ve3", "soft"])
def test_hands_rest_at_the_wall_of_the_coupling(name: str, hand: tuple[float, float, float]) -> None:
    coupling = tuned(name)
    speed, stiffness, most = pressed(coupling, hand)
    k, k_e = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    assert speed < 5e-3
    assert stiffness == pytest.approx(k * k_e / (k + k_e), rel=0.02)
    assert most > 1


class RockingBench(Bench):
    """The target goes to 12 mm and then to and fro at 8 Hz."""

    @staticmethod
    def target(time: float) -> tuple[float, float]:
        arrival, omega = 0.022 / 0.07, 2 * math.pi * 8.0
        if time < arrival:
            return -0.01 + 0.07 * time, 0.07
        phase = omega * (time - arrival)
        return 0.012 + 0.004 * math.sin(phase), 0.004 * omega * math.cos(phase)


def rocked(coupling: Coupling) -> float:
    """Return the mean depth after some seconds of it, over whole periods."""
    device = coupling.problem.device
    bench = RockingBench(device.mass_kg, device.damping_ns_per_m, HANDS[1])
    board = Exported(coupling)
    step, time_s = device.encoder_resolution_m, device.sample_time_s
    line = [0.0] * int(device.delay_samples)
    depths = []
    for sample in range(5000):
        line.append(board.step(step * math.floor(bench.x / step + 0.5)))
        force = line.pop(0)
        bench.pass_time(sample * time_s, time_s, force)
        if sample >= 3000:
            assert force > 0
            depths.append(bench.x)
    return sum(depths) / len(depths)


@pytest.mark.slow
def test_gains_that_follow_a_moving_hand_do_not_sag_under_its_mean_force() -> None:
    """The mean depth is that of the row of rest, where the row of 8 Hz alone would give way by 4 %."""
    problem = avc.load_problem("ve3").changed(device={"delay_samples": 1})
    made = Coupling.of(problem, avc.solve(problem, "direct"))
    b, k, _ = made.table(8.0).tolist()
    rest = made.table.at_rest
    depth = rocked(with_gains(problem, rest.damping_ns_per_m, rest.stiffness_n_per_m))
    assert rocked(with_gains(problem, b, k)) > 1.03 * depth
    assert rocked(made) == pytest.approx(depth, rel=0.005)


def test_a_rigid_coupling_to_a_stiff_wall_does_not_rest() -> None:
    """The bench can fail: without a coupling that gives way this wall buzzes."""
    speed, _, most = pressed(with_gains(avc.load_problem("figure5"), 1e4, 1e7), HANDS[1])
    assert speed > 0.05
    assert most > 20


def test_the_observer_looks_over_the_delay_that_would_make_the_wall_buzz() -> None:
    """Two samples of delay and a 20 um encoder: with the observer of the export the same gains rest."""
    problem = avc.load_problem("ve3").changed(device={"delay_samples": 2, "encoder_resolution_m": 2e-5})
    gains = with_gains(problem, 5.0, 8e3)
    without = pressed(gains, HANDS[0])[0]
    seen = Coupling(problem, gains.schedule, gains.table, Runtime(observer_mass_kg=0.16))
    speed, stiffness, _ = pressed(seen, HANDS[0])
    assert speed < 5e-3 < without
    assert stiffness == pytest.approx(8e3 * 4.5e3 / 12.5e3, rel=0.03)
