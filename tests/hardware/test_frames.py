"""Frames: the C and the Python codec agree, and a spoilt frame is never taken for another."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hardware_bench import INSTALL, host_core, require, run, scratch
from hypothesis import example, given
from hypothesis import strategies as st

from avc_hardware.codegen.build import compile_with, compiler, generate, options_of
from avc_hardware.codegen.figures import BoardLimits, Config, RuntimeFigures
from avc_hardware.link.faults import Refusal, RefusalReason
from avc_hardware.link.frames import MAX_ENCODED, MAX_PAYLOAD, Decoder, Frame, cobs_decode, cobs_encode, decode, encode
from avc_hardware.link.messages import Kind, parse

VECTORS = json.loads((Path(__file__).parents[1] / "oracle" / "hardware_frames.json").read_text(encoding="utf-8"))

payloads = st.binary(max_size=MAX_PAYLOAD)
frames = st.builds(Frame, st.integers(0, 255), st.integers(0, 65535), payloads)


@given(st.binary(max_size=1100))
@example(b"")
@example(b"\0")
@example(b"\1" * 254)
@example(b"\1" * 254 + b"\0")
@example(b"\1" * 255)
@example(b"\1" * 508)
def test_stuffed_bytes_hold_no_zero_and_come_back(data: bytes) -> None:
    stuffed = cobs_encode(data)
    assert 0 not in stuffed
    assert len(stuffed) <= len(data) + 1 + len(data) // 254
    assert cobs_decode(stuffed) == data


@given(frames)
def test_frame_comes_back(frame: Frame) -> None:
    data = encode(frame)
    assert len(data) <= MAX_ENCODED
    assert data.endswith(b"\0")
    assert decode(data[:-1]) == frame


@given(st.lists(frames, max_size=4), st.integers(1, 50), st.booleans())
def test_decoder_does_not_care_how_bytes_arrive(sent: list[Frame], step: int, delimiters: bool) -> None:
    stream = b"".join((b"\0" if delimiters else b"") + encode(frame) for frame in sent)
    decoder = Decoder()
    got = [frame for at in range(0, len(stream), step) for frame in decoder.feed(stream[at : at + step])]
    assert got == sent
    assert decoder.broken == 0


def spoilt(data: bytes) -> bytes:
    """A frame with another last byte, which is no delimiter."""
    return data[:-2] + bytes([data[-2] ^ (2 if data[-2] == 1 else 1)]) + data[-1:]


@given(st.lists(st.tuples(frames, st.sampled_from(["good", "spoilt", "endless"])), max_size=4), st.integers(1, 50))
@example([(Frame(1, 2, b""), "spoilt")], 1)
@example([(Frame(1, 2, b""), "endless"), (Frame(1, 3, b""), "good")], 50)
def test_decoder_counts_each_broken_frame_once(sent: list[tuple[Frame, str]], step: int) -> None:
    ways = {"good": lambda data: data, "spoilt": spoilt, "endless": lambda data: b"\1" * (2 * MAX_ENCODED) + data}
    stream = b"".join(ways[way](encode(frame)) for frame, way in sent)
    decoder = Decoder()
    got = [frame for at in range(0, len(stream), step) for frame in decoder.feed(stream[at : at + step])]
    assert got == [frame for frame, way in sent if way == "good"]
    assert decoder.broken == len(sent) - len(got)


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])
def test_golden_frames(vector: dict[str, str]) -> None:
    data = bytes.fromhex(vector["bytes"])
    frame = Frame(int(vector["type"]), int(vector["sequence"]), bytes.fromhex(vector["payload"]))
    assert encode(frame) == data
    assert decode(data[:-1]) == frame


def test_golden_frames_are_answered_by_the_firmware() -> None:
    core = host_core()
    core.read()
    for vector in VECTORS:
        core.write(bytes.fromhex(vector["bytes"]))
        (answer,) = Decoder().feed(core.read())
        assert answer.sequence == int(vector["sequence"])
        assert answer.type == int(vector["answer_type"]), vector["name"]


def test_every_bit_of_a_frame_matters() -> None:
    frame = Frame(Kind.SET_GAINS, 7, struct.pack("<II3f", 1, 60, 100.0, 1e5, 0.0))
    data = encode(frame)
    for at in range(len(data) - 1):
        for bit in range(8):
            spoilt = bytearray(data)
            spoilt[at] ^= 1 << bit
            assert Decoder().feed(bytes(spoilt)) == []


@given(st.binary(max_size=1500))
def test_random_bytes_do_not_harm_the_firmware(noise: bytes) -> None:
    core = host_core()
    core.read()
    core.write(noise + b"\0")
    core.read()
    core.write(encode(Frame(Kind.STATUS, 9, b"")))
    answers = [frame for frame in Decoder().feed(core.read()) if frame.sequence == 9]
    assert [frame.type for frame in answers] == [Kind.STATUS | 0x80]


@given(st.integers(0, 255), st.binary(max_size=600), st.integers(0, 255))
def test_any_message_is_answered_once_and_no_answer_is(kind: int, payload: bytes, version: int) -> None:
    core = host_core()
    core.read()
    core.write(encode(Frame(kind, 77, payload, version)))
    core.tick(np.zeros(2, dtype=np.int32))
    answers = Decoder().feed(core.read())
    if kind >= 0x80:  # an answer: a line that echoes brings them back
        assert answers == []
        return
    (answer,) = answers
    assert answer.sequence == 77
    if version != 1:
        assert parse(answer) == Refusal(RefusalReason.VERSION, 1)


# No input harms the firmware: the kept corpus under sanitizers, and a search for more, as long as one likes.

CORPUS = (Path(__file__).parents[1] / "oracle" / "hardware_corpus.txt").read_text(encoding="utf-8").split()
LIMITS = BoardLimits(max_acceleration_m_per_s2=1e6, max_energy_j=1.0, max_overruns=3.0)


@pytest.mark.slow
def test_kept_corpus_runs_clean_under_sanitizers() -> None:
    require("clang")
    program, made, corpus = (scratch() / name for name in ("fuzz", "fuzz-generated", "corpus"))
    sources = generate(made, Config(LIMITS, RuntimeFigures(estimator="zero-crossing")), bound=True)
    sources.append(Path(__file__).parents[1] / "oracle" / "hardware_fuzz.c")
    options = [*options_of(made, "fuzz"), "-g", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all"]
    compile_with([compiler("clang", INSTALL["clang"]), *options, *map(str, sources), "-o", str(program)])
    corpus.mkdir()
    for index, text in enumerate(CORPUS):
        (corpus / f"{index:04d}").write_bytes(bytes.fromhex(text))
    seconds = os.environ.get("AVC_FUZZ_SECONDS")
    run(str(program), f"-max_total_time={seconds}" if seconds else "-runs=0", str(corpus))
