"""Stepwise model selection: from the simplest device upwards, each term by its evidence in the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import FORCE
from avc_casadi.identification.assumed_mass_ratio import shared
from avc_casadi.identification.fit import (
    FIRST_RATE_PER_S,
    Fit,
    Window,
    best_observer,
    closely,
    fit,
    judged,
    richer,
    ringing_behind_a_lag,
    rms_m_of,
    roughly,
    slowest_observer,
)
from avc_casadi.identification.frequency import Response
from avc_casadi.identification.initial_guess import starts_of
from avc_casadi.identification.lag_vs_resonance import ALIKE, damped_as_it_is, rival_resonance
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.selection import Selection, no_false_loop, no_false_resonance, settled, told_by_its_kind
from avc_casadi.identification.terms import HIGHEST_SEEN, LOOP_DAMPING, PLAY, SIZE_OF, TERMS, Structure
from avc_casadi.identification.uncertainty import Trial, compared, sensitivity

# Terms of one group have similar effects: the better one is accepted first.
_ORDER = (
    ("coulomb",),
    ("resonance", "amplifier", "stiffness", "play"),
    ("asymmetry",),
    ("stribeck", "dead-zone", "drag"),
    ("drift",),
)
# A term is fitted only where a Gauss-Newton step from its absence improves the error by so many standard errors.
_HOPEFUL = 1.5
# The limit is wider for an amplifier and its delay: friction that reverses inside a sample helps to separate them.
_COLLINEAR, _COLLINEAR_LAG = 100.0, 300.0
# Terms that a poor model masks, and those that may change everything.
_SMALL = ("asymmetry", "stribeck", "dead-zone", "drag", "drift")
_STRONG = {"coulomb", "resonance", "amplifier", "stiffness", "play"}
# A final fit starts only from a coarse fit within this factor of the best one; nor beyond this factor of another
# accepted term, which then comes first.
_NEAR_THE_BEST, _NEAR_ANOTHER = 1.05, 1.5
# Relative size below which a term is absent.
_VANISHED = 1e-5
# Bandwidth times sample time up to which an amplifier is separable from a delay; less beside a resonance, where the
# discretisation error of dry friction looks like a lag.
_FASTEST_LAG, _BESIDE_RESONANCE = 1.5, 0.6
# A resonance further beyond the excited frequencies, as a multiple of the highest, has no effect among them.
_FURTHEST = 10.0
_ALIKE = "cannot be distinguished from the rest of the model"
_PAIR = ("resonance", "amplifier")
HIDDEN = "is smaller than what encoder and noise hide"
"""Reason for backlash."""
_UNSEEN = {"play": "is not identified: the log hardly ever turns"}
# Terms with an initial guess of their own: it is fitted, whatever a step from 0 shows.
_FROM_AFAR = {"stiffness": "stiffness_n_per_m", "play": PLAY}


def select(
    predictor: Predictor,
    guess: Mapping[str, float],
    structure: Structure,
    response: Response,
    window: Window,
    sides: Sequence[str],
    progress: Progress = SILENT,
) -> Selection:
    """Select the terms that the log supports.

    Args:
        predictor: of the records.
        guess: initial guess.
        structure: the simplest one, with the known values.
        response: of the log.
        window: of the fits.
        sides: where the encoder may sit.
        progress: of the search.
    """
    _prepare(predictor, structure, _ORDER[1])
    observer = Observer(max(FIRST_RATE_PER_S, slowest_observer(predictor)))
    simplest = fit(predictor, structure, guess, observer, window, tolerance=1e-5)
    simplest = fit(
        predictor, structure, simplest.values, best_observer(predictor, simplest, window), window, tolerance=1e-6
    )
    chosen = Selection(simplest)
    late: list[str] = []
    for index, terms in enumerate(_ORDER):
        progress.advance(index, len(_ORDER), ", ".join(str(TERMS[term].words) for term in terms))
        taken = _try(predictor, chosen, terms, guess, response, window, sides)
        following = [one for later in _ORDER[index + 1 :] for one in later]
        _prepare(predictor, chosen.fit.structure, [*following, *(terms if taken and index else ())])
        if taken:
            late += [one for earlier in _ORDER[: index + 1] for one in earlier if not chosen.trials[one].taken]
    if _friction_beside_drag(predictor, chosen, window):
        late += [term for term in _SMALL if not chosen.trials[term].taken]
    if late:
        # The apparent gain of another term may only be this model's distance from its own optimum.
        chosen.fit = settled(predictor, chosen.fit, window)
    for term in dict.fromkeys(late):
        if term not in chosen.fit.structure.terms:
            _try(predictor, chosen, (term,), guess, response, window, sides)
    _together(predictor, chosen, response, window)
    chosen.fit = settled(predictor, chosen.fit, window)
    _no_rival_resonance(predictor, chosen, response, window, sides)
    other = "resonance" in chosen.fit.structure.terms and no_false_resonance(predictor, chosen, window)
    if "amplifier" in chosen.fit.structure.terms:
        told_by_its_kind(predictor, chosen, window)
    other = ("handle" in sides and no_false_loop(predictor, chosen, window)) or other
    for term in _SMALL if other else ():
        if term not in chosen.fit.structure.terms:
            _try(predictor, chosen, (term,), guess, response, window, sides)
    _prune(predictor, chosen, window)
    return chosen


def _prepare(predictor: Predictor, structure: Structure, terms: Sequence[str]) -> None:
    """Start compiling the models that will be tried."""
    predictor.prepare([structure, *(richer(structure, one) for one in terms if one not in structure.terms)])


def _no_rival_resonance(
    predictor: Predictor, chosen: Selection, response: Response, window: Window, sides: Sequence[str]
) -> None:
    """Remove an amplifier confounded with a resonance beyond the excited frequencies, rare beside friction."""
    lagging = chosen.fit
    if chosen.rival_resonance is None or "amplifier" not in lagging.structure.terms:
        return
    rival = rival_resonance(predictor, lagging, chosen.rival_resonance, response, window, sides)
    if rival is None:
        return
    chosen.not_told(lagging, rival)
    without = fit(
        predictor, lagging.structure.less("amplifier"), lagging.values, lagging.observer, window, tolerance=1e-6
    )
    chosen.fit = settled(predictor, without, window)


def _friction_beside_drag(predictor: Predictor, chosen: Selection, window: Window) -> bool:
    """Try dry friction and drag at once: alone each leans damping the other way, and neither bears itself out."""
    simple = chosen.fit
    if {"coulomb", "drag"} & set(simple.structure.terms) or chosen.trials["coulomb"].inseparable:
        return False
    both = richer(simple.structure, "coulomb", "drag")
    dry = chosen.rivals["coulomb"].values if "coulomb" in chosen.rivals else {}
    start = {**simple.values, "coulomb_friction_n": dry.get("coulomb_friction_n", 0.0)}
    rough = roughly(predictor, both, start, min(simple.observer.rate_per_s, FIRST_RATE_PER_S))
    found = closely(predictor, rough, window)
    trials = {term: compared(simple, found, term) for term in ("coulomb", "drag")}
    if not trials["drag"].worth:
        return False
    # Where it is not sure, or not told from damping, it still bounds what there may be.
    chosen.rivals |= dict.fromkeys(trials, found)
    if trials["drag"].taken and sensitivity(found)[1] > _COLLINEAR:
        trials = {term: replace(one, taken=False, why=_ALIKE, inseparable=True) for term, one in trials.items()}
    chosen.trials |= trials
    if trials["drag"].taken:
        chosen.fit = found
    return trials["drag"].taken


def _together(predictor: Predictor, chosen: Selection, response: Response, window: Window) -> None:
    """Try resonance and amplifier together, where neither was significant and the resonance alone was promising."""
    if not all(term in chosen.rivals and not chosen.trials[term].taken for term in _PAIR):
        return
    if not chosen.trials["resonance"].worth:
        return
    ringing, lagging = (chosen.rivals[term] for term in _PAIR)
    found = ringing_behind_a_lag(predictor, chosen.fit, ringing, lagging, window)
    trials = {term: compared(chosen.fit, found, term) for term in _PAIR}
    period = predictor.sample_time_s
    if all(one.taken and not _beyond(found, term, response, period) for term, one in trials.items()):
        chosen.fit = found
        chosen.trials |= trials


def _prune(predictor: Predictor, chosen: Selection, window: Window) -> None:
    """Remove terms that the full model no longer supports: those whose size is 0 within its uncertainty."""
    for term in (
        "stribeck",
        "dead-zone",
        "drag",
        "asymmetry",
        "drift",
        "stiffness",
        LOOP_DAMPING,
        "amplifier",
        "resonance",
        "play",
        "coulomb",
    ):
        found = chosen.fit
        if term not in found.structure.terms:
            continue
        dependent = [one for one in found.structure.terms if term in TERMS[one].needs]
        if dependent:
            continue
        without = fit(
            predictor, found.structure.less(term), found.values, found.observer, window, steps=15, tolerance=1e-6
        )
        trial = compared(without, found, term)
        gone = term in SIZE_OF and found.values[SIZE_OF[term]] < _VANISHED * found.structure.units[SIZE_OF[term]]
        if trial.taken and not gone:
            chosen.trials[term] = trial
            continue
        chosen.rivals[term] = found
        chosen.trials[term] = replace(trial, taken=False, why="is no longer borne out beside the rest of the model")
        chosen.fit = settled(predictor, without, window)


def _try(
    predictor: Predictor,
    chosen: Selection,
    terms: Sequence[str],
    guess: Mapping[str, float],
    response: Response,
    window: Window,
    sides: Sequence[str],
) -> bool:
    """Try terms; accept the one with the smallest error among those that the evidence supports."""
    borne_out: dict[str, Fit] = {}
    terms = [term for term in terms if term not in chosen.fit.structure.terms]
    for term in terms:
        before = min((chosen.rough_m[one] for one in borne_out), default=np.inf)
        found = _tried(predictor, chosen, term, guess, response, window, sides, before)
        borne_out |= {} if found is None else {term: found}
    if "amplifier" in borne_out:
        # A resonance beyond the excited frequencies may have been tried with it, or long before.
        seen = chosen.rivals.get("resonance")
        lagging = borne_out["amplifier"]
        beside = seen is not None and "amplifier" not in seen.structure.terms
        rival = rival_resonance(predictor, lagging, seen if beside else None, response, window, sides)
        chosen.rival_resonance = rival
        if rival is not None and lagging.rms_m > ALIKE * rival.rms_m:
            chosen.trials[LOOP_DAMPING], free = damped_as_it_is(predictor, lagging, window)
            if chosen.trials[LOOP_DAMPING].taken and free.rms_m <= ALIKE * rival.rms_m:
                borne_out["amplifier"] = free
            else:
                chosen.not_told(lagging, rival)
                del borne_out["amplifier"]
    if not borne_out:
        return False
    taken = min(borne_out, key=lambda term: borne_out[term].rms_m)
    for term in terms:
        if term != taken:
            chosen.trials[term] = replace(chosen.trials[term], taken=False)
    chosen.fit = borne_out[taken]
    return True


def _tried(
    predictor: Predictor,
    chosen: Selection,
    term: str,
    guess: Mapping[str, float],
    response: Response,
    window: Window,
    sides: Sequence[str],
    before_m: float,
) -> Fit | None:
    """Return the model with a term where the evidence supports it, and record the trial.

    A term whose coarse fit is far worse than that of a term accepted before is not tried now, but later.
    """
    simple = chosen.fit
    if not simple.structure.admits(term):
        missing = [str(TERMS[need].words) for need in TERMS[term].needs if need not in simple.structure.terms]
        chosen.trials[term] = Trial(term, False, 0.0, 0.0, f"says nothing without {', '.join(missing)}")
        return None
    near: dict[tuple[str, int], Fit] = {}
    chosen.trials[term] = Trial(term, False, 0.0, 0.0, _UNSEEN.get(term, "is not seen in the frequency response"))
    # A simpler model that misses much has an observer too fast for a search from a distant guess.
    slow = min(simple.observer.rate_per_s, FIRST_RATE_PER_S)
    for structure, start in starts_of(simple, richer(simple.structure, term), term, guess, response, predictor, sides):
        from_afar = term in {"coulomb", "resonance"} or start.get(_FROM_AFAR.get(term, ""), 0.0) > 0
        if not from_afar:
            at_start = judged(predictor, structure, structure.start(start), simple.observer, window)
            hope = compared(simple, at_start, term)
            chosen.trials[term] = replace(hope, taken=False)
            if hope.standard_errors < _HOPEFUL:
                if term == "amplifier" and hope.held_out_change < 0:
                    # Inconclusive: what it would change is no better known than that.
                    rival = roughly(predictor, structure, start, slow)
                    chosen.rivals[term] = judged(predictor, structure, rival.search, simple.observer, window)
                continue
        if term in _STRONG:
            found = roughly(predictor, structure, start, slow)
        else:
            found = fit(predictor, structure, start, simple.observer, window, steps=12, tolerance=1e-5)
        kind = (structure.encoder_at, structure.amplifier_order)
        near[kind] = min(near.get(kind, found), found, key=rms_m_of)
    if not near:
        return None
    least = chosen.rough_m[term] = min(found.rms_m for found in near.values())
    if least > _NEAR_ANOTHER * before_m:
        return None
    likely = [found for found in near.values() if found.rms_m <= _NEAR_THE_BEST * least]
    best = min((closely(predictor, found, window) if term in _STRONG else found for found in likely), key=rms_m_of)
    best, trial = _told_apart(predictor, simple, best, term, window)
    beyond = _beyond(best, term, response, predictor.sample_time_s)
    if trial.taken and beyond:
        # A resonance beyond the excited band exists all the same: what it would change is no better known than that.
        seen = best.values["resonance.frequency_hz"] < _FURTHEST * (response.excited_hz or (0, 0))[1]
        trial = replace(trial, taken=False, why=beyond, inseparable=term == "resonance" and seen)
    chosen.trials[term] = trial
    if trial.taken:
        return best
    chosen.rivals[term] = best
    return None


def _told_apart(predictor: Predictor, simple: Fit, best: Fit, term: str, window: Window) -> tuple[Fit, Trial]:
    """Weigh the evidence of a term, and reject it where the rest of the model could have the same effect."""
    trial = compared(simple, best, term)
    most = _COLLINEAR_LAG if term == "amplifier" else _COLLINEAR
    _, collinear = sensitivity(best)
    if trial.taken and collinear > most and term == "resonance":
        best = shared(predictor, best, window, 1e-5)
        trial = compared(simple, best, term)
        _, collinear = sensitivity(best)
    if trial.taken and collinear > most:
        # Under the observer of the richer model the simpler one may fit as well.
        trial = compared(fit(predictor, simple.structure, simple.values, best.observer, window), best, term)
        if trial.taken:
            trial = replace(trial, taken=False, why=_ALIKE, inseparable=True)
    return best, trial


def _beyond(found: Fit, term: str, response: Response, period: float) -> str:
    """Return why an estimated frequency or backlash lies where the log cannot show it, if it does."""
    band = response.excited_hz
    top = min(HIGHEST_SEEN / period, 1.3 * band[1] if band else 0.0)
    if term == "resonance" and found.values["resonance.frequency_hz"] > top:
        return f"lies beyond the frequencies that the {FORCE} excites"
    fastest = _BESIDE_RESONANCE if found.structure.present("resonance.frequency_hz") else _FASTEST_LAG
    if term == "amplifier" and found.values["amplifier_bandwidth_hz"] > fastest / period:
        return "is too fast to be distinguished from a shorter delay at this sample rate"
    return HIDDEN if term == "play" and found.hides_play else ""
