"""Digits that the plain formulas lose where those of the package keep them, against 50 digits.

    python -m tests.benchmarks.conditioning

Each form is evaluated in double precision at its hard case; digits are -log10 of the relative error of what is asked.
Overwrites no file.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from reference_optimum import MP, NUMBERS

from avc_casadi.model.problem import Problem
from avc_casadi.paper.arcs import real_roots
from avc_casadi.paper.equations import (
    SampleAngle,
    backward_difference,
    coupling_gains,
    coupling_impedance,
    environment_impedance,
    series,
)
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.numbers import NUMPY


@dataclass(frozen=True)
class Form:
    """One formula at its hard case: the plain value, ours, and the truth."""

    what: str
    case: str
    plain_form: str
    our_form: str
    plain: float
    ours: float
    truth: object

    def digits(self, value: float) -> float:
        """Correct digits, at most 16."""
        error = abs(MP.mpf(float(value)) - self.truth) / abs(self.truth)
        return 16.0 if error == 0 else float(min(16, max(0, -MP.log10(error))))


def _z(frequency: float, sample_time: float) -> complex:
    return complex(np.exp(2j * np.pi * frequency * sample_time))


def differences() -> Form:
    """Re s_b at 0.01 Hz and 10 kHz, which is 2 sin^2(phi)/T."""
    f, t = 0.01, 1e-4
    z = _z(f, t)
    truth = backward_difference(SampleAngle.at(NUMBERS, MP.mpf(f), MP.mpf(t))).real
    ours = backward_difference(SampleAngle.at(NUMPY, f, t)).real
    plain = ((z - 1) / (t * z)).real
    return Form(
        "Re s_b",
        "0.01 Hz at 10 kHz",
        "(z-1)/(T z)",
        "(2/T) sin(phi) (sin(phi) + j cos(phi))",
        plain,
        float(ours),
        truth,
    )


def parallel() -> Form:
    """Real part of a soft wall without damping behind a coupling a million times as stiff."""
    f, t, b, k, b_e, k_e = 3.0, 1e-3, 20.0, 1e9, 0.0, 1e3

    def value(numbers: object, n: Callable[[float], object]) -> tuple[object, object]:
        angle = SampleAngle.at(numbers, n(f), n(t))  # type: ignore[arg-type]
        return coupling_impedance(angle, n(b), n(k)), environment_impedance(angle, "paper", n(b_e), n(k_e))

    c, e = value(NUMPY, float)
    exact_c, exact_e = value(NUMBERS, MP.mpf)
    truth = series(exact_c, exact_e, numbers=NUMBERS).real
    plain = complex(c * e / (c + e)).real  # type: ignore[operator]
    ours = float(series(c, e, numbers=NUMPY).real)
    return Form(
        "Re Z_eavc",
        "b_e = 0, k = 1e6 k_e",
        "Z_1 Z_2/(Z_1 + Z_2)",
        "(Z_1 |Z_2|^2 + Z_2 |Z_1|^2)/|Z_1 + Z_2|^2",
        plain,
        ours,
        truth,
    )


def _near_rigid(share: float) -> Problem:
    bound = {"damping_ns_per_m": 10.0 * share, "stiffness_n_per_m": 1e5 * share}
    return Problem.model_validate(
        {
            "device": {"mass_kg": 0.1, "damping_ns_per_m": 200.0},
            "environment": {"damping_ns_per_m": 10.0, "stiffness_n_per_m": 1e5},
            "boundaries": {"upper": bound, "lower": bound},
        }
    )


def nearly_rigid() -> Form:
    """Stiffness of the closed form where the desired wall is 1 - 1e-9 of the environment."""
    problem, f = _near_rigid(1 - 1e-9), 3.0
    loop, exact = loop_at(problem, f), loop_at(problem, MP.mpf(f), NUMBERS)
    truth = coupling_gains(exact.angle, exact.environment * exact.desired / (exact.environment - exact.desired))[1]
    ours = coupling_gains(loop.angle, loop.environment * loop.desired / loop.desired_gap)[1]
    # (15), (16): through Z_h and back.
    rendered = (loop.target - loop.device) / loop.hold
    plain = coupling_gains(loop.angle, loop.environment * rendered / (loop.environment - rendered))[1]
    return Form(
        "k of the closed form", "Z_ds = (1 - 1e-9) Z_e", "(15), (16): subtract Z_d, then Z_e - Z_eavc",
        "Z_e - Z_ds from the differences of b and k", float(plain), float(ours), truth,
    )  # fmt: skip


def roots() -> Form:
    """The smaller root of an edge's quadratic whose roots are 1e-4 and 1e8."""
    a, b, c = 1.0, -(1e8 + 1e-4), 1e4
    truth = 2 * MP.mpf(c) / (-MP.mpf(b) + MP.sqrt(MP.mpf(b) ** 2 - 4 * MP.mpf(a) * MP.mpf(c)))
    plain = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
    ours = float(np.min(real_roots(np.array(a), np.array(b), np.array(c))))
    return Form(
        "root of an edge",
        "roots 1e-4 and 1e8",
        "(-b - sqrt(b^2 - 4 a c))/(2 a)",
        "c/q, q = -(b + sign(b) sqrt(...))/2",
        plain,
        ours,
        truth,
    )


FORMS = (differences, parallel, nearly_rigid, roots)


def main() -> int:
    print("| what | at | plain form | digits | the package's form | digits |")
    print("|---|---|---|--:|---|--:|")
    for make in FORMS:
        form = make()
        plain_form, our_form = (text.replace("|", "\\|") for text in (form.plain_form, form.our_form))
        print(
            f"| {form.what} | {form.case} | `{plain_form}` | {form.digits(form.plain):.1f} |"
            f" `{our_form}` | {form.digits(form.ours):.1f} |"
        )
    return 0


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    sys.exit(main())
