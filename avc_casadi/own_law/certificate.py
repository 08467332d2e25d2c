"""A law of one's own, force = -(k x + (b + b_p) v): stable with every hand and released, by how much, and its limits.

x is the measured position, v its backward difference behind a first-order filter where one is given. In the wall all
three act, outside b_p alone. Every number is the worst of a search over the ranges of hand and device; the loop is
linear, with hold, delay, amplifier and resonance as declared, and without dry friction, encoder and limit of the force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi.files.device_file import load_device
from avc_casadi.files.problem_file import AnyProblem, as_problem, is_device
from avc_casadi.loops.margins import LEAST_DISK, SOUND_DISK
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES, force_over_position
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges
from avc_casadi.model.problem import Impedance, Problem
from avc_casadi.own_law.loops import Case, Law, Loops
from avc_casadi.own_law.remedies import Remedy
from avc_casadi.own_law.remedies import remedies as remedies_of

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

FELT_N = 0.05
"""Rms of a force at the handle below which noise of it is taken as not felt."""
_AT_HZ = (1.0, 10.0)


@dataclass(frozen=True, eq=False, repr=False)
class LawCertificate(Printed):
    """Whether a law of one's own holds on a device, by how much, where its limits are, and what would help.

    Attributes:
        released: without a hand; None where nothing has a mass then.
        free: b_p alone, outside the wall, the worse of held and released; None without b_p.
        largest_stiffness_n_per_m: up to which k holds at this b; 0 where none does.
        damping_range_ns_per_m: lowest and largest b that hold at this k; None where none does.
        static_stiffness_n_per_m: at rest, at the handle.
        rendered_n_per_m: magnitude of force over position at the handle, by frequency in Hz.
        encoder_step_n: change of the force by one step of the encoder.
        noise_n: rms of the force at rest, of the noise of the position.
        quiet_n: rms below which that is held by dry friction, or not felt.

    Example:
        >>> avc.certify_law("knob", k=1.0, b=0.002, remedies=False).stable
        True
    """

    problem: Problem
    law: Law
    held: Case
    released: Case | None
    free: Case | None
    largest_stiffness_n_per_m: float
    damping_range_ns_per_m: tuple[float, float] | None
    static_stiffness_n_per_m: float
    rendered_n_per_m: dict[float, float]
    encoder_step_n: float
    noise_n: float
    quiet_n: float
    remedies: tuple[Remedy, ...]

    @property
    def cases(self) -> tuple[Case, ...]:
        """Held, and released and free where there are these."""
        return tuple(case for case in (self.held, self.released, self.free) if case is not None)

    @property
    def stable(self) -> bool:
        """Whether the loop is stable with every hand and released, in the wall and outside."""
        return all(case.stable for case in self.cases)

    @property
    def disk_margin(self) -> float:
        """The smallest disk margin of all cases."""
        return min(case.margins.disk for case in self.cases)

    @property
    def passed(self) -> bool:
        """Whether it may be deployed: stable, with a disk margin of 0.15 or more."""
        return self.stable and self.disk_margin >= LEAST_DISK

    @property
    def quiet(self) -> bool:
        """Whether noise of the position gives no force that is felt."""
        return self.noise_n <= self.quiet_n

    @property
    def reason(self) -> str:
        """What decides, in one line."""
        largest, allowed, law = self.largest_stiffness_n_per_m, self.damping_range_ns_per_m, self.law
        device, b, k = self.problem.device, self.law.damping_ns_per_m, self.law.stiffness_n_per_m
        delay = f"{device.delay_samples:g} sample{'' if device.delay_samples == 1 else 's'} of delay"
        ranges = ", over [device.range]" if device_ranges(device, LINEAR_KEYS) else ""
        late = f"with {delay} at {1 / device.sample_time_s:g} Hz{ranges}"
        low, high = allowed or (0.0, 0.0)
        if self.stable:
            thin = f"a disk margin of {self.disk_margin:.2g} is {'thin' if self.passed else f'below {LEAST_DISK}'}"
            doubts = [thin] if self.disk_margin < SOUND_DISK else []
            doubts += [] if self.quiet else ["noise of the position shakes the handle through b"]
            return f"stable, but {', and '.join(doubts)}" if doubts else "stable with every hand and released"
        unstable = {
            f"no b holds this k {late}": allowed is None,
            f"b {b:.4g} is above its largest, {high:.4g}, {late}": b > high,
            f"b {b:.4g} is below the {low:.4g} that this k needs {late}": b < low,
            f"k {k:.4g} is above its largest, {largest:.4g}, {late}": k > largest,
            f"b_p {law.local_damping_ns_per_m:.4g} is too much outside the wall {late}": True,
        }
        return f"unstable: {next(text for text, holds in unstable.items() if holds)}"

    def __repr__(self) -> str:
        return f"LawCertificate({'deployable' if self.passed else 'not deployable'}: {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        verdict = {"pass": self.passed, "stable": self.stable, "disk_margin": self.disk_margin, "quiet": self.quiet}
        rendered = {f"at_{hz:g}_hz_n_per_m": value for hz, value in self.rendered_n_per_m.items()}
        own = {"problem": self.problem.name, "deployable": {**verdict, "reason": self.reason}, "rendered": rendered}
        numbers = {key: value for key, value in vars(self).items() if key not in ("problem", "rendered_n_per_m")}
        return self.problem.units.document(plain({"schema": "avc/1", "kind": "law", **own, **numbers}))


def certify_law(
    problem: AnyProblem,
    *,
    k: float = 0.0,
    b: float = 0.0,
    b_p: float = 0.0,
    cutoff_hz: float | None = None,
    remedies: bool = True,
) -> LawCertificate:
    """Judge your own spring and damper, force = -(k x + (b + b_p) v), on a device: its wall is not used.

    Args:
        problem: device and hands: a problem, its file or name, or a device file or its name.
        k: spring, N/m; N.m/rad of a device that turns.
        b: damper in the wall, N.s/m or N.m.s/rad.
        b_p: damper that acts outside the wall too.
        cutoff_hz: of a first-order filter of the velocity; None: no filter.
        remedies: look for what would help too.

    Raises:
        InputError: a value that is refused, or neither spring nor damper.
        UnsupportedError: nothing has a mass, or more than 32 samples of delay.

    Example:
        >>> law = avc.certify_law("knob", k=1.0, b=0.002)
        >>> law.passed, round(law.held.damping_ratio, 2)
        (False, 0.06)
    """
    law, found = Law(k, b, b_p, cutoff_hz), _problem_of(problem)
    _refuse(law, found.device)
    loops = Loops(found)
    held, released = loops.case(law, 0), loops.case(law, 1) if len(loops.boxes) > 1 else None
    local, outside = Law(local_damping_ns_per_m=b_p, cutoff_hz=cutoff_hz), None
    if b_p:
        sides = (loops.case(local, side) for side in range(len(loops.boxes)))
        outside = min(sides, key=lambda case: (case.stable, case.margins.disk))
    static, rendered = _rendered(found.device, law)
    certificate = LawCertificate(
        problem=found,
        law=law,
        held=held,
        released=released,
        free=outside,
        largest_stiffness_n_per_m=loops.largest_stiffness(law),
        damping_range_ns_per_m=loops.damping_range(law),
        static_stiffness_n_per_m=static,
        rendered_n_per_m=rendered,
        encoder_step_n=float(law.rendering(found.device.sample_time_s).force[0, 0]) * found.device.encoder_resolution_m,
        noise_n=law.noise_n(found.device),
        quiet_n=max(found.device.coulomb_friction_n, FELT_N * found.device.metres_per_unit),
        remedies=(),
    )
    if not remedies or (certificate.passed and certificate.disk_margin >= SOUND_DISK and certificate.quiet):
        return certificate
    return replace(certificate, remedies=tuple(remedies_of(certificate, loops)))


def _problem_of(source: AnyProblem) -> Problem:
    """Return a problem, or a device file as one without a wall."""
    if isinstance(source, str | Path) and is_device(str(source)):
        file = load_device(source)
        nothing = Impedance(damping_ns_per_m=0.0, stiffness_n_per_m=0.0)
        return Problem(name=file.name, title=file.title, device=file.device, environment=nothing)
    return as_problem(source)


def _refuse(law: Law, device: Device) -> None:
    named = {"k": law.stiffness_n_per_m, "b": law.damping_ns_per_m, "b_p": law.local_damping_ns_per_m}
    faults = [
        Fault("", None, key, f"is {value:g}; allowed: 0 or a positive finite number")
        for key, value in named.items()
        if not (math.isfinite(value) and value >= 0)
    ]
    if law.cutoff_hz is not None and not (math.isfinite(law.cutoff_hz) and law.cutoff_hz > 0):
        faults.append(Fault("", None, "cutoff_hz", f"is {law.cutoff_hz:g}; allowed: a positive finite number"))
    if not faults and not any(named.values()):
        faults.append(Fault("", None, "k", "is 0, and so are b and b_p: there is no law; give at least one of them"))
    if faults:
        raise InputError(faults)
    slowest = max(corner.delay_samples for corner in device_corners(device, ("delay_samples",)))
    if slowest > MAX_DELAY_SAMPLES:
        raise UnsupportedError(
            f"linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not {slowest:g}",
            key="device.delay_samples",
        )


def _rendered(device: Device, law: Law) -> tuple[float, dict[float, float]]:
    """Return the stiffness at rest, behind the spring of a resonance, and force over position of the law by Hz."""
    k, period, mode = law.stiffness_n_per_m, device.sample_time_s, device.resonance
    static = k
    if mode is not None and device.encoder_at == "motor":
        share = mode.mass_ratio * (1 - mode.mass_ratio)
        joint = (2 * math.pi * mode.frequency_hz) ** 2 * device.mass_kg * share
        static = k * joint / (k + joint)
    rendering, found = law.rendering(period), {}
    for hz in _AT_HZ:
        if hz < 0.5 / period:
            turn = np.exp(2j * math.pi * hz * period)
            found[hz] = float(abs(force_over_position(rendering, turn)))
    return static, found
