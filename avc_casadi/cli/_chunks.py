"""Studies in chunks: the common arguments of their commands, and their evaluation."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import avc_casadi as avc
from avc_casadi.cli._arguments import positive_int
from avc_casadi.cli._console import Answer, Console

if TYPE_CHECKING:
    from avc_casadi._util.checkpoint import Chunked, Part

R = TypeVar("R")


def add_chunks(parser: argparse.ArgumentParser) -> None:
    """Declare --workers, --resume, --chunk and --merge."""
    group = parser.add_argument_group(
        "many workers",
        "the answer is the same, whoever works it out; shares, going on and clusters: tests/benchmarks/README.md",
    )
    group.add_argument("--workers", type=positive_int, metavar="N", help="processes (default: one for each processor)")
    group.add_argument("--resume", metavar="DIR", help="keep what is done in this folder, and go on where it stopped")
    group.add_argument(
        "--chunk",
        type=_part,
        metavar="I/N",
        help="only the I-th of N shares of the work, as one of N jobs that share the folder of --resume",
    )
    group.add_argument(
        "--merge", action="store_true", help="answer from what stands in the folder of --resume; work nothing out"
    )


def done(study: Chunked[Any, R], args: argparse.Namespace, console: Console) -> R | Answer:
    """Return the result of a study; or the answer where only a part of it was requested.

    Raises:
        InputError: incompatible options, a folder of another study, or missing chunks.
    """
    if args.resume is None and (args.chunk is not None or args.merge):
        key = "--merge" if args.merge else "--chunk"
        raise avc.InputError.of("needs the folder that the jobs share; add --resume DIR", key=key)
    if args.merge and args.chunk is not None:
        raise avc.InputError.of("goes without --merge: first every job its share, then the merging", key="--chunk")
    folder = None if args.resume is None else Path(args.resume)
    if args.merge and folder is not None:
        return study.merged(folder)
    from avc_casadi._util.parallel import processors

    workers = processors() if args.workers is None else args.workers
    many, count = sum(study.sizes) or len(study.tasks), len(study.tasks)
    share = "" if args.chunk is None else f", share {args.chunk}"
    with console.step(f"{many} {study.things} in {count} chunks{share}, {min(workers, count)} at a time"):
        if args.chunk is None or folder is None:
            return study.run(workers=workers, folder=folder, progress=console)
        there = study.run_part(args.chunk, folder, workers=workers, progress=console)
    document = {"schema": "avc-chunks/1", "folder": str(folder), "share": str(args.chunk), "done": there, "of": count}
    what = "the answer: the same with --merge in place of --chunk" if there == count else "the other shares are missing"
    idle = f" (nothing fell to it: chunks are dealt out to the first {count} jobs)" if args.chunk.number > count else ""
    return Answer(document, f"share {args.chunk}: done{idle}. {folder} holds {there} of {count} chunks; {what}")


def _part(text: str) -> Part:
    from avc_casadi._util.checkpoint import Part

    try:
        return Part.of_text(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no share; allowed: 1/N to N/N, for example 7/100") from None
