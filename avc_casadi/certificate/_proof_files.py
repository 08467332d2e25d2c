"""Proofs as files: each holds what it speaks of, so that other code can check it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi.support import plain

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import Certificate
    from avc_casadi.problem import Problem

SCHEMA = "avc-proof-file/1"


def proof_files(problem: Problem, certificate: Certificate) -> dict[str, dict[str, Any]]:
    """Return the files of the levels that were asked to be proved, by name: JSON values.

    Args:
        problem: what was judged against; its device, wall and hands stand in each file.
        certificate: with proofs, as `certify` with ``prove`` gives it.
    """
    spoken_of = {name: getattr(problem, name).model_dump(mode="json") for name in ("device", "environment", "hands")}
    return {
        f"{level}.json": plain(
            {
                "schema": SCHEMA,
                "level": level,
                "outcome": found.outcome,
                "claim": found.claim,
                "problem": spoken_of,
                "proofs": found.detail["proofs"],
            }
        )
        for level, found in certificate.levels.items()
        if "proofs" in found.detail
    }
