"""The gate before a device: a coupling with its certificate, and the refusal of one that is not deployable."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi._errors import NotDeployableError
from avc_casadi.certificate._certify import certify
from avc_casadi.certificate._deployable import Deployable, deployable
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


def certified(coupling: Coupling, progress: Progress = SILENT, *, prove: bool = False) -> Coupling:
    """Return the coupling with its certificate: the levels of its rows, and the verdict on the table that runs.

    The certificate is the `certify` document; ``deployable`` in it holds the verdict.

    Args:
        coupling: the coupling.
        progress: told of the rows that are judged.
        prove: ask for proofs too, as `certify` does.
    """
    found = certify(coupling.problem, coupling, prove=prove, progress=progress)
    return coupling.with_certificate(found.document() | {"deployable": deployable(coupling, progress).document()})


def require_deployable(coupling: Coupling, *, unsafe: bool = False) -> Deployable:
    """Judge a coupling before it goes into a device or into C; its own certificate is not relied on.

    Args:
        coupling: what is to be deployed.
        unsafe: let it pass whatever the verdict; the caller writes down that it did.

    Raises:
        NotDeployableError: which claim fails, and what to do.
    """
    verdict = deployable(coupling)
    if not verdict.passed and not unsafe:
        raise NotDeployableError(
            f"{coupling.problem.name} by {coupling.method}: {verdict.sentence}. {verdict.advice[0].upper()}"
            f"{verdict.advice[1:]}; --unsafe (in Python unsafe=True) overrides."
        )
    return verdict
