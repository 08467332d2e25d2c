"""Scenes integrated by scipy with located events: an independent reference, slow and written from the physics alone."""

import math

import numpy as np
import plain_velocity
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.signal import bilinear

import avc_casadi as avc

TOLERANCES = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15}

HEAD = """
[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
coulomb_friction_n = 0.2
encoder_resolution_m = 2e-6
max_force_n = 3.0
[environment]
damping_ns_per_m = {b_e}
stiffness_n_per_m = {k_e}
"""


def scene_problem(effects=(), *, b_e=10.0, k_e=1e5, scene="", motion="", head=HEAD, name="scene"):
    """Write and load a problem whose scene lists the given effects (bodies of TOML tables)."""
    text = head.format(b_e=b_e, k_e=k_e) + "\n[scene]\n" + scene
    text += "\n[scene.motion]\n" + motion if motion else ""
    text += "".join("\n[[scene.effects]]\n" + effect for effect in effects)
    return avc.parse_problem(text, name=name)


class Reference:
    """The scene of a problem, sample by sample."""

    def __init__(self, problem, gains, target_position, device_start):
        self.problem, self.gains, self.target = problem, gains, np.append(target_position, target_position[-1])
        self.T = problem.device.sample_time_s
        tables = problem.scene.effects
        self.effects = {table.kind: table for table in tables} if tables else {"hand": None, "wall": None}
        self.start = device_start
        self.fc = 0.0
        if "coulomb-friction" in self.effects:
            self.fc = self.effects["coulomb-friction"].force_n or problem.device.coulomb_friction_n
        self._continuous()

    def _continuous(self):
        device, effects, hands = self.problem.device, self.effects, self.problem.hands
        self.m1, self.b1 = device.mass_kg, device.damping_ns_per_m
        if "viscous-friction" in effects:
            self.b1 += effects["viscous-friction"].damping_ns_per_m
        self.m2, self.k12, self.b12 = 0.0, 0.0, 0.0
        if "resonance" in effects:
            mode = effects["resonance"] if effects["resonance"].frequency_hz else device.resonance
            self.m2 = device.mass_kg * mode.mass_ratio
            self.m1 = device.mass_kg - self.m2
            reduced, omega = self.m1 * self.m2 / (self.m1 + self.m2), 2 * math.pi * mode.frequency_hz
            self.k12, self.b12 = reduced * omega**2, 2 * mode.damping_ratio * omega * reduced
        self.hand = None
        if "hand" in effects:
            table = effects["hand"]
            self.hand = [
                sum(getattr(hands, key)) / 2 if getattr(table, key, None) is None else getattr(table, key)
                for key in ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
            ]
            if self.m2:
                self.m2 += self.hand[0]
            else:
                self.m1 += self.hand[0]
        self.stylus = effects.get("stylus-hand")
        self.bandwidth, self.order, self.ratio = None, 1, None
        if "amplifier" in effects:
            self.bandwidth = 2 * math.pi * (effects["amplifier"].bandwidth_hz or device.amplifier_bandwidth_hz)
            self.order = effects["amplifier"].order or device.amplifier_order
            self.ratio = effects["amplifier"].damping_ratio or device.amplifier_damping_ratio

    def rates(self, y, force, xh, vh):
        """Rates of [x1 v1 x2 v2 xs vs fa ra] without dry friction."""
        x1, v1, x2, v2, xs, vs, fa, ra = y
        w = self.bandwidth
        acting = fa if self.bandwidth else force
        on1, on2, ons = -acting - self.b1 * v1, 0.0, 0.0
        if self.m2:
            link = self.k12 * (x2 - x1) + self.b12 * (v2 - v1)
            on1, on2 = on1 + link, -link
        tip_x, tip_v = (x2, v2) if self.m2 else (x1, v1)
        pull = 0.0
        if self.hand:
            pull = self.hand[2] * (xh - tip_x) + self.hand[1] * (vh - tip_v)
        elif self.stylus:
            s = self.stylus
            pull = s.grip_stiffness_n_per_m * (xs - tip_x) + s.grip_damping_ns_per_m * (vs - tip_v)
            ons = s.arm_stiffness_n_per_m * (xh - xs) + s.arm_damping_ns_per_m * (vh - vs) - pull
        on1, on2 = (on1, on2 + pull) if self.m2 else (on1 + pull, on2)
        return [
            v1,
            on1 / self.m1,
            v2,
            on2 / self.m2 if self.m2 else 0.0,
            vs,
            ons / self.stylus.mass_kg if self.stylus else 0.0,
            ra if self.order == 2 else w * (force - fa) if w else 0.0,
            w**2 * (force - fa) - 2 * self.ratio * w * ra if self.order == 2 else 0.0,
        ]

    def move(self, y, force, k, begin, end):
        """Integrate from `begin` to `end` seconds after sample k under a constant command."""
        vh = (self.target[k + 1] - self.target[k]) / self.T

        def free(t, y):
            return np.array(self.rates(y, force, self.target[k] + vh * t, vh))

        t, pieces, breaking = begin, 0, False
        while t < end:
            pieces += 1
            assert pieces < 50, "the reference does not get past an event"
            load = free(t, [*y[:1], 0.0, *y[2:]])[1] * self.m1
            if self.fc and y[1] == 0 and abs(load) <= self.fc and not breaking:

                def sticking(t, y):
                    rate = free(t, y)
                    rate[:2] = 0
                    return rate

                def held(t, y):
                    return self.fc - abs(free(t, y)[1]) * self.m1

                held.terminal, held.direction = True, -1
                found = solve_ivp(sticking, (t, end), y, events=held, **TOLERANCES)
                y, t = found.y[:, -1].copy(), found.t[-1]
                breaking = found.status == 1  # the load is at the threshold, to rounding, and grows
            else:
                direction, breaking = np.sign(y[1]) if y[1] != 0 else np.sign(load), False

                def sliding(t, y, direction=direction):
                    rate = free(t, y)
                    rate[1] -= direction * self.fc / self.m1
                    return rate

                def moving(_, y, direction=direction):
                    return direction * y[1]

                moving.terminal, moving.direction = True, -1
                events = moving if self.fc else None
                # From rest the event is 0 at the beginning: the first step must not reach beyond its next zero.
                step = self.T / 200 if y[1] == 0 else np.inf
                found = solve_ivp(sliding, (t, end), y, events=events, max_step=step, **TOLERANCES)
                y, t = found.y[:, -1].copy(), found.t[-1]
                if found.status == 1:
                    y[1] = 0.0
        return y

    def run(self, samples, noise=None, late=None, dropped=None, commands=None, computer=None):
        """Return position, velocity and held force at each sample; `commands` replay the forces of another computer.

        `computer` is another law in place of wall and coupling.

        Position and velocity of the handle are left in `handle`.
        """
        effects, period = self.effects, self.T
        delay = (effects["delay"].samples or self.problem.device.delay_samples) if "delay" in effects else 0
        lag = math.floor(delay)
        limit = math.inf
        if "saturation" in effects:
            limit = effects["saturation"].force_n or self.problem.device.max_force_n
        resolution = 0.0
        if "encoder" in effects:
            resolution = effects["encoder"].resolution_m or self.problem.device.encoder_resolution_m
        at_handle = "encoder" in effects and (effects["encoder"].at or self.problem.device.encoder_at) == "handle"
        gap = (effects["backlash"].gap_m or self.problem.device.backlash_m) if "backlash" in effects else 0.0
        played, filters = self.start, sections_of(effects, self.T)
        rest = self.start
        for section in filters:
            section.begin(rest)
            rest *= section.gain
        computer, line, before = computer or Computer(self, rest), [0.0] * lag, 0.0
        believer = Believer(effects["state-feedback"]) if "state-feedback" in effects else None
        y = np.array([self.start, 0.0, self.start, 0.0, self.start, 0.0, 0.0, 0.0])
        out, self.handle = [], np.empty((2, samples))
        for k in range(samples):
            command = before
            if commands is not None:
                command = commands[k]
            elif dropped is None or not dropped[k]:
                x = y[2] if at_handle else y[0]
                if abs(x - played) > gap / 2:
                    played = x - math.copysign(gap / 2, x - played)
                x = (played if gap else x) + (0.0 if noise is None else noise[k])
                x = resolution * math.floor(x / resolution + 0.5) if resolution else x
                for section in filters:
                    x = section(x)
                x = x if believer is None else believer(x)
                line.append(min(max(computer.force(x), -limit), limit))
                command = line.pop(0)
                if believer is not None:
                    believer.force = line[-1] if line else command
            out.append((y[0], y[1], command))
            self.handle[:, k] = y[2:4]
            arrival = (delay - lag) * period if late is None else late[k] * period
            if arrival > 0:
                y = self.move(y, before, k, 0.0, arrival)
            y = self.move(y, command, k, arrival, period)
            before = command
        return np.array(out).T


class Filter:
    """A difference equation with its past written out: inputs and outputs of the last two samples."""

    def __init__(self, b0, b1, b2, a1, a2):
        self.b, self.a, self.gain = (b0, b1, b2), (a1, a2), (b0 + b1 + b2) / (1 + a1 + a2)

    def begin(self, value):
        self.inputs, self.outputs = [value] * 2, [value * self.gain] * 2

    def __call__(self, value):
        given = [value, *self.inputs]
        out = sum(b * u for b, u in zip(self.b, given, strict=True))
        out -= sum(a * y for a, y in zip(self.a, self.outputs, strict=True))
        self.inputs, self.outputs = given[:2], [out, self.outputs[0]]
        return out


class Believer:
    """Observer and feedback in matrices, with the force that was asked for in the tick before."""

    def __init__(self, table):
        self.table, self.state, self.force = table, None, 0.0
        self.smooth = self.highest = self.lowest = None
        self.a, self.b, self.l, self.r = (
            np.array(getattr(table, key)) for key in ("state", "force_m_per_n", "innovation", "feedback")
        )

    def closed(self, value):
        """How far the dead zone is closed, by the highest and the lowest late smoothed position, which fade."""
        table = self.table
        if self.smooth is None:
            self.smooth = self.highest = self.lowest = value
        here = self.smooth = value + table.smoothing * (self.smooth - value)
        self.highest = min(max(here, here + table.kept * (self.highest - here)), here + table.open_m)
        self.lowest = max(min(here, here + table.kept * (self.lowest - here)), here - table.open_m)
        if table.open_m == 0:
            return 1.0
        opened = (self.highest - self.lowest - table.opens_m) / (table.open_m - table.opens_m)
        return 1.0 - min(max(opened, 0.0), 1.0)

    def __call__(self, value):
        closed = self.closed(value)
        value += closed * self.table.face_m
        if self.state is None:
            self.state = np.array([value if row in self.table.positions else 0.0 for row in range(len(self.b))])
        else:
            self.state = self.a @ self.state + self.b * self.force
        error = value - self.state[self.table.measures]
        outside = math.copysign(max(abs(error) - self.table.dead_zone_m, 0.0), error)
        self.state = self.state + self.l * (closed * outside + (1 - closed) * error)
        return float(self.r @ self.state)


def sections_of(effects, period):
    """The filters on the position; the notch by scipy's bilinear transform of the prewarped analogue one."""
    filters = []
    if "notch" in effects:
        table = effects["notch"]
        warped = 2 / period * math.tan(math.pi * table.frequency_hz * period)
        above = [1, table.depth * table.width * warped, warped**2]
        b, a = bilinear(above, [1, table.width * warped, warped**2], 1 / period)
        filters.append(Filter(*b, *a[1:]))
    return filters


class Computer:
    """The force law: coupling and environment in series, found by bisection of their forces; gated or clipped last."""

    def __init__(self, reference, start=None):
        start = reference.start if start is None else start
        problem, effects = reference.problem, reference.effects
        self.T, self.gains = reference.T, reference.gains
        wall = effects.get("wall") or effects.get("environment") or problem.environment
        self.k_e, self.b_e = (
            getattr(problem.environment if getattr(wall, key) is None else wall, key)
            for key in ("stiffness_n_per_m", "damping_ns_per_m")
        )
        self.one_sided = "environment" not in effects
        self.gated = self.one_sided and problem.coupling.contact == "gated"
        self.absent = not ("wall" in effects or "environment" in effects) or self.k_e == self.b_e == 0
        self.share, self.gains_of_kalman = 0.0, None
        if "velocity-filter" in effects:
            self.choose(effects["velocity-filter"])
        depth = self.depth(start)
        # Value and rate of the last sample.
        self.stretch, self.surface, self.contact = [0.0, 0.0], [depth, 0.0], [start, 0.0]

    def choose(self, table):
        """Take the share of a first-order lag, or the gains of a Kalman filter."""
        if table.estimator == "first-order":
            self.share = math.exp(-2 * math.pi * table.cutoff_hz * self.T)
        else:
            known = table.acceleration_m_per_s2, table.noise_rms_m
            self.gains_of_kalman = plain_velocity.Kalman(self.T, 0.0, *known).gains

    def depth(self, x):
        return max(x, 0.0) if self.gated else x

    def rate(self, value, memory):
        if self.gains_of_kalman is not None:
            return memory[1] + self.gains_of_kalman[1] * (value - memory[0] - self.T * memory[1])
        return (1 - self.share) * (value - memory[0]) / self.T + self.share * memory[1]

    def kept(self, value, memory):
        """Value and rate; of a Kalman filter the position that it believes."""
        rate = self.rate(value, memory)
        if self.gains_of_kalman is not None:
            coming = memory[0] + self.T * memory[1]
            value = coming + self.gains_of_kalman[0] * (value - coming)
        return [value, rate]

    def wall_force(self, tool):
        if self.gated and tool <= 0:
            return 0.0
        force = self.k_e * self.depth(tool) + self.b_e * self.rate(self.depth(tool), self.surface)
        return max(force, 0.0) if self.gated else force

    def coupling_force(self, x, tool):
        return self.gains.stiffness_n_per_m * (x - tool) + self.gains.damping_ns_per_m * self.rate(
            x - tool, self.stretch
        )

    def force(self, x):
        if self.absent:
            return 0.0
        gains, tool = self.gains, x
        command = self.wall_force(x) if gains.rigid else 0.0
        if not gains.rigid and (gains.stiffness_n_per_m or gains.damping_ns_per_m):

            def imbalance(tool):
                return self.coupling_force(x, tool) - self.wall_force(tool)

            tool = brentq(imbalance, x - 1, x + 1, xtol=1e-20, rtol=1e-15)
            command = self.coupling_force(x, tool)
        if self.gated:
            command = max(command, 0.0)
        self.stretch = self.kept(x - tool, self.stretch)
        self.surface = self.kept(self.depth(tool), self.surface)
        if gains.contact_damping_ns_per_m:
            self.contact = self.kept(x, self.contact)
            command += gains.contact_damping_ns_per_m * self.contact[1]
            if self.gated:
                command = max(command, 0.0) if x > 0 else 0.0
        return max(command, 0.0) if self.one_sided else command
