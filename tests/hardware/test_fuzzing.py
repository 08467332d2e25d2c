"""No input harms the firmware: the kept corpus under sanitizers, and a short search for more.

`AVC_FUZZ_SECONDS=60 pytest tests/hardware/test_fuzzing.py` searches for longer.
"""

import os
import re
from pathlib import Path

import pytest
from hardware_bench import require, run, scratch

from avc_casadi import UnsupportedError
from avc_hardware.codegen.build import HOST_INSTALL, compile_with, compiler, generate, options_of
from avc_hardware.codegen.figures import BoardLimits, Config, RuntimeFigures

CORPUS = (Path(__file__).parents[1] / "oracle" / "hardware_corpus.txt").read_text(encoding="utf-8").split()
SECONDS = int(os.environ.get("AVC_FUZZ_SECONDS", "4"))
INSTALL = "apt-get install -y --no-install-recommends clang libclang-rt-dev"


LIMITS = BoardLimits(max_acceleration_m_per_s2=1e6, max_energy_j=1.0, max_overruns=3.0)


def build_fuzzer(*, cc: str = "clang", replay: bool = False) -> Path:
    """Build the fuzzer with sanitizers, or a program that runs the files it is given."""
    program, made = scratch() / ("replay" if replay else "fuzz"), scratch() / "fuzz-generated"
    sources = generate(made, Config(LIMITS, RuntimeFigures(estimator="zero-crossing")), bound=True)
    sources.append(Path(__file__).parents[1] / "oracle" / "hardware_fuzz.c")
    sanitize = (
        ["-fsanitize=address,undefined", "-DAVC_FUZZ_REPLAY"] if replay else ["-fsanitize=fuzzer,address,undefined"]
    )
    options = [*options_of(made, "fuzz"), "-g", *sanitize, "-fno-sanitize-recover=all"]
    compile_with([compiler(cc, HOST_INSTALL), *options, *map(str, sources), "-o", str(program)])
    return program


def corpus_folder() -> Path:
    folder = scratch() / "corpus"
    folder.mkdir(exist_ok=True)
    for index, text in enumerate(CORPUS):
        (folder / f"{index:04d}").write_bytes(bytes.fromhex(text))
    return folder


@pytest.mark.thorough
def test_kept_corpus_runs_clean_under_sanitizers() -> None:
    require("gcc")
    program = build_fuzzer(cc="gcc", replay=True)
    assert len(CORPUS) > 100
    run(str(program), *(str(path) for path in sorted(corpus_folder().iterdir())))


@pytest.mark.thorough
def test_search_finds_nothing_new_that_harms(tmp_path: Path) -> None:
    require("clang")
    try:
        program = build_fuzzer()
    except UnsupportedError as error:
        if os.environ.get("HIL_REQUIRE") == "all":
            raise
        pytest.skip(f"clang cannot link libFuzzer: {INSTALL} ({str(error).splitlines()[-1]})")
    report = run(
        *(str(program), f"-max_total_time={SECONDS}", "-max_len=1024", "-print_final_stats=1", "-seed=1"),
        *(f"-artifact_prefix={tmp_path}/", str(tmp_path), str(corpus_folder())),
        errors=True,
    ).decode()
    executed = re.search(r"number_of_executed_units:\s*(\d+)", report)
    assert executed is not None
    assert int(executed.group(1)) > len(CORPUS)
