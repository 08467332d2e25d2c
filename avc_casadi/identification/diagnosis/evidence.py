"""The evidence for a verdict in sentences; amplitude over the detection threshold; the deciding log."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.causes import CAUSES
from avc_casadi.identification.diagnosis.hypothesis import Hypothesis, worst_growth_of_hands
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import IntegralTerm, Law, output_step_n
from avc_casadi.identification.diagnosis.log import Log, Ticks
from avc_casadi.identification.diagnosis.model import Measured
from avc_casadi.identification.diagnosis.oscillation import Oscillation, TracedOscillation
from avc_casadi.identification.diagnosis.saturation import force_limit
from avc_casadi.simulation.population.motions import felt_vibration, threshold_m

# An encoder that toggles between two counts moves by no more steps.
_TOGGLES = 1.5


def toggles(found: Oscillation) -> bool:
    """Return whether a position toggles by one step of its encoder."""
    return found.steps < _TOGGLES


def felt(log: Log, swing: TracedOscillation, declared: Declared) -> float:
    """Return the amplitude of an oscillation relative to the vibrotactile detection threshold of a stylus grip.

    Within one encoder step the amplitude of the motion is unknown, but its force is: the hand of the box with the
    largest response counts. A saturated force excites no motion, and the position counts.
    """
    found = swing.found
    if toggles(found) and np.ptp(log.force_n[(swing.first + swing.last) // 2 : swing.last]) > 0:
        return _moved_by_its_force(log, swing, declared)
    amplitude_m = log.reach_m * found.peak_to_peak_m / 2
    return amplitude_m / float(threshold_m(np.array([found.frequency_hz]))[0])


def _moved_by_its_force(log: Log, swing: TracedOscillation, declared: Declared) -> float:
    period, device, box = log.ticks.period_s, declared.device, declared.box()
    force = log.force_n[swing.first : swing.last]
    spectrum = np.fft.rfft(force - force.mean())[1:]
    angular = 2 * np.pi * np.fft.rfftfreq(force.size, period)[1:]

    def motion(mass_kg: float, damping_ns_per_m: float, stiffness_n_per_m: float) -> FloatArray:
        mass, damping = device.mass_kg + mass_kg, device.damping_ns_per_m + damping_ns_per_m
        moved = spectrum / (stiffness_n_per_m - mass * angular**2 + 1j * damping * angular)
        return np.asarray(log.reach_m * np.fft.irfft(np.append(0.0, moved), force.size))

    return max(float(felt_vibration(motion(**box.values(row)), period)) for row in range(len(box)))


_DECIDES = {
    "delay": "a log of a force pulse commanded in free space, which tells the delay",
    "damping": "the same press with b halved and k as it is",
    "stiffness": "the same press with k halved and b as it is",
    "encoder": "the same press with the encoder's positions smoothed by a velocity filter, or with b halved",
    "resonance": "a slow sine sweep of the force in free space (its peak is the resonance), for avc identify",
    "let-go": "the same with the device held firmly, and once released, in one log",
    "ticks": "the time stamps of the ticks themselves, taken by the computer that runs the loop",
    "rate": "the time stamps of the ticks themselves, taken by the computer that runs the loop",
}
_FILE = ", or the device's file (--device)"
# A force saturated for less than this share of the oscillation hardly bounds it.
_CUT = 0.02
# At a limit to which a count takes the force at once, it is seldom, and far below it a sample before.
_TOP, _FEW, _NEARLY_ALL, _SELDOM, _OFTEN, _FAR_BELOW = 0.999, 8, 0.9, 0.3, 0.3, 0.5
_FEWEST_LEVELS = 20


def oscillation_sentence(found: Oscillation, felt: float) -> str:
    """Describe the oscillation and its multiple of the detection threshold."""
    if not math.isfinite(found.frequency_hz):
        return f"no oscillation: above 4 Hz the position moves by {_um(found.at_rest_m)} rms"
    counted = number(found.steps, 3)
    steps = f", {counted} encoder step{'' if counted == '1' else 's'}" if math.isfinite(found.steps) else ""
    grows = ""
    if math.isfinite(found.growth_per_s) and found.growth_error_per_s < 0.5 * abs(found.growth_per_s):
        what = "grew" if found.growth_per_s > 0 else "decays"
        grows = f"; it {what} by {number(abs(found.growth_per_s), 2)} +- {number(found.growth_error_per_s, 1)} 1/s"
    share = found.at_force_limit_share
    stands = f", {100 * share:.0f} % of it with the force at its limit of {number(found.largest_force_n, 3)}"
    bounded = f"{stands}, which bounds it" if share > _CUT else ""
    return (
        f"{found.looks} at {number(found.frequency_hz, 3)} +- {number(found.frequency_error_hz, 1)} Hz from "
        f"{number(found.begins_s, 3)} to {number(found.ends_s, 3)} s: {_um(found.peak_to_peak_m)} peak to peak{steps}, "
        f"{number(found.force_peak_to_peak_n, 3)}, in contact {100 * found.contact_share:.0f} % of the time, "
        f"{number(felt, 2)} times what a hand on a stylus detects{bounded}{grows}"
    )


def ticks_sentence(ticks: Ticks, declared: Declared) -> str:
    """Describe the timing of the ticks."""
    parts = [f"ticks of {number(1e3 * ticks.sample_time_s, 4)} ms"]
    if ticks.held > 1:
        parts.append(f"a new force only every {ticks.held} samples, {number(1 / ticks.period_s)} Hz")
    if declared.known and abs(ticks.period_s / declared.device.sample_time_s - 1) > 0.02:
        parts.append(f"declared {number(1e3 * declared.device.sample_time_s)} ms")
    if ticks.missed_share > 0:
        how = "did not run: the force stays while the position moves" if ticks.repeats else "missing"
        parts.append(f"{100 * ticks.missed_share:.2g} % {how}, at most {ticks.longest_gap} in a row")
    if ticks.uneven_share > 0.02:
        parts.append(f"each {100 * ticks.uneven_share:.2g} % earlier or later after the one before")
    elif ticks.jitter_rms_s > 0.02 * ticks.sample_time_s:
        parts.append(f"stamps scatter by {number(1e6 * ticks.jitter_rms_s, 2)} us rms")
    return ", ".join(parts)


def law_sentence(law: Law, sample_time_s: float) -> str:
    """Describe how the force follows the position."""
    if not law.told:
        return (
            f"the force is no spring and damper of the position: {100 * law.misfit:.0f} % of it is left (another "
            f"force, a filter of higher order, or a position that is not the one measured)"
        )
    cut = law.filter_hz(sample_time_s)
    filtered = "" if cut is None else f", velocity filter {number(cut, 3)} Hz"
    late = f", {law.lag} samples after the position" if law.lag else ""
    return (
        f"the computer rendered k = {number(law.stiffness_n_per_m, 4)} and b = "
        f"{number(law.damping_ns_per_m, 3)}{filtered}{late}, which is the force to "
        f"{number(max(100 * law.misfit, 0.1), 2)} %"
    )


def integral_sentence(found: IntegralTerm) -> str:
    """Describe a force with an integral term."""
    return (
        f"the computer rendered k = {number(found.stiffness_n_per_m, 4)}, b = "
        f"{number(found.damping_ns_per_m, 3)} and an integral term of "
        f"{number(found.integral_n_per_ms, 3)} in a second"
    )


def measured_sentences(measured: Measured, declared: Declared) -> list[str]:
    """Describe the identified device and hand."""
    known = "declared" if declared.known else "assumed"
    late = (
        f"from position to motion {number(measured.delay_samples, 3)} +- {number(measured.delay_error_samples, 1)} "
        f"samples of delay beside the hold; {known} {number(measured.declared_delay_samples, 3)}"
    )
    if declared.known and measured.hand is None:
        # The force of a swing tells mass and delay together.
        moved, meant = measured.device["mass_kg"], declared.device.mass_kg
        late += f", for a device of {number(moved, 3)}, {known} {number(meant, 3)}"
    beyond = max(
        measured.delay_samples - measured.declared_delay_samples,
        measured.least_declared_delay_samples - measured.delay_samples,
    )
    if measured.delay_error_samples > max(declared.delay_prior()[1], beyond) / 2:
        low, high = declared.device.range.delay_samples or (measured.declared_delay_samples,) * 2
        late = f"the log does not tell the delay; {known} {number(low, 3)} to {number(high, 3)} samples"
    lines = [late]
    if measured.hand is None:
        lines.append("the device answers its force as it does when no hand holds it")
    else:
        mass, damping, stiffness = measured.hand.values()
        held = "held by about {}, {}, {}"
        if not declared.known:
            own_mass, own_damping = measured.device.values()
            mass, damping = mass + own_mass, damping + own_damping
            held = "device and hand, which the log does not tell apart: about {}, {}, {}"
        elif mass == 0:
            held = "held by a grip of about {1}, {2}, as on a stylus, its mass behind it"
        lines.append(held.format(number(mass, 2), number(damping, 2), number(stiffness, 2)))
    if measured.resonance is not None:
        frequency, ratio, share = measured.resonance.values()
        lines.append(
            f"a resonance of {number(frequency, 3)} Hz, damping ratio {number(ratio, 2)}, {100 * share:.0f} % of the "
            f"mass beyond it"
        )
    what = "grow by" if measured.growth_per_s > 0 else "decay by"
    lines.append(
        f"the loop model with these numbers would {what} {number(abs(measured.growth_per_s), 2)} 1/s at "
        f"{number(measured.frequency_hz, 3)} Hz in contact"
    )
    return lines


def named_sentence(cause: str, measured: Measured, law: Law, log: Log, declared: Declared, answer: Hypothesis) -> str:
    """Describe the cause and the reasons for it."""
    words = CAUSES[cause]
    smallest = "is more than the loop bears, and less of it is the smallest change that makes it settle"
    shape, meant = measured.resonance, measured.declared_delay_samples
    known = "meant" if declared.known else "assumed"
    why = {
        "delay": f"{number(measured.delay_samples, 3)} samples, {known} {number(meant, 3)}, at which the loop settles",
        "damping": f"b = {number(law.damping_ns_per_m, 3)} {smallest}",
        "stiffness": f"k = {number(law.stiffness_n_per_m, 4)} {smallest}",
        "encoder": f"the loop settles without steps of {number(1e6 * log.encoder_m, 3)}, and swings with them",
        "resonance": f"{'' if shape is None else number(shape['frequency_hz'], 3)} Hz; with rigid mechanics it settles",
        "let-go": _released(measured, law, declared, answer) if cause == "let-go" else "",
        "ticks": f"{100 * log.ticks.missed_share:.2g} % of the ticks are missing; with all of them {_rests(measured)}",
        "rate": f"a new force every {number(1e3 * log.ticks.period_s, 3)} ms; at the rate that was intended it settles",
    }[cause]
    return f"{words}: {why}"


def _released(measured: Measured, law: Law, declared: Declared, answer: Hypothesis) -> str:
    """Describe what holds the device, and why a hand is missing."""
    who = "no hand holds the device, or one too light to be told from its mass"
    if measured.hand is not None:
        mass, damping, _ = measured.hand.values()
        who = f"hardly any hand holds the device, {number(mass, 2)} and {number(damping, 2)}"
    if (worst_growth_of_hands(answer, law, declared.box()) < 0).all():
        return f"{who}; with a hand of {_box(declared)} on it the loop settles"
    return f"{who}, and while it was held the loop rested"


def _box(declared: Declared) -> str:
    """Return the intended hands."""
    ends = (
        declared.hands.mass_kg,
        declared.hands.damping_ns_per_m,
        declared.hands.stiffness_n_per_m,
    )
    return ", ".join(f"{number(low, 3)} to {number(high, 3)}" for low, high in ends)


def _rests(measured: Measured) -> str:
    grows = measured.growth_per_s
    return "the loop settles" if grows < 0 else f"it would hardly grow, by {number(grows, 2)} 1/s"


def limit_sentence(log: Log, limit_n: float | None) -> str:
    """Describe how force saturation hides the behaviour beyond it; empty where it hides little.

    Args:
        log: on its tick grid.
        limit_n: force limit of the device, None where none was declared.
    """
    reached = force_limit(log, limit_n)
    if reached is None:
        return ""
    size = np.abs(log.force_n)
    at_limit = size > _TOP * reached
    limit = number(reached, 3)
    begins = np.flatnonzero(at_limit[1:] & ~at_limit[:-1]) + 1
    moved = np.abs(log.position_m[begins] - log.position_m[begins - 1])
    jumps = (moved > 0.5 * log.encoder_m) & (moved < 1.5 * log.encoder_m) & (size[begins - 1] < _FAR_BELOW * reached)
    share = np.count_nonzero(at_limit) / np.count_nonzero(log.touching)
    if begins.size >= _FEW and np.mean(jumps) > _NEARLY_ALL and share < _SELDOM:
        return (
            f"{CAUSES['damping']} or {CAUSES['encoder']}; whenever the count changes the force jumps to {limit} "
            f", its limit, and what a damper would be beyond it is not in the log"
        )
    if share < _OFTEN:
        return ""
    return (
        f"the force stands at {limit}, its limit, for {100 * share:.0f} % of the contact, and what it would "
        "be beyond is not in the log"
    )


def steps_sentence(log: Log) -> str:
    """Describe a force that comes in few steps; empty where there are many."""
    step_n = output_step_n(log.force_n)
    if not np.ptp(log.force_n) < _FEWEST_LEVELS * step_n:
        return ""
    return f"the force comes in steps of {number(step_n, 3)}, too few to tell its spring and damper"


def declared_resonance(measured: Measured) -> str:
    """Describe the identified resonance as the device file takes it."""
    told = ", ".join(f"{key} = {value:.3g}" for key, value in (measured.resonance or {}).items())
    return f"with resonance = {{ {told} }} under [device] in its file, avc recommend finds gains and a filter beside it"


def deciding_log(candidates: Sequence[str], *, known: bool) -> str:
    """Return the log that would decide between the candidates.

    Args:
        candidates: causes by key.
        known: whether the device file was given.
    """
    logs = [f"{_DECIDES[cause]}{_FILE * (cause == 'delay' and not known)}" for cause in candidates if cause in _DECIDES]
    return "; ".join(dict.fromkeys(logs))


def _um(length_m: float) -> str:
    return f"{number(1e3 * length_m, 3)}" if length_m >= 1e-3 else f"{number(1e6 * length_m, 3)}"
