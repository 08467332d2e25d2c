"""Shared parts of the commands that deploy: the device of --port, the push, and its report."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._subject import unsafe_note

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


def push_or_say(coupling: Coupling | None, *, unsafe: bool) -> dict[str, Any]:
    """Push to the emulated device and try it there; a failed push does not discard the other results.

    Returns:
        The `push` document with ``unsafe`` (empty where it is deployable) and ``in_the_loop``; or ``{"skipped": why}``,
        or ``{"refused": why}``, with ``"deployable": False`` where that is the reason.
        ``{"skipped": why}``, or ``{"refused": why}``, with ``"deployable": False`` where that is why.
    """
    from avc_casadi.claims.deployable import require_deployable
    from avc_hardware import push

    if coupling is None:
        return {"skipped": "no coupling is deployable"}
    try:
        note = unsafe_note(require_deployable(coupling, unsafe=unsafe))
        pushed = push(coupling, "emulator", unsafe=unsafe).document()
        return pushed | {"unsafe": note, "in_the_loop": tried_or_say(coupling)}
    except (avc.MissingExtraError, avc.UnsupportedError) as error:
        return {"skipped": str(error)}
    except avc.NotDeployableError as error:
        return {"refused": str(error), "deployable": False}
    except avc.LinkError as error:
        return {"refused": str(error)}


def tried_or_say(coupling: Coupling) -> dict[str, Any]:
    """Try a pushed coupling with a hand on the emulated device; an unsupported trial does not discard the push.

    Returns:
        The figures of the trial; or ``{"skipped": why}``.
    """
    from avc_casadi._util.json_values import plain
    from avc_hardware import tried_in_the_loop

    try:
        found: dict[str, Any] = plain(tried_in_the_loop(coupling).document())
    except avc.UnsupportedError as error:
        return {"skipped": str(error)}
    return found
