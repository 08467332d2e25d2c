"""Causes of an oscillation: the one change with which the loop that the log shows would settle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.json_values import plain_table
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi._util.text import number, plural
from avc_casadi.coupling import Coupling
from avc_casadi.diagnose.change import OTHER, cause_of, late_alone, undeclared_mode, unknown_mechanics
from avc_casadi.diagnose.fit import FitTask, PlantFit, fit_log
from avc_casadi.diagnose.law import FittedLaw, find_law, is_cut_off
from avc_casadi.diagnose.mass import apparent_mass_kg
from avc_casadi.diagnose.oscillation import Log, Oscillation, find_oscillation, log_of
from avc_casadi.diagnose.plant import Hypothesis, IntendedLaw, stable
from avc_casadi.diagnose.remedies import LoggedScene, Remedy, remedies_of, without
from avc_casadi.diagnose.rest import below_limit, rests, toggles_by_a_step
from avc_casadi.diagnose.should_run import RunComparison, compared_with
from avc_casadi.diagnose.words import CAUSES, cause_numbers
from avc_casadi.diagnose.work import drives_from_outside
from avc_casadi.identification.log import Columns, allowed_sign, require_radius, require_radius_of
from avc_casadi.identification.read import Layout, read_columns
from avc_casadi.model.device import Device
from avc_casadi.model.problem import Hands, defaults_at

Verdict = Literal["named", "cannot tell", "nothing wrong", "not the loop"]

_SURE = 2 / 3
"""Share of the evidence from which on a cause is named: odds of two to one."""

_FEWEST_SAMPLES = 60
"""Samples of the shortest log."""

_MISFIT = 12.0
"""Residual, per noise of the position, above which the model of a declared device is in doubt."""

_MISFIT_ASSUMED = 4.0
"""The same of an assumed device, which is free to explain much that it did not do; above it no remedy is told."""

_OVER_LIMIT = 1.01
"""Ratio of a force to the declared limit above which the limit is another one."""

_OVER_LIMIT_SHARE = 1e-3
"""Share of ticks above the declared limit from which on it is not used."""

_USUAL_MASS_KG = 0.1
"""Mass of a usual device on a desk, kg, at 1 m from the axis or on one that slides."""

_USUAL_DAMPING_NS_PER_M = 1.0
"""Damping of the same device, N.s/m."""

_USUAL_DELAY_SAMPLES = 1
"""Delay of the same device, samples."""

_FORCE_EXPLAINED = 0.03
"""Residual of the force above which what makes it is told."""

_MOST_OF_STEPS = 0.15
"""Residual of the force that encoder steps make, above which nothing is said to be wrong or right."""

_MISSED_TICKS = 0.12
"""Scatter of the clock, or share of missed samples, above which no loop model fits."""

_DEVICE_ALONE = (0.8, 1.25)
"""Ratios of the mass that the force moves to that of the device within which no hand holds it."""

_ABOUT_DEVICE = (0.5, 2.0)
"""The same within which a hand does not decide about the sign of the force."""

_LEAST_WEIGHT = 1e-3
"""Evidence of a structure below which it has no say."""

_NEAR_BY_SHARE = 0.01
"""Share of the evidence of a hypothesis above which a remedy has to do for it."""

_NEAR_BY_MOST = 8
"""About as many such hypotheses are simulated."""

_BESIDE_STOPS = frozenset({"delay", "let-go", "encoder"})
"""Causes that are not named beside travel stops that are not declared: the stops may explain the motion alone."""

_BESIDE_RESONANCE = _BESIDE_STOPS | {"stiffness", "damping"}
"""Causes that are not named beside a resonance that is not declared. Whether a gain is too large without the resonance
depends on the hand, which the log shows too inaccurately."""

_USUAL_STAGES = 9
"""Stages of a usual diagnosis: four structures, each fitted and refined; causes and remedies."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The diagnosis of one log."""

    log: Log
    swing: Oscillation
    law: FittedLaw | None
    design: IntendedLaw
    verdict: Verdict
    conclusion: str
    """The verdict in words."""
    flip_force: bool = False
    """Whether the force along the position was taken as positive."""
    cause: str | None = None
    """Key of `CAUSES`, where the cause is named."""
    candidates: tuple[str, ...] = ()
    """Keys of the causes that it may be, the likeliest first."""
    shares: Mapping[str, float] = field(default_factory=dict)
    """Share of the evidence of each cause, the largest first."""
    decides: str = ""
    """The log that would decide."""
    remedies: tuple[Remedy, ...] = ()
    fit: PlantFit | None = None
    hand_determined: bool = True
    """Whether only structures with a hand explain the motion, or only those without."""
    notes: tuple[str, ...] = ()
    compared: RunComparison | None = None

    def data(self) -> dict[str, Any]:
        """Return its JSON values."""
        log = self.log
        swing = self.swing
        law = self.law
        units = self.design.device.units
        document = {
            "log": log.name,
            "seconds": float(log.position_m.size * log.period_s),
            "verdict": self.verdict,
            "cause": self.cause,
            "candidates": self.candidates,
            "conclusion": self.conclusion,
            "shares": self.shares,
            "decides": self.decides,
            "notes": self.notes,
            "remedies": [{**asdict(remedy), "key": units.key(remedy.key)} for remedy in self.remedies],
            "oscillation": {
                "kind": swing.kind,
                "first": swing.first,
                "last": swing.last,
                "frequency_hz": swing.frequency_hz,
                "peak_to_peak_m": swing.peak_to_peak_m,
                "force_peak_to_peak_n": swing.force_peak_to_peak_n,
                "steps": swing.steps,
                "contact_share": swing.contact_share,
                "sustained": swing.sustained,
                "rest_from_s": swing.rest_from_s(log),
            },
            "sample_time_s": log.period_s,
            "missed_share": log.missed_share,
            "encoder_resolution_m": log.encoder_m or None,
            "law": law and {**asdict(law), "explains": law.explains, "filter_hz": law.filter_hz(log.period_s)},
            "measured": self._measured(),
            "compared": self.compared and self.compared.data(),
        }
        return plain_table(document)

    def _measured(self) -> dict[str, Any] | None:
        """Return the JSON values of the fitted device and hand."""
        if self.fit is None or self.law is None:
            return None
        best = self.fit.best
        samples_a_tick = self.design.samples_a_tick(self.log)
        stops_error = None
        if best.stops is not None:
            # Where between two samples a stop lies the log does not tell.
            inside = self.log.position_m[self.swing.first : self.swing.last]
            stops_error = float(np.abs(np.diff(inside)).max())
        return {
            "delay_samples": (best.delay + self.law.lag) * samples_a_tick,
            "delay_error_samples": self.fit.delay_error * samples_a_tick,
            "misfit": self.fit.misfit,
            "stops_m": best.stops,
            "stops_error_m": stops_error,
            "mass_kg": best.device.mass_kg,
            "damping_ns_per_m": best.device.damping_ns_per_m,
            "hand": best.hand and best.hand.values(0),
            "resonance": best.device.resonance and best.device.resonance.model_dump(),
            "resonance_hz": self.fit.resonance_hz,
        }


def diagnose(  # noqa: PLR0913 - options by name, of a public call
    log: str | Path | Columns,
    *,
    layout: Layout | None = None,
    device: Device | None = None,
    hands: Hands | None = None,
    coupling: Coupling | None = None,
    handle_radius_m: float | None = None,
    flip_force: bool = False,
    seed: int = 0,
    progress: Progress = SILENT,
) -> Diagnosis:
    """Diagnose one log of time, position and commanded force, and compare it with a `coupling` that should have run.

    `device` and `hands` are those of the design, by default those of the `coupling`, else usual ones.
    `handle_radius_m` is the radius at which the hand holds a device that turns, by default that of the `device`.
    `flip_force` takes the force along the position as positive. `seed` is that of the draws.
    """
    require_radius(handle_radius_m)
    columns = log if isinstance(log, Columns) else read_columns(log, layout)
    if coupling is not None:
        device, hands = device or coupling.problem.device, hands or coupling.problem.hands
    count = columns.time_s.size
    if count < _FEWEST_SAMPLES:
        allowed = f"allowed: at least {_FEWEST_SAMPLES}"
        raise InputError.of(f"has {plural(count, 'sample')}; {allowed}", file=columns.file, key="time")
    grid, notes = log_of(columns, flip_force=flip_force)
    design = _design(device, hands, grid, columns, handle_radius_m)
    if not design.known:
        notes.append(
            "no device given: a typical device is assumed, which may be wrong by a factor of 50; give --device"
        )
    if _passes_limit(grid, design.device):
        notes.append("the log has larger forces than max_force_n; the limit is ignored: check the limit and the units")
        design = replace(design, device=design.device.model_copy(update={"max_force_n": None}))
    limit = design.device.max_force_n
    notes += design.mismatches(grid)
    with progress.step("oscillation and force"):
        swing = find_oscillation(grid, limit)
        law = find_law(grid, swing, limit, design.device.coulomb_friction_n)
    compared = None if coupling is None else compared_with(coupling, law, swing, grid)
    begun = Diagnosis(
        grid, swing, law, design, "cannot tell", "", flip_force=flip_force, notes=tuple(notes), compared=compared
    )
    law_or_verdict = _at_once(begun)
    if isinstance(law_or_verdict, Diagnosis):
        return law_or_verdict
    with progress.step("device, hand, causes and remedies"):
        stages = Stages(progress, _USUAL_STAGES * (2 if grid.missed_share else 1))
        fitted_log, fits = fit_log(FitTask(grid, swing, law_or_verdict, seed, stages), design)
        stages.begin("causes and remedies")
        return _judge(replace(begun, log=fitted_log), law_or_verdict, fits)


def _passes_limit(log: Log, device: Device) -> bool:
    """Return whether a log has forces well beyond the limit of the device."""
    limit_n = device.max_force_n
    return limit_n is not None and bool(np.mean(np.abs(log.force_n) > _OVER_LIMIT * limit_n) > _OVER_LIMIT_SHARE)


def _design(
    device: Device | None, hands: Hands | None, log: Log, columns: Columns, radius_m: float | None
) -> IntendedLaw:
    """Return the intended loop, a usual device on a desk where none is given; refuse a log that is not of it."""
    message = ""
    if device is not None and device.motion != columns.motion:
        message = f"is {columns.motion} by its units; allowed: {device.motion}, as the device"
    elif not np.ptp(log.position_m) and np.ptp(log.force_n):
        message = "never changes, and the force does; allowed: a device that moves; is the encoder stuck?"
    if message:
        raise InputError.of(message, file=columns.file, key="position")
    require_radius_of(columns.motion, radius_m, device)
    if device is not None and radius_m is not None:
        device = device.model_copy(update={"handle_radius_m": radius_m})
    known = device is not None
    reach = (radius_m or 1.0) if device is None else device.metres_per_unit
    if device is None:
        values = {
            "motion": columns.motion,
            "sample_time_s": log.sample_time_s,
            "mass_kg": _USUAL_MASS_KG * reach**2,
            "damping_ns_per_m": _USUAL_DAMPING_NS_PER_M * reach**2,
            "delay_samples": _USUAL_DELAY_SAMPLES,
        }
        if columns.motion == "rotary":
            values["handle_radius_m"] = reach
        device = Device.model_validate(values)
    return IntendedLaw(device, known, hands or Hands.model_validate(defaults_at(Hands, reach)))


def _at_once(diagnosis: Diagnosis) -> Diagnosis | FittedLaw:
    """Return the verdict that needs no loop model, or the law of one that does."""
    log = diagnosis.log
    swing = diagnosis.swing
    law = diagnosis.law
    design = diagnosis.design
    mass = apparent_mass_kg(log, design.device, known=design.known)
    toggles = bool(swing.sustained and toggles_by_a_step(log, swing, design.device))
    if swing.sustained and swing.contact_share == 0:
        text = "it oscillates while no force is commanded; a hand, a cable or the table moves it"
        return _concluded(diagnosis, "not the loop", text)
    if not np.ptp(log.position_m):
        text = "the device stands still over the whole log: nothing oscillates, and no motion shows the law"
        return _concluded(diagnosis, "cannot tell", text, "a log in which it oscillates, or of a press and a release")
    if law is None or not law.explains:
        text = (
            "no known law explains the force: spring and damper, with a dead zone, a filter or a clock of its own; a"
            " switched force; or two rates"
        )
        if law is None and not log.force_n.any():
            text = "no force is commanded"
        text = _with_rest(diagnosis, text)
        decides = "the same with a spring and a damper alone, unlimited, and with the position that the law reads"
        return _concluded(diagnosis, "cannot tell", text, decides)
    return _of_explained(diagnosis, law, mass, toggles=toggles)


def _of_explained(diagnosis: Diagnosis, law: FittedLaw, mass: float, *, toggles: bool) -> Diagnosis | FittedLaw:
    """Return the verdict of a force that is explained and needs no loop model, or the law of one that does."""
    log, swing = diagnosis.log, diagnosis.swing
    of_sign = _of_sign(diagnosis, law, mass)
    if of_sign is not None:
        return of_sign
    if swing.sustained and max(log.uneven_share, log.missed_share) > _MISSED_TICKS:
        text = "ticks come at uneven times or are missing, and no loop model fits"
        return _concluded(diagnosis, "cannot tell", text, "the same log on an even clock")
    if swing.sustained and not toggles:
        return law
    return _of_rest(diagnosis, law, mass, toggles=toggles)


def _of_rest(diagnosis: Diagnosis, law: FittedLaw, mass: float, *, toggles: bool) -> Diagnosis:
    """Return the verdict of a force that is explained, and under which nothing swings on."""
    log = diagnosis.log
    swing = diagnosis.swing
    design = diagnosis.design
    if law.misfit > _MOST_OF_STEPS:
        text = _with_rest(diagnosis, f"encoder steps leave {100 * law.misfit:.0f} % of the force unexplained")
        return _concluded(diagnosis, "cannot tell", text, "the same with the position that the law reads")
    if is_cut_off(log, law):
        text = _with_rest(diagnosis, "no force is commanded at the end, where its law requires a force")
        return _concluded(diagnosis, "cannot tell", text, "the same with the force on to the end")
    if swing.rest_from is not None and swing.contact_share and below_limit(log, design.device.max_force_n):
        return _concluded(
            diagnosis, "nothing wrong", _with_rest(diagnosis, _decay_words(diagnosis, law, mass, toggles=False))
        )
    if law.switch is None and rests(log, swing, design.device.max_force_n):
        return _concluded(diagnosis, "nothing wrong", _decay_words(diagnosis, law, mass, toggles=toggles))
    text = "nothing swings, and no motion decays under the force either"
    return _concluded(diagnosis, "cannot tell", text, "a log of a press, a push or a release")


def _with_rest(diagnosis: Diagnosis, text: str) -> str:
    """Return why a verdict is given, after what a swing that came to rest did."""
    swing = diagnosis.swing
    rest_s = swing.rest_from_s(diagnosis.log)
    if rest_s is None:
        return text
    return f"it oscillated at {number(swing.frequency_hz, 3)} Hz and stands still from {number(rest_s, 3)} s on; {text}"


def _concluded(diagnosis: Diagnosis, verdict: Verdict, text: str, decides: str = "") -> Diagnosis:
    """Return a diagnosis with its verdict and why."""
    return replace(diagnosis, verdict=verdict, conclusion=f"{verdict}: {text}", decides=decides)


def _decay_words(diagnosis: Diagnosis, law: FittedLaw, mass: float, *, toggles: bool) -> str:
    """Return why nothing is wrong, and what a hand may hide."""
    design = diagnosis.design
    steps = f", but for {100 * law.misfit:.0f} % that encoder steps make," if law.misfit > _FORCE_EXPLAINED else ""
    text = f"the law explains the force{steps} and the motion decays"
    if toggles:
        text += ", except for an encoder step that is not felt"
    low, high = _DEVICE_ALONE
    device_alone = design.known and low < mass / design.device.mass_kg < high
    return text if device_alone else text + "; a hand on the device may hide a wrong sign of the force"


def _of_sign(diagnosis: Diagnosis, law: FittedLaw, mass: float) -> Diagnosis | None:
    """Return the verdict of a force that pushes the device away from where it is none; None of one that does not."""
    log, device = diagnosis.log, diagnosis.design.device
    k, b = law.stiffness_n_per_m, law.damping_ns_per_m
    away = k < 0
    # A spring late by a tick that no lag explains is a damper of this size.
    drives = law.linear and k > 0 and b + law.damping_error_ns_per_m < -k * log.period_s
    # A mass that is not the device alone is a hand's too, and a hand may push the device away as well.
    low, high = _ABOUT_DEVICE
    alone = diagnosis.design.known and low < abs(mass) / device.mass_kg < high
    if law.linear and away and not math.isfinite(mass):
        way = "leave --flip-force out" if diagnosis.flip_force else "give --flip-force"
        text = (
            "cannot tell: the fitted force drives the device away, and the motion does not show whether it does; "
            f"{way} if the log has the other sign of force"
        )
        return replace(diagnosis, conclusion=text, candidates=("sign",), decides=CAUSES["sign"].deciding_log)
    if law.linear and away and not (alone and mass > 0):
        message = f"drives the device away from rest; allowed: {allowed_sign(flip_force=diagnosis.flip_force)}"
        raise InputError.of(f"{message}; otherwise the loop has a wrong sign", file=log.name, key="force")
    why = "the motor or the encoder is reversed"
    if away:
        why = "the spring"
    elif drives:
        why = "the damper"
    if drives or (alone and (mass < 0) != away):
        turned = Remedy("force_sign", -1.0, 1.0, "number")
        if drives:
            turned = Remedy("damping_ns_per_m", -b, b, "damping")
        elif away and b > 0:
            turned = Remedy("stiffness_n_per_m", -k, k, "stiffness")
        right_law = replace(law, stiffness_n_per_m=abs(k), damping_ns_per_m=abs(b))
        remedies = (turned,) if stable(Hypothesis(device, None), right_law) else ()
        text = f"{CAUSES['sign'].name}: the force pushes in the direction of the motion; {why}"
        return replace(
            diagnosis, verdict="named", cause="sign", candidates=("sign",), conclusion=text, remedies=remedies
        )
    if mass > 0 or diagnosis.swing.sustained or not law.linear:
        return None
    text = f"cannot tell: a hand pushes the device away, or the force does: {why}"
    return replace(diagnosis, conclusion=text, candidates=("sign",), decides=CAUSES["sign"].deciding_log)


@dataclass(frozen=True, eq=False)
class _Answer:
    """A hypothesis that the log bears out, with its evidence and the cause that it has."""

    fit: PlantFit
    hypothesis: Hypothesis
    weight: float
    cause: str


def _judge(diagnosis: Diagnosis, law: FittedLaw, fits: Sequence[PlantFit]) -> Diagnosis:
    """Return the verdict by the hypotheses that the log bears out, each weighed and then simulated."""
    log, design = diagnosis.log, diagnosis.design
    # Beside a noise that the log shows, a swing of few steps is one of little more than what the readings scatter by.
    scatter_m = fits[0].scatter_m
    noise_steps = diagnosis.swing.peak_to_peak_m / (math.sqrt(12) * scatter_m) if scatter_m else math.inf
    swing = replace(diagnosis.swing, steps=min(diagnosis.swing.steps, noise_steps))
    scene = LoggedScene.of(log, swing, law, design, scatter_m)
    answers = _answers(fits, law, log, swing, design)
    shares = _shares(answers)
    first = next(iter(shares))
    best = max((answer for answer in answers if answer.cause == first), key=lambda answer: answer.weight)
    fit = replace(best.fit, best=best.hypothesis)

    swings = scene.swings(fit.best, law)
    doubts = _doubts(first, fit, law, scene, diagnosis, shares)
    if not swings:
        doubts.append("simulated with these numbers the loop does not swing as the log does")
    outside = drives_from_outside(log, swing, law, fit.best)
    if outside:
        doubts = [outside] if fit.best.shake_hz is not None else [*doubts, outside]
    candidates: tuple[str, ...] = ()
    if shares.get(OTHER, 0.0) < _SURE:
        candidates = tuple(key for key in shares if key != OTHER)[:2]
    if law.overcompensates(design.device.coulomb_friction_n):
        candidates = tuple(dict.fromkeys((*candidates[:1], "relay")))
    mended = candidates
    if not doubts:
        mended = candidates[:1]
    elif first == OTHER or not swings or fit.misfit > _MISFIT_ASSUMED or outside:
        mended = ()

    hypotheses = _to_be_mended(best, answers, fits, log, design)
    remedies = [remedy for cause in mended for remedy in remedies_of(cause, hypotheses, law, scene, log, design)]
    if doubts and (unknown_mechanics(fit.best, design) or not design.known):
        # Neither delay nor hand beside unknown mechanics is to be relied on where the answer is in doubt.
        remedies = [remedy for remedy in remedies if not (remedy.while_held or remedy.key == "delay_samples")]
    diagnosis = replace(
        diagnosis,
        shares=shares,
        fit=fit,
        hand_determined=_hand_determined(fit, fits),
        remedies=tuple(dict.fromkeys(remedies)),
    )
    if not doubts:
        words = f"{CAUSES[first].name}: {cause_numbers(first, fit, law, log, diagnosis.swing, design)}"
        words += "; travel stops may limit the motion" if fit.best.stops is not None else ""
        return replace(diagnosis, verdict="named", cause=first, candidates=(first,), conclusion=words)
    names = " or ".join(CAUSES[key].name for key in candidates) or "none of the causes it knows"
    logs = [] if outside else [CAUSES[key].deciding_log for key in candidates]
    decides = "; or ".join(logs) or "the same log with the force off"
    words = f"cannot tell: {names}; {'; '.join(doubts)}"
    return replace(diagnosis, candidates=candidates, conclusion=words, decides=decides)


def _answers(
    fits: Sequence[PlantFit], law: FittedLaw, log: Log, swing: Oscillation, design: IntendedLaw
) -> list[_Answer]:
    """Return the best answer and the draws of each structure that the log bears out, with their causes.

    The weight of a structure, exp(-cost) of all, is shared by its answers.
    """
    plain_law = replace(law, switch=None, frames=None)
    special = ""
    if law.switch is not None:
        special = "relay"
    elif law.frames is not None:
        special = "rates"
    costs = np.array([fit.cost for fit in fits])
    odds = np.exp(-np.minimum(costs - fits[0].cost, 700.0))
    answers = []
    for fit, weight in zip(fits, (odds / odds.sum()).tolist(), strict=True):
        if weight <= _LEAST_WEIGHT:
            continue
        for hypothesis in (fit.best, *fit.draws):
            if special and stable(hypothesis, plain_law):
                cause = special
            else:
                cause = cause_of(hypothesis, plain_law, log, swing, design)
            answers.append(_Answer(fit, hypothesis, weight / (1 + len(fit.draws)), cause))
    return answers


def _shares(answers: Sequence[_Answer]) -> dict[str, float]:
    """Return the share of the evidence of each cause, the largest first."""
    total = sum(answer.weight for answer in answers)
    shares = {
        cause: sum(answer.weight for answer in answers if answer.cause == cause) / total
        for cause in dict.fromkeys(answer.cause for answer in answers)
    }
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def _hand_determined(best: PlantFit, fits: Sequence[PlantFit]) -> bool:
    """Return whether structures that explain the motion have a hand as the best one has, or none as it has none."""
    return all((fit.best.hand is None) == (best.best.hand is None) for fit in fits if fit.explains_as_well(best))


def _to_be_mended(
    best: _Answer, answers: Sequence[_Answer], fits: Sequence[PlantFit], log: Log, design: IntendedLaw
) -> list[Hypothesis]:
    """Return the hypotheses for which a remedy has to do, the best first."""
    total = sum(answer.weight for answer in answers)
    near_by = [answer.hypothesis for answer in answers if answer.weight > _NEAR_BY_SHARE * total]
    near_by = near_by[:: max(1, len(near_by) // _NEAR_BY_MOST)]
    if undeclared_mode(best.hypothesis, design) or not design.known:
        # The priors of a resonance and of an assumed device are a guess: each structure that explains the log counts.
        near_by += [fit.best for fit in fits if fit.explains_as_well(best.fit)]
    if not design.known:
        return [best.hypothesis, *near_by]
    # Damping is told the worst, and a delay not at all by noise: a remedy has to do for the declared ones too.
    declared = best.hypothesis.vary(
        mass_kg=design.device.mass_kg,
        damping_ns_per_m=design.device.damping_ns_per_m,
        delay_samples=max(best.hypothesis.delay, design.latest(log)),
    )
    return [best.hypothesis, *near_by, declared]


def _doubts(
    first: str, fit: PlantFit, law: FittedLaw, scene: LoggedScene, diagnosis: Diagnosis, shares: Mapping[str, float]
) -> list[str]:
    """Return the doubts about the first cause: odds, residual, and a simulation without it."""
    log, design, doubts = diagnosis.log, diagnosis.design, []
    if first == OTHER:
        return ["no single change makes the loop settle, or its model settles already"]
    if shares[first] < _SURE:
        names = {key: CAUSES[key].name if key in CAUSES else "another" for key in shares}
        parts = [f"{names[key]} {100 * share:.0f} %" for key, share in shares.items()]
        doubts.append(f"of the hypotheses that the log supports {', '.join(parts)}")
    if first != "relay" and law.overcompensates(design.device.coulomb_friction_n):
        doubts.append("more friction is compensated than there is, which drives a swing as well")
    most = _MISFIT if design.known else _MISFIT_ASSUMED
    if fit.misfit > most and first != "rate":
        doubts.append(f"the model leaves {number(fit.misfit, 3)} times what encoder and noise do")
    # Where the switched force is the cause, its first harmonic is what a damper has to matter beside.
    switched = law.switch.gain_n_per_m(diagnosis.swing.peak_to_peak_m / 2) if law.switch and first == "relay" else 0.0
    if law.leaves_damping_open(log.period_s, switched):
        doubts.append("the log does not determine b")
    beyond_declared = fit.best.delay + law.lag - design.latest(log)
    if fit.at_end or (first == "delay" and beyond_declared < 2 * fit.delay_error):
        doubts.append("the log does not determine the delay")
    resonates = undeclared_mode(fit.best, design)
    if (resonates and first in _BESIDE_RESONANCE) or (fit.best.stops is not None and first in _BESIDE_STOPS):
        doubts.append("a resonance or travel stops that are not declared explain the motion too")
    if first == "resonance" and late_alone(fit.best, law, log, design):
        doubts.append("without the delay beyond the declared one the loop settles too")
    if not _settles_without(first, fit.best, law, scene, diagnosis):
        doubts.append("simulated without it the loop swings too")
    return doubts


def _settles_without(
    cause: str, hypothesis: Hypothesis, law: FittedLaw, scene: LoggedScene, diagnosis: Diagnosis
) -> bool:
    """Return whether a simulation without a cause settles."""
    mended, mended_law = without(cause, hypothesis, law, diagnosis.log, diagnosis.design)
    # A device on which nothing acts any more goes on at its speed.
    if cause == "relay" and not (mended_law.stiffness_n_per_m or mended_law.damping_ns_per_m):
        return True
    if cause in {"stiffness", "damping", "let-go"}:
        return True
    exact = replace(scene, encoder_m=0.0, noise_m=0.0) if cause == "encoder" else scene
    return exact.decays(mended, mended_law)
