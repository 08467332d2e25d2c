"""What gains are safe for, and which of two are safer: stability comes before realism."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from avc_casadi.certificate import Certificate, Deployable


@dataclass(frozen=True)
class Safety:
    """What a gain table is safe for, as its certificate says.

    Attributes:
        levels: whether every row meets each level; None where the level is refused on this device.
        hands: L5, linearly stable with every hand, at the rows and where the device interpolates between them.
        let_go: the same with the device let go.
        passive: L3, passive in the model of the loop that runs.
        rows_failed: by level, how many rows do not meet it.
        rows: how many rows there are.
    """

    levels: dict[str, bool | None]
    hands: bool
    let_go: bool
    passive: bool
    rows_failed: dict[str, int]
    rows: int

    @classmethod
    def of(cls, certificate: Certificate, verdict: Deployable | None = None) -> Safety:
        """Read a certificate and the verdict on the coupling; what could not be judged is not safe."""
        levels = certificate.levels
        claims = {} if verdict is None else {claim.name: claim.passed for claim in verdict.claims}
        return cls(
            levels={level: None if found.refused else found.passed for level, found in levels.items()},
            hands=levels["L5"].passed and claims.get("hands", False),
            let_go=bool(levels["L5"].detail.get("released_pass", False)) and claims.get("let-go", False),
            passive=levels["L3"].passed,
            rows_failed={level: found.rows_failed for level, found in levels.items()},
            rows=len(certificate.frequency_hz),
        )

    @property
    def rank(self) -> tuple[bool, bool, bool]:
        """Order of safety: every hand, then let go, then passive; larger is safer."""
        return self.hands, self.let_go, self.passive

    @property
    def deployable(self) -> bool:
        """Whether the frozen gains may go into a device: stable with every hand and let go."""
        return self.hands and self.let_go

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"levels": self.levels, "let_go": self.let_go, "deployable": self.deployable}


def safer(mine: Safety, other: Safety, name: str) -> str:
    """Say which of two is safer: "mine", the name of the other, or "equal"."""
    if mine.rank == other.rank:
        return "equal"
    return "mine" if mine.rank > other.rank else name


def safety_reason(mine: Safety, other: Safety, name: str) -> str:
    """Say in one sentence what two tables are safe for and which not to deploy.

    Args:
        mine: of the hand-tuned pair.
        other: of the method that it is judged beside.
        name: that method's name.
    """
    if mine.rank == other.rank:
        return _equal(mine, other, name)
    ahead = mine.rank > other.rank
    better, worse = (mine, other) if ahead else (other, mine)
    names = ("mine", name) if ahead else (name, "mine")
    what, why = _first_difference(better, worse)
    advice = "" if worse.deployable else f": do not deploy {names[1]}"
    also = "" if worse.deployable or better.deployable else f", nor {names[0]} ({_lacks(better)})"
    return f"{names[0]} is {what}, {names[1]} is not ({why}){advice}{also}"


def _equal(mine: Safety, other: Safety, name: str) -> str:
    if not mine.deployable:
        return f"deploy neither mine ({_lacks(mine)}) nor {name} ({_lacks(other)})"
    passive = "and passive in the sampled-data model" if mine.passive else "neither is passive (L3)"
    return f"mine and {name} are both stable with every hand and let go, {passive}"


def _first_difference(better: Safety, worse: Safety) -> tuple[str, str]:
    """What the one is and the other is not, and why the other is not."""
    if better.hands != worse.hands:
        return "stable with every hand", _failing(worse, "L5")
    if better.let_go != worse.let_go:
        return "stable when let go", "the device let go is not stable"
    return "passive in the sampled-data model", _failing(worse, "L3")


def _lacks(safety: Safety) -> str:
    return "the device let go is not stable" if safety.hands else _failing(safety, "L5")


def _failing(safety: Safety, level: str) -> str:
    return f"{level} fails at {safety.rows_failed[level]} of {safety.rows} rows"
