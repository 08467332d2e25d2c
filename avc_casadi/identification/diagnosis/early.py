"""Verdicts by the force and the motion of a log alone: no oscillation, another unit, no spring and damper."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.causes import CAUSES
from avc_casadi.identification.diagnosis.envelope import LOWEST_HZ
from avc_casadi.identification.diagnosis.evidence import felt, limit_sentence, steps_sentence, toggles
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, growth_of_two_rates, worst_mode
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import IntegralTerm, Law
from avc_casadi.identification.diagnosis.limit_cycle import goes_back, passes
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.model import Diagnosis, Measured, Remedy, Trace, Verdict
from avc_casadi.identification.diagnosis.oscillation import TracedOscillation
from avc_casadi.identification.diagnosis.plant import Fit
from avc_casadi.identification.diagnosis.relay import SwitchedForce, TwoRates, find_jump, jump_sentence
from avc_casadi.identification.diagnosis.remedies import remedies_of_relay, remedies_of_two_rates
from avc_casadi.identification.diagnosis.saturation import fed

# An oscillation in contact for a smaller share of its time is a bounce.
_BOUNCES = 1 / 3
# Ticks that scatter by more of the period, each about the one before, are no even ones to a loop model: up to 10 % of
# it a delay is read rightly, at 15 % it was twice as long.
_UNEVEN = 0.12
EVEN = "the same log of a loop on an even clock"


class EarlyJudge:
    """The findings of a log, and the verdicts that its force and its motion decide alone."""

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
                f"{number(found.frequency_hz, 2)} Hz takes work from the force: a hand moves it"
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
            said = "not the loop: it swings while no force is commanded; a hand, a cable or the table moves it"
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
            f"{CAUSES['stiffness']}: the force jumps by {size} where contact begins, a spring without "
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
            f"cannot tell: the force has an integral term, which at {number(hertz, 3)} Hz takes {number(takes, 3)} "
            f" of damping and the force gives {number(has, 3)}; no loop model is made with one"
        )
        return self._made("cannot tell", said, decides="the same log without the integral term, or with half of it")

    def relay(self, found: SwitchedForce, fits: Sequence[Fit]) -> Diagnosis | None:
        """Return the verdict where a sign switches the force, and the loop would be stable without it.

        Args:
            found: the switched force.
            fits: of device and hand, likeliest first.
        """
        if not found.alone and not mostly(worst_mode(one, found.law).stable for one in answers_of(fits)):
            return None
        friction_n = self._declared.device.coulomb_friction_n
        cures = remedies_of_relay(found, answers_of(fits), self._log, friction_n)
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
        answers = answers_of(fits)
        if not mostly(worst_mode(one, found.law).stable for one in answers) or not mostly(
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
            less = "the same log below the force limit: a smaller start or touch, or a quarter of both k and b"
            return self._made("cannot tell", f"cannot tell: {limit}", decides=less)
        uneven = uneven_ticks(self._log)
        if uneven:
            return self._made("cannot tell", f"cannot tell: {uneven}", decides=EVEN)
        coarse = steps_sentence(self._log)
        if coarse:
            rounds = "the same log with the force as it is before it is rounded"
            return self._made("cannot tell", f"cannot tell: {coarse}", decides=rounds)
        said = (
            "cannot tell: the force of this log is not that of a spring and a damper on its position, so that no "
            "loop model can be made"
        )
        decides = "the same with a spring and a damper alone, or with the position that the law itself reads"
        return self._made("cannot tell", said, decides=decides)

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


def answers_of(fits: Sequence[Fit]) -> tuple[Hypothesis, ...]:
    """Return device and hand of the likeliest fit."""
    return (fits[0].answer, *fits[0].draws)


def mostly(some: Iterable[bool]) -> bool:
    """Return whether more than half are true."""
    return bool(np.mean(list(some)) > 1 / 2)


def uneven_ticks(log: Log) -> str:
    """Describe ticks at times that are too uneven for a loop model; empty where they are not."""
    share = log.ticks.uneven_share
    if share < _UNEVEN:
        return ""
    return f"the ticks come at uneven times, each {100 * share:.2g} % earlier or later, which no loop model here holds"


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
