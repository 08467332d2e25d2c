"""Verdict of a column of the page: a mark, a word and the margin, which stay in sight while a slider moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch

from avc_casadi.claims.admittance import AdmittanceCertificate
from avc_casadi.claims.deployable import Deployable
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.design.pair_certificate import PairCertificate
from avc_casadi.design.virtual_tool import WIDEST_MARGIN
from avc_casadi.loops.margins import SOUND_DISK
from avc_casadi.present.row import Mark, Part, Row, Value, grade, parts, row, verdict_mark
from avc_casadi.present.rows.admittance import mark_of
from avc_casadi.present.rows.other_ends import thin
from avc_casadi.present.rows.recommend import recommendation, ringing, verdict
from avc_casadi.recommendation.recommendation import NoCoupling, PairRecommendation, Recommendation, WallRecommendation

DEPLOYABLE = "deployable"
NOT_DEPLOYABLE = "not deployable"
NONE_DEPLOYABLE = "no coupling is deployable"


@dataclass(frozen=True)
class Verdict:
    """Whether a coupling or a law may be deployed, in a few words, and its margin."""

    mark: Mark
    word: str
    margin: tuple[Part, ...] = ()


@dataclass(frozen=True)
class Judged:
    """A verdict with the rows that explain it; None where it takes longer than the rows."""

    verdict: Verdict | None
    rows: Sequence[Row]


def disk_margin(margin: float) -> tuple[Part, ...]:
    """Return a disk margin in words; nothing where none is known."""
    return () if math.isnan(margin) else ("disk margin", Value(margin, "number", 2))


def gain_margin(margin: float) -> tuple[Part, ...]:
    """Return a common gain margin in words; a search ends at `WIDEST_MARGIN`."""
    more = "or more" if margin >= WIDEST_MARGIN else ""
    return parts("gain margin", Value(min(margin, WIDEST_MARGIN), "number"), more)


def of_law(certificate: LawCertificate) -> Verdict:
    """Return the verdict on a law of one's own; a thin margin or a noisy force is a caution."""
    if not certificate.stable:
        return Verdict(Mark.FAIL, "unstable")
    margin = disk_margin(certificate.disk_margin)
    if not certificate.passed:
        return Verdict(Mark.FAIL, NOT_DEPLOYABLE, margin)
    return Verdict(verdict_mark(certificate.passed, certificate.sound), DEPLOYABLE, margin)


def of_admittance(certificate: AdmittanceCertificate) -> Verdict:
    """Return the verdict on an admittance law; a thin margin, and a law that rings, is a caution."""
    if not certificate.stable:
        return Verdict(Mark.FAIL, "unstable")
    margin = disk_margin(certificate.disk_margin)
    if not certificate.passed:
        return Verdict(Mark.FAIL, NOT_DEPLOYABLE, margin)
    return Verdict(mark_of(certificate), DEPLOYABLE, margin)


def of_stability(stable: bool) -> Verdict:
    """Return the verdict on a pair of which stability alone is known."""
    return Verdict(grade(stable), "stable" if stable else "unstable")


def of_pair(certificate: PairCertificate) -> Verdict:
    """Return the verdict on a spring and damper to another end; a thin margin, and a law that rings, is a caution."""
    if not certificate.stable:
        return of_stability(stable=False)
    sound = not thin(certificate.gain_margin, certificate.motor_margins)
    return Verdict(grade(sound, Mark.CAUTION), "stable", gain_margin(certificate.gain_margin))


def of_coupling(deployable: Deployable | None) -> Verdict:
    """Return the verdict on a coupling of a method; None where the method has no gains."""
    if deployable is None:
        return Verdict(Mark.FAIL, "no gains")
    if not deployable.passed:
        return Verdict(Mark.FAIL, NOT_DEPLOYABLE)
    return Verdict(verdict_mark(deployable.passed, deployable.sound), DEPLOYABLE, disk_margin(deployable.disk_margin))


def of_recommendation(recommended: Recommendation) -> Judged:
    """Return the verdict of `recommend`, with its rows under the sentence that says what to deploy."""
    rows = [shown for shown in recommendation(recommended).rows if shown.rank == 0]
    sentence, good = verdict(recommended, rows)
    judged = _recommended(recommended) if good else Verdict(Mark.FAIL, NOT_DEPLOYABLE)
    if good and ringing(rows):
        judged = replace(judged, mark=Mark.CAUTION, word=f"{judged.word}, rings")
    if isinstance(recommended, NoCoupling):
        judged = Verdict(Mark.FAIL, NONE_DEPLOYABLE)
    return Judged(judged, [row("Deployable", sentence, mark=judged.mark), *rows])


@singledispatch
def _recommended(recommended: Recommendation) -> Verdict:  # noqa: ARG001
    """Return the verdict on a coupling that `recommend` calls deployable."""
    return Verdict(Mark.PASS, DEPLOYABLE)


@_recommended.register
def _recommended_wall(recommended: WallRecommendation) -> Verdict:
    sides = recommended.margins.released.disk, recommended.margins.worst_hand.disk
    disk = min((margin for margin in sides if not math.isnan(margin)), default=math.nan)
    sound = math.isnan(disk) or disk >= SOUND_DISK
    return Verdict(grade(sound, Mark.CAUTION), DEPLOYABLE, disk_margin(disk))


@_recommended.register
def _recommended_pair(recommended: PairRecommendation) -> Verdict:
    pair = recommended.pair
    sound = not thin(pair.gain_margin, pair.motor_margins)
    return Verdict(grade(sound, Mark.CAUTION), DEPLOYABLE, gain_margin(pair.gain_margin))
