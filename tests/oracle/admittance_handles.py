"""Handles of an admittance device that hands hold, release and push against contacts, written out a second time.

It takes plain numbers and shares no matrix with the package: the equations of `PlainDevice` for one state at a time,
SciPy's matrix exponential over small parts of a sample, and a contact that is looked at anew at each of them.
"""

import math

import numpy as np
from admittance_loop import PlainDevice
from scipy.linalg import expm

DRIVE, DRIVE_SPEED, HANDLE, HANDLE_SPEED = 0, 1, 3, 4


class PushedHandles:
    """Many hands (mass, damper, spring), each with a contact (damper, spring) at 0 that pushes and never pulls."""

    def __init__(self, problem, hands, contacts, parts_per_radian=8.0):
        device = problem.device
        self.plain = PlainDevice.of(problem)
        self.hands, self.contacts = np.asarray(hands, float), np.asarray(contacts, float)
        count = len(self.hands)
        self.state = np.zeros((count, 5))
        self.held = np.ones(count, dtype=bool)
        self.past = [np.zeros(count)] * (int(device.delay_samples) + 2)
        late_s = (device.delay_samples - int(device.delay_samples)) * device.sample_time_s
        lightest = device.force_sensor.handle_mass_kg
        stiffest = self.contacts[:, 1].max(initial=0.0) + self.hands[:, 2].max()
        fastest = math.sqrt(stiffest / lightest) + self.contacts[:, 0].max(initial=0.0) / lightest
        self.spans = []
        for span_s in (late_s, device.sample_time_s - late_s):
            parts = max(2, math.ceil(parts_per_radian * span_s * fastest)) if span_s else 0
            self.spans.append((parts, self._moved(span_s / parts) if parts else None))

    def _moved(self, part_s):
        """Maps of (motion, command, target, its speed) over a part of a sample: [held][touching], (hands, 8, 8)."""
        maps = np.zeros((2, 2, len(self.hands), 8, 8))
        for held in (0, 1):
            for touching in (0, 1):
                rates = [self._rates(row, held, touching) for row in range(len(self.hands))]
                maps[held, touching] = expm(np.array(rates) * part_s)
        return maps

    def _rates(self, row, held, touching):
        mass, damper, spring = self.hands[row] * held
        damper_of_contact, spring_of_contact = self.contacts[row] * touching
        moved_kg = self.plain.handle_kg + mass
        rates = np.zeros((8, 8))
        for column, unit in enumerate(np.eye(8)):
            motion, command, target, speed = unit[:5], unit[5], unit[6], unit[7]
            rates[:5, column] = self.plain.rates(motion, command)
            # Of a plain device nothing is carried: its handle alone is the mass that the sensor pulls.
            push = -self.plain.force(motion)
            push += spring * (target - motion[HANDLE]) + damper * (speed - motion[HANDLE_SPEED])
            push -= spring_of_contact * motion[HANDLE] + damper_of_contact * motion[HANDLE_SPEED]
            rates[HANDLE_SPEED, column] = push / moved_kg
        rates[6, 7] = 1.0
        return rates

    def force(self):
        """What the sensors read."""
        return self.plain.force(self.state.T)

    def move(self, command, target, speed):
        """Move on by a sample, with the velocity that is commanded at its beginning and the targets of the hands."""
        self.past = [np.asarray(command, float), *self.past[:-1]]
        count = len(self.state)
        rows, held = np.arange(count), self.held.astype(int)
        target = np.array(np.broadcast_to(target, count), float)
        speed = np.broadcast_to(speed, count)
        for (parts, maps), arrived in zip(self.spans, (self.past[-1], self.past[-2]), strict=True):
            for _ in range(parts):
                depth, into = self.state[:, HANDLE], self.state[:, HANDLE_SPEED]
                push = self.contacts[:, 1] * depth + self.contacts[:, 0] * into
                touching = ((depth > 0) & (push > 0)).astype(int)
                whole = np.column_stack([self.state, arrived, target, speed])
                after = np.einsum("hij,hj->hi", maps[held, touching, rows], whole)
                self.state, target = after[:, :5], after[:, 6]
