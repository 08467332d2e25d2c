"""Command line of the scripts beside this file: --help says what one does and which files it overwrites."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from avc_casadi._util.progress import Progress


class _Printed(Progress):
    def step(self, name: str) -> AbstractContextManager[None]:
        print(name, flush=True)
        return nullcontext()

    def advance(self, done: int, total: int, part: str = "") -> None:
        print(f"{done} of {total}: {part}", flush=True)


PRINTED = _Printed()


def script_arguments(
    about: str | None, *, people: int | None = None, out: Path | None = None, results: Path | None = None
) -> argparse.Namespace:
    """Parse the command line of a script; --help ends it before it does anything."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    if people is not None:
        parser.add_argument("people", metavar="PEOPLE", nargs="?", type=int, default=people, help=f"default {people}")
    if out is not None:
        parser.add_argument("out", metavar="OUT", nargs="?", type=Path, default=out, help=f"default {out.name}")
    if results is not None:
        told = f"overwrites {results.name} too; without it the results are printed only"
        parser.add_argument("--write", action="store_const", const=results, help=told)
    return parser.parse_args()
