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
from avc_casadi._util.text import number
from avc_casadi.coupling import Coupling
from avc_casadi.diagnose.law import Law, find_law, outside_force_n
from avc_casadi.diagnose.oscillation import Log, Oscillation, find_oscillation, log_of
from avc_casadi.diagnose.plant import Declared, Fit, Hypothesis, fit_plants, growth, measured, stable
from avc_casadi.diagnose.remedies import (
    Remedy,
    Scene,
    intended,
    limit_of,
    meant_delay,
    remedies_of,
)
from avc_casadi.identification.read import read_columns
from avc_casadi.identification.record import Columns
from avc_casadi.identification.units import Layout
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand
from avc_casadi.model.problem import Hands, defaults_at

CAUSES: Mapping[str, str] = {
    "delay": "delay",
    "rate": "sample rate too low",
    "stiffness": "stiffness over the limit",
    "damping": "damping over the limit",
    "let-go": "hand released the device",
    "resonance": "resonance",
    "relay": "force switched by a sign",
    "rates": "two rates in one loop",
    "encoder": "encoder steps or noise",
    "ticks": "dropped ticks",
}
"""Causes by key, in words."""

Verdict = Literal["named", "cannot tell", "nothing wrong", "not the loop"]
# A cause is named at odds of two to one. Below so many encoder steps quantisation alone may sustain a swing.
_SURE, _FEW_STEPS, _OTHER = 2 / 3, 14.0, "other"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The diagnosis of one log.

    Attributes:
        verdict, cause: what was found; the cause by key, None where none is named.
        candidates, shares: causes that remain, and shares of the hypotheses by cause.
        conclusion: one sentence.
        decides: the log that would decide; empty where none is needed.
        remedies: changes that settled in simulation.
        fit: device and hand, None where no loop was fitted.
    """

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
        swing, law, fit, units = self.swing, self.law, self.fit, self.declared.device.units
        found: dict[str, Any] = plain(
            {
                "log": self.log.name,
                "seconds": float(self.log.position_m.size * self.log.ticks.period_s),
                "verdict": self.verdict,
                "cause": self.cause,
                "candidates": list(self.candidates),
                "conclusion": self.conclusion,
                "shares": dict(self.shares),
                "remedies": [{**asdict(one), "key": units.key(one.key)} for one in self.remedies],
                "decides": self.decides,
                "oscillation": {key: value for key, value in vars(swing).items() if key not in {"fast_m", "envelope_m"}}
                | {"sustained": swing.sustained},
                "ticks": asdict(self.log.ticks),
                "encoder_resolution_m": self.log.encoder_m or None,
                "law": None
                if law is None
                else {**asdict(law), "explains": law.explains, "filter_hz": law.filter_hz(self.log.ticks.period_s)},
                "measured": None
                if fit is None or law is None
                else {
                    "delay_samples": fit.best.delay + law.lag,
                    "delay_error_samples": fit.delay_error,
                    "misfit": fit.misfit,
                    "stops_m": None if fit.best.stops is None else fit.best.stops[:2],
                    **measured(fit.best),
                },
                "notes": list(self.notes),
            }
        )
        return found


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
    """Diagnose one log of time, position and commanded force.

    Args:
        log: a file, or its columns.
        layout: columns and units of the file.
        device: as declared; None assumes a usual one.
        hands: for which the loop was designed; None takes the usual ranges.
        coupling: the intended one; its device and hands are used where none are given.
        handle_radius_m: of a device that turns, where no device is given.
        flip_force: whether the log counts the force against +position.
        seed: of the draws.
        progress: of the diagnosis.

    Raises:
        InputError: a fault of the log, or a force that drives the device away from its equilibrium.
    """
    columns = log if isinstance(log, Columns) else _one(read_columns(log, layout), str(log))
    if coupling is not None:
        device, hands = device or coupling.problem.device, hands or coupling.problem.hands
    _check(columns, device, handle_radius_m)
    grid, notes = log_of(columns, flip_force=flip_force)
    if not np.ptp(grid.position_m) and np.ptp(grid.force_n):
        raise InputError.of(
            "never changes, and the force does; allowed: a log of a device that moves; look for an encoder that is "
            "stuck, or another column",
            file=columns.file,
            key="position",
        )
    declared = _declared(device, hands, grid.ticks.sample_time_s, columns.motion, handle_radius_m)
    if not declared.known:
        notes.append("no device is given: a usual one is assumed, within a factor of 3; better: --device")
    limit = declared.device.max_force_n
    if limit is not None and np.mean(np.abs(grid.force_n) > 1.01 * limit) > 1e-3:
        notes.append("the log commands more than max_force_n, which is not used: is the limit, or a unit, another one?")
        wide = declared.device.range.model_copy(update={"max_force_n": None})
        free = declared.device.model_copy(update={"max_force_n": None, "range": wide})
        declared, limit = replace(declared, device=free), None
    rubs = declared.device.coulomb_friction_n
    with progress.step("oscillation and force"):
        swing = find_oscillation(grid, limit)
        law = find_law(grid, swing, limit, rubs)
        weighed = replace(grid, outside_n=outside_force_n(grid))
        beside = find_law(weighed, swing, limit, rubs) if weighed.outside_n else None
        if beside is not None and beside.explains and (law is None or beside.misfit < 0.3 * law.misfit):
            grid, law = weighed, beside
            swing = find_oscillation(grid, limit)
            notes.append(f"a constant force of {number(-grid.outside_n, 3)} stands outside contact")
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


def _one(columns: Sequence[Columns], file: str) -> Columns:
    if len(columns) > 1:
        raise InputError.of(f"holds {len(columns)} records; allowed: one record a file", file=file)
    return columns[0]


def _check(columns: Columns, device: Device | None, radius_m: float | None) -> None:
    """Refuse a log of the other motion, one without a handle radius, and one that is too short."""
    turns = columns.motion == "rotary"
    if device is not None and device.motion != columns.motion:
        raise InputError.of(
            f"is {columns.motion} by its units, and the device is {device.motion}; allowed: a log of the device's own "
            "motion (--units)",
            file=columns.file,
            key="position",
        )
    if device is None and turns and radius_m is None:
        raise InputError.of(
            "is of a device that turns, and nothing says where the hand holds it; allowed: with --handle-radius-m, "
            "--device, --problem or --coupling",
            file=columns.file,
            key="position",
        )
    if columns.time_s.size < 60:
        raise InputError.of(f"has {columns.time_s.size} samples; allowed: at least 60", file=columns.file, key="time")


def _declared(
    device: Device | None, hands: Hands | None, period_s: float, motion: str, radius_m: float | None
) -> Declared:
    """Return the intended loop; a usual device on a desk where none is given."""
    reach = (radius_m or 1.0) if device is None else device.metres_per_unit
    known = device is not None
    if device is None:
        turns: dict[str, object] = {"motion": "rotary", "handle_radius_m": reach} if motion == "rotary" else {}
        usual = {"mass_kg": 0.1 * reach**2, "damping_ns_per_m": reach**2, "delay_samples": 1, "sample_time_s": period_s}
        device = Device.model_validate({**usual, **turns})
    return Declared(device, known, hands or Hands.model_validate(defaults_at(Hands, reach)))


def _at_once(found: Diagnosis) -> Diagnosis | Law:
    """Return the verdict that needs no loop model, or the law of one that does."""
    log, swing, law = found.log, found.swing, found.law
    if swing.sustained and swing.contact_share == 0:
        said = "not the loop: it swings while no force is commanded; a hand, a cable or the table moves it"
        return replace(found, verdict="not the loop", conclusion=said)
    if law is None or not law.explains:
        said = "the force is not that of a spring and a damper on the position, nor of a switch or two rates"
        if law is None and not log.force_n.any():
            said = "no force is commanded"
        decides = "the same with a spring and a damper alone, unlimited, and with the position that the law reads"
        return replace(found, conclusion=f"cannot tell: {said}", decides=decides)
    if swing.sustained:
        if log.ticks.uneven_share > 0.12:
            said = f"the ticks come at uneven times, each {100 * log.ticks.uneven_share:.2g} % off; no loop model fits"
            return replace(found, conclusion=f"cannot tell: {said}", decides="the same log on an even clock")
        return law
    envelope = swing.envelope_m
    late, most = float(np.median(envelope[-max(envelope.size // 5, 5) :])), float(envelope.max())
    rests = swing.kind == "decaying" or late < max(1.5 * log.encoder_m, 0.3 * most)
    seen = rests and most > 1.5 * log.encoder_m and bool(log.touching[envelope > 0.3 * most].mean() > 0.5)
    if seen and law.switch is None:
        return replace(
            found, verdict="nothing wrong", conclusion="nothing wrong: the force is explained and the motion decays"
        )
    said = "cannot tell: nothing swings, and no motion decays under the force either"
    return replace(found, conclusion=said, decides="a log of a press, a push or a release")


def causes_of(one: Hypothesis, law: Law, log: Log, swing: Oscillation, declared: Declared) -> dict[str, float]:
    """Return the changes with which the loop of one rate settles, with shares."""
    slower = declared.known and log.ticks.period_s > 1.3 * declared.device.sample_time_s
    meant = meant_delay(log, declared)
    late = one.delay + law.lag > meant + 0.35
    punctual = one.changed(delay_samples=meant), replace(law, lag=0)
    if stable(one, law):
        if log.ticks.missed_share > 0.01 and swing.steps >= _FEW_STEPS:
            return {"ticks": 1.0}
        return {"encoder": 1.0} if swing.steps < _FEW_STEPS else {_OTHER: 1.0}
    if (slower or log.ticks.held > 1) and stable(*intended(one, law, log, declared)):
        return {"rate": 1.0}
    if late and stable(*punctual):
        return {"delay": 1.0}
    gone = 0.0
    if _let_go(one, declared):
        box = declared.box()
        rest = float(np.mean([stable(replace(one, hand=box.pick(slice(i, i + 1))), law) for i in range(len(box))]))
        touching = np.flatnonzero(log.touching)
        rested = (swing.first - touching[0]) * log.ticks.period_s if touching.size else 0.0
        if rest == 1 or rested * growth(one, law)[0] > 6:
            return {"let-go": 1.0}
        gone = min(rest, 0.5) if rest > 0.2 else 0.0
    left = _of_gains(one, law)
    if late and _OTHER not in left:
        now, then = _away(one, law), _away(*punctual)
        share = max(0.0, 1 - then / now) if 0 < now < math.inf else 0.0
        left = left if share < 0.25 else {"delay": share} | {key: part * (1 - share) for key, part in left.items()}
    return {key: part * (1 - gone) for key, part in left.items()} | ({"let-go": gone} if gone else {})


def _of_gains(one: Hypothesis, law: Law) -> dict[str, float]:
    """Return the shares of resonance and gains of a declared loop that are too large."""
    if one.device.resonance is not None and stable(one.changed(resonance=None), law):
        return {"resonance": 1.0}
    limits = {gain: limit_of(one, law, gain) for gain in ("stiffness", "damping")}
    nearest = max(limits, key=lambda gain: limits[gain] or 0.0)
    return {nearest: 1.0} if limits[nearest] else {_OTHER: 1.0}


def _away(one: Hypothesis, law: Law) -> float:
    """Return the distance to the nearer limit of a gain, as a logarithm."""
    limit = max(limit_of(one, law, gain) or 0.0 for gain in ("stiffness", "damping"))
    return -math.log(limit) if limit else math.inf


def _let_go(one: Hypothesis, declared: Declared) -> bool:
    """Return whether hardly any hand holds the device: neither a mass on it nor a grip."""
    if not isinstance(one.hand, Hand):
        return True
    mass, damping, stiffness = one.hand.values(0).values()
    if mass == 0:
        least = declared.grip()[:, 0]
        return declared.known and damping < 0.7 * least[0] and stiffness < 0.7 * least[1]
    least_mass, least_damping = declared.hands.mass_kg[0], declared.hands.damping_ns_per_m[0]
    return declared.known and mass < 0.35 * least_mass and damping < 0.7 * least_damping


def _judged(found: Diagnosis, law: Law, fits: Sequence[Fit]) -> Diagnosis:
    """Return the verdict by the hypotheses that the log bears out, each weighed and then simulated."""
    log, swing, declared = found.log, found.swing, found.declared
    plain_law = replace(law, switch=None, frames=None)
    scene = Scene.of(log, swing, law, declared)
    # Of answers that explain the log about as well, those count that swing about as far in simulation.
    near = [fit for fit in fits if fit.cost < fits[0].cost + 7]
    fits = [fit for fit in near if len(near) > 1 and scene.swings(fit.best, law)] or list(fits)
    odds = np.exp(-np.minimum(np.array([fit.cost for fit in fits]) - fits[0].cost, 700.0))
    asked: list[tuple[Fit, Hypothesis, float, dict[str, float]]] = []
    for fit, weight in zip(fits, (odds / odds.sum()).tolist(), strict=True):
        for one in fit.answers if weight > 1e-3 else ():
            causes = causes_of(one, plain_law, log, swing, declared)
            special = "relay" if law.switch is not None else "rates" if law.frames is not None else ""
            if special and stable(one, plain_law):
                causes = {special: 1.0}
            asked.append((fit, one, weight / len(fit.answers), causes))
    total = sum(weight for _, _, weight, _ in asked)
    shares: dict[str, float] = {}
    for _, _, weight, causes in asked:
        for key, share in causes.items():
            shares[key] = shares.get(key, 0.0) + share * weight / total
    shares = dict(sorted(shares.items(), key=lambda item: -item[1]))
    first = next(iter(shares))
    fit, one, _, _ = max(
        (each for each in asked if each[3].get(first, 0.0) >= 0.5), key=lambda each: each[2], default=asked[0]
    )
    fit = replace(fit, best=one)
    doubts = _doubts(first, fit, law, scene, found, shares)
    candidates = tuple(key for key in shares if key != _OTHER)[:2] if shares.get(_OTHER, 0.0) < _SURE else ()
    outside = work_w(log, swing, one) < 0 and swing.steps > _FEW_STEPS
    if outside:
        doubts.append("the force as it acts takes energy from the swing: a hand, the table or a machine drives it")
    tried = () if outside or (doubts and not scene.swings(one, law)) else candidates[:1] if not doubts else candidates
    near_by = [each for _, each, weight, _ in asked if weight > 0.01 * total]
    # The damping of a device is told the worst: a remedy has to do for the declared one too.
    drag = {key: getattr(declared.device, key) for key in ("mass_kg", "damping_ns_per_m") if declared.known}
    answers = (one, *near_by[:: max(1, len(near_by) // 8)], one.changed(**drag))
    cures = [cure for key in tried for cure in remedies_of(key, answers, law, scene, log, declared)]
    remedies = tuple(dict.fromkeys(cures))
    found = replace(found, shares=shares, fit=fit, remedies=remedies)
    if not doubts:
        quiet = first == "encoder" and scene.noise_m > 0 and replace(scene, noise_m=0.0).settles(one, law)
        conclusion = _sentence("noise" if quiet else first, one, law, found)
        return replace(found, verdict="named", cause=first, candidates=(first,), conclusion=conclusion)
    names = " or ".join(CAUSES[key] for key in candidates) or "none of the causes it knows"
    return replace(
        found,
        candidates=candidates,
        conclusion=f"cannot tell: {names}; {'; '.join(doubts)}",
        decides="the same log with the force off" if outside or not candidates else _decides(candidates),
    )


def _doubts(first: str, fit: Fit, law: Law, scene: Scene, found: Diagnosis, shares: Mapping[str, float]) -> list[str]:
    """Return what speaks against the first cause: odds, residual, and simulations with it and without it."""
    one, log, declared = fit.best, found.log, found.declared
    if first == _OTHER:
        return ["no single change makes the loop settle, or its model settles already"]
    doubts = []
    if shares[first] < _SURE:
        parts = (f"{CAUSES.get(key, 'another')} {100 * share:.0f} %" for key, share in shares.items() if share > 0.01)
        doubts.append(f"of the hypotheses that the log bears out {', '.join(parts)}")
    if fit.misfit > 12 and first not in {"ticks", "rate"}:
        doubts.append(f"the model leaves {number(fit.misfit, 2)} times what encoder and noise do")
    meant = meant_delay(log, declared)
    if fit.at_end or (first == "delay" and one.delay + law.lag - meant < 2 * fit.delay_error):
        doubts.append("the log does not tell the delay")
    if not scene.swings(one, law):
        doubts.append("simulated with these numbers the loop does not swing as the log does")
    without: dict[str, tuple[Hypothesis, Law, Scene]] = {
        "delay": (one.changed(delay_samples=meant), replace(law, lag=0), scene),
        "rate": (*intended(one, law, log, declared), scene),
        "resonance": (one.changed(resonance=None), law, scene),
        "relay": (one, replace(law, switch=None), scene),
        "rates": (one, replace(law, frames=None), scene),
        "encoder": (one, law, replace(scene, encoder_m=0.0, noise_m=0.0)),
        "ticks": (one, law, replace(scene, ran=np.ones(1, dtype=bool))),
    }
    if first in without:
        other, its_law, its_scene = without[first]
        if not its_scene.settles(other, its_law):
            doubts.append("simulated without it the loop swings too")
    return doubts


def work_w(log: Log, swing: Oscillation, one: Hypothesis) -> float:
    """Return the mean power of the force on the device over whole cycles, the force as it acts: late and held."""
    period = log.ticks.period_s
    inside = log.position_m[swing.first : swing.last]
    rises = swing.first + np.flatnonzero((inside[1:] > inside.mean()) & (inside[:-1] <= inside.mean())) + 1
    if rises.size < 2:
        return 0.0
    ticks = np.arange(int(rises[0]), int(rises[-1]))
    whole = int(one.delay)
    part = one.delay - whole
    # The force of a tick acts from its delay on; the position moves by `moved` in that sample.
    acts = (1 - part) * log.force_n[np.maximum(ticks - whole, 0)] + part * log.force_n[np.maximum(ticks - whole - 1, 0)]
    moved = log.position_m[ticks + 1] - log.position_m[ticks]
    return -float(np.sum(acts * moved)) / (ticks.size * period)


def _sentence(cause: str, one: Hypothesis, law: Law, found: Diagnosis) -> str:
    """Return the cause with its numbers, and what shows it."""
    log, declared = found.log, found.declared
    words = CAUSES.get(cause, "position noise through the damper")
    stiff, damp = number(law.stiffness_n_per_m, 4), number(law.damping_ns_per_m, 3)
    meant = "declared" if declared.known else "assumed"
    frames, switch = law.frames, law.switch
    by = "" if switch is None else {
        "position": "the position", "speed": "the speed", "force": "its own sign (a minimum force)",
        "contact": "contact: a spring without length",
    }[switch.by]  # fmt: skip
    why = {
        "delay": f"{number(one.delay + law.lag, 3)} samples in place of {number(meant_delay(log, declared), 3)} "
        f"({meant}), with which the loop settles",
        "rate": f"a new force every {number(1e3 * log.ticks.period_s, 3)} ms; at the intended rate the loop settles",
        "stiffness": f"k = {stiff} exceeds the stability limit; reducing it is the smallest change",
        "damping": f"b = {damp} exceeds the stability limit; reducing it is the smallest change"
        if law.damping_ns_per_m > 0
        else f"b = {damp} has the wrong sign",
        "let-go": "with a hand of the usual ranges the loop settles",
        "resonance": f"{number(one.device.resonance.frequency_hz, 3)} Hz; with rigid mechanics the loop settles"
        if one.device.resonance is not None
        else "",
        "relay": f"{number(abs(switch.force_n), 3)} switched by {by}; without it the loop settles" if switch else "",
        "rates": f"the {frames.slow} is new every {number(1e3 * frames.ticks * log.ticks.period_s, 3)} ms"
        f"{f' and {frames.late} frames late' if frames.late else ''}; with one rate the loop settles"
        if frames
        else "",
        "noise": f"b = {damp} turns it into the force; without noise the loop settles",
        "encoder": f"{number(found.swing.steps, 2)} steps peak to peak; without steps and noise the loop settles",
        "ticks": f"{100 * log.ticks.missed_share:.2g} % are missing; with all of them the loop settles",
    }[cause]
    stops = "; travel stops bound the swing" if one.stops is not None else ""
    return f"{words}: {why}{stops}"


def _decides(candidates: Sequence[str]) -> str:
    """Return the log that would decide between the candidates."""
    logs = {
        "delay": "a force pulse in free space",
        "stiffness": "the same with k halved",
        "damping": "the same with b halved",
        "let-go": "the same with the device held firmly, and released",
        "resonance": "a chirp in free space (avc excite --signal chirp), for avc identify",
        "encoder": "the same with b halved, or with a filter of the velocity",
        "relay": "the same without the switched force",
        "rates": "the same with one rate",
        "rate": "the time stamps of the ticks themselves",
        "ticks": "the time stamps of the ticks themselves",
    }
    return "; or ".join(logs[key] for key in candidates)
