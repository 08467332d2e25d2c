"""English of results: the words that rows say of enumerations and of named levels, claims and outcomes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterable

    from avc_casadi.claims.deployable import ClaimName
    from avc_casadi.diagnose.remedies import RemedyKey
    from avc_casadi.model.ends import Exchange
    from avc_casadi.recommendation.assumptions import Unused
    from avc_casadi.simulation.scene import Claim

# Certificates of couplings to a wall.

CLAIMS: dict[ClaimName, str] = {
    "hands": "All hands",
    "let-go": "Released",
    "dead-zone": "Dead zone",
    "clip": "Clipped force",
    "detent": "Detents",
    "detent-hands": "Detents",
    "detent-let-go": "Detents",
    "disk-margin": "Disk margin",
    "renders": "Rendering",
}
"""Labels of the claims of a verdict, in their order; those on detents share one."""

LEVEL_WORDS = {
    "pass": "met",
    "fail": "not met",
    "refused": "not judged",
    "proved": "proved",
    "refuted": "refuted",
    "open": "open",
}
"""What is said of a level by its `word`."""

PASSIVE = {
    "L0": "at each row's own frequency",
    "L1": "in a band about each row's frequency",
    "L2": "at all frequencies with paper's hold",
    "L3": "at all frequencies with sampled-data hold",
    "L4": "with any passive wall (Llewellyn)",
}
"""The levels of passivity, which deployment does not need, as the row *Passivity* names them."""

# Margins and time responses.

Who = Literal["released", "worst_hand"]
"""Loops of which an answer gives margins and time responses."""

LOOPS: dict[Who, str] = {"released": "released", "worst_hand": "worst hand"}
"""What these loops are called."""

# Simulations.

EXCHANGES: dict[Exchange, str] = {
    "on-time": "position and velocity that {step} begins with",
    "late": "position and velocity that the step before {step} began with",
    "ahead": "position and velocity read after {step}",
    "held-force": "the force on the tool in {step}, which it holds until the next one",
}
"""What the device is handed; {step} is the call of the engine's step."""

# Simulated scenes.

ENDINGS: dict[Claim, str] = {
    "asymptotic": "settles",
    "held-by-friction": "settles only by dry friction",
    "unstable": "does not settle",
}
"""How a run ends."""

NAMED_BY_GAINS = frozenset({"contact damper"})
"""Methods whose name is what the row of their gains begins with."""

# Diagnosis.

REMEDIES: dict[RemedyKey, str] = {
    "force_sign": "force sign",
    "damping_ns_per_m": "damping",
    "stiffness_n_per_m": "stiffness",
    "sample_time_s": "sample time",
    "encoder_resolution_m": "encoder resolution",
    "delay_samples": "delay",
    "velocity_filter_hz": "velocity filter",
    "notch_hz": "notch",
    "switched_n": "switched",
    "switch_width": "switch width",
}
"""What a remedy changes."""

# Recommendations.


def used_by_solve(declared: Iterable[Unused]) -> list[str]:
    """Return one sentence on the tables by which other methods are asked; none where there are none."""
    tables = [unused.key for unused in declared if unused.asked_of_solve]
    return [f"{', '.join(tables)}: used by avc solve, not by avc recommend"] if tables else []
