"""The exported coupling of a teleoperator is the loop that was judged, on any compiler; faults end in less force."""

import math

import numpy as np
import pytest
from exported import C99
from exported_teleoperator import ExportedPair, teleoperator_coupling
from teleoperator_simulator import run

import avc_casadi as avc
from avc_hardware import export_c

# In which a force fades, and after how many a link is silent, in samples.
FADE, SILENT = 50, 5
# At rest, then a whole swing of the hand's target.
SECONDS = 0.9
FOLLOWER = "mass_kg = 0.3\ndamping_ns_per_m = 1.0\ndelay_samples = 1\n"


def target(time):
    """At rest until the force has come in."""
    return 0.02 * math.sin(2 * math.pi * 1.5 * (time - 0.2)) if time > 0.2 else 0.0


@pytest.mark.parametrize(
    ("gains", "period", "there", "back", "scales", "force", "contact", "uneven", "limit"),
    [
        ((2000.0, 10.0, 0.0), 1e-3, 0.0, 0.0, (1.0, 1.0), None, None, (0.0, 0.0), math.inf),
        ((800.0, 6.0, 2.0), 1e-3, 5e-3, 3.5e-3, (1.0, 1.0), None, (2000.0, 4.0), (0.1, 0.05), math.inf),
        pytest.param(
            (300.0, 6.0, 1.0), 2e-3, 20e-3, 20e-3, (0.2, 0.5), None, None, (0.1, 0.01), math.inf, marks=pytest.mark.slow
        ),
        ((800.0, 6.0, 2.0), 0.5e-3, 2e-3, 2e-3, (5.0, 3.0), None, "fixed", (0.3, 0.0), 2.0),
        ((400.0, 6.0, 4.0), 1e-3, 1e-3, 1e-3, (1.0, 1.0), "commanded", (500.0, 4.0), (0.0, 0.0), math.inf),
        ((400.0, 6.0, 4.0), 1e-3, 0.0, 0.0, (0.5, 4.0), "measured", (500.0, 4.0), (0.0, 0.0), math.inf),
    ],
)
def test_exported_loop_is_the_plain_simulation(gains, period, there, back, scales, force, contact, uneven, limit):
    scale = scales[0] * scales[1]
    text = (
        f"mass_kg = {0.3 / scale!r}\ndamping_ns_per_m = {1 / scale!r}\nsample_time_s = {period!r}\ndelay_samples = 1\n"
        f"delay_s = {there!r}\nreturn_delay_s = {back!r}\nposition_scale = {scales[0]}\nforce_scale = {scales[1]}\n"
        f"jitter = {uneven[0]}\nlost_share = {uneven[1]}\n"
        f"architecture = '{'position-position' if force is None else 'position-force'}'\n"
        f"force = '{force or 'commanded'}'\n"
    )
    device = "[device]\nmass_kg = 0.12\ndamping_ns_per_m = 0.8\ndelay_samples = 1\n"
    if math.isfinite(limit):
        text, device = f"{text}max_force_n = {limit / scales[1]!r}\n", f"{device}max_force_n = {limit}\n"
    pair = ExportedPair(teleoperator_coupling(text, *gains, device=device))
    for end in (pair.leader, pair.follower):
        # Where the other one is, is known at the beginning.
        assert end.receive(pair.Message(2**32 - 1, 0.0, 0.0, 0.0))
    given = {
        "hand": (0.1, 5.0, 400.0),
        "contact": contact,
        "target": target,
        "force": force,
        "limit": limit,
        "jitter": uneven[0],
        "lost": uneven[1],
    }
    devices = (0.12, 0.8, 1e-3, 1), (0.3, 1.0, period, 1)
    wanted = run(*devices, gains, SECONDS, there, back, **given)
    found = run(*devices, gains, SECONDS, there, back, **given, ends=(pair.leader, pair.follower))
    assert np.abs(wanted[0]).max() > 5e-3
    assert np.abs(wanted).max() < 1
    assert np.abs(found - wanted).max() < 1e-9


def pulled(compiler=C99, precision="double", follower=FOLLOWER):
    """Both ends after a while, the follower 1 mm behind a leader at rest, and what the follower has sent last."""
    pair = ExportedPair(teleoperator_coupling(follower, 1000.0, 5.0, 2.0), compiler=compiler, precision=precision)
    for _ in range(2 * FADE):
        message = pair.follower.message()
        pair.follower.step(0.001, pair.leader.message())
        force = pair.leader.step(0.0, message)
    assert force == pytest.approx(1.0)
    return pair


def test_force_comes_in_slowly_wherever_both_ends_are():
    pair = ExportedPair(teleoperator_coupling(FOLLOWER, 1000.0, 5.0))
    assert pair.leader.step(0.0) == 0.0
    forces = []
    for _ in range(FADE):
        pair.follower.sample(0.02)
        forces.append(pair.leader.step(0.0, pair.follower.message()))
    assert forces == pytest.approx([20.0 * (k + 1) / FADE for k in range(FADE)])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9, 0.5])
@pytest.mark.parametrize("place", ["position", "velocity", "force"])
def test_bad_numbers_of_a_message_are_refused(bad, place):
    pair = pulled()
    message = pair.follower.message()
    message.number += 1
    value = bad if place == "position" or not math.isfinite(bad) else 1e9
    setattr(message, place, value)
    assert not pair.leader.receive(message)
    assert pair.leader.step(0.0, message) == pytest.approx(1.0)


def test_silent_link_lets_the_force_fade_and_an_end_that_starts_anew_is_believed():
    pair = pulled()
    forces = [pair.leader.step(0.0) for _ in range(SILENT + FADE + 5)]
    assert forces[: SILENT - 1] == pytest.approx([1.0] * (SILENT - 1))
    assert np.all(np.diff(forces) <= 1e-12)
    assert np.abs(np.diff(forces)).max() <= 1.01 / FADE
    assert forces[-1] == 0.0
    pair.follower.init()
    pair.follower.sample(0.3)
    back = [pair.leader.step(0.0, pair.follower.message())]
    for _ in range(FADE):
        pair.follower.sample(0.3)
        back.append(pair.leader.step(0.0, pair.follower.message()))
    assert back[:2] == pytest.approx([300 / FADE, 600 / FADE])
    assert back[-1] == pytest.approx(300.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9, 0.5, 0.005])
def test_own_position_that_is_none_fades_both_ends(bad):
    pair = pulled()
    number = pair.leader.message().number
    assert pair.leader.step(bad) == pytest.approx(1.0 - 1 / FADE)
    assert pair.leader.message().number == number
    for _ in range(SILENT + FADE + 1):
        pair.leader.step(math.nan)
        force = pair.follower.step(0.001, pair.leader.message())
        assert math.isfinite(force)
    assert force == 0.0
    assert pair.leader.step(math.nan) == 0.0


@pytest.mark.parametrize("silenced", ["leader", "follower"])
def test_message_that_is_repeated_for_ever_is_believed_once(silenced):
    """A sensor that has failed, and a link that goes on with what it was given last: no force comes back."""
    pair = pulled()
    failed, other = pair.leader, pair.follower
    if silenced == "follower":
        failed, other = other, failed
    forces = []
    for _ in range(20 * (SILENT + FADE)):
        assert failed.step(math.nan, other.message()) <= 1.0
        forces.append(other.step(0.02, failed.message()))
    assert np.abs(forces[: SILENT + FADE]).max() > 0.9
    assert np.all(np.array(forces[2 * (SILENT + FADE) :]) == 0)
    # The sensor works again.
    for _ in range(SILENT + FADE):
        failed.step(0.0, other.message())
        force = other.step(0.02, failed.message())
    assert abs(force) == pytest.approx(20.0)


def test_lost_damper_uncovers_no_spring():
    """The follower is drawn off at 0.25 m/s, damper against spring; a bad sample anywhere lets no force grow."""
    path = 1e-3 - 0.25e-3 * np.concatenate([np.zeros(80), np.arange(1, 13)])
    for lost in range(78, 92):
        pair, forces = pulled(), []
        for k, x in enumerate(path):
            pair.leader.step(0.0, pair.follower.message())
            forces.append(pair.follower.step(math.nan if k == lost else x, pair.leader.message()))
        assert forces[lost] * forces[lost - 1] >= 0
        assert abs(forces[lost]) <= abs(forces[lost - 1])
        if lost + 1 < len(path):
            # The law asks for less than 4 N; half a step of the fade is rounding.
            assert abs(forces[lost + 1]) <= abs(forces[lost]) + 1.5 * 4.0 / FADE


@pytest.mark.slow
def test_unstable_coupling_is_written_by_request_only():
    coupling = teleoperator_coupling(f"{FOLLOWER}delay_s = 0.02\n", 20000.0, 1.0)
    with pytest.raises(avc.NotDeployableError, match="linearly unstable"):
        export_c(coupling)
    assert "UNSAFE, written by request" in export_c(coupling, unsafe=True)["avc_coupling.h"]
