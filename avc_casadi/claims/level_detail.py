"""What a level of a certificate finds beyond its margin: radii and worst hands of L5, proofs of L7."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import Document


@dataclass(frozen=True, eq=False, kw_only=True)
class HandsDetail(Document):
    """What L5 finds beyond its margin; what only gains without an observer have is None behind one.

    Attributes:
        spectral_radius: the largest of all rows with hands; None without any row.
        released_spectral_radius: the largest of all rows released; None without any row.
        released_passed: whether all rows are stable released.
        hands: hands that were tried before the search.
        hands_seed: seed of those that were drawn.
        row_spectral_radius: the largest of each row, shape (n,).
        row_worst_hand: worst hand of each row, each value of shape (n,).
        worst_hand: worst hand of the worst row; None without any row.
        worst_device: device of that loop, by the values that the linear loop has.
        worst_share: share of the innovation or the force of the worst loop behind an observer.
    """

    JSON_KEYS: ClassVar = (
        "spectral_radius",
        "row_spectral_radius",
        "released_spectral_radius",
        ("released_pass", "released_passed"),
        "row_worst_hand",
        "hands",
        "hands_seed",
        "worst_hand",
        "worst_device",
        "worst_share",
    )
    JSON_LEFT_OUT: ClassVar = frozenset(
        {"row_spectral_radius", "row_worst_hand", "hands_seed", "worst_hand", "worst_device", "worst_share"}
    )

    spectral_radius: float | None
    released_spectral_radius: float | None
    released_passed: bool
    hands: int
    hands_seed: int | None = None
    row_spectral_radius: FloatArray | None = None
    row_worst_hand: Mapping[str, FloatArray] | None = None
    worst_hand: dict[str, float] | None = None
    worst_device: dict[str, float] | None = None
    worst_share: float | None = None


@dataclass(frozen=True)
class ProofDetail(Document):
    """The proofs and witnesses of L7 by row, JSON values that `claims.prove.rest.Rest.from_document` reads."""

    JSON_KEYS: ClassVar = ("proofs",)

    proofs: tuple[Mapping[str, Any], ...]
