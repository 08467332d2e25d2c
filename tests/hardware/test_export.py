"""The exported C is the scene's coupling: the bits of its expressions in either precision, on every compiler."""

import dataclasses
import functools
import itertools
import math
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from exported import C99, CLANG, CLANG_CPP17, CPP11, WARNINGS, Exported
from exported_bench import BOARDS, Ran, ran
from exported_cases import drawn, motions, notched
from exported_teleoperator import teleoperator_coupling
from exported_tool import tool_coupling
from hardware_bench import bench_problem, coupling, export_c, require, with_gains
from hypothesis import example, given
from hypothesis import strategies as st
from quick import first
from reference_coupling import ReferenceCoupling

from avc_casadi import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.emit import PRECISIONS

# Every kind of observer, guard, delay and estimator.
SEEDS = (0, 1, 2, 3, 5, 6, 7, 11, 16, 17, 21)


@functools.cache
def reference(made: Coupling, precision: str = "single") -> FloatArray:
    ways = motions(made)
    devices = ReferenceCoupling(made, len(ways), PRECISIONS[precision])
    return np.stack([devices.step(column) for column in ways.T], axis=1)


def check_bits(made: Coupling, compiler: tuple[str, ...], precision: str = "single") -> None:
    device = Exported(made, compiler=compiler, precision=precision)
    for way, forces in zip(motions(made), reference(made, precision), strict=True):
        device.start()
        assert device.forces(way).tobytes() == forces.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_compiled_coupling_gives_the_bits_of_the_expressions(seed: int) -> None:
    for compiler in (C99, (CPP11, CLANG, CLANG_CPP17)[seed % 3]):
        check_bits(drawn(seed), compiler)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS[1::4])
def test_double_precision_gives_the_bits_of_the_expressions(seed: int) -> None:
    check_bits(drawn(seed), (C99, CPP11, CLANG, CLANG_CPP17)[seed // 4 % 4], "double")


def test_fast_math_is_refused() -> None:
    require("gcc")
    with pytest.raises(AssertionError, match="compile without -ffast-math"):
        Exported(drawn(0), flags=(*WARNINGS, "-ffast-math"))


# Detents in the exported C: the bits of the scene's expressions, and the sine of their definition.

# Nothing beside the gains; a table; observer and tank; a controller; state feedback.
NOTCHED = (0, 1, 2, 7, 16)


@pytest.mark.slow
@pytest.mark.parametrize("seed", NOTCHED)
def test_compiled_detents_have_the_bits_of_the_expressions(seed: int) -> None:
    check_bits(notched(seed), (C99, CPP11, CLANG_CPP17)[seed % 3])


@pytest.mark.parametrize(("precision", "off"), first([("single", 2e-5), ("double", 1e-12)]))
@pytest.mark.parametrize("width", first([1.0, 0.3]))
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
    assert result.state_bytes <= 544
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
    """What is left of C without its comments and the digest of its text: of each line what stands between blanks."""
    for trigraph, character in TRIGRAPHS.items():
        text = text.replace(trigraph, character)
    joined = re.sub(r"\\[ \t]*\r?\n", "", text)
    bare = TOKEN.sub(lambda found: found[0] if found[0].startswith('"') else " ", joined)
    return re.sub(r"_DIGEST( !=)? 0x[0-9a-f]+ULL", "_DIGEST", " ".join(bare.split()))


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


@pytest.mark.parametrize("name", ["", "Soft", "2nd", "a b", "a*/", "x" * 21, "soft_", "int main", "math", "int8"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="name: is "):
        export_c(PLAIN, name=name)


# Header and source of two exports, as a kill between the two files leaves them, do not compile.

SIMULATED = "step_s = 0.002\ntool_mass_kg = 0.2\n"
LED = "mass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\ndelay_s = 0.004\n"
# Two of each kind that differ in one number alone; constant gains, a table, state feedback, an engine, a follower.
TWO_COUPLINGS = {
    "gains": lambda: (coupling(1, seed=1), coupling(1, seed=2)),
    "table": lambda: (coupling(7, seed=1), coupling(7, seed=2)),
    "law": lambda: (drawn(16), drawn(17)),
    "engine": lambda: (tool_coupling(SIMULATED, 300.0, 1.0), tool_coupling(SIMULATED, 301.0, 1.0)),
    "follower": lambda: (teleoperator_coupling(LED, 300.0, 1.0), teleoperator_coupling(LED, 301.0, 1.0)),
}


def compiles(files: dict[str, str], folder: Path, compiler: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    command = [*compiler, *WARNINGS, "-fsyntax-only", str(folder / "avc_coupling.c")]
    return subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603


@pytest.mark.parametrize("compiler", [C99, pytest.param(CPP11, marks=pytest.mark.slow)], ids=["C", "C++"])
@pytest.mark.parametrize("kind", first(TWO_COUPLINGS, 3))
def test_header_and_source_of_two_couplings_do_not_compile(
    kind: str, compiler: tuple[str, ...], tmp_path: Path
) -> None:
    require(compiler[0])
    exports = [export_c(made) for made in TWO_COUPLINGS[kind]()]
    exports.append(export_c(TWO_COUPLINGS[kind]()[0], precision="double"))
    for header, source in itertools.product(range(3), repeat=2):
        mixed = {
            "avc_coupling.h": exports[header]["avc_coupling.h"],
            "avc_coupling.c": exports[source]["avc_coupling.c"],
        }
        done = compiles(mixed, tmp_path, compiler)
        assert (done.returncode == 0) is (header == source), done.stderr
        assert ("header and source are of two couplings" in done.stderr) is (header != source)
    # A header of an earlier release states no digest.
    lines = exports[0]["avc_coupling.h"].splitlines(keepends=True)
    older = "".join(line for line in lines if not line.startswith("#define AVC_COUPLING_DIGEST"))
    assert compiles({**exports[0], "avc_coupling.h": older}, tmp_path, compiler).returncode != 0
