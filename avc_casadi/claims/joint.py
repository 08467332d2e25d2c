"""kp and kd of a joint that an engine moves: stable over its ranges, by how much, and between which limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray, Interval
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Printed
from avc_casadi.claims.stable_interval import searched_ends, stable_interval
from avc_casadi.files.border import in_keys_of
from avc_casadi.files.problem_file import AnyProblem, load_any
from avc_casadi.loops.joint import JointFamily, JointGains
from avc_casadi.loops.margins import SOUND_DISK
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE
from avc_casadi.model.control_law import LawNumber
from avc_casadi.model.ends import LIGHTEST_TOOL_KG, LONGEST_STEP_S
from avc_casadi.model.joint import Joint
from avc_casadi.model.problem import Problem

# A limit is confirmed by at most so many searches of the ranges.
_SEARCHES = 4
# A step or a mass of 0 is none.
_SHORTEST_STEP_S = 1e-7
_LEAST_GAIN = 1e-4


@dataclass(frozen=True, eq=False, repr=False)
class JointCertificate(Printed):
    """Whether kp and kd are stable on a joint over its ranges, and between which limits.

    Attributes:
        spectral_radius: the largest of a step.
        worst: the joint of it: mass, damping, step and contact.
        damping_ratio: the least, of the joint where it touches nothing; 1 without an oscillation.
        damping_ratio_hz: its frequency; 0 without one.
        disk_margin: the least, of all forces of kp and kd, up to 2; 0 if one is unstable.
        largest_gain: up to which factor kp and kd are stable together; 0 where none is.
        stiffness_n_per_m: between which values kp is stable at this kd; None: none is.
        damping_ns_per_m: between which values kd is stable at this kp; None: none is.
        step_s: between which steps kp and kd are stable; None: at none.
        mass_kg: between which masses of the joint they are; None: with none. MuJoCo's armature adds to the mass.

    Example:
        >>> joint = {"simulation": {"tool_mass_kg": 0.01, "step_s": 0.005, "integrator": "implicit-damping"}}
        >>> round(avc.certify_joint(joint, kp=5000.0, kd=18.97).stiffness_n_per_m[1])
        9188
    """

    problem: Problem
    gains: JointGains
    spectral_radius: float
    stable: bool
    worst: Mapping[str, float]
    damping_ratio: float
    damping_ratio_hz: float
    disk_margin: float
    largest_gain: float
    stiffness_n_per_m: Interval | None
    damping_ns_per_m: Interval | None
    step_s: Interval | None
    mass_kg: Interval | None

    @property
    def passed(self) -> bool:
        """Whether every loop is stable."""
        return self.stable

    @property
    def marginal(self) -> bool:
        """Whether an oscillation neither grows nor decays, up to rounding."""
        return abs(self.spectral_radius - 1) <= RADIUS_TOLERANCE

    @property
    def sound(self) -> bool:
        """Whether the disk margin is 0.2 or more."""
        return self.disk_margin >= SOUND_DISK

    @property
    def armature_kg(self) -> float:
        """What has to be added to the lightest mass of the joint for these gains to be stable; 0 where nothing has."""
        lightest = self.problem.end_as(Joint).engine.tool_mass_kg
        return max(self.mass_kg[0] - lightest[0], 0.0) if self.mass_kg is not None and lightest is not None else 0.0

    def __repr__(self) -> str:
        return f"JointCertificate({'stable' if self.stable else 'unstable'}: disk margin {self.disk_margin:.2g})"

    def document(self) -> dict[str, Any]:
        """Return the certificate as JSON values: the law, its limits under `stable_at`, and the other numbers."""
        values = {key: value for key, value in vars(self).items() if key not in ("problem", "gains")}
        law: dict[str, Any] = {"stiffness_n_per_m": self.gains.kp, "damping_ns_per_m": self.gains.kd}
        law |= {"velocity": "difference" if self.gains.difference else "engine"}
        whole = {"problem": self.problem.name, "law": law, "armature_kg": self.armature_kg, "stable_at": {}}
        limits = ("stiffness_n_per_m", "damping_ns_per_m", "step_s", "mass_kg")
        whole["stable_at"] = {key: values.pop(key) for key in limits}
        return dict(plain(whole | values))


def joint_of(problem: AnyProblem) -> Problem:
    """Return the problem of a joint that an engine moves, from a problem, its tables, file or name.

    Raises:
        InputError: it states a device.
    """
    stated = load_any(problem)
    if not isinstance(stated.end, Joint):
        allowed = "allowed: a file with [simulation] and no [device]"
        raise InputError.of(f"is given; {allowed}", file=stated.name or "problem", key="device")
    return stated


def joint_gains(problem: Problem, kp: float | None, kd: float | None, *, difference: bool = False) -> JointGains:
    """Return kp and kd as given, or else those of the table [law].

    Raises:
        InputError: a value below 0, or neither kp nor kd.
    """
    keys = {"stiffness_n_per_m": kp, "damping_ns_per_m": kd}
    changes: dict[str, Any] = {key: value for key, value in keys.items() if value is not None}
    if difference:
        changes["velocity"] = {"kind": "difference"}
    stated = problem.changed(law=changes) if changes else problem
    law = stated.law
    if law is None:
        raise InputError.of("is missing, and there is no table [law]; allowed: --kp KP --kd KD", key="kp")
    return JointGains(law.stiffness_n_per_m, law.damping_ns_per_m, "velocity" in law.model_fields_set)


def certify_joint(
    problem: AnyProblem, kp: float | None = None, kd: float | None = None, *, difference: bool = False
) -> JointCertificate:
    """Judge kp and kd of a joint that an engine moves, a file with [simulation] and no [device].

    Args:
        problem: the joint.
        kp: stiffness, N/m; N.m/rad of a joint that turns. None: that of the table [law].
        kd: damping, N.s/m or N.m.s/rad. None: that of the table [law].
        difference: of the position over a step in place of the engine's own velocity, as in a drive with an encoder.

    Raises:
        InputError: a value that is refused, no gains, or a problem with a device.

    Example:
        >>> joint = {"simulation": {"tool_mass_kg": 0.01, "step_s": 0.005, "integrator": "implicit-damping"}}
        >>> avc.certify_joint(joint, kp=5000.0, kd=18.97).passed
        True
    """
    stated = joint_of(problem)
    with in_keys_of(stated.units):
        gains = joint_gains(stated, kp, kd, difference=difference)
    family = JointFamily(stated.end_as(Joint).engine)
    family.search(gains, 0.0)
    family.search(gains, family.disk_margin(gains))
    worst = family.worst(gains, lambda loops: loops.radius)
    ratio, ratio_hz = family.damping_ratio(gains)
    limits = _Limits(family, gains)
    largest = limits.interval(LawNumber(("gain",), 1.0, _LEAST_GAIN))
    # A gain of 0 has no size: its scan is about m/h^2 and m/h, at which a gain acts within a step.
    lightest = min(family.engine.tool_mass_kg or (1.0,))
    step_s = max(family.engine.step_s)
    return JointCertificate(
        problem=stated,
        gains=gains,
        spectral_radius=worst.value,
        stable=family.stable(gains),
        worst=worst.joint,
        damping_ratio=ratio,
        damping_ratio_hz=ratio_hz,
        disk_margin=family.disk_margin(gains),
        largest_gain=(largest or (0.0, 0.0))[1],
        stiffness_n_per_m=limits.interval(LawNumber(("kp",), float(gains.kp) or lightest / step_s**2)),
        damping_ns_per_m=limits.interval(LawNumber(("kd",), float(gains.kd) or lightest / step_s)),
        step_s=limits.interval(LawNumber(("step_s",), step_s, _SHORTEST_STEP_S, LONGEST_STEP_S)),
        mass_kg=limits.interval(LawNumber(("mass_kg",), lightest, LIGHTEST_TOOL_KG)),
    )


@dataclass(frozen=True)
class _Limits:
    """Between which values of one number the loops of a joint are stable, with the others kept."""

    family: JointFamily
    gains: JointGains

    def _at(self, name: str, value: float) -> tuple[JointGains, Mapping[str, float]]:
        """Return the gains of the joint, and its changed values, where one number has a value.

        A number is a factor on both gains, kp, kd, the step, s, or the mass, kg.
        """
        kp = self.gains.kp
        kd = self.gains.kd
        difference = self.gains.difference
        if name in ("step_s", "mass_kg"):
            return self.gains, {name: value}
        by_name = {
            "gain": JointGains(value * kp, value * kd, difference),
            "kp": JointGains(value, kd, difference),
            "kd": JointGains(kp, value, difference),
        }
        return by_name[name], {}

    def interval(self, number: LawNumber) -> Interval | None:
        """Return the interval of a number about its value, or nearest to it, in which all loops are stable, or None.

        Its ends are confirmed by a search of the ranges.
        """
        name = number.key
        for _ in range(_SEARCHES):
            ends = stable_interval(number, partial(self._growth, name))
            if ends is None or all(self._confirmed(name, value) for value in searched_ends(number, ends)):
                break
        # Without any gain the joint is as it is: that alone is no interval.
        return None if ends == (0.0, 0.0) else ends

    def _growth(self, name: str, values: FloatArray) -> FloatArray:
        """Return the largest spectral radius less 1 at each of some values."""
        loops = (self.family.loops(*self._at(name, value)) for value in values.tolist())
        return np.array([loop.radius.max() - 1 + RADIUS_TOLERANCE for loop in loops])

    def _confirmed(self, name: str, value: float) -> bool:
        """Return whether a search of the ranges finds no joint that is unstable at a value of a number."""
        gains, changes = self._at(name, value)
        return self.family.worst(gains, lambda loops: loops.radius, changes).value < 1
