"""How light force feedback may make a device: the largest gain with a sound disk margin, and what would allow more.

The rest of the law is that of the file. Gains are scanned at the corners of the ranges, from none up to the first one
without a sound margin; the largest is confirmed by a search of the ranges, whose worst plants join the corners.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi._util.progress import SILENT, Progress, Stages
from avc_casadi.claims.admittance import SensorAnalysis
from avc_casadi.claims.force_feedback import (
    ForceFeedbackCertificate,
    certify_force_feedback,
    value_of,
    with_value_of,
)
from avc_casadi.files.admittance_file import AnyForceFeedback, as_force_feedback
from avc_casadi.loops.margins import SOUND_DISK
from avc_casadi.model.sensed import ForceFeedback, ForceFeedbackProblem, SensedLaw

# Gains of a scan: a smaller one is not felt, a larger one no file may state.
_GAINS = np.geomspace(0.01, 1000.0, 41)
_BISECTIONS = 9
# A gain is confirmed by at most so many searches, each of which may refuse it.
_SEARCHES = 5
# A rough disk margin is right to two per cent.
_SOUND_ROUGHLY = 1.02 * SOUND_DISK
# A gain that grows by less than this share does not help.
_HELPS = 1.02
_OTHER_STAGES = 2
"""Stages besides changes: the gain, and the certificate."""
_CHANGES = {
    "device.delay_samples": 0.5,
    "device.sample_time_s": 0.5,
    "device.amplifier_bandwidth_hz": 2.0,
    "device.force_sensor.stiffness_n_per_m": 0.5,
    "device.force_sensor.damping_ratio": 2.0,
    "device.force_sensor.handle_mass_kg": 2.0,
    "law.damping_ns_per_m": 2.0,
    "law.force_feedback.cutoff_hz": 2.0,
}
"""Changes of device and law whose effect is reported, by key, as factors."""


@dataclass(frozen=True)
class LargerGain:
    """The largest sound gain with another value of device or law, at the corners of the ranges."""

    key: str
    value: float
    gain: float


@dataclass(frozen=True, eq=False, repr=False)
class ForceFeedbackRecommendation(Printed):
    """The force feedback to run on a device.

    Attributes:
        problem: the problem with the recommended gain; with its own law where no gain is sound.
        certificate: the verdict on it; None where no gain is sound.
        helps: what would allow a larger gain, the largest first.

    Example:
        >>> found = avc.recommend_force_feedback("admittance/lightened")
        >>> found.passed, found.certificate.disk_margin >= 0.2
        (True, True)
    """

    problem: ForceFeedbackProblem
    certificate: ForceFeedbackCertificate | None
    helps: tuple[LargerGain, ...]

    @property
    def passed(self) -> bool:
        """Whether there is a gain to run."""
        return self.certificate is not None and self.certificate.passed

    @property
    def reason(self) -> str:
        """What decides, in one line."""
        if self.certificate is None:
            return f"no gain has a disk margin of {SOUND_DISK} with the rest of the law"
        return self.certificate.reason

    def __repr__(self) -> str:
        return f"ForceFeedbackRecommendation({self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        judged = None if self.certificate is None else self.certificate.document()
        law = None if self.certificate is None else self.certificate.law.document()
        stated = {"problem": self.problem.name, "deployable": self.passed, "reason": self.reason, "law": law}
        return self.problem.units.document(plain({**stated, "helps": self.helps, "certificate": judged}))


def recommend_force_feedback(problem: AnyForceFeedback, progress: Progress = SILENT) -> ForceFeedbackRecommendation:
    """Recommend the largest gain of force feedback with a disk margin of 0.2 with every hand and contact.

    The rest of the law is kept, and its low pass of the force where it has one. The gain ends the run of sound gains
    from 0 up; searches of the ranges confirm it, and it is rounded down to 3 digits. The answer also lists changes of
    device or law, each with the larger gain that it allows.

    Args:
        problem: a `ForceFeedbackProblem`, its file or name.
        progress: told which stage begins.

    Raises:
        InputError: a value that is refused.

    Example:
        >>> avc.recommend_force_feedback("admittance/lightened").problem.law.gain > 1.0
        True
    """
    stated = as_force_feedback(problem)
    base = stated.law or SensedLaw()
    if base.force_feedback is None:
        base = base.model_copy(update={"force_feedback": ForceFeedback(gain=1.0)})
    stages = Stages(progress, _OTHER_STAGES + len(_CHANGES))
    stages.begin("gain of the force")
    analysis = SensorAnalysis(stated)
    gain = _confirmed_gain(analysis, base)
    law = _with_gain(base, gain)
    certificate = None
    if gain:
        stages.begin("certificate")
        chosen = stated.model_copy(update={"law": law})
        certificate = certify_force_feedback(chosen)
        stated = chosen
    helps = sorted(_larger_gains(analysis, law, gain, stages), key=lambda larger: -larger.gain)
    return ForceFeedbackRecommendation(stated, certificate, tuple(helps))


def _with_gain(law: SensedLaw, gain: float) -> SensedLaw:
    return law.with_number(law.gain_number.path, gain)


def _rounded_down(gain: float) -> float:
    """Return a gain of three digits, not larger."""
    if not gain:
        return 0.0
    step = 10.0 ** (math.floor(math.log10(gain)) - 2)
    return float(f"{math.floor(gain / step * (1 + 1e-9)) * step:.6g}")


def _largest_gain(analysis: SensorAnalysis, law: SensedLaw, limit: float) -> float:
    """Return the gain of the force up to which every gain of a scan has a disk margin of `limit`; 0 where none has.

    It is bisected in the logarithm.
    """

    def is_sound(gain: float) -> bool:
        return analysis.rough_margin(_with_gain(law, gain)) >= limit

    sound = 0.0
    for gain in _GAINS.tolist():
        if not is_sound(gain):
            break
        sound = gain
    if not sound or sound == _GAINS[-1]:
        return sound
    unsound = sound * float(_GAINS[1] / _GAINS[0])
    for _ in range(_BISECTIONS):
        middle = math.sqrt(sound * unsound)
        if is_sound(middle):
            sound = middle
        else:
            unsound = middle
    return sound


def _confirmed_gain(analysis: SensorAnalysis, law: SensedLaw) -> float:
    """Return the largest gain that a search of the ranges confirms, rounded down; 0 where none is found."""
    for _ in range(_SEARCHES):
        gain = _rounded_down(_largest_gain(analysis, law, _SOUND_ROUGHLY))
        if not gain or analysis.confirmed_margin(_with_gain(law, gain)) >= _SOUND_ROUGHLY:
            return gain
    return 0.0


def _larger_gains(analysis: SensorAnalysis, law: SensedLaw, gain: float, stages: Stages) -> Iterator[LargerGain]:
    """Yield each change of device or law that allows a gain larger than `gain`, with that gain; each is a stage."""
    problem = analysis.problem.model_copy(update={"law": law})
    for key, factor in _CHANGES.items():
        stages.begin(f"with another {key.rpartition('.')[2]}")
        value = value_of(problem, key)
        if not value:
            continue
        changed = with_value_of(problem, key, factor * value)
        larger = _rounded_down(_largest_gain(analysis.changed(changed), changed.law or law, _SOUND_ROUGHLY))
        if larger > _HELPS * gain:
            yield LargerGain(key, factor * value, larger)
