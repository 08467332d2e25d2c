"""A position that no hand brings about is a fault of the sensor: exported C gives no force outside, and no energy."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from bad_samples import SANITIZED, BadSensor, laws_of_each_kind
from exported import Exported
from faulty_sensor import KINDS, FaultySensor
from hardware_bench import believer, bench_problem, export_c, host_library, push, with_gains
from host_device import HostCore, HostLink
from quick import first

from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling
from avc_casadi.model.runtime import Runtime
from avc_hardware import BoardLimits, DeviceFault
from avc_hardware.codegen.sensor import SensorBounds

STEP = 2e-5
STIFFNESS = 5e3


def laws() -> dict[str, Coupling]:
    """Couplings that remember: a damper, an observer between steps, one whose state is fed back, a guard."""
    problem = bench_problem((5.0, STIFFNESS), encoder_resolution_m=STEP, max_force_n=8.0)
    plain = with_gains(problem, 5.0, 4e3, 3.0)
    runtimes = {
        "plain": Runtime(estimator="zero-crossing"),
        "observer": Runtime(estimator="zero-crossing", observer_mass_kg=0.25),
        "state feedback": Runtime(estimator="zero-crossing", state_feedback=believer(3)),
        "guard": Runtime(estimator="zero-crossing", guard="passivity-controller"),
    }
    return {name: dataclasses.replace(plain, runtime=runtime) for name, runtime in runtimes.items()}


LAWS = laws()


def on_steps(way: FloatArray) -> FloatArray:
    return np.asarray(STEP * np.round(way / STEP))


@pytest.mark.parametrize("name", first(LAWS))
def test_wrong_samples_at_rest_outside_give_no_force_then_or_later(name: str) -> None:
    device = Exported(LAWS[name])
    for wrong_m in (0.1, -1.0, 1e6, 0.02, 5.5e-3, -4e-3, 3e-4, math.nan, math.inf, -3e38):
        for lasts in (1, 2, 30):
            way = np.full(150, -5e-3)
            way[50 : 50 + lasts] += wrong_m
            way[50 + lasts + 2] += 6e-3  # and one more just after it
            device.start()
            assert np.abs(device.forces(way)).max() == 0


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("speed_m_per_s", [9.8, -9.8, 4.0, 3.0, -3.0, 1.5])
def test_a_run_of_bad_samples_that_agree_gives_no_force(name: str, speed_m_per_s: float) -> None:
    """No hand is that fast within some milliseconds of rest, however steady the samples are."""
    device = Exported(LAWS[name])
    for lasts in (1, 2, 3, 5):
        for sample in (1, 2, 3, 7):
            way = np.full(60, -0.08)
            way[sample : sample + lasts] += 1e-3 * speed_m_per_s * np.arange(1, lasts + 1)
            device.start()
            assert np.abs(device.forces(way)).max() == 0


@pytest.mark.parametrize(("sample_time_s", "step_m"), [(2.5e-4, 1e-5), (5e-4, 5e-5), (1e-3, STEP)])
def test_steps_of_an_encoder_do_not_add_up_to_a_movement(sample_time_s: float, step_m: float) -> None:
    """Samples that agree are believed once hand and actuator can have made their speed."""
    problem = bench_problem((0.0, STIFFNESS), encoder_resolution_m=step_m, max_force_n=8.0, sample_time_s=sample_time_s)
    device, most_m_per_s2 = Exported(with_gains(problem, 0.0, 4e3)), 100.0 + 8.0 / problem.device.mass_kg
    for lasts in (6, 12, 20):
        far_m = 1.05 * (most_m_per_s2 * (lasts * sample_time_s) ** 2 + lasts * 4 * step_m)
        for speed_m_per_s in (0.5, 1.0, 2.0, 3.5, 5.0, 7.0):
            way = np.full(60, -far_m)
            way[20 : 20 + lasts] += sample_time_s * speed_m_per_s * np.arange(1, lasts + 1)
            device.start()
            assert np.abs(device.forces(way)).max() == 0


@pytest.mark.parametrize(("share", "stiffness_n_per_m"), first([(0.12, 4e3), (0.12, 1e8), (0.5, 4e3), (1.0, 1e8)]))
def test_the_first_sample_outside_gives_no_force(share: float, stiffness_n_per_m: float) -> None:
    """The position of a law begins elsewhere than the measured one: no damper may take that for a movement."""
    problem = bench_problem((5.0, STIFFNESS), encoder_resolution_m=STEP, max_force_n=8.0)
    law = believer(3)
    law = law.model_copy(update={"feedback": tuple(share * one for one in law.feedback)})
    coupling = with_gains(problem, 0.0, stiffness_n_per_m, 3.0)
    device = Exported(dataclasses.replace(coupling, runtime=Runtime(estimator="zero-crossing", state_feedback=law)))
    for place_m in (-1.0, -0.05, -1e-3, -STEP):
        device.start()
        assert np.abs(device.forces(np.full(20, place_m))).max() == 0


@pytest.mark.parametrize("name", LAWS)
def test_a_fault_in_contact_gives_back_no_more_than_had_been_stored(name: str) -> None:
    """The wall goes on at the depth that was seen, wherever the device is by then; outside all is as new."""
    device, fresh = Exported(LAWS[name]), Exported(LAWS[name])
    press = on_steps(np.linspace(-1e-3, 2e-3, 200))
    first = device.forces(np.concatenate([press, np.full(50, press[-1])]))
    assert 0.8 * first[-1] < device.step(math.nan) <= first[-1]
    near = device.forces(np.full(100, press[-1]))
    np.testing.assert_allclose(near, first[-1], rtol=0.05)
    device.step(math.nan)
    deeper = device.forces(np.full(100, press[-1] + 3e-3))
    assert np.all(np.diff(deeper[: np.argmin(deeper)]) <= 0)
    assert deeper.min() < 0.2 * first[-1]  # no hand brings it there as fast
    assert np.all(np.diff(deeper[np.argmin(deeper) :]) <= 0.3 * first[-1])
    assert deeper.max() <= 1.05 * near[-1]
    assert deeper[-1] == pytest.approx(near[-1], rel=1e-3)
    leaving = device.forces(on_steps(np.linspace(5e-3, -1e-3, 600)))
    assert np.abs(leaving[250:]).max() < 0.05  # from 2.5 mm on: the wall begins 3 mm deeper
    device.forces(np.full(500, -1e-3))
    fresh.forces(np.full(500, -1e-3))
    again, new = device.forces(press), fresh.forces(press)
    np.testing.assert_allclose(again, new, atol=0.05 * float(new.max()))
    assert new.max() > 3


@pytest.mark.parametrize("name", LAWS)
def test_who_is_in_the_wall_at_the_start_gets_no_force_until_it_goes_deeper(name: str) -> None:
    device = Exported(LAWS[name])
    assert np.abs(device.forces(np.full(20, 4e-3))).max() < 1e-3
    assert device.forces(on_steps(np.linspace(4e-3, 5e-3, 100)))[-1] > 0.5


@pytest.mark.parametrize("wrong_m", [math.nan, 0.1, -0.1])
@pytest.mark.parametrize("name", LAWS)
def test_a_fault_before_the_face_lets_no_spring_begin_stretched(name: str, wrong_m: float) -> None:
    """What a device went in without force does not count: the force begins as of a wall that begins there."""
    speed, hold = 3e-4, np.full(300, 2.4e-3)
    way = np.concatenate([on_steps(-0.7 * speed + speed * np.arange(-30, 8)), hold])
    faulty, unseen = way.copy(), way[32]
    faulty[30] += wrong_m
    assert way[30] < 0 < way[31]
    found, pressed = Exported(LAWS[name]).forces(faulty), Exported(LAWS[name]).forces(way - unseen)
    assert np.all(found[30:33] == 0)
    assert 1 < found[-1] < 1.05 * pressed[-1]


@pytest.mark.parametrize("delay", [1, 3])
def test_a_light_device_that_is_thrown_out_is_no_fault(delay: int) -> None:
    """The last forces act on 20 g when it is outside already, with up to 750 m/s2; a fault would end the next one."""
    mass, time, press = 0.02, 1e-3, 1.6
    problem = bench_problem(
        (0.0, 1.2e4),
        mass_kg=mass,
        delay_samples=delay,
        max_force_n=15.0,
        encoder_resolution_m=STEP,
        damping_ns_per_m=0.3,
    )
    device, fastest = Exported(with_gains(problem, 0.5, 1.2e4)), 0.0
    for speed in np.linspace(0.05, 1.0, 60):
        x, v, queue = -0.004, float(speed), [0.0] * delay
        device.start()
        for _ in range(400):
            seen = STEP * round(x / STEP)
            force = device.step(seen)
            assert force > 0 or seen < 3e-4
            queue.append(force)
            acceleration = (press - queue.pop(0)) / mass
            x, v = x + time * v + time**2 / 2 * acceleration, v + time * acceleration
            fastest = max(fastest, -v if x < 0 else 0.0)
    assert fastest > 0.5


@functools.cache
def bench(name: str) -> FaultySensor:
    return FaultySensor(LAWS[name].problem.device, export_c(LAWS[name]))


def check(name: str, runs: int, seed: int) -> None:
    for kind in KINDS:
        assert bench(name).meets(kind, runs, seed, thrown=False).outside_n.max() == 0
        law, spring = (
            bench(name).meets(kind, runs, seed, thrown=True, spring_n_per_m=k).given_j.max() for k in (0.0, STIFFNESS)
        )
        assert law <= spring


@pytest.mark.parametrize("name", first(LAWS))
def test_no_fault_gives_force_outside_or_more_energy_than_a_spring_would(name: str) -> None:
    check(name, runs=40, seed=1)


# Bad samples in a row that nearly agree, the first of them 20 mm away or more.

EACH_KIND = laws_of_each_kind()
BOUND_N = 0.05


def devices() -> Iterator[Any]:
    """Sample times, encoder steps, masses and force limits; the quick ones hold every pair of values."""
    times, steps = (1e-4, 5e-4, 1e-3, 2e-3), (0.0, 1e-6, 2e-5, 1e-4)
    for time, step, mass, limit in itertools.product(range(4), range(4), range(2), range(2)):
        quick = mass == (time + step) % 2 and limit == (time // 2 + step) % 2
        numbers = (times[time], steps[step], (0.01, 0.2)[mass], (None, 8.0)[limit])
        yield pytest.param(*numbers, marks=() if quick else pytest.mark.slow)


@pytest.mark.parametrize(("sample_time_s", "step_m", "mass_kg", "max_force_n"), list(devices()))
def test_any_device_bears_six_bad_samples_and_its_header_says_how_many(
    sample_time_s: float, step_m: float, mass_kg: float, max_force_n: float | None
) -> None:
    keys = {"sample_time_s": sample_time_s, "mass_kg": mass_kg, "encoder_resolution_m": step_m}
    made = with_gains(bench_problem((0.0, 3e3), **keys, max_force_n=max_force_n), 1.0, 3e3)
    borne = SensorBounds.of(made.problem.device).most_bad_samples(1.0)
    assert 6 <= borne <= 20
    device = Exported(made)
    way = np.full(60 + borne, -18e-3)
    way[30 : 30 + borne] = 2e-3 - 1e-3 * np.arange(borne)
    assert np.abs(device.forces(way)).max() == 0
    assert f"up to {borne} in a row" in " ".join(export_c(made)["avc_coupling.h"].replace("*", "").split())


@functools.cache
def bad_sensor(name: str) -> BadSensor:
    return BadSensor(EACH_KIND[name])


@pytest.mark.parametrize("name", first(EACH_KIND, 3))
def test_bad_samples_that_nearly_agree_give_no_force_outside(name: str) -> None:
    found = bad_sensor(name).bad_samples(300, seed=2)
    assert found.bad > 1000
    assert found.largest_n <= BOUND_N


@pytest.mark.slow
@pytest.mark.parametrize("name", EACH_KIND)
def test_bad_samples_that_nearly_agree_are_no_matter_for_sanitizers(name: str) -> None:
    assert BadSensor(EACH_KIND[name], SANITIZED).bad_samples(5000, seed=3).largest_n <= BOUND_N


@pytest.mark.parametrize("name", first(EACH_KIND, 2))
def test_hands_that_strike_lose_no_sample(name: str) -> None:
    found = bad_sensor(name).strikes(10, (0.1, 3.0), seed=4)
    assert found.samples > 500
    assert found.refused == 0
    assert found.largest_n > 1


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("counts", [0, 1, 4, 50])
@pytest.mark.parametrize("samples", range(1, 8))
def test_a_law_has_learnt_nothing_from_refused_samples(name: str, counts: int, samples: int) -> None:
    """18 mm outside, samples 30 mm farther on that agree to some counts: force and law are those of a sound sensor."""
    device, sound = Exported(LAWS[name]), Exported(LAWS[name])
    way = np.full(400, -18e-3)
    way[300:] = on_steps(np.linspace(-18e-3, 3e-3, 100))
    faulty = way.copy()
    faulty[50 : 50 + samples] = 12e-3 + STEP * counts * np.arange(samples)
    forces, expected = device.forces(faulty), sound.forces(way)
    np.testing.assert_array_equal(forces, expected)
    assert expected.max() > 3


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("lasts", [1, 3, 10, 200])
def test_a_force_that_was_lost_in_contact_falls_and_comes_back_without_a_jump(name: str, lasts: int) -> None:
    device = Exported(LAWS[name])
    pressed = device.forces(np.concatenate([on_steps(np.linspace(-1e-3, 2e-3, 200)), np.full(100, 2e-3)]))[-1]
    lost = device.forces(np.full(lasts, math.nan))
    back = device.forces(np.full(100, 2e-3))
    assert np.all(np.diff(np.array([pressed, *lost])) <= 0)
    assert np.all(np.diff(np.array([lost[-1], *back])) <= 2 * pressed / min(lasts + 1, 50))
    assert back[-1] == pytest.approx(pressed, rel=0.05)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("speed_m_per_s", [-0.1, -0.5])
def test_a_device_that_leaves_while_samples_are_lost_gets_no_force_outside(name: str, speed_m_per_s: float) -> None:
    coming = on_steps(np.concatenate([np.linspace(-1e-3, 2e-3, 300), np.full(100, 2e-3)]))
    leaving = on_steps(2e-3 + 1e-3 * speed_m_per_s * np.arange(1, 60))
    for lost in range(1, 22):
        device, way = Exported(LAWS[name]), leaving.copy()
        way[lost : lost + 6] = math.nan
        device.forces(coming)
        forces = device.forces(way)
        assert np.abs(forces[lost : lost + 6][leaving[lost : lost + 6] < 0]).max(initial=0) <= BOUND_N


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("shift_m", [0.05, -0.05])
def test_an_encoder_that_is_set_to_0_anew_locks_no_device_up(name: str, shift_m: float) -> None:
    """The device stands 80 mm outside, 30 or 130 after that: the wall is at the new 0."""
    device, fresh = Exported(LAWS[name]), Exported(LAWS[name])
    device.forces(np.full(100, -0.08))
    assert np.abs(device.forces(np.full(100, -0.08 + shift_m))).max() == 0
    stroke = on_steps(np.concatenate([np.linspace(-0.08 + shift_m, 2e-3, 500), np.full(50, 2e-3)]))
    assert device.forces(stroke)[-1] == pytest.approx(fresh.forces(stroke)[-1], rel=1e-3)


@pytest.mark.parametrize("name", LAWS)
def test_an_encoder_set_anew_inside_begins_the_wall_there_from_no_force(name: str) -> None:
    device = Exported(LAWS[name])
    device.forces(np.full(100, -0.02))
    assert np.abs(device.forces(np.full(100, 0.03))).max() <= BOUND_N
    forces = device.forces(on_steps(np.linspace(0.03, 0.031, 200)))
    assert forces[-1] > 1
    assert np.abs(np.diff(forces)).max() < 0.3


@pytest.mark.parametrize("counts", [0, 1, 4, 50])
def test_firmware_latches_the_jump_and_gives_no_force(counts: int) -> None:
    """What begins with a jump is a fault of the device, whatever the samples agree on."""
    outside, far = round(-18e-3 / STEP), round(12e-3 / STEP)
    core = HostCore(host_library(), BoardLimits(metres_per_count=STEP, max_force_n=8.0))
    push(LAWS["state feedback"], HostLink(core, position=lambda _: outside))
    way = [*[outside] * 50, *(far + counts * k for k in range(6)), *[outside] * 50]
    forces = core.tick(np.array(way, dtype=np.int32))[0]
    assert np.all(np.asarray(forces) == 0)
    assert core.faults() & DeviceFault.JUMP
