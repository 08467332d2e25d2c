"""What the tests of excitation share: a plan, and devices that play it on the core compiled for the host."""

import dataclasses
import functools
import itertools

import numpy as np
from hardware_bench import host_library
from host_device import HostCore, HostLink

from avc_casadi.identification.excitation import Plan, plan_excitation
from avc_casadi.identification.signal import Signal
from avc_casadi.model.device import Device
from avc_hardware import BenchDevice, excite
from avc_hardware.link.excite import plan_bytes
from avc_hardware.link.messages import Kind

DECLARED = Device(
    mass_kg=0.1,
    damping_ns_per_m=1.0,
    delay_samples=1,
    coulomb_friction_n=0.1,
    encoder_resolution_m=2e-5,
    max_force_n=8.0,
    range={"mass_kg": (0.07, 0.15), "damping_ns_per_m": (0.5, 2.0), "coulomb_friction_n": (0.05, 0.2)},
)


@functools.cache
def planned(kind="multisine", seconds=2.0, **limits):
    return plan_excitation(DECLARED, kind, seconds=seconds, **limits).plan


def half_sines(share, halves=1, ticks=60, max_force_n=8.0):
    """A plan without a controller that pushes to one side, in half a sine, or in so many halves in turn."""
    return Plan(
        kind="multisine", sample_time_s=1e-3, metres_per_count=2e-5, ticks=ticks, ramp_ticks=5, max_force_n=max_force_n,
        max_speed_m_per_s=1.0, max_travel_m=0.1, spring_n_per_m=0.0, damper_ns_per_m=0.0, window=4,
        signal=Signal.of([500.0 * halves / ticks], [share], [0.0], 1e-3),
    )  # fmt: skip


def device(**values):
    """A device without ranges: the declared one, with other values."""
    whole = DECLARED.model_dump(exclude={"range"}) | values
    return Device.model_validate(whole)


class Bench:
    """A device on the core, tick by tick, and everything that it did."""

    def __init__(self, hidden, **limits):
        self.device = BenchDevice(hidden)
        self.core = HostCore(host_library(), dataclasses.replace(self.device.limits, **limits))
        self.force_n, self.counts = [], []
        self.link = HostLink(self.core, position=lambda _: self._count(), on_force=self._hold)

    def _count(self):
        self.counts.append(self.device.count())
        return self.counts[-1]

    def _hold(self, force_n):
        self.force_n.append(-force_n)
        self.device.hold(force_n)

    def excite(self, plan):
        return excite(plan, self.link)

    def play_unheard(self, connection, plan, ticks, number=7):
        """Begin and never ask again."""
        connection.run(connection.session.ask(Kind.EXCITE, plan_bytes(plan, number), object))
        self.pass_by(ticks)

    def pass_by(self, ticks):
        for _ in range(ticks):
            force, _ = self.core.tick(np.array([self._count()], dtype=np.int32))
            self._hold(float(force[0]))


def first_broken(plan, counts, start):
    """The tick at which a limit is first exceeded, from the encoder alone, by the rule that the README tells."""
    away = np.array(counts[start:]) - counts[start]
    period, step, window = np.float32(plan.sample_time_s), np.float32(plan.metres_per_count), plan.window
    most = [int(np.float32(plan.max_travel_m) / step)]
    most += [int(np.float32(plan.max_speed_m_per_s) * (np.float32(window) * period) / step)]
    most += [int(np.float32(plan.max_speed_m_per_s) * period / step) + 1]
    before = np.concatenate([np.zeros(window, dtype=int), away])
    found = [np.abs(away), np.abs(away - before[: away.size]), np.abs(np.diff(away, prepend=0))]
    places = itertools.chain.from_iterable(np.flatnonzero(a > b)[:1] for a, b in zip(found, most, strict=True))
    return min(places, default=None)
