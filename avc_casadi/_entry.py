"""Start and end of the process `avc`: Ctrl-C and SIGTERM end it with 130 and 143, with no traceback, no half answer."""

import os
import signal
import sys

from avc_casadi._util.interrupt import exit_code, handle_interrupts, interrupted

_INTERRUPTED = '{\n "errors": [{"file": "", "line": null, "key": "", "message": "interrupted"}]\n}\n'


def run() -> int:
    """Run `avc` with the arguments of the process and return its exit code."""
    handle_interrupts()
    # Matrices are small here: threads of a product or a factorisation would mostly wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from importlib.util import find_spec  # noqa: PLC0415 - Ctrl-C while they load is answered too
        from pathlib import Path  # noqa: PLC0415

        if find_spec("avc_hardware") is None:  # a plain checkout
            sys.path.append(str(Path(__file__).resolve().parent.parent / "hardware"))
        from avc_casadi.cli import main  # noqa: PLC0415
    except KeyboardInterrupt:
        (sys.stdout if "--json" in sys.argv else sys.stderr).write(
            _INTERRUPTED if "--json" in sys.argv else "avc: interrupted\n"
        )
        code = exit_code()
    else:
        code = main() if sys.stdout else 2  # closed: an answer has no reader
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if interrupted() and code == exit_code():
        # After Ctrl-C in code generated from text, as of a dataclass, Python would end by the signal.
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.flush()
        os._exit(code)
    return code
