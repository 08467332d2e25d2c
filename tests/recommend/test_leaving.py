"""The force that still acts outside the wall after a press is that of the exported C on a device written out here."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from quick import first
from withdrawn_device import NOTICED_N, pushed_outside, target_m

import avc_casadi as avc
from avc_casadi.claims.impedance import HandExcitation
from avc_casadi.coupling import Coupling
from avc_casadi.design.observer_law import GUESSES, regulator
from avc_casadi.model.gains import Gains, spring_before
from avc_casadi.model.runtime import Runtime
from avc_casadi.present.row import Mark, text_of
from avc_casadi.present.rows.wall import contact_rows
from avc_casadi.recommendation.recommend import judged_as_recommended
from avc_casadi.recommendation.rendered import NOTICED_LATE_S, LeavingContact, leaving_contact

LIGHT, LATE, LIMITED = "light", "late by a part of a sample", "with a force limit"
DEVICES = {
    LIGHT: {"mass_kg": 0.064, "damping_ns_per_m": 0.5, "sample_time_s": 1.08e-3, "delay_samples": 3},
    LATE: {"mass_kg": 0.2, "damping_ns_per_m": 1.0, "delay_samples": 2.1},
    LIMITED: {"mass_kg": 0.12, "damping_ns_per_m": 0.8, "delay_samples": 1, "max_force_n": 4.0},
}
WALLS_N_PER_M = {LIGHT: 13700.0, LATE: 6000.0, LIMITED: 3000.0}
STEP_M = 2e-5


def problem(name, **changed):
    wall = {"stiffness_n_per_m": WALLS_N_PER_M[name], "damping_ns_per_m": 0.0}
    return avc.load_problem("spring").changed(
        device={"encoder_resolution_m": STEP_M} | DEVICES[name] | changed, environment=wall
    )


def observed(stated, guess=0):
    """An observer whose estimate of the hand is slow, with state feedback."""
    law = regulator(stated.device, stated.hands, stated.environment.stiffness_n_per_m, GUESSES[guess])
    return Coupling.constant(stated, Gains(0.0, 1e12), "mine", Runtime(state_feedback=law))


def told_and_found(coupling):
    told, device = leaving_contact(coupling), coupling.problem.device
    depth_m = HandExcitation.of(device, coupling.static_stiffness_n_per_m).depth_m
    return told, pushed_outside(coupling, depth_m)


@pytest.mark.parametrize("name", first(DEVICES))
def test_an_observer_pushes_outside_as_its_exported_c_does(name):
    told, (outside_m, lasting_s, force_n) = told_and_found(observed(problem(name)))
    assert told.lasting_s > 2 * NOTICED_LATE_S
    assert told.outside_m == pytest.approx(outside_m, rel=0.04)
    assert told.lasting_s == pytest.approx(lasting_s, rel=0.04)
    assert told.force_n == pytest.approx(force_n, rel=0.04)


def pushed_by_matrices(coupling, depth_m, faces=8):
    """The same numbers by the equations of the law, led exactly along the motion of the hand."""
    device, law = coupling.problem.device, coupling.runtime.state_feedback
    a, b, gain, weight = (np.array(part) for part in (law.state, law.force_m_per_n, law.innovation, law.feedback))
    wall, most_n = coupling.problem.environment.stiffness_n_per_m, device.max_force_n or np.inf
    time_s = device.sample_time_s * np.arange(round(2.25 / device.sample_time_s))
    x = np.array([target_m(depth_m, now_s) for now_s in time_s])
    outside, found = (time_s > 1.25) & (x < 0), []
    for face in np.arange(faces) / faces:
        state, forces = np.zeros(len(b)), [0.0] * int(device.delay_samples)
        for seen in STEP_M * (np.floor(x / STEP_M - face + 0.5) + face) + law.face_m:
            error = seen - state[law.measures]
            state = state + gain * np.sign(error) * max(abs(error) - law.dead_zone_m, 0.0)
            forces.append(min(max(wall * (weight @ state), 0.0), most_n))
            state = a @ state + b * forces[-1]
        arriving = np.array(forces[: len(x)])
        noticed = np.flatnonzero(outside & (arriving > NOTICED_N))
        lasting = (noticed[-1] + 1 - np.flatnonzero(outside)[0]) * device.sample_time_s
        found.append((-x[noticed[-1]], lasting, arriving[outside].max()))
    return tuple(map(max, zip(*found, strict=True)))


@pytest.mark.parametrize("name", first(DEVICES))
def test_an_observer_pushes_outside_as_its_matrices_do(name):
    coupling = observed(problem(name))
    told, device = leaving_contact(coupling), coupling.problem.device
    depth_m = HandExcitation.of(device, coupling.static_stiffness_n_per_m).depth_m
    found = pushed_by_matrices(coupling, depth_m)
    assert (told.outside_m, told.lasting_s, told.force_n) == pytest.approx(found, rel=0.04)


SERIES, BEHIND_A_PLAIN_OBSERVER = "series", "behind a plain observer"


@pytest.mark.parametrize(
    ("name", "kind"),
    # With more delay than one sample this damper is too much for the plain observer: it rings.
    first([(LIMITED, BEHIND_A_PLAIN_OBSERVER), *itertools.product(DEVICES, ("contact damper", SERIES))], 3),
)
def test_the_force_of_springs_and_dampers_ends_as_that_of_their_exported_c_does(name, kind):
    stated = problem(name)
    gains = Gains(0.0, 1e8, 8.0)
    if kind == SERIES:
        gains = Gains(5.0, spring_before(stated, 0.7 * stated.environment.stiffness_n_per_m), 4.0)
    runtime = Runtime(observer_mass_kg=0.1) if kind == BEHIND_A_PLAIN_OBSERVER else Runtime()
    told, (outside_m, lasting_s, _) = told_and_found(Coupling.constant(stated, gains, "mine", runtime))
    # Within two samples and three steps of the encoder.
    assert told.lasting_s == pytest.approx(lasting_s, abs=2 * stated.device.sample_time_s)
    assert told.outside_m == pytest.approx(outside_m, abs=3 * STEP_M)
    assert told.lasting_s < NOTICED_LATE_S


@pytest.mark.parametrize("late", [0, 1, 4])
def test_a_bare_spring_pushes_outside_for_its_delay_and_no_longer(late):
    stated = problem(LIMITED, delay_samples=late, encoder_resolution_m=0.0)
    told = leaving_contact(Coupling.constant(stated, Gains(0.0, 1e8), "mine"))
    assert told.lasting_s <= (late + 1) * stated.device.sample_time_s
    assert (told.force_n > 0) == (late > 0)


def test_the_force_of_a_contact_damper_ends_before_the_face():
    stated = problem(LIMITED, delay_samples=0, encoder_resolution_m=0.0)
    told = leaving_contact(Coupling.constant(stated, Gains(0.0, 1e8, 8.0), "mine"))
    assert (told.outside_m, told.lasting_s, told.force_n) == (0.0, 0.0, 0.0)


def test_dry_friction_has_no_part_in_it():
    smooth, rough = (problem(LIGHT, coulomb_friction_n=friction_n) for friction_n in (0.0, 0.8))
    assert leaving_contact(observed(rough)) == leaving_contact(observed(smooth))


@pytest.mark.slow
def test_the_row_stands_where_a_hand_notices_that_the_force_ends_late():
    soft = avc.load_problem("soft")
    found = judged_as_recommended(soft, Coupling.constant(soft, Gains(0.0, 1e8), "mine").schedule, hands=4)
    data = found.data()

    def row(lasting_s):
        leaving = LeavingContact(outside_m=1.25e-3, lasting_s=lasting_s, force_n=3.5, withdrawn_s=0.5)
        rows = contact_rows(replace(found.rendered, leaving=leaving), soft)
        return next(shown for shown in rows if shown.label == "Leaving contact")

    assert set(data["felt"]["leaving"]) == {"outside_m", "lasting_s", "force_n", "withdrawn_s"}
    assert (row(0.9 * NOTICED_LATE_S).mark, row(0.9 * NOTICED_LATE_S).rank) == (Mark.NONE, 1)
    told = row(0.084)
    assert (told.mark, told.rank) == (Mark.CAUTION, 0)
    told_text = text_of(told.values, soft.units)
    assert all(value in told_text for value in ("3.50 N", "84.0 ms", "1.25 mm", "500 ms"))
    turning = avc.load_problem("knob").units
    assert "3.50 N.m for 84.0 ms outside the wall, until 1.25 mrad" in text_of(told.values, turning)
