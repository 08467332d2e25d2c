"""Arguments that several verbs share."""

from __future__ import annotations

import argparse
import math


def add_port(parser: argparse.ArgumentParser) -> None:
    """Declare --port."""
    parser.add_argument(
        "--port",
        required=True,
        help="serial port (avc ports), or `emulator`: the real firmware image on an emulated board",
    )


def positive(text: str) -> float:
    """Read a finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is no number above 0; allowed: finite numbers above 0")
    return value


def positive_int(text: str) -> int:
    """Read a whole number above 0."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number above 0")
    return value
