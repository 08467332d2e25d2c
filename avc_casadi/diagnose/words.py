"""Causes of an oscillation in words, with their numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from avc_casadi._util.text import number, quantity
from avc_casadi.diagnose.fit import PlantFit
from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.diagnose.plant import IntendedLaw


@dataclass(frozen=True)
class Cause:
    """A cause in words."""

    name: str
    deciding_log: str
    """The log that would decide whether it is this one."""


CAUSES: Mapping[str, Cause] = {
    "sign": Cause("sign of the force", "a force pulse in free space"),
    "delay": Cause("delay", "a force pulse in free space"),
    "rate": Cause("sample rate too low", "the time stamps of the ticks themselves"),
    "stiffness": Cause("stiffness over the limit", "the same with k halved"),
    "damping": Cause("damping over the limit", "the same with b halved"),
    "let-go": Cause("hand released the device", "the same with the device held firmly, and released"),
    "resonance": Cause("resonance", "a chirp in free space (avc excite --signal chirp), for avc identify"),
    "relay": Cause("force switched by a sign", "the same without the switched force"),
    "rates": Cause("two rates in one loop", "the same with one rate"),
    "encoder": Cause("encoder steps or noise", "the same with b halved, or with a filter of the velocity"),
}
"""Causes by key."""


def cause_numbers(cause: str, fit: PlantFit, law: FittedLaw, log: Log, swing: Oscillation, design: IntendedLaw) -> str:
    """Return the numbers of a cause, without which the loop settles."""
    hypothesis = fit.best
    unit, mode = hypothesis.device.units.unit, hypothesis.device.resonance
    spring = quantity(law.stiffness_n_per_m, unit("N/m"))
    damper = quantity(law.damping_ns_per_m, unit("N.s/m"))
    delay = number((hypothesis.delay + law.lag) * design.samples_a_tick(log), 3)
    intended = f"{number(design.delay_samples[1], 3)} {'declared' if design.known else 'assumed'}"
    released = ", with no hand on the device" if hypothesis.hand is None else ""
    frames_late = law.frames.late if law.frames else law.lag
    late = f", {number(frames_late, 2)} of them late" if frames_late else ""
    steps = number(swing.steps, 2)
    words = {
        "delay": f"{delay} samples, {intended}",
        "rate": f"a new force every {number(1e3 * log.period_s, 3)} ms{late}",
        "stiffness": f"k = {spring}{released}",
        "damping": f"b = {damper}{released}",
        "let-go": "the device was at rest in contact; without a hand it oscillates",
        "encoder": f"{steps} step{'' if steps == '1' else 's'} peak to peak, b = {damper}",
    }
    if mode and fit.resonance_hz:
        low, high = (number(end, 3) for end in fit.resonance_hz)
        words["resonance"] = f"{number(mode.frequency_hz, 3)} Hz ({low} to {high} at 95 %), not declared"
    if law.switch:
        words["relay"] = f"{quantity(abs(law.switch.force_n), unit('N'))} by the sign of the {law.switch.by}"
        if law.switch.keep:
            filter_ms = number(-1e3 * log.period_s / math.log(law.switch.keep), 2)
            words["relay"] += f" behind a filter of {filter_ms} ms"
    if law.frames:
        frame_ms = number(1e3 * law.frames.ticks * log.period_s, 3)
        words["rates"] = f"the {law.frames.slow} is new every {frame_ms} ms{late}"
    return words[cause]
