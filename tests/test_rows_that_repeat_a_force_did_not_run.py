"""A logger that writes a row whether or not the computer ran: the force that stays though the law moved tells which."""

from dataclasses import replace

import numpy as np
import pytest
from buzzing_cases import declared_of
from buzzing_device import Buzzing, logged, played

from avc_casadi.identification.diagnosis.diagnose import diagnose
from avc_casadi.identification.diagnosis.law import find_law, without_repeats
from avc_casadi.identification.diagnosis.log import log_of
from avc_casadi.identification.diagnosis.told import diagnosis_text
from avc_casadi.identification.record import Columns

STIFF = Buzzing(mass=0.12, damping=0.5, friction=0.03, delay=0.0, stiffness=8000.0, damper=4.0, limit=12.0)
STIFF = replace(STIFF, two_sided=1.0, hand_mass=0.1, hand_damping=4.0, hand_stiffness=600.0)
SAMPLES = 1600


def pattern(kind):
    if kind == "uneven":
        return (np.random.default_rng(3).random(SAMPLES) < 0.5).astype(float)
    return np.resize({"even": [0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0], "bursts": [0.0] * 7 + [1.0] * 4}[kind], SAMPLES)


def rows(loop, missed, output_n=0.0):
    time, position, force, _ = played(loop, SAMPLES * loop.period, missed)
    return Columns("rows", time, position, output_n * np.round(force / output_n) if output_n else force)


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "output_n"), [("uneven", 0.05), ("even", 0.0), ("bursts", 0.0)])
def test_ticks_that_are_rows_all_the_same_are_found_as_those_that_are_not_in_the_log(kind, output_n):
    missed = pattern(kind)
    found = diagnose(rows(STIFF, missed, output_n), device=declared_of(STIFF))
    gaps = diagnose(Columns("gaps", *logged(STIFF, 1.6, missed)), device=declared_of(STIFF))
    assert found.cause == gaps.cause == "ticks", found.conclusion
    assert found.ticks.missed_share == pytest.approx(missed.mean(), abs=0.1)
    assert found.law.told
    assert found.law.stiffness_n_per_m == pytest.approx(STIFF.stiffness, rel=0.01)
    assert "the force stays while the position moves" in diagnosis_text(found)


@pytest.mark.parametrize(
    ("changed", "output_n"),
    [
        ({}, 0.0),
        ({}, 0.1),
        ({}, 0.5),
        ({"encoder": 3e-5, "damper": 12.0}, 0.1),
        ({"limit": 4.0}, 0.0),
        ({"limit": 4.0}, 0.1),
        ({"delay": 4.0, "limit": 8.0}, 0.05),
        ({"keep": 0.6, "delay": 3.0}, 0.1),
        ({"two_sided": 1.0, "grab": 0.6, "sway": 1e-3}, 0.02),
        ({"stiffness": 600.0}, 0.5),
    ],
)
@pytest.mark.parametrize("declared", [True, False])
def test_a_force_that_stays_for_another_reason_did_run(changed, output_n, declared):
    loop = replace(STIFF, **changed)
    log, _ = log_of(rows(loop, None, output_n))
    assert np.count_nonzero(np.diff(log.force_n) == 0) > 50
    assert without_repeats(log, loop.limit if declared else None) is log


def test_a_law_is_fitted_without_the_ticks_that_did_not_run():
    log, _ = log_of(rows(STIFF, pattern("uneven")))
    assert not find_law(log, STIFF.limit).told
    law = find_law(without_repeats(log, STIFF.limit), STIFF.limit)
    assert (law.stiffness_n_per_m, law.damping_ns_per_m) == pytest.approx((8000.0, 4.0), rel=1e-6)
