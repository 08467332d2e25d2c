"""The current model of the selection: its fit, the trial of every term, and replacements of spurious terms."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from avc_casadi.identification.fit import Fit, Window, best_observer, fit
from avc_casadi.identification.identifiability import refusals, vague_terms
from avc_casadi.identification.lag_vs_resonance import (
    A_LAG_FROM,
    NOT_TOLD_APART,
    behind_a_structure,
    damped_as_it_is,
    in_place_of_a_resonance,
    of_the_other_order,
)
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.terms import LOOP_DAMPING, LOOP_RATIO
from avc_casadi.identification.uncertainty import Trial, compared, sensitivity, spread_of


@dataclass
class Selection:
    """A model with the history of its selection.

    Attributes:
        fit: the fitted model.
        trials: of every term, the last of each.
        rivals: the fit of each term that was tried in full and rejected.
        rival_resonance: beyond the excited frequencies, as good as the amplifier was when that was accepted.
        rough_m: error of the best coarse fit of each term that was tried last.
    """

    fit: Fit
    trials: dict[str, Trial] = field(default_factory=dict)
    rivals: dict[str, Fit] = field(default_factory=dict)
    rival_resonance: Fit | None = None
    rough_m: dict[str, float] = field(default_factory=dict)

    @property
    def inseparable(self) -> set[str]:
        """Terms that the evidence supports but that are confounded with the rest of the model."""
        return {term for term, trial in self.trials.items() if trial.inseparable}

    def not_told(self, lagging: Fit, ringing: Fit) -> None:
        """Record that an amplifier and a resonance are confounded."""
        for term, found in (("amplifier", lagging), ("resonance", ringing)):
            self.rivals[term] = found
            self.trials[term] = replace(self.trials[term], taken=False, why=str(NOT_TOLD_APART[term]), inseparable=True)


def settled(predictor: Predictor, found: Fit, window: Window) -> Fit:
    """Return the final fit under the best observer."""
    observer = best_observer(predictor, found, window)
    return fit(predictor, found.structure, found.values, observer, window, tolerance=1e-10)


def without(predictor: Predictor, chosen: Selection, term: str, why: str, window: Window) -> None:
    """Remove a term from the model and fit again."""
    found = chosen.fit
    chosen.rivals[term] = found
    chosen.trials[term] = replace(chosen.trials[term], taken=False, why=why)
    simpler = fit(predictor, found.structure.less(term), found.values, found.observer, window, tolerance=1e-6)
    chosen.fit = settled(predictor, simpler, window)


def no_false_resonance(predictor: Predictor, chosen: Selection, window: Window) -> bool:
    """Replace a resonance that is not structural by a current loop that fits as well; return whether it does.

    Args:
        predictor: of the records.
        chosen: the model, with a resonance.
        window: of the fits.
    """
    ringing = chosen.fit
    spread = spread_of(ringing, ())
    vague = vague_terms(
        ringing, spread.half_width.tolist(), refusals(ringing, spread.half_width, sensitivity(ringing)[0])
    )
    loop = in_place_of_a_resonance(predictor, ringing, window, doubted="resonance" in vague)
    if loop is None:
        return False
    chosen.fit = settled(predictor, loop, window)
    found = compared(ringing, loop, "amplifier")
    why = "a current loop does as well"
    chosen.trials["resonance"] = replace(chosen.trials["resonance"], taken=False, why=why)
    for term in ("amplifier", LOOP_DAMPING):
        chosen.trials[term] = replace(found, term=term, taken=True, why="in place of a resonance that is none")
    return True


def no_false_loop(predictor: Predictor, chosen: Selection, window: Window) -> bool:
    """Replace a current loop by a resonance before an encoder at the handle, where that fits better."""
    loop = chosen.fit
    ringing = None if LOOP_DAMPING not in loop.structure.terms else behind_a_structure(predictor, loop, window)
    if ringing is None:
        return False
    chosen.fit = settled(predictor, ringing, window)
    chosen.trials["resonance"] = compared(loop, ringing, "resonance")
    for term in ("amplifier", LOOP_DAMPING):
        chosen.trials[term] = replace(chosen.trials[term], taken=False, why="a resonance does better in its place")
    return True


def told_by_its_kind(predictor: Predictor, chosen: Selection, window: Window) -> None:
    """Separate amplifiers of the first and second order, and of other damping ratios.

    Args:
        predictor: of the records.
        chosen: the model, with an amplifier.
        window: of the fits.
    """
    if LOOP_DAMPING in chosen.fit.structure.terms:
        return
    other = of_the_other_order(predictor, chosen.fit, window)
    if compared(chosen.fit, other, "amplifier").taken:
        chosen.fit = settled(predictor, other, window)
    else:
        chosen.rivals["amplifier"] = other
    chosen.trials[LOOP_DAMPING], free = damped_as_it_is(predictor, chosen.fit, window)
    if chosen.trials[LOOP_DAMPING].taken:
        chosen.fit = settled(predictor, free, window)
    elif chosen.fit.structure.amplifier_order == 2 or free.values[LOOP_RATIO] < A_LAG_FROM:
        chosen.rivals[LOOP_DAMPING] = free
