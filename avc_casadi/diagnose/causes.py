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
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number, quantity
from avc_casadi.coupling import Coupling
from avc_casadi.diagnose.law import FittedLaw, find_law
from avc_casadi.diagnose.oscillation import Log, Oscillation, apparent_mass_kg, find_oscillation, log_of
from avc_casadi.diagnose.plant import Hypothesis, IntendedLaw, PlantFit, fit_plants, growth, stable
from avc_casadi.diagnose.remedies import LoggedScene, Remedy, limit_of, remedies_of, without
from avc_casadi.identification.log import Columns
from avc_casadi.identification.read import Layout, read_columns
from avc_casadi.model.device import Device
from avc_casadi.model.problem import Hands, defaults_at
from avc_casadi.simulation.judge import QUIET, vibration_level

CAUSES: Mapping[str, tuple[str, str]] = {
    "sign": ("sign of the force", "a force pulse in free space"),
    "delay": ("delay", "a force pulse in free space"),
    "rate": ("sample rate too low", "the time stamps of the ticks themselves"),
    "stiffness": ("stiffness over the limit", "the same with k halved"),
    "damping": ("damping over the limit", "the same with b halved"),
    "let-go": ("hand released the device", "the same with the device held firmly, and released"),
    "resonance": ("resonance", "a chirp in free space (avc excite --signal chirp), for avc identify"),
    "relay": ("force switched by a sign", "the same without the switched force"),
    "rates": ("two rates in one loop", "the same with one rate"),
    "encoder": ("encoder steps or noise", "the same with b halved, or with a filter of the velocity"),
}
"""Causes by key: in words, and the log that would decide."""

Verdict = Literal["named", "cannot tell", "nothing wrong", "not the loop"]
# A cause is named at odds of two to one. Below so many encoder steps quantisation alone may sustain a swing.
_SURE, _FEW_STEPS, _OTHER, _FEWEST, _MISFIT = 2 / 3, 14.0, "other", 60, 12.0


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The diagnosis of one log."""

    log: Log
    swing: Oscillation
    law: FittedLaw | None
    design: IntendedLaw
    verdict: Verdict
    conclusion: str
    cause: str | None = None
    candidates: tuple[str, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)
    decides: str = ""
    remedies: tuple[Remedy, ...] = ()
    fit: PlantFit | None = None
    notes: tuple[str, ...] = ()

    def data(self) -> dict[str, Any]:
        """Return its JSON values."""
        log, swing, law, fit, units = self.log, self.swing, self.law, self.fit, self.design.device.units
        oscillation = {key: value for key, value in vars(swing).items() if key not in {"fast_m", "envelope_m"}}
        estimates = None
        if fit is not None and law is not None:
            one, each = fit.best, self.design.samples_a_tick(log)
            estimates = {
                "delay_samples": (one.delay + law.lag) * each,
                "delay_error_samples": fit.delay_error * each,
                "misfit": fit.misfit,
                "stops_m": one.stops,
                # Where between two samples a stop lies the log does not tell.
                "stops_error_m": one.stops and float(np.abs(np.diff(log.position_m[swing.first : swing.last])).max()),
                **{key: getattr(one.device, key) for key in ("mass_kg", "damping_ns_per_m")},
                "hand": one.hand and one.hand.values(0),
                "resonance": one.device.resonance and one.device.resonance.model_dump(),
            }
        document = {
            "log": log.name,
            "seconds": float(log.position_m.size * log.period_s),
            **{
                key: getattr(self, key) for key in ("verdict", "cause", "candidates", "conclusion", "shares", "decides")
            },
            "notes": self.notes,
            "remedies": [{**asdict(one), "key": units.key(one.key)} for one in self.remedies],
            "oscillation": {**oscillation, "sustained": swing.sustained},
            "sample_time_s": log.period_s,
            "missed_share": log.missed_share,
            "encoder_resolution_m": log.encoder_m or None,
            "law": law and {**asdict(law), "explains": law.explains, "filter_hz": law.filter_hz(log.period_s)},
            "measured": estimates,
        }
        return plain_table(document)


def diagnose(
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
    """Diagnose one log of time, position and commanded force."""
    columns = log if isinstance(log, Columns) else read_columns(log, layout)
    if coupling is not None:
        device, hands = device or coupling.problem.device, hands or coupling.problem.hands
    if (count := columns.time_s.size) < _FEWEST:
        raise InputError.of(f"has {count} samples; allowed: at least {_FEWEST}", file=columns.file, key="time")
    grid, notes = log_of(columns, flip_force=flip_force)
    design = _design(device, hands, grid, columns, handle_radius_m)
    notes += [] if design.known else ["no device given: a usual one is assumed, up to 50 times off; give --device"]
    limit = design.device.max_force_n
    if limit is not None and np.mean(np.abs(grid.force_n) > 1.01 * limit) > 1e-3:
        notes.append("the log commands more than max_force_n, which is not used: is the limit, or a unit, another one?")
        design, limit = replace(design, device=design.device.model_copy(update={"max_force_n": None})), None
    with progress.step("oscillation and force"):
        swing = find_oscillation(grid, limit)
        law = find_law(grid, swing, limit, design.device.coulomb_friction_n)
    whole = Diagnosis(grid, swing, law, design, "cannot tell", "", notes=tuple(notes))
    if isinstance(model := _at_once(whole), Diagnosis):
        return model
    with progress.step("device, hand, causes and remedies"):
        return _judge(whole, model, fit_plants(grid, swing, design, model.lag, seed))


def _design(
    device: Device | None, hands: Hands | None, log: Log, columns: Columns, radius_m: float | None
) -> IntendedLaw:
    """Return the intended loop, a usual device on a desk where none is given; refuse a log that is not of it."""
    message = ""
    if device is not None and device.motion != columns.motion:
        message = f"is {columns.motion} by its units, and the device is {device.motion}; allowed: its own motion"
    elif device is None and columns.motion == "rotary" and radius_m is None:
        message = "is of a device that turns; allowed: with --handle-radius-m, where the hand holds it, or --device"
    elif not np.ptp(log.position_m) and np.ptp(log.force_n):
        message = "never changes, and the force does; allowed: a device that moves; is the encoder stuck?"
    if message:
        raise InputError.of(message, file=columns.file, key="position")
    reach, known = (radius_m or 1.0) if device is None else device.metres_per_unit, device is not None
    if device is None:
        turns: dict[str, object] = {"handle_radius_m": reach} if columns.motion == "rotary" else {}
        usual = {"mass_kg": 0.1 * reach**2, "damping_ns_per_m": reach**2, "delay_samples": 1}
        device = Device.model_validate({"motion": columns.motion, "sample_time_s": log.sample_time_s, **usual, **turns})
    return IntendedLaw(device, known, hands or Hands.model_validate(defaults_at(Hands, reach)))


def _at_once(diagnosis: Diagnosis) -> Diagnosis | FittedLaw:
    """Return the verdict that needs no loop model, or the law of one that does."""
    log, swing, law, design = diagnosis.log, diagnosis.swing, diagnosis.law, diagnosis.design
    text, decides, verdict, mass = "", "", diagnosis.verdict, apparent_mass_kg(log, design.device, known=design.known)
    toggles = swing.sustained and _toggles(log, swing, design.device)
    if swing.sustained and swing.contact_share == 0:
        text, verdict = "it swings while no force is commanded; a hand, a cable or the table moves it", "not the loop"
    elif law is None or not law.explains:
        text = "the force is not that of a spring and a damper on the position, nor of a switch or two rates"
        text = text if law is not None or log.force_n.any() else "no force is commanded"
        decides = "the same with a spring and a damper alone, unlimited, and with the position that the law reads"
    elif not (law.switch or law.frames) and (sign := _of_sign(diagnosis, law, mass)) is not None:
        return sign
    elif swing.sustained and max(log.uneven_share, log.missed_share) > 0.12:
        text = "ticks come at uneven times or are missing, and no loop model fits"
        decides = "the same log on an even clock"
    elif swing.sustained and not toggles:
        return law
    elif law.switch is None and _rests(log, swing, design.device.max_force_n):
        text, verdict = "the force is explained and the motion decays", "nothing wrong"
        text += ", but for an encoder step that is not felt" if toggles else ""
        device_alone = design.known and 0.8 < mass / design.device.mass_kg < 1.25  # the force moves the device alone
        text += "" if device_alone else "; what holds the device may hide a wrong sign of the force"
    else:
        text = "nothing swings, and no motion decays under the force either"
        decides = "a log of a press, a push or a release"
    return replace(diagnosis, verdict=verdict, conclusion=f"{verdict}: {text}", decides=decides)


def _of_sign(diagnosis: Diagnosis, law: FittedLaw, mass: float) -> Diagnosis | None:
    """Return the verdict of a force that pushes the device away from where it is none; None of one that does not."""
    log, device, k, b = diagnosis.log, diagnosis.design.device, law.stiffness_n_per_m, law.damping_ns_per_m
    # A spring late by a tick that no lag explains is a damper of this size.
    away, drives = k < 0, k > 0 and b + law.damping_error_ns_per_m < -k * log.period_s
    # A mass that is not the device alone is a hand's too, and a hand may push the device away as well.
    alone = diagnosis.design.known and 0.5 < abs(mass) / device.mass_kg < 2
    if away and not (alone and mass > 0):
        message = "drives the device away from its equilibrium; allowed: force along +position, or --flip-force"
        raise InputError.of(f"{message}; or the sign of the loop is wrong", file=log.name, key="force")
    why = "the spring" if away else "the damper" if drives else "the motor or the encoder is reversed"
    if drives or (alone and (mass < 0) != away):
        damper, spring = Remedy("damping_ns_per_m", -b, b, "damping"), Remedy("stiffness_n_per_m", -k, k, "stiffness")
        turn = damper if drives else spring if away and b > 0 else None
        right = stable(Hypothesis(device, None), replace(law, stiffness_n_per_m=abs(k), damping_ns_per_m=abs(b)))
        cures = (turn or Remedy("force_sign", -1.0, 1.0, "number"),) if right else ()
        text = f"{CAUSES['sign'][0]}: it pushes the way the device moves; {why}"
        return replace(diagnosis, verdict="named", cause="sign", candidates=("sign",), conclusion=text, remedies=cures)
    if mass > 0 or diagnosis.swing.sustained:
        return None
    text = f"cannot tell: a hand pushes the device away, or the force does: {why}"
    return replace(diagnosis, conclusion=text, candidates=("sign",), decides=CAUSES["sign"][1])


def _toggles(log: Log, swing: Oscillation, device: Device) -> bool:
    """Return whether a swing is one step to either side that nobody feels, as it reads or as the force moves a mass."""
    x, force = (each[(swing.first + swing.last) // 2 : swing.last] for each in (log.position_m, log.force_n))
    reads, turn = np.fft.rfft(x), 2 * math.pi * np.fft.rfftfreq(x.size, log.period_s)
    shakes = np.fft.rfft(force) / (device.mass_kg * np.maximum(turn, turn[1]) ** 2)
    moves = np.fft.irfft(np.where(np.abs(shakes) < np.abs(reads), shakes, reads), x.size)
    felt = vibration_level(device.metres_per_unit * moves, log.period_s)
    return bool(np.ptp(x) < 2.5 * log.encoder_m and felt < QUIET)


def _rests(log: Log, swing: Oscillation, limit_n: float | None) -> bool:
    """Return whether a motion in contact comes to rest, and not at the force limit."""
    envelope = swing.envelope_m
    late, most = float(np.median(envelope[-max(envelope.size // 5, 5) :])), float(envelope.max())
    rests = swing.kind == "decaying" or late < max(1.5 * log.encoder_m, 0.3 * most)
    rests = rests and most > 1.5 * log.encoder_m and abs(log.force_n[-1]) < 0.999 * (limit_n or math.inf)
    return bool(rests and log.touching[envelope > 0.3 * most].mean() > 0.5)


def cause_of(one: Hypothesis, law: FittedLaw, log: Log, swing: Oscillation, design: IntendedLaw) -> str:
    """Return the change with which the loop of one rate settles."""
    slower = (design.known and design.samples_a_tick(log) > 1) or log.hold > 1
    if stable(one, law):
        return "encoder" if swing.steps < _FEW_STEPS else _OTHER
    if slower and stable(*without("rate", one, law, log, design)):
        return "rate"
    if one.delay + law.lag > design.latest(log) + 0.35 and stable(*without("delay", one, law, log, design)):
        return "delay"
    if one.hand is None and _had_rest(log, swing, growth(one, law)):
        return "let-go"
    if one.device.resonance is not None and stable(*without("resonance", one, law, log, design)):
        return "resonance"
    limits = {limit_of(one, law, gain): gain for gain in ("damping", "stiffness")}
    return limits[max(limits)] if max(limits) else _OTHER


def _had_rest(log: Log, swing: Oscillation, growth_per_s: float) -> bool:
    """Return whether a motion in contact, small beside the swing, came to less than what grows as the swing does."""
    cycle = max(round(1 / swing.frequency_hz / log.period_s), 2)
    size = np.ptp(np.lib.stride_tricks.sliding_window_view(log.position_m, min(cycle, log.position_m.size)), axis=1)
    at = np.flatnonzero(log.touching[: size.size])
    level = np.log(np.maximum(size[at], log.encoder_m + 1e-12)) - growth_per_s * log.period_s * at
    fell = (np.maximum.accumulate(level) - level)[size[at] < 0.15 * swing.peak_to_peak_m]
    return bool(fell.max(initial=0.0) > 3)


def _judge(diagnosis: Diagnosis, law: FittedLaw, every: Sequence[PlantFit]) -> Diagnosis:
    """Return the verdict by the hypotheses that the log bears out, each weighed and then simulated."""
    log, swing, design = diagnosis.log, diagnosis.swing, diagnosis.design
    plain_law = replace(law, switch=None, frames=None)
    special = "relay" if law.switch is not None else "rates" if law.frames is not None else ""
    # Beside a noise that the log shows, a swing of few steps is one of little more than what the readings scatter by.
    grain = math.sqrt(12) * every[0].scatter_m
    swing = replace(swing, steps=min(swing.steps, swing.peak_to_peak_m / grain if grain else math.inf))
    scene = LoggedScene.of(log, swing, law, design, every[0].scatter_m)
    odds = np.exp(-np.minimum(np.array([fit.cost for fit in every]) - every[0].cost, 700.0))
    answers: list[tuple[PlantFit, Hypothesis, float, str]] = []
    for fit, weight in zip(every, (odds / odds.sum()).tolist(), strict=True):
        for one in (fit.best, *fit.draws) if weight > 1e-3 else ():
            cause = special if special and stable(one, plain_law) else cause_of(one, plain_law, log, swing, design)
            answers.append((fit, one, weight / (1 + len(fit.draws)), cause))
    total = sum(weight for _, _, weight, _ in answers)
    sums = {key: sum(weight for *_, weight, cause in answers if cause == key) / total for *_, key in answers}
    shares, first = dict(sorted(sums.items(), key=lambda item: -item[1])), max(sums, key=lambda key: sums[key])
    fit, one, _, _ = max((each for each in answers if each[3] == first), key=lambda each: each[2])
    swings = scene.swings(one, law)
    doubts = _doubts(first, replace(fit, best=one), law, scene, diagnosis, shares)
    doubts += [] if swings else ["simulated with these numbers the loop does not swing as the log does"]
    candidates = tuple(key for key in shares if key != _OTHER)[:2] if shares.get(_OTHER, 0.0) < _SURE else ()
    if outside := work_w(log, swing, one) < 0 and swing.steps > _FEW_STEPS:
        doubts.append("the force as it acts takes energy from the swing: a hand, the table or a machine drives it")
    causes = (() if not swings or fit.misfit > _MISFIT / 3 or outside else candidates) if doubts else candidates[:1]
    near_by = [each for _, each, weight, _ in answers if weight > 0.01 * total]
    # Damping is told the worst, and a delay not at all by noise: a remedy has to do for the declared ones too.
    own, late = design.device, max(one.delay, design.latest(log))
    intended = one.vary(mass_kg=own.mass_kg, damping_ns_per_m=own.damping_ns_per_m, delay_samples=late)
    # The prior of an assumed device is a guess: each structure that explains the log counts.
    others = [intended] if design.known else [each.best for each in every if each.misfit < max(1.0, 1.3 * fit.misfit)]
    several = [one, *near_by[:: max(1, len(near_by) // 8)], *others]
    cures = [cure for key in causes for cure in remedies_of(key, several, law, scene, log, design)]
    # Neither delay nor hand of an assumed device is to be relied on where the answer is in doubt.
    sure = design.known or not doubts
    cures = [cure for cure in cures if sure or not (cure.while_held or cure.key == "delay_samples")]
    diagnosis = replace(diagnosis, shares=shares, fit=replace(fit, best=one), remedies=tuple(dict.fromkeys(cures)))
    if not doubts:
        words = f"{CAUSES[first][0]}: {_numbers(first, one, law, diagnosis)}"
        words += "; travel stops bound the swing" if one.stops is not None else ""
        return replace(diagnosis, verdict="named", cause=first, candidates=(first,), conclusion=words)
    names = " or ".join(CAUSES[key][0] for key in candidates) or "none of the causes it knows"
    decides = "; or ".join(CAUSES[key][1] for key in candidates if not outside) or "the same log with the force off"
    words = f"cannot tell: {names}; {'; '.join(doubts)}"
    return replace(diagnosis, candidates=candidates, conclusion=words, decides=decides)


def _doubts(
    first: str, fit: PlantFit, law: FittedLaw, scene: LoggedScene, diagnosis: Diagnosis, shares: Mapping[str, float]
) -> list[str]:
    """Return the doubts about the first cause: odds, residual, and a simulation without it."""
    one, log, design, doubts = fit.best, diagnosis.log, diagnosis.design, []
    if first == _OTHER:
        return ["no single change makes the loop settle, or its model settles already"]
    if shares[first] < _SURE:
        parts = (f"{CAUSES.get(key, ('another',))[0]} {100 * share:.0f} %" for key, share in shares.items())
        doubts.append(f"of the hypotheses that the log bears out {', '.join(parts)}")
    # An assumed device is free to explain much that it did not do.
    if fit.misfit > (_MISFIT if design.known else _MISFIT / 3) and first != "rate":
        doubts.append(f"the model leaves {number(fit.misfit, 3)} times what encoder and noise do")
    # What a third of a sample of delay does as well matters no more.
    if law.damping_error_ns_per_m > max(abs(law.damping_ns_per_m), abs(law.stiffness_n_per_m) * log.period_s / 3):
        doubts.append("the log does not tell b")
    if fit.at_end or (first == "delay" and one.delay + law.lag - design.latest(log) < 2 * fit.delay_error):
        doubts.append("the log does not tell the delay")
    exact = replace(scene, encoder_m=0.0, noise_m=0.0) if first == "encoder" else scene
    right, its = without(first, one, law, log, design)
    # A device on which nothing acts any more goes on at its speed.
    free = first == "relay" and not (its.stiffness_n_per_m or its.damping_ns_per_m)
    settles = free or first in {"stiffness", "damping", "let-go"} or exact.decays(right, its)
    return doubts if settles else [*doubts, "simulated without it the loop swings too"]


def work_w(log: Log, swing: Oscillation, one: Hypothesis) -> float:
    """Return the mean power of the force on the device over whole cycles, the force as it acts: late and held."""
    inside = log.position_m[swing.first : swing.last]
    rises = swing.first + np.flatnonzero((inside[1:] > inside.mean()) & (inside[:-1] <= inside.mean())) + 1
    if rises.size < 2:
        return 0.0
    ticks = np.arange(int(rises[0]), int(rises[-1]))
    # The force of a tick acts from its delay on.
    acts = np.interp(ticks - one.delay, np.arange(log.force_n.size), log.force_n)
    moves = log.position_m[ticks + 1] - log.position_m[ticks]
    return -float(np.sum(acts * moves)) / (ticks.size * log.period_s)


def _numbers(cause: str, one: Hypothesis, law: FittedLaw, diagnosis: Diagnosis) -> str:
    """Return the numbers of a cause, without which the loop settles."""
    log, mode, switch, frames, unit = diagnosis.log, one.device.resonance, law.switch, law.frames, one.device.units.unit
    spring, damper = quantity(law.stiffness_n_per_m, unit("N/m")), quantity(law.damping_ns_per_m, unit("N.s/m"))
    intended = f"{number(diagnosis.design.delay_samples[1], 3)} {'declared' if diagnosis.design.known else 'assumed'}"
    alone = ", with no hand on the device" if one.hand is None else ""
    behind = frames.late if frames else law.lag
    late = f", {number(behind, 2)} of them late" if behind else ""
    return {
        "delay": f"{number((one.delay + law.lag) * diagnosis.design.samples_a_tick(log), 3)} samples, {intended}",
        "rate": f"a new force every {number(1e3 * log.period_s, 3)} ms{late}",
        "stiffness": f"k = {spring}{alone}",
        "damping": f"b = {damper}{alone}",
        "let-go": "it rested in contact before; without a hand it swings",
        "resonance": f"{number(mode.frequency_hz, 3)} Hz, not declared" if mode else "",
        "relay": f"{quantity(abs(switch.force_n), unit('N'))} by the sign of the {switch.by}" if switch else "",
        "rates": f"the {frames.slow} is new every {number(1e3 * frames.ticks * log.period_s, 3)} ms{late}"
        if frames
        else "",
        "encoder": f"{number(diagnosis.swing.steps, 2)} steps peak to peak, b = {damper}",
    }[cause]
