"""Laws that others run between device and wall, from what their authors published, and exported C beside them.

Each takes the positions that the encoders of all lanes read, above 0 in the wall, and returns the forces out of the
wall, once a sample. Velocity is a backward difference, as published, where nothing else is said.

PO/PC: B. Hannaford and J.-H. Ryu, IEEE Trans. Robotics and Automation 18(1), 2002, with the observer of J.-H. Ryu, Y.
S. Kim and B. Hannaford, IEEE Trans. Robotics 20(4), 2004; its reference: J.-H. Ryu, C. Preusche, B. Hannaford and G.
Hirzinger, IEEE Trans. Control Systems Technology 13(5), 2005. Energy bounding: J.-P. Kim and J. Ryu, Int. J. Robotics
Research 29(6), 2010. Force augmentation: H. Singh, D. Janetzko, A. Jafari, B. Weber, C.-I. Lee and J.-H. Ryu, IEEE
Trans. Industrial Electronics 67(1), 2020.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from baseline_plant import Floats
from simulator_in_c import with_exported

from avc_casadi.model.device import Device


@dataclass(frozen=True)
class Loop:
    """What a law is made for.

    `tuned` is a passivity controller's largest damper, N.s/m, or the rate of a force augmentation, m/s: how fast the
    offset grows, over what the stiffness misses.
    """

    device: Device
    stiffness_n_per_m: float
    damping_ns_per_m: float
    tuned: float = math.nan

    @property
    def passive_n_per_m(self) -> float:
        """Stiffest spring that is passive on the device without dry friction: b/(T/2 + t_d)."""
        device = self.device
        return device.damping_ns_per_m / ((0.5 + device.delay_samples) * device.sample_time_s)


@dataclass(frozen=True)
class Sample:
    """A sample of all lanes: what the encoder reads, the way since the sample before, the force of the wall."""

    seen_m: Floats
    moved_m: Floats
    wall_n: Floats


class Wall:
    """The wall itself, sampled: spring and damper where the reading is inside, never pulling."""

    def __init__(self, loop: Loop, lanes: int) -> None:
        self.loop, self.time_s, self.limit_n = loop, loop.device.sample_time_s, loop.device.max_force_n or math.inf
        # Of the sample before; at the first one the device is taken to stand where it is.
        self.before = np.full(lanes, np.nan)

    def __call__(self, seen: Floats) -> Floats:
        moved = np.where(np.isnan(self.before), 0.0, seen - self.before)
        self.before = seen
        wall = self.loop.stiffness_n_per_m * seen + self.loop.damping_ns_per_m * moved / self.time_s
        return self.rendered(Sample(seen, moved, np.where(seen > 0, np.maximum(wall, 0.0), 0.0)))

    def rendered(self, now: Sample) -> Floats:
        """The force in place of the wall's."""
        return now.wall_n


class PassivityController(Wall):
    """Passivity observer and controller: a damper takes out within a sample what the wall has given too much.

    The observer pairs the force that was held with the way over which it was, its delay known. The energy is 0 again
    where there was no wall for 0.1 s. The damper has a largest value, without which it is a sampled damper that no
    device holds.
    """

    RESET_S = 0.1

    def __init__(self, loop: Loop, lanes: int) -> None:
        super().__init__(loop, lanes)
        self.energy, self.outside_s = np.zeros(lanes), np.zeros(lanes)
        self.sent = [np.zeros(lanes) for _ in range(1 + round(loop.device.delay_samples))]

    def reference(self, seen: Floats) -> Floats:
        """Energy below which it acts, J."""
        return np.zeros_like(seen)

    def rendered(self, now: Sample) -> Floats:
        self.outside_s = np.where(now.wall_n > 0, 0.0, self.outside_s + self.time_s)
        self.energy = np.where(self.outside_s > self.RESET_S, 0.0, self.energy + self.sent[-1] * now.moved_m)
        missing = np.minimum(self.energy - self.reference(now.seen_m), 0.0)
        # A damper alpha = -missing/(T v^2), times v = moved/T.
        alpha = np.minimum(-missing * self.time_s / np.where(now.moved_m == 0, np.inf, now.moved_m**2), self.loop.tuned)
        force = np.clip(now.wall_n + alpha * now.moved_m / self.time_s, -self.limit_n, self.limit_n)
        self.sent = [force, *self.sent[:-1]]
        return force


class ReferenceFollowing(PassivityController):
    """The same, acting where the energy falls behind that of the wall's spring, k x^2/2, already."""

    def reference(self, seen: Floats) -> Floats:
        return 0.5 * self.loop.stiffness_n_per_m * np.maximum(seen, 0.0) ** 2


class EnergyBounding(Wall):
    """Energy bounding: the held force gives out no more than the device's own damper takes.

    F(k) = F(k-1) + beta dx with beta = (F_wall - F(k-1))/dx between bounds. With F^2/(2 c) as storage and b dx^2/T as
    what the damper takes at least, F(k-1) dx + b dx^2/T >= (F(k)^2 - F(k-1)^2)/(2 c); for c = 2 b/T the bounds are
    |F(k)| <= |F(k-1) + c dx|. With a delay c is the stiffest spring that is passive behind it. Dry friction does not
    count.
    """

    def __init__(self, loop: Loop, lanes: int) -> None:
        super().__init__(loop, lanes)
        self.force = np.zeros(lanes)

    def rendered(self, now: Sample) -> Floats:
        bound = np.abs(self.force + self.loop.passive_n_per_m * now.moved_m)
        self.force = np.minimum(np.minimum(now.wall_n, bound), self.limit_n)
        return self.force


class ForceAugmentation(Wall):
    """Successive force augmentation: a spring that is soft enough, and beside it an offset that is fed forward.

    While the device goes in, the offset grows by a part of what the force misses of the wall's; while it comes out, it
    stays; outside it is 0. The soft spring is the stiffest passive one.
    """

    def __init__(self, loop: Loop, lanes: int) -> None:
        super().__init__(loop, lanes)
        self.soft = min(loop.passive_n_per_m, loop.stiffness_n_per_m)
        self.offset = np.zeros(lanes)

    def rendered(self, now: Sample) -> Floats:
        seen = now.seen_m
        depth = np.where(seen > 0, seen, np.inf)
        missing = self.loop.stiffness_n_per_m - self.soft - self.offset / depth
        grown = self.offset + np.where(now.moved_m > 0, self.loop.tuned * self.time_s * missing, 0.0)
        self.offset = np.where(seen > 0, grown, 0.0)
        return np.where(seen > 0, np.maximum(self.soft * seen + self.offset, 0.0), 0.0)


BASELINES: Mapping[str, type[Wall]] = {
    "the wall itself": Wall,
    "PO/PC": PassivityController,
    "PO/PC with reference energy": ReferenceFollowing,
    "energy bounding": EnergyBounding,
    "force augmentation": ForceAugmentation,
}

_LANES = """
#include "avc_coupling.h"
int lane_bytes(void) { return (int)sizeof(avc_coupling_t); }
void lanes_start(avc_coupling_t *c, int n) { for (int i = 0; i < n; i++) avc_coupling_start(c + i); }
void lanes_step(avc_coupling_t *c, const double *x, double *f, int n)
{
    for (int i = 0; i < n; i++) f[i] = (double)avc_coupling_step(c + i, (avc_coupling_real_t)x[i]);
}
"""


class Exported:
    """The exported C of a coupling, by file name, as firmware runs it."""

    def __init__(self, files: Mapping[str, str]) -> None:
        self._c = with_exported({**files, "lanes.c": _LANES}, "lanes.c")

    def lanes(self, lanes: int) -> ExportedLanes:
        """The coupling in so many devices, started anew."""
        return ExportedLanes(self._c, lanes)


class ExportedLanes:
    """A coupling in many devices."""

    def __init__(self, library: ctypes.CDLL, lanes: int) -> None:
        self._c, self._states = library, np.zeros(lanes * library.lane_bytes(), dtype=np.uint8)
        self._c.lanes_start(self._states.ctypes.data_as(ctypes.c_void_p), lanes)

    def __call__(self, seen: Floats) -> Floats:
        x, force = np.ascontiguousarray(seen), np.empty_like(seen)
        places = (array.ctypes.data_as(ctypes.c_void_p) for array in (self._states, x, force))
        self._c.lanes_step(*places, len(x))
        return force
