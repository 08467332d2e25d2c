"""A device that follows the logged force up to a limit of its own is refused; one that is only unusual is not."""

import re
from dataclasses import replace

import numpy as np
import pytest
from measured_device import Truth, measured, multisine

import avc_casadi as avc
from avc_casadi.identification.identify import identify
from avc_casadi.identification.initial_guess import first_guess, saturated_force_n
from avc_casadi.identification.record import Record

USUAL = Truth(mass=0.12, damping=0.8, coulomb=0.1, delay=1.0, encoder=2e-5)


def excited(truth, limit=np.inf, seconds=8.0, seed=0, rms=1.5):
    """The log has the force as it is commanded, the device gives less."""
    random = np.random.default_rng(seed)
    wanted = multisine(random, seconds, truth.period, 0.5, 80.0, rms)
    # Without a controller, so that nothing but the limit lies between the two.
    _, position, _ = measured(truth, np.clip(wanted, -limit, limit), random)
    return Record("log", truth.period, position, wanted)


def cut(record):
    return saturated_force_n([record], first_guess([record]).values["delay_samples"])


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [0.2, 0.35, 0.55])
def test_where_the_force_ends_is_found(seed, share):
    random = np.random.default_rng(100 + seed)
    truth = replace(USUAL, mass=random.uniform(0.05, 0.5), delay=random.uniform(0, 3), coulomb=random.uniform(0, 0.3))
    largest = np.abs(excited(truth, seed=seed).force_n).max()
    assert cut(excited(truth, share * largest, seed=seed)) == pytest.approx(share * largest, rel=0.25)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "unusual",
    [
        {},
        {"coulomb": 1.2},
        {"coulomb": 0.3, "breakaway": 0.3},
        {"damping": 8.0},
        {"resonance": 80.0},
        {"ground": 400.0},
        {"bandwidth": 60.0},
        {"encoder": 2e-4},
        {"offset": 0.8, "drift": 0.3},
        {"scale": 0.6},
        {"mass": 2.0, "delay": 3.0},
    ],
    ids=str,
)
def test_a_force_that_acts_as_it_is_logged_is_not_cut(unusual):
    for seed in range(3):
        assert cut(excited(replace(USUAL, **unusual), seed=seed)) is None


def test_it_is_refused_by_name():
    with pytest.raises(avc.InputError) as refused:
        identify([excited(USUAL, limit=2.0)])
    (fault,) = refused.value.faults
    assert fault.key == "force"
    told = re.search(r"up to (\S+) N, and the device follows it up to about (\S+) N", fault.message)
    assert float(told[1]) > 3.5
    assert float(told[2]) == pytest.approx(2.0, rel=0.25)


SELDOM = replace(USUAL, mass=0.25, coulomb=0.8)


def seldom(beyond, seed):
    """The same with a force that is cut in a share of the samples, in a band where inverse dynamics hardly see it."""
    random = np.random.default_rng(seed)
    wanted = multisine(random, 6.0, SELDOM.period, 0.5, 300.0, 2.0)
    limit = float(np.quantile(np.abs(wanted), 1 - beyond))
    _, position, _ = measured(SELDOM, np.clip(wanted, -limit, limit), random)
    return Record("log", SELDOM.period, position, wanted), limit


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [5, 6])
def test_a_force_that_is_cut_seldom_is_noted_with_its_limit(seed):
    record, limit = seldom(0.02, seed)
    (note,) = [note for note in identify([record]).notes if "seems to follow the force" in note]
    assert float(re.search(r"up to about (\S+) N", note)[1]) == pytest.approx(limit, rel=0.2)


@pytest.mark.thorough
@pytest.mark.parametrize("unusual", [{}, {"breakaway": 0.4, "slow": 0.005}, {"ground": 200.0}, {"resonance": 90.0}])
def test_nothing_is_noted_of_a_force_that_acts_as_it_is_logged(unusual):
    found = identify([excited(replace(USUAL, **unusual), seed=4)])
    assert not [note for note in found.notes if "seems to follow the force" in note]
