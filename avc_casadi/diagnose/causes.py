"""Causes of an oscillation: the one change with which the loop that the log shows would settle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number, quantity
from avc_casadi.coupling import Coupling
from avc_casadi.diagnose.law import Law, find_law
from avc_casadi.diagnose.oscillation import Log, Oscillation, find_oscillation, log_of
from avc_casadi.diagnose.plant import Declared, Fit, Hypothesis, fit_plants, growth, stable
from avc_casadi.diagnose.remedies import Remedy, Scene, limit_of, remedies_of, without
from avc_casadi.identification.log import Columns
from avc_casadi.identification.read import Layout, read_columns
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Hands, defaults_at

CAUSES: Mapping[str, tuple[str, str]] = {
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
    law: Law | None
    declared: Declared
    verdict: Verdict
    conclusion: str
    cause: str | None = None
    candidates: tuple[str, ...] = ()
    shares: Mapping[str, float] = field(default_factory=dict)
    decides: str = ""
    remedies: tuple[Remedy, ...] = ()
    fit: Fit | None = None
    notes: tuple[str, ...] = ()

    def data(self) -> dict[str, Any]:
        """Return its JSON values."""
        swing, law, fit, units, period = self.swing, self.law, self.fit, self.declared.device.units, self.log.period_s
        plainly = ("verdict", "cause", "candidates", "conclusion", "shares", "decides", "notes")
        oscillation = {key: value for key, value in vars(swing).items() if key not in {"fast_m", "envelope_m"}}
        measured = None
        if fit is not None and law is not None:
            measured = {
                "delay_samples": fit.best.delay + law.lag,
                "delay_error_samples": fit.delay_error,
                "misfit": fit.misfit,
                "stops_m": fit.best.stops,
                # Where between two samples a stop lies the log does not tell.
                "stops_error_m": fit.best.stops
                and float(np.abs(np.diff(self.log.position_m[swing.first : swing.last])).max()),
                "mass_kg": fit.best.device.mass_kg,
                "damping_ns_per_m": fit.best.device.damping_ns_per_m,
                "hand": fit.best.hand and fit.best.hand.values(0),
                "resonance": fit.best.device.resonance and fit.best.device.resonance.model_dump(),
            }
        document = {
            "log": self.log.name,
            "seconds": float(self.log.position_m.size * period),
            **{key: getattr(self, key) for key in plainly},
            "remedies": [{**asdict(one), "key": units.key(one.key)} for one in self.remedies],
            "oscillation": {**oscillation, "sustained": swing.sustained},
            "sample_time_s": period,
            "missed_share": self.log.missed_share,
            "encoder_resolution_m": self.log.encoder_m or None,
            "law": law and {**asdict(law), "explains": law.explains, "filter_hz": law.filter_hz(period)},
            "measured": measured,
        }
        return dict(plain(document))


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
    if columns.time_s.size < _FEWEST:
        message = f"has {columns.time_s.size} samples; allowed: at least {_FEWEST}"
        raise InputError.of(message, file=columns.file, key="time")
    grid, notes = log_of(columns, flip_force=flip_force)
    declared = _declared(device, hands, grid, columns, handle_radius_m)
    if not declared.known:
        notes.append("no device is given: a usual one is assumed, which may be 50 times off; better: --device")
    limit = declared.device.max_force_n
    if limit is not None and np.mean(np.abs(grid.force_n) > 1.01 * limit) > 1e-3:
        notes.append("the log commands more than max_force_n, which is not used: is the limit, or a unit, another one?")
        wide = declared.device.range.model_copy(update={"max_force_n": None})
        free = declared.device.model_copy(update={"max_force_n": None, "range": wide})
        declared, limit = replace(declared, device=free), None
    with progress.step("oscillation and force"):
        swing = find_oscillation(grid, limit)
        law = find_law(grid, swing, limit, declared.device.coulomb_friction_n)
    if law is not None and law.explains and law.stiffness_n_per_m < 0 and law.damping_ns_per_m < 0:
        raise InputError.of(
            "drives the device away from its equilibrium; allowed: force along +position, or --flip-force; or the sign "
            "of the loop is wrong",
            file=columns.file,
            key="force",
        )
    whole = Diagnosis(grid, swing, law, declared, "cannot tell", "", notes=tuple(notes))
    model = _at_once(whole)
    if isinstance(model, Diagnosis):
        return model
    with progress.step("device and hand"):
        fits = fit_plants(grid, swing, declared, model.lag, seed)
    with progress.step("causes and remedies"):
        return _judged(whole, model, fits)


def _declared(
    device: Device | None, hands: Hands | None, log: Log, columns: Columns, radius_m: float | None
) -> Declared:
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
    reach = (radius_m or 1.0) if device is None else device.metres_per_unit
    known = device is not None
    if device is None:
        turns: dict[str, object] = {"handle_radius_m": reach} if columns.motion == "rotary" else {}
        usual = {"mass_kg": 0.1 * reach**2, "damping_ns_per_m": reach**2, "delay_samples": 1}
        device = Device.model_validate({"motion": columns.motion, "sample_time_s": log.sample_time_s, **usual, **turns})
    return Declared(device, known, hands or Hands.model_validate(defaults_at(Hands, reach)))


def _at_once(found: Diagnosis) -> Diagnosis | Law:
    """Return the verdict that needs no loop model, or the law of one that does."""
    log, swing, law = found.log, found.swing, found.law
    if swing.sustained and swing.contact_share == 0:
        said = "not the loop: it swings while no force is commanded; a hand, a cable or the table moves it"
        return replace(found, verdict="not the loop", conclusion=said)
    if law is None or not law.explains:
        said = "the force is not that of a spring and a damper on the position, nor of a switch or two rates"
        said = said if law is not None or log.force_n.any() else "no force is commanded"
        decides = "the same with a spring and a damper alone, unlimited, and with the position that the law reads"
        return replace(found, conclusion=f"cannot tell: {said}", decides=decides)
    if swing.sustained and max(log.uneven_share, log.missed_share) > 0.12:
        said = "cannot tell: ticks come at uneven times or are missing, and no loop model fits"
        return replace(found, conclusion=said, decides="the same log on an even clock")
    if swing.sustained:
        return law
    envelope = swing.envelope_m
    late, most = float(np.median(envelope[-max(envelope.size // 5, 5) :])), float(envelope.max())
    rests = swing.kind == "decaying" or late < max(1.5 * log.encoder_m, 0.3 * most)
    if rests and most > 1.5 * log.encoder_m and log.touching[envelope > 0.3 * most].mean() > 0.5 and not law.switch:
        said = "nothing wrong: the force is explained and the motion decays"
        return replace(found, verdict="nothing wrong", conclusion=said)
    said = "cannot tell: nothing swings, and no motion decays under the force either"
    return replace(found, conclusion=said, decides="a log of a press, a push or a release")


def causes_of(one: Hypothesis, law: Law, log: Log, swing: Oscillation, declared: Declared) -> dict[str, float]:
    """Return the changes with which the loop of one rate settles, with shares."""
    slower = declared.known and log.period_s > 1.3 * declared.device.sample_time_s
    meant = declared.delays_in(log)[1]
    if stable(one, law):
        return {"encoder" if swing.steps < _FEW_STEPS else _OTHER: 1.0}
    if (slower or log.held > 1) and stable(*without("rate", one, law, log, declared)):
        return {"rate": 1.0}
    if one.delay + law.lag > meant + 0.35 and stable(*without("delay", one, law, log, declared)):
        return {"delay": 1.0}
    if _released(one, declared) and _was_held(log, swing, growth(one, law)[0]):
        return {"let-go": 1.0}
    if one.device.resonance is not None and stable(*without("resonance", one, law, log, declared)):
        return {"resonance": 1.0}
    limits = {gain: limit_of(one, law, gain) or 0.0 for gain in ("stiffness", "damping")}
    nearest = max(limits, key=lambda gain: limits[gain])
    return {nearest if limits[nearest] else _OTHER: 1.0}


def _released(one: Hypothesis, declared: Declared) -> bool:
    """Return whether nothing that is a hand holds the device."""
    if not (isinstance(one.hand, Hand) and declared.known):
        return one.hand is None
    mass, damping, _ = one.hand.values(0).values()
    return mass < 0.35 * declared.hands.mass_kg[0] and damping < 0.7 * declared.hands.damping_ns_per_m[0]


def _was_held(log: Log, swing: Oscillation, growth_per_s: float) -> bool:
    """Return whether a motion in contact, small beside the swing, came to less than what grows as the swing does."""
    cycle = max(round(1 / swing.frequency_hz / log.period_s), 2)
    size = np.ptp(np.lib.stride_tricks.sliding_window_view(log.position_m, min(cycle, log.position_m.size)), axis=1)
    at = np.flatnonzero(log.touching[: size.size])
    level = np.log(np.maximum(size[at], log.encoder_m + 1e-12)) - growth_per_s * log.period_s * at
    fell = (np.maximum.accumulate(level) - level)[size[at] < 0.15 * swing.peak_to_peak_m]
    return bool(fell.max(initial=0.0) > 3)


def _judged(found: Diagnosis, law: Law, every: Sequence[Fit]) -> Diagnosis:
    """Return the verdict by the hypotheses that the log bears out, each weighed and then simulated."""
    log, swing, declared = found.log, found.swing, found.declared
    plain_law = replace(law, switch=None, frames=None)
    special = "relay" if law.switch is not None else "rates" if law.frames is not None else ""
    # Beside a noise that the log shows, a swing of few steps is one of little more than what the readings scatter by.
    grain = math.sqrt(12) * every[0].scatter_m
    swing = replace(swing, steps=min(swing.steps, swing.peak_to_peak_m / grain if grain else math.inf))
    scene = Scene.of(log, swing, law, declared, every[0].scatter_m)
    # Of answers that explain the log about as well, those count that swing about as far in simulation.
    near = [fit for fit in every if fit.cost < every[0].cost + 7]
    fits = [fit for fit in near if len(near) > 1 and scene.swings(fit.best, law)] or list(every)
    odds = np.exp(-np.minimum(np.array([fit.cost for fit in fits]) - fits[0].cost, 700.0))
    answers: list[tuple[Fit, Hypothesis, float, dict[str, float]]] = []
    for fit, weight in zip(fits, (odds / odds.sum()).tolist(), strict=True):
        for one in (fit.best, *fit.draws) if weight > 1e-3 else ():
            alone = special and stable(one, plain_law)
            causes = {special: 1.0} if alone else causes_of(one, plain_law, log, swing, declared)
            answers.append((fit, one, weight / (1 + len(fit.draws)), causes))
    total = sum(weight for _, _, weight, _ in answers)
    sums: dict[str, float] = {}
    for _, _, weight, causes in answers:
        for key, share in causes.items():
            sums[key] = sums.get(key, 0.0) + share * weight / total
    shares = dict(sorted(sums.items(), key=lambda item: -item[1]))
    first = next(iter(shares))
    fit, one, _, _ = max(
        (each for each in answers if each[3].get(first, 0.0) >= 0.5), key=lambda each: each[2], default=answers[0]
    )
    swings = scene.swings(one, law)
    doubts = _doubts(first, replace(fit, best=one), law, scene, found, shares)
    doubts += [] if swings else ["simulated with these numbers the loop does not swing as the log does"]
    candidates = tuple(key for key in shares if key != _OTHER)[:2] if shares.get(_OTHER, 0.0) < _SURE else ()
    outside = work_w(log, swing, one) < 0 and swing.steps > _FEW_STEPS
    if outside:
        doubts.append("the force as it acts takes energy from the swing: a hand, the table or a machine drives it")
    tried = (() if not swings or fit.misfit > _MISFIT / 3 or outside else candidates) if doubts else candidates[:1]
    near_by = [each for _, each, weight, _ in answers if weight > 0.01 * total]
    # Damping is told the worst, and a delay not at all by noise: a remedy has to do for the declared ones too.
    own, late = declared.device, max(one.delay, declared.delays_in(log)[1])
    meant = one.changed(mass_kg=own.mass_kg, damping_ns_per_m=own.damping_ns_per_m, delay_samples=late)
    # The prior of an assumed device is a guess: each structure that explains the log counts.
    others = [meant] if declared.known else [each.best for each in every if each.misfit < max(1.0, 1.3 * fit.misfit)]
    several = [one, *near_by[:: max(1, len(near_by) // 8)], *others]
    cures = [cure for key in tried for cure in remedies_of(key, several, law, scene, log, declared)]
    # The delay of an assumed device is no number to change where the answer is in doubt.
    cures = [cure for cure in cures if declared.known or not doubts or cure.key != "delay_samples"]
    found = replace(found, shares=shares, fit=replace(fit, best=one), remedies=tuple(dict.fromkeys(cures)))
    if not doubts:
        words = f"{CAUSES[first][0]}: {_numbers(first, one, law, found)}"
        words += "; travel stops bound the swing" if one.stops is not None else ""
        return replace(found, verdict="named", cause=first, candidates=(first,), conclusion=words)
    names = " or ".join(CAUSES[key][0] for key in candidates) or "none of the causes it knows"
    decides = "; or ".join(CAUSES[key][1] for key in candidates if not outside) or "the same log with the force off"
    said = f"cannot tell: {names}; {'; '.join(doubts)}"
    return replace(found, candidates=candidates, conclusion=said, decides=decides)


def _doubts(first: str, fit: Fit, law: Law, scene: Scene, found: Diagnosis, shares: Mapping[str, float]) -> list[str]:
    """Return the doubts about the first cause: odds, residual, and a simulation without it."""
    one, log, declared = fit.best, found.log, found.declared
    if first == _OTHER:
        return ["no single change makes the loop settle, or its model settles already"]
    doubts = []
    if shares[first] < _SURE:
        parts = (f"{CAUSES.get(key, ('another',))[0]} {100 * share:.0f} %" for key, share in shares.items())
        doubts.append(f"of the hypotheses that the log bears out {', '.join(parts)}")
    # An assumed device is free to explain much that it did not do.
    if fit.misfit > (_MISFIT if declared.known else _MISFIT / 3) and first != "rate":
        doubts.append(f"the model leaves {number(fit.misfit, 3)} times what encoder and noise do")
    meant = declared.delays_in(log)[1]
    if fit.at_end or (first == "delay" and one.delay + law.lag - meant < 2 * fit.delay_error):
        doubts.append("the log does not tell the delay")
    exact = replace(scene, encoder_m=0.0, noise_m=0.0) if first == "encoder" else scene
    settles = first in {"stiffness", "damping", "let-go"} or exact.settles(*without(first, one, law, log, declared))
    return doubts if settles else [*doubts, "simulated without it the loop swings too"]


def work_w(log: Log, swing: Oscillation, one: Hypothesis) -> float:
    """Return the mean power of the force on the device over whole cycles, the force as it acts: late and held."""
    inside = log.position_m[swing.first : swing.last]
    rises = swing.first + np.flatnonzero((inside[1:] > inside.mean()) & (inside[:-1] <= inside.mean())) + 1
    if rises.size < 2:
        return 0.0
    ticks = np.arange(int(rises[0]), int(rises[-1]))
    whole, part = int(one.delay), one.delay % 1.0
    # The force of a tick acts from its delay on.
    acts = (1 - part) * log.force_n[np.maximum(ticks - whole, 0)] + part * log.force_n[np.maximum(ticks - whole - 1, 0)]
    moved = log.position_m[ticks + 1] - log.position_m[ticks]
    return -float(np.sum(acts * moved)) / (ticks.size * log.period_s)


def _numbers(cause: str, one: Hypothesis, law: Law, found: Diagnosis) -> str:
    """Return the numbers of a cause, without which the loop settles."""
    log, mode, switch, frames, unit = found.log, one.device.resonance, law.switch, law.frames, one.device.units.unit
    spring, damper = quantity(law.stiffness_n_per_m, unit("N/m")), quantity(law.damping_ns_per_m, unit("N.s/m"))
    meant = f"{number(found.declared.delays_in(found.log)[1], 3)} {'declared' if found.declared.known else 'assumed'}"
    alone = ", with no hand on the device" if _released(one, found.declared) else ""
    return {
        "delay": f"{number(one.delay + law.lag, 3)} samples, {meant}",
        "rate": f"a new force every {number(1e3 * log.period_s, 3)} ms",
        "stiffness": f"k = {spring}{alone}",
        "damping": f"b = {damper}{alone}",
        "let-go": "it rested in contact before; without a hand it swings",
        "resonance": f"{number(mode.frequency_hz, 3)} Hz, not declared" if mode else "",
        "relay": f"{quantity(abs(switch.force_n), unit('N'))} by the sign of the {switch.by}" if switch else "",
        "rates": f"the {frames.slow} is new every {number(1e3 * frames.ticks * log.period_s, 3)} ms" if frames else "",
        "encoder": f"{number(found.swing.steps, 2)} steps peak to peak, b = {damper}",
    }[cause]
