"""Where the process `avc` begins and ends: Ctrl-C leaves neither a traceback nor half an answer at either end."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from typing import Any, NoReturn

_INTERRUPTED = 130


def run() -> int:
    """Run `avc` with the arguments of the process and return its exit code; Ctrl-C is passed over from then on.

    An interrupted process ends here, with 130.
    """
    before = signal.getsignal(signal.SIGINT)
    handled = before is signal.default_int_handler  # not where the caller of the process had it ignored
    if handled:
        signal.signal(signal.SIGINT, _leave)
    from avc_casadi.cli import main  # noqa: PLC0415 - an interrupt of this import is handled too

    try:
        if handled:
            signal.signal(signal.SIGINT, before)
        code = main()
    except KeyboardInterrupt:
        code = _INTERRUPTED
    if handled:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if handled and code == _INTERRUPTED:
        # Where Ctrl-C fell into code made from text, as of a dataclass, Python would end by the signal in spite of us.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        _leave()
    return code


def _leave(*_: Any) -> NoReturn:
    os._exit(_INTERRUPTED)
