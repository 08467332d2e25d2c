"""The verdict on one log from its loop model, and what stays open."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.causes import CAUSES, OTHER, Asked, shares_of
from avc_casadi.identification.diagnosis.counterfactual import doubts_of_encoder, settled
from avc_casadi.identification.diagnosis.early import EVEN, EarlyJudge, answers_of, mostly, uneven_ticks
from avc_casadi.identification.diagnosis.evidence import (
    deciding_log,
    declared_resonance,
    measured_sentences,
    named_sentence,
)
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, worst_mode
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.model import Diagnosis, Measured
from avc_casadi.identification.diagnosis.oscillation import TracedOscillation
from avc_casadi.identification.diagnosis.plant import Fit
from avc_casadi.identification.diagnosis.remedies import remedies_of, remedies_of_sign
from avc_casadi.identification.diagnosis.saturation import GROWN, unlimited

# A cause is named at odds of two to one: of 200 logs drawn at random that names five more than a share of 0.8 and no
# rival above 0.12 did, all of them rightly.
_SURE = 2 / 3
# Log ratio of measured and modelled frequency, in contact throughout, beyond which the model is rejected.
_FREQUENCY = 0.3
_FORCE_OFF = "the same log with the force off: what a force from outside drives goes on"
# The tremor of a hand: its frequencies, and an amplitude above its own.
_TREMOR_HZ, _TREMOR_M = (6.0, 13.0), 2e-3
# With a delay so much longer than declared, in samples, a strong tremor is as likely a cause.
_LATE, _STRONG_TREMOR_M = 8.0, 2e-2
# Largest residual of the position that a model may have, relative to encoder and noise.
_UNEXPLAINED = 12.0


class Judge(EarlyJudge):
    """The verdict by the loop model of a log."""

    def drives(self, law: Law, fits: Sequence[Fit]) -> Diagnosis | None:
        """Return the verdict where the damper has the wrong sign, and the loop would be stable with the right one.

        A lag of less than a sample, of which no law is told, makes a damper of up to -k T.

        Args:
            law: from position to force.
            fits: of device and hand, likeliest first.
        """
        b, answers = law.damping_ns_per_m, answers_of(fits)
        if not b < -abs(law.stiffness_n_per_m) * self._log.ticks.period_s:
            return None
        cures = remedies_of_sign(law, answers)
        if not cures or mostly(worst_mode(one, law).stable for one in answers):
            return None
        said = f"the damper has the wrong sign: b = {number(b, 3)} drives the motion on"
        return self._made("named", said, cause="damping", candidates=("damping",), cures=cures)

    def judged(self, law: Law, fits: Sequence[Fit], asked: Sequence[Asked]) -> Diagnosis:
        """Return the verdict by the shares of the causes."""
        found, log, declared = self._swing.found, self._log, self._declared
        asked = settled(asked, law, log, found, declared, self._evidence)
        shares = shares_of(asked)
        causes = list(shares)
        first = causes[0]
        answer, fit = _likeliest(first, asked, fits)
        measured = _measured(answer, fit, law, log, declared)
        evidence = [*self._evidence, *measured_sentences(measured, declared)]
        doubts = []
        if first == OTHER:
            doubts.append(
                "no single change of those that were tried makes this loop settle, or it settles on the model"
            )
        elif together := _together(asked):
            doubts.append(
                f"the delay is more than declared, and with the declared one there would be {CAUSES[together]} still"
            )
        elif shares[first] < _SURE:
            doubts.append(f"of the answers that the log bears out {_shares_text(shares)}")
        apart = abs(math.log(max(measured.frequency_hz, 0.1) / found.frequency_hz))
        linear = unlimited(log, found, declared.device.max_force_n)
        if first not in {"encoder", "ticks", OTHER} and linear and apart > _FREQUENCY:
            doubts.append(
                f"the model swings at {number(measured.frequency_hz, 3)} Hz, the log at {number(found.frequency_hz, 3)}"
            )
        seen, lasts = _growth(self._swing, log.ticks.period_s)
        driven = linear and first != OTHER and (measured.growth_per_s - max(seen, 0.0)) * lasts > GROWN
        if driven:
            doubts.append(
                f"a loop that grows by {number(measured.growth_per_s, 2)} 1/s does not swing so evenly for "
                f"{number(lasts, 2)} s where nothing limits it: the hand, the table or a machine may drive it"
            )
        size_m = log.reach_m * found.peak_to_peak_m
        late = measured.delay_samples - measured.declared_delay_samples
        size = _TREMOR_M if late < _LATE else _STRONG_TREMOR_M
        trembles = first == "delay" and _TREMOR_HZ[0] < found.frequency_hz < _TREMOR_HZ[1] and size_m < size
        if trembles and not driven:
            doubts.append("a hand trembles so of its own")
        # The period itself is told.
        uneven = "" if first == "rate" else uneven_ticks(log)
        doubts += [uneven] * bool(uneven)
        if measured.misfit > _UNEXPLAINED and first not in {"ticks", "rate"}:
            doubts.append(f"the model leaves {number(measured.misfit, 2)} times what encoder and noise do")
        doubts += _doubts_of_delay(first, measured, fit)
        if first == "encoder":
            some = [one.answer for one in asked if one.causes.get(first, 0.0) >= 0.5]
            doubts += doubts_of_encoder([answer, *some], law, log, evidence)
        if doubts:
            # At the odds at which a cause is named, none of them is.
            unknown = shares.get(OTHER, 0.0) >= _SURE
            candidates = () if unknown else tuple(cause for cause in causes if cause != OTHER)[:2]
            known = [str(CAUSES[cause]) for cause in candidates] + ["a force from outside the loop"] * (
                driven or trembles
            )
            names = " or ".join(known) or "none of the causes it knows"
            said = f"cannot tell: {names}; {'; '.join(doubts)}"
            # What is driven from outside has no remedy in the loop: less k lets it move further.
            outside = driven or trembles or unknown
            tried = () if uneven or outside else candidates
            cures = tuple(cure for cause in tried for cure in remedies_of(cause, answer, law, log, declared))
            return self._made(
                "cannot tell",
                said,
                candidates=candidates,
                shares=shares,
                measured=measured,
                evidence=evidence,
                cures=tuple(dict.fromkeys(cures)),
                decides=EVEN
                if uneven
                else str(_FORCE_OFF)
                if outside
                else deciding_log(candidates, known=declared.known),
            )
        if first == "resonance":
            self._notes.append(declared_resonance(measured))
        return self._made(
            "named",
            named_sentence(first, measured, law, log, declared, answer),
            cause=first,
            candidates=(first,),
            shares=shares,
            measured=measured,
            evidence=evidence,
            cures=remedies_of(first, answer, law, log, declared),
        )


def _together(asked: Sequence[Asked]) -> str | None:
    """Return the cause that most hypotheses name together with a delay, each a part of it; None for no such cause."""
    shares: dict[str, float] = {}
    for one in asked:
        if "delay" in one.causes and "encoder" not in one.causes:
            for cause in one.causes.keys() - {"delay", OTHER}:
                shares[cause] = shares.get(cause, 0.0) + one.weight
    most = max(shares, key=lambda cause: shares[cause], default=None)
    return most if most is not None and shares[most] > 0.5 * sum(one.weight for one in asked) else None


def _likeliest(cause: str, asked: Sequence[Asked], fits: Sequence[Fit]) -> tuple[Hypothesis, Fit]:
    """Return the likeliest hypothesis of a cause, and its fit."""
    of_cause = [one for one in asked if one.causes.get(cause, 0.0) >= 0.5] or list(asked)
    # The estimate of each fit stands before its draws.
    best = max(of_cause, key=lambda one: one.weight).answer
    fit = next(fit for fit in fits if best is fit.answer or any(best is draw for draw in fit.draws))
    return best, fit


def _measured(answer: Hypothesis, fit: Fit, law: Law, log: Log, declared: Declared) -> Measured:
    mode = worst_mode(answer, law)
    shape = answer.device.resonance
    return Measured(
        delay_samples=float(answer.device.delay_samples) + law.lag,
        delay_error_samples=float(np.std([float(draw.device.delay_samples) for draw in fit.draws])),
        declared_delay_samples=declared.longest_delay * declared.device.sample_time_s / log.ticks.period_s,
        least_declared_delay_samples=declared.shortest_delay * declared.device.sample_time_s / log.ticks.period_s,
        lag_samples=law.lag,
        device={"mass_kg": answer.device.mass_kg, "damping_ns_per_m": answer.device.damping_ns_per_m},
        hand=None if answer.hand is None else answer.hand.values(0),
        resonance=None if shape is None else shape.model_dump(),
        misfit=fit.misfit,
        growth_per_s=mode.growth_per_s,
        frequency_hz=mode.frequency_hz,
    )


def _growth(swing: TracedOscillation, period_s: float) -> tuple[float, float]:
    """Return the growth rate from the first half of the oscillation to the second, and its time."""
    halves = np.array_split(swing.envelope_m[swing.first : swing.last], 2)
    before, after = (max(float(np.median(half)), 1e-300) for half in halves)
    lasts = (swing.last - swing.first) * period_s
    return 2 * math.log(after / before) / lasts, lasts


def _shares_text(shares: Mapping[str, float]) -> str:
    return ", ".join(
        f"{100 * share:.0f} % say {CAUSES.get(cause, 'none of them')}"
        for cause, share in shares.items()
        if share > 0.01
    )


def _doubts_of_delay(first: str, measured: Measured, fit: Fit) -> list[str]:
    """Return why the delay is not sure."""
    doubts = []
    if first == "delay" and measured.delay_samples - measured.declared_delay_samples < 2 * measured.delay_error_samples:
        doubts.append("the log does not tell the delay well enough")
    if "delay" in fit.at_end:
        doubts.append("its delay lies at the end of what was searched, and is not found")
    return doubts
