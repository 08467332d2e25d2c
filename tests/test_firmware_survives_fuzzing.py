"""No input harms the firmware: the kept corpus under sanitizers, and a short search for more.

`AVC_FUZZ_SECONDS=60 pytest tests/test_firmware_survives_fuzzing.py` searches for longer.
"""

import os
import re
from pathlib import Path

import pytest
from hardware_bench import require, run, scratch

from avc_casadi import UnsupportedError
from avc_hardware.codegen.build import build_fuzzer

CORPUS = (Path(__file__).parent / "hardware_corpus.txt").read_text(encoding="utf-8").split()
SECONDS = int(os.environ.get("AVC_FUZZ_SECONDS", "4"))
INSTALL = "apt-get install -y --no-install-recommends clang libclang-rt-dev"


def corpus_folder() -> Path:
    folder = scratch() / "corpus"
    folder.mkdir(exist_ok=True)
    for index, text in enumerate(CORPUS):
        (folder / f"{index:04d}").write_bytes(bytes.fromhex(text))
    return folder


@pytest.mark.thorough
def test_kept_corpus_runs_clean_under_sanitizers() -> None:
    require("gcc")
    program = build_fuzzer(scratch(), cc="gcc", replay=True)
    assert len(CORPUS) > 100
    run(str(program), *(str(path) for path in sorted(corpus_folder().iterdir())))


@pytest.mark.thorough
def test_search_finds_nothing_new_that_harms(tmp_path: Path) -> None:
    require("clang")
    try:
        program = build_fuzzer(scratch())
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
