"""Start and end of the process `avc`: Ctrl-C leaves neither a traceback nor a partial answer."""

from __future__ import annotations

import os
import signal
import sys

from avc_casadi._interrupted import DOCUMENT, EXIT_CODE, TEXT

TYPE_CHECKING = False  # typing takes long to load, and Ctrl-C meanwhile is a traceback
if TYPE_CHECKING:
    from typing import Any, NoReturn


def run() -> int:
    """Run `avc` with the arguments of the process and return its exit code; Ctrl-C is ignored from then on.

    An interrupted process ends here, with 130.
    """
    before = signal.getsignal(signal.SIGINT)
    handled = before is signal.default_int_handler  # not where the caller of the process had it ignored
    if handled:
        signal.signal(signal.SIGINT, _interrupted)
    # Matrices are small here: threads of a product or a factorisation would mostly wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # An interrupt of these imports is handled too.
    from contextlib import suppress  # noqa: PLC0415
    from importlib.util import find_spec  # noqa: PLC0415
    from pathlib import Path  # noqa: PLC0415

    if find_spec("avc_hardware") is None:  # a plain checkout
        sys.path.append(str(Path(__file__).resolve().parent.parent / "hardware"))
    from avc_casadi.cli import main  # noqa: PLC0415

    try:
        if handled:
            signal.signal(signal.SIGINT, before)
        code = main()
    except KeyboardInterrupt:
        code = EXIT_CODE
    if handled:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if handled and code == EXIT_CODE:
        # After Ctrl-C in code generated from text, as of a dataclass, Python would still end by the signal.
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
        _leave()
    return code


def _interrupted(*_: Any) -> NoReturn:
    descriptor, said = (1, DOCUMENT) if "--json" in sys.argv else (2, TEXT)
    try:  # noqa: SIM105 - contextlib may not be loaded yet
        os.write(descriptor, said.encode("ascii"))
    except OSError:
        pass  # closed
    _leave()


def _leave() -> NoReturn:
    os._exit(EXIT_CODE)
