"""The verdict on one log: from the log alone, from its loop model, and what stays open."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from avc_casadi._util.text import number
from avc_casadi._util.units import FORCE, NEWTON, NS_PER_M, Wording
from avc_casadi.identification.diagnosis.causes import CAUSES, OTHER, Asked, shares_of
from avc_casadi.identification.diagnosis.counterfactual import doubts_of_encoder, settled
from avc_casadi.identification.diagnosis.evidence import (
    deciding_log,
    declared_resonance,
    felt,
    limit_sentence,
    measured_sentences,
    named_sentence,
    steps_sentence,
    toggles,
)
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, growth_of_two_rates, worst_mode
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import IntegralTerm, Law
from avc_casadi.identification.diagnosis.limit_cycle import goes_back, passes
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.model import Diagnosis, Measured, Remedy, Trace, Verdict
from avc_casadi.identification.diagnosis.oscillation import LOWEST_HZ, TracedOscillation
from avc_casadi.identification.diagnosis.plant import Fit
from avc_casadi.identification.diagnosis.relay import SwitchedForce, TwoRates, find_jump, jump_sentence
from avc_casadi.identification.diagnosis.remedies import (
    remedies_of,
    remedies_of_relay,
    remedies_of_sign,
    remedies_of_two_rates,
)
from avc_casadi.identification.diagnosis.saturation import GROWN, fed, unlimited

# A cause is named at odds of two to one: of 200 logs drawn at random that names five more than a share of 0.8 and no
# rival above 0.12 did, all of them rightly.
_SURE = 2 / 3
# Log ratio of measured and modelled frequency, in contact throughout, beyond which the model is rejected.
_FREQUENCY = 0.3
_FORCE_OFF = Wording.of(lambda: f"the same log with the {FORCE} off: what a {FORCE} from outside drives goes on")
# The tremor of a hand: its frequencies, and an amplitude above its own.
_TREMOR_HZ, _TREMOR_M = (6.0, 13.0), 2e-3
# With a delay so much longer than declared, in samples, a strong tremor is as likely a cause.
_LATE, _STRONG_TREMOR_M = 8.0, 2e-2
# Largest residual of the position that a model may have, relative to encoder and noise.
_UNEXPLAINED = 12.0
# An oscillation in contact for a smaller share of its time is a bounce.
_BOUNCES = 1 / 3


# Ticks that scatter by more of the period, each about the one before, are no even ones to a loop model: up to 10 % of
# it a delay is read rightly, at 15 % it was twice as long.
_UNEVEN = 0.12
_EVEN = "the same log of a loop on an even clock"


class Judge:
    """The findings of a log before the judgement."""

    def __init__(
        self,
        log: Log,
        swing: TracedOscillation,
        law: Law | None,
        declared: Declared,
        evidence: list[str],
        notes: list[str],
    ) -> None:
        self._log, self._swing, self._law, self._declared = log, swing, law, declared
        self._evidence, self._notes = evidence, notes

    def at_once(self) -> Diagnosis | None:
        """Return the verdict where no loop model is needed."""
        found, log = self._swing.found, self._log
        if not found.sustained:
            what = "an oscillation comes and dies away" if found.kind == "decaying" else "nothing swings"
            return self._made("nothing wrong", f"nothing wrong: {what} in {number(_seconds(log), 3)} s")
        if found.frequency_hz < LOWEST_HZ and not fed(log, self._swing, self._declared.device):
            said = (
                f"nothing wrong: above {LOWEST_HZ:g} Hz nothing swings, and what goes to and fro at "
                f"{number(found.frequency_hz, 2)} Hz takes work from the {FORCE}: a hand moves it"
            )
            return self._made("nothing wrong", said)
        if toggles(found) and felt(log, self._swing, self._declared) < 1:
            said = (
                "nothing wrong: it toggles by one step of the encoder, below the vibrotactile threshold; a finer one "
                "would end it"
            )
            return self._made("nothing wrong", said)
        if passes(log, self._swing.first, self._swing.last, found.frequency_hz):
            cycles = number(found.frequency_hz * (found.ends_s - found.begins_s), 2)
            said = f"nothing wrong: after {cycles} cycles until {number(found.ends_s, 3)} s it settles in contact"
            return self._made("nothing wrong", said)
        if found.contact_share == 0:
            said = f"not the loop: it swings while no {FORCE} is commanded; a hand, a cable or the table moves it"
            return self._made("not the loop", said)
        return None

    def in_another_unit(self, told: str) -> Diagnosis | None:
        """Return the verdict where no model can fit because the positions are not in metres."""
        if not told:
            return None
        return self._made("cannot tell", f"cannot tell: {told}", decides="the same log with its unit told (--units)")

    def jumps(self) -> Diagnosis | None:
        """Return the verdict where the force jumps at the edge of contact in every cycle."""
        jump = find_jump(self._log, self._swing, self._law, self._declared.device.max_force_n)
        if jump is None:
            return None
        size = number(jump.force_n, 3)
        told = jump_sentence(jump, self._log.reach_m)
        said = (
            f"{CAUSES['stiffness']}: the {FORCE} jumps by {size} {NEWTON} where contact begins, a spring without "
            "length; let it grow with the depth (k below its limit), or keep it on through the whole cycle"
        )
        return self._made("named", said, cause="stiffness", candidates=("stiffness",), evidence=[*self._evidence, told])

    def integrates(self, found: IntegralTerm | None) -> Diagnosis | None:
        """Return the verdict where the force integrates the position, of which no loop model is made."""
        if found is None:
            return None
        hertz = self._swing.found.frequency_hz
        takes, has = found.takes_ns_per_m(hertz), found.damping_ns_per_m
        said = (
            f"cannot tell: the {FORCE} has an integral term, which at {number(hertz, 3)} Hz takes {number(takes, 3)} "
            f"{NS_PER_M} of damping and the {FORCE} gives {number(has, 3)}; no loop model is made with one"
        )
        return self._made("cannot tell", said, decides="the same log without the integral term, or with half of it")

    def relay(self, found: SwitchedForce, fits: Sequence[Fit]) -> Diagnosis | None:
        """Return the verdict where a sign switches the force, and the loop would be stable without it.

        Args:
            found: the switched force.
            fits: of device and hand, likeliest first.
        """
        if not found.alone and not _mostly(worst_mode(one, found.law).stable for one in _answers(fits)):
            return None
        friction_n = self._declared.device.coulomb_friction_n
        cures = remedies_of_relay(found, _answers(fits), self._log, friction_n)
        why = "which no loop with a delay holds" if found.force_n > 0 else "which feeds the swing beyond the friction"
        evidence = [*self._evidence, found.sentence()]
        if not found.alone:
            evidence.append("with its spring and damper alone the loop model settles")
        return self._made(
            "named",
            f"{CAUSES['relay']}: {found.sentence()}, {why}",
            cause="relay",
            candidates=("relay",),
            evidence=evidence,
            law=None if found.alone else found.law,
            cures=cures,
        )

    def two_rates(self, found: TwoRates, fits: Sequence[Fit]) -> Diagnosis | None:
        """Return the verdict where two parts of the force have different rates, and one rate would stabilise the loop.

        Args:
            found: the two rates.
            fits: of device and hand, likeliest first.
        """
        answers = _answers(fits)
        if not _mostly(worst_mode(one, found.law).stable for one in answers) or not _mostly(
            growth_of_two_rates(one, found.law, found.slow, found.ticks, found.late) > 0 for one in answers
        ):
            return None
        period = self._log.ticks.period_s
        told = found.sentence(period)
        why = "comes late by half its frame and by what that waits, and with one rate it settles"
        return self._made(
            "named",
            f"{told}; the {found.slow} {why}",
            cause="rates",
            candidates=("rates",),
            evidence=[*self._evidence, told],
            law=found.law,
            cures=remedies_of_two_rates(found, answers, period),
        )

    def drives(self, law: Law, fits: Sequence[Fit]) -> Diagnosis | None:
        """Return the verdict where the damper has the wrong sign, and the loop would be stable with the right one.

        A lag of less than a sample, of which no law is told, makes a damper of up to -k T.

        Args:
            law: from position to force.
            fits: of device and hand, likeliest first.
        """
        b, answers = law.damping_ns_per_m, _answers(fits)
        if not b < -abs(law.stiffness_n_per_m) * self._log.ticks.period_s:
            return None
        cures = remedies_of_sign(law, answers)
        if not cures or _mostly(worst_mode(one, law).stable for one in answers):
            return None
        said = f"the damper has the wrong sign: b = {number(b, 3)} {NS_PER_M} drives the motion on"
        return self._made("named", said, cause="damping", candidates=("damping",), cures=cures)

    def moves_on(self) -> Diagnosis | None:
        """Return the verdict where the position never goes back, as where a hand moves it over steps and friction."""
        swing = self._swing
        if goes_back(self._log, swing.first, swing.last, swing.found.frequency_hz):
            return None
        said = (
            f"nothing wrong: until {number(swing.found.ends_s, 3)} s a hand moves it over encoder steps and friction, "
            "one after the other and never back"
        )
        return self._made("nothing wrong", said)

    def without_model(self) -> Diagnosis:
        """Return the verdict where no loop model can be made."""
        limit = limit_sentence(self._log, self._declared.device.max_force_n)
        if limit:
            less = f"the same log below the {FORCE} limit: a smaller start or touch, or a quarter of both k and b"
            return self._made("cannot tell", f"cannot tell: {limit}", decides=less)
        uneven = _uneven(self._log)
        if uneven:
            return self._made("cannot tell", f"cannot tell: {uneven}", decides=_EVEN)
        coarse = steps_sentence(self._log)
        if coarse:
            rounds = f"the same log with the {FORCE} as it is before it is rounded"
            return self._made("cannot tell", f"cannot tell: {coarse}", decides=rounds)
        said = (
            f"cannot tell: the {FORCE} of this log is not that of a spring and a damper on its position, so that no "
            "loop model can be made"
        )
        decides = "the same with a spring and a damper alone, or with the position that the law itself reads"
        return self._made("cannot tell", said, decides=decides)

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
        uneven = "" if first == "rate" else _uneven(log)
        doubts += [uneven] * bool(uneven)
        if measured.misfit > _UNEXPLAINED and first not in {"ticks", "rate"}:
            doubts.append(f"the model leaves {number(measured.misfit, 2)} times what encoder and noise do")
        doubts += _doubts_of_delay(first, measured, fit)
        if first == "encoder":
            some = [one.answer for one in asked if one.causes.get(first, 0.0) >= 0.5]
            doubts += doubts_of_encoder([answer, *some], law, log, evidence)
        if doubts:
            candidates = tuple(cause for cause in causes if cause != OTHER)[:2]
            known = [str(CAUSES[cause]) for cause in candidates] + [f"a {FORCE} from outside the loop"] * (
                driven or trembles
            )
            names = " or ".join(known) or "none of the causes it knows"
            said = f"cannot tell: {names}; {'; '.join(doubts)}"
            tried = () if uneven else candidates
            cures = tuple(cure for cause in tried for cure in remedies_of(cause, answer, law, log, declared))
            return self._made(
                "cannot tell",
                said,
                candidates=candidates,
                shares=shares,
                measured=measured,
                evidence=evidence,
                cures=tuple(dict.fromkeys(cures)),
                decides=_EVEN
                if uneven
                else str(_FORCE_OFF)
                if driven or trembles
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

    def _made(
        self,
        verdict: Verdict,
        conclusion: str,
        *,
        cause: str | None = None,
        candidates: tuple[str, ...] = (),
        shares: Mapping[str, float] | None = None,
        measured: Measured | None = None,
        evidence: Sequence[str] | None = None,
        law: Law | None = None,
        cures: tuple[Remedy, ...] = (),
        decides: str = "",
    ) -> Diagnosis:
        log, share = self._log, self._swing.found.contact_share
        if share < _BOUNCES and any(math.isfinite(cure.growth_per_s) for cure in cures):
            self._notes.append(
                f"in contact for {100 * share:.0f} % of the time it bounces: changes were checked on the loop in "
                "contact, and a bounce may outlast a loop that settles there"
            )
        return Diagnosis(
            source=log.name,
            seconds=_seconds(log),
            ticks=log.ticks,
            encoder_m=log.encoder_m,
            oscillation=self._swing.found,
            law=self._law if law is None else law,
            measured=measured,
            verdict=verdict,
            cause=cause,
            candidates=candidates,
            shares=dict(shares or {}),
            conclusion=conclusion,
            evidence=tuple(self._evidence if evidence is None else evidence),
            cures=cures,
            decides=decides,
            notes=tuple(self._notes),
            trace=_trace(log, self._swing),
        )


def _doubts_of_delay(first: str, measured: Measured, fit: Fit) -> list[str]:
    """Return why the delay is not sure."""
    doubts = []
    if first == "delay" and measured.delay_samples - measured.declared_delay_samples < 2 * measured.delay_error_samples:
        doubts.append("the log does not tell the delay well enough")
    if "delay" in fit.at_end:
        doubts.append("its delay lies at the end of what was searched, and is not found")
    return doubts


def _uneven(log: Log) -> str:
    """Describe ticks at times that are too uneven for a loop model; empty where they are not."""
    share = log.ticks.uneven_share
    if share < _UNEVEN:
        return ""
    return f"the ticks come at uneven times, each {100 * share:.2g} % earlier or later, which no loop model here holds"


def _answers(fits: Sequence[Fit]) -> tuple[Hypothesis, ...]:
    """Return device and hand of the likeliest fit."""
    return (fits[0].answer, *fits[0].draws)


def _mostly(some: Iterable[bool]) -> bool:
    return bool(np.mean(list(some)) > 1 / 2)


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


def _seconds(log: Log) -> float:
    return float(log.position_m.size * log.ticks.period_s)


def _trace(log: Log, swing: TracedOscillation) -> Trace:
    part = swing.fast_m[swing.first : swing.last]
    window = np.hanning(part.size)
    amplitude = 2 * np.abs(np.fft.rfft(part * window)) / window.sum()
    return Trace(
        time_s=log.time_s,
        position_m=log.position_m,
        fast_m=swing.fast_m,
        envelope_m=swing.envelope_m,
        force_n=-log.force_n,
        frequency_hz=np.asarray(np.fft.rfftfreq(part.size, log.ticks.period_s), dtype=np.float64),
        spectrum_m=np.asarray(amplitude),
    )
