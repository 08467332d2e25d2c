"""A terminal that a foreign solver cannot write to."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def silent_terminal(*, active: bool) -> Iterator[None]:
    """Send what is written to standard output and error to nowhere, whether by Python or by a library.

    Args:
        active: whether to do so at all.
    """
    if not active:
        yield
        return
    sys.stdout.flush()
    sys.stderr.flush()
    with contextlib.ExitStack() as stack:
        nowhere = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123 - not a real path
        for number in (1, 2):
            kept = os.dup(number)
            stack.callback(_restore, kept, number)
            os.dup2(nowhere.fileno(), number)
        stack.enter_context(contextlib.redirect_stdout(nowhere))
        stack.enter_context(contextlib.redirect_stderr(nowhere))
        yield


def _restore(kept: int, number: int) -> None:
    # A library's own buffer would otherwise be written to the terminal later.
    with contextlib.suppress(OSError, TypeError, AttributeError):
        ctypes.CDLL(None).fflush(None)
    os.dup2(kept, number)
    os.close(kept)
