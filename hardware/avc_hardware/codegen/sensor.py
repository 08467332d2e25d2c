"""What exported C believes of a position sensor: one rule and one text of C for walls, engines and followers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from avc_hardware.codegen.figures import actuator_m_per_s2, board_limits

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.simulation.emit import Precision

FARTHEST_M = 1e6
"""Larger positions count as infinite, and single precision might end."""
JUMP_M = 0.02
"""The fault model: bad positions begin with a jump of this size at the handle,"""
DRIFT_M = 1e-3
"""and go on from sample to sample by this much at most."""

_FASTEST_M_PER_S = 10.0  # no hand moves a handle faster: a larger step in a sample is a fault of the sensor
_STRIKE_M_PER_S = 3.5  # fastest movement that may be under way at the first sample; hard strikes are 2 to 3 m/s
_HAND_M_PER_S2 = 100.0  # ten times that of a fast tap: what a hand alone does to a device
_STOP_M_PER_S2 = 1000.0  # beyond it firmware takes an encoder for one that has jumped: stops and contacts strike
_QUIET_M_PER_S2 = 10.0  # forces that accelerate less than a tenth of a hand do not count
_UNDECLARED_M = 1e-4  # two steps of 50 um: an encoder that nobody declared may be that coarse
_LAG_TIME_CONSTANTS = 5.0  # after which 1 % of an amplifier's force is left
_NOISE_DEVIATIONS = 15.0  # six of a second difference, which is of sqrt(1 + 4 + 1)
ROUNDING = 1e-9  # by which a number of samples may exceed a whole one
_FADE_S = 0.05  # long for a sample, short for a hand
_RECOIL_S = 0.05  # in which a hand catches a device that a wall has thrown back, with more than it moves it by
_FEWEST_LOST = 8  # samples, at slow rates: longer than the six bad ones in a row of the fault model


def fade_samples(device: Device) -> int:
    """Return the number of samples in which a force fades, or comes back after a long fault."""
    return max(1, round(_FADE_S / device.sample_time_s))


def _pushed_samples(device: Device) -> int:
    """Return for how many samples a force that has ended may still change what the encoder sees."""
    # A change of movement is made in two samples.
    lasting_s = (max((device.delay_samples, *(device.range.delay_samples or ()))) + 2) * device.sample_time_s
    bandwidths_hz = (device.amplifier_bandwidth_hz, *(device.range.amplifier_bandwidth_hz or ()))
    slowest_hz = min((bandwidth_hz for bandwidth_hz in bandwidths_hz if bandwidth_hz), default=math.inf)
    lasting_s += _LAG_TIME_CONSTANTS / (2 * math.pi * slowest_hz)
    if device.resonance is not None:
        # The joint swings on, and dies out from the actuator's acceleration to one that does not count.
        swing = actuator_m_per_s2(device) * device.metres_per_unit / _QUIET_M_PER_S2
        decay_per_s = device.resonance.damping_ratio * 2 * math.pi * device.resonance.frequency_hz
        lasting_s += min(math.log(max(swing, 1.0)) / decay_per_s, 5 * _FADE_S)
    return math.ceil(float(max(lasting_s, _RECOIL_S)) / device.sample_time_s - ROUNDING)


@dataclass(frozen=True)
class SensorBounds:
    """Bounds of a position about where the device can be, in the device's own units.

    A movement is that of one sample to the next. n samples after the last believed position p, to which the movement
    was m, a position x is believed where it is between p and p + n m, or beyond by no more than
    n ((n + 1)/2 a + unsure), a the change of movement by hand and actuator: n movements that each change by a.
    With n = 1 only p + m is the middle, and a is larger where something may be struck.
    """

    fastest_m_per_s: float  # of the handle, by the radius of a rotary one
    jump_m: float  # farthest movement; the fastest and a step of the encoder at both ends
    start_m: float  # farthest of the second sample from the first, as a hand that strikes may be under way
    unsure_m: float  # what steps and noise add to a change of movement
    hand_m: float  # largest change of movement by a hand alone, once no force acts
    driven_m: float  # the same by hand and actuator
    inside_m: float  # the same where device and hand strike stops or a stiff wall under force
    struck_m: float  # the same without force
    quiet_n: float  # a force that does not count
    pushed_samples: int  # for which one that counts may act afterwards
    lost_samples: int  # not believed in a row, after which the next position is where the device is

    @classmethod
    def of(cls, device: Device) -> Self:
        """Return by how much a position may differ from what speed, hand and actuator can do in a sample, m.

        Accelerations a bound it by a T^2; encoder steps and noise add what is unsure.
        """
        time = device.sample_time_s
        ranges = device.range
        reach = device.metres_per_unit
        step = max((device.encoder_resolution_m or 0.0, *(ranges.encoder_resolution_m or ())))
        noise = max((device.position_noise_rms_m, *(ranges.position_noise_rms_m or ())))
        actuator = actuator_m_per_s2(device)
        most = board_limits(device).max_acceleration_m_per_s2  # above it the encoder has jumped, as firmware judges
        hand_m = min(most, _HAND_M_PER_S2 / reach) * time**2
        # Two steps of rounding, two of a flickering count.
        unsure: float = 4 * step + _NOISE_DEVIATIONS * noise
        if not step:
            unsure += max(_UNDECLARED_M / reach - hand_m, 0.0)
        return cls(
            fastest_m_per_s=_FASTEST_M_PER_S / reach,
            jump_m=_FASTEST_M_PER_S / reach * time + 2 * step,
            start_m=_STRIKE_M_PER_S / reach * time + 2 * step,
            unsure_m=unsure,
            hand_m=hand_m,
            driven_m=min(most, _HAND_M_PER_S2 / reach + actuator) * time**2,
            inside_m=most * time**2,
            struck_m=min(most, _STOP_M_PER_S2 / reach) * time**2,
            quiet_n=_QUIET_M_PER_S2 / reach / actuator * (device.max_force_n or board_limits(device).max_force_n),
            pushed_samples=_pushed_samples(device),
            lost_samples=max(fade_samples(device), _FEWEST_LOST),
        )

    def most_bad_samples(self, reach: float) -> int:
        """Return how many samples in a row are refused, at most, that jump and then drift back to a device at rest.

        `reach` is the way of the handle, m, per unit of position, m or rad.
        """
        samples = 0
        while samples < self.lost_samples:
            further = samples + 1
            near_m = min(further * ((further + 1) / 2 * self.hand_m + self.unsure_m), self.jump_m)
            if near_m >= (JUMP_M - samples * DRIFT_M) / reach:
                break
            samples = further
        return samples

    def literals(self, precision: Precision) -> dict[str, str]:
        """Return what stands for the bounds in the C of a wall."""
        lengths = ("jump", "start", "unsure", "hand", "driven", "inside")
        literals = {name: precision.literal(getattr(self, f"{name}_m")) for name in lengths}
        whole = {"pushed": f"{self.pushed_samples}u", "lost": f"{self.lost_samples}u"}
        quiet, farthest = map(precision.literal, (self.quiet_n, FARTHEST_M))
        return literals | whole | {"quiet": quiet, "farthest": farthest}


SENSOR_TYPE = """\
/* What is known of the own position. */
typedef struct {{
    /* The last position that was believed, and the movement to it from the sample before. */
    {real} position_m, moved_m;
    /* Samples since then; and those in which a force of before may still act. */
    unsigned short missed, pushed;
    /* 0: nothing is known, 1: a position, 2: a movement too. */
    unsigned char known;{more}
}} avc_coupling_sensor_t;
"""

SENSOR = """\
enum {{ REFUSED, AGAIN, SOUND }};

static int within({real} value, {real} most)
{{
    return value >= -most && value <= most;
}}

/* By how much a movement changes from one sample to the next: by a hand alone, once no force acts on the device. */
static {real} driven(const avc_coupling_sensor_t *sensor{end})
{{
    return sensor->pushed != 0u ? {driven} : {hand};
}}

/* Whether a position is a number, and one to which a hand can have brought the device since the last that was believed:
 * with the movement that it had, or stopped, and what hand and actuator add in each sample. SOUND, or AGAIN for the
 * first one after others were refused, and for a second one that shows a device under way. first_m: the largest change
 * of movement by the next sample. */
static int look(avc_coupling_sensor_t *sensor{end}, {real} position_m, {real} first_m)
{{
    int again = sensor->missed != 0u;
    const {real} samples = ({real})sensor->missed + {one};
    const {real} moved_m = position_m - sensor->position_m;
    const {real} carried_m = samples * sensor->moved_m;
    const {real} low_m = again && carried_m > {zero} ? {zero} : carried_m;
    const {real} high_m = again && carried_m < {zero} ? {zero} : carried_m;
    {real} unsure_m = first_m + {unsure};
    if (again) {{
        unsure_m = samples * ({half} * (samples + {one}) * driven(sensor{passed}) + {unsure});
    }} else if (sensor->known == 1u && !within(moved_m, unsure_m)) {{
        unsure_m = {start};
        again = 1;
    }}
    if (unsure_m > {jump}) {{
        unsure_m = {jump};
    }}
    if (!within(position_m, {farthest}) ||
        (sensor->known != 0u && !(within(moved_m, samples * {jump}) && moved_m >= low_m - unsure_m &&
                                  moved_m <= high_m + unsure_m))) {{
        if (sensor->missed < {lost}) {{
            sensor->missed++;
        }}
        if (sensor->missed >= {lost}) {{
            sensor->known = 0u;
        }}
        return REFUSED;
    }}
    sensor->moved_m = sensor->known == 0u ? {zero} : moved_m / samples;
    sensor->known = sensor->known == 0u ? 1u : 2u;
    sensor->position_m = position_m;
    sensor->missed = 0u;
    return again ? AGAIN : SOUND;
}}

/* Remember that a force is given. */
static void push(avc_coupling_sensor_t *sensor{end}, {real} force_n)
{{
    if (!within(force_n, {quiet})) {{
        sensor->pushed = {pushed};
    }} else if (sensor->pushed > 0u) {{
        sensor->pushed--;
    }}
}}

static void forget(avc_coupling_sensor_t *sensor)
{{
    sensor->position_m = {zero};
    sensor->moved_m = {zero};
    sensor->missed = 0u;
    sensor->pushed = 0u;
    sensor->known = 0u;
}}
"""
"""C that both kinds of export have; a wall's bounds stand in it as numbers, those of one of two ends in its struct."""
