"""Level L9: ripple of encoder, noise and friction bounded in contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import Claim, Judged

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult


class Ripple(Claim):
    """A bound of the ripple by encoder, noise and friction in sustained contact."""

    name: ClassVar[str] = "L9"
    title: ClassVar[str] = "ripple of encoder, noise and friction bounded in contact"
    rank: ClassVar[float] = 90
    claims: ClassVar[str] = (
        "how far encoder, bounded noise and friction move device and force at most, in every hand that keeps in contact"
        " (with `--prove`)"
    )
    leaves: ClassVar[str] = "that they do; what happens at the surface"
    on_demand: ClassVar[bool] = True
    provable: ClassVar[str] = (
        "ripple of encoder, noise and friction in kept contact: constant gains, a device whose linear values are"
        " known\nexactly, whole delay"
    )

    def judge(self, judged: Judged) -> LevelResult:
        """Bound the ripple."""
        from avc_casadi.claims.proof_levels import ripple_level  # noqa: PLC0415 - loads the proofs

        assert judged.coupling is not None  # noqa: S101 - a level on demand is judged of what runs
        with judged.progress.step("bound of the ripple"):
            return ripple_level(judged.coupling, judged.rests, judged.progress)
