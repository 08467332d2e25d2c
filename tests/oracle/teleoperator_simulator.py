"""Leader, follower and the link between them, event by event in plain Python: shares nothing with the project."""

import heapq
import itertools
import math

import numpy as np
from scipy.linalg import expm


class Body:
    """A mass with damper and spring to a target, exact for a held force."""

    def __init__(self, mass, damping, stiffness, period, hand_damping=0.0, start=0.0):
        rate = np.zeros((5, 5))
        rate[0, 1] = rate[3, 4] = 1
        rate[1] = [-stiffness / mass, -damping / mass, 1 / mass, stiffness / mass, hand_damping / mass]
        self.step, self.period = expm(rate * period)[:2], period
        self.x, self.v, self.last = start, 0.0, start

    def move(self, force, aim=0.0, aim_speed=0.0):
        self.x, self.v = self.step @ np.array([self.x, self.v, force, aim, aim_speed])


def run(  # noqa: PLR0912 - one loop over events
    leader,
    follower,
    gains,
    seconds,
    there,
    back,
    *,
    hand=(0.0, 0.0, 0.0),
    contact=None,
    wall=False,
    phase=0.0,
    target=None,
    start=0.0,
    kick=0.0,
    jitter=0.0,
    lost=0.0,
    force=None,
    limit=math.inf,
    seed=0,
    ends=None,
    motors=(1.0, 1.0),
):
    """Return positions of leader and follower at the leader's samples.

    Devices are mass, damping, T and delay in samples; gains K, B and the damper of each loop; delays of the link in s,
    `jitter` and `lost` shares of them and of its messages; the hand mass, damping and stiffness. A contact is (k, b) on
    both sides or "fixed", a wall stops the follower at x = 0, whose first sample is a share `phase` of its T late.
    `force` is None for position-position, else "commanded" or "measured". `ends` take the place of springs and dampers,
    a pair that has sample(position), message(), receive(message) and force().
    """
    k, b, local = gains
    rng = np.random.default_rng(seed)
    times, delays = (leader[2], follower[2]), (there, back)
    k_c, b_c = contact if isinstance(contact, tuple) else (0.0, 0.0)
    bodies = [
        Body(leader[0] + hand[0], leader[1] + hand[1], hand[2], times[0], hand[1], start),
        Body(follower[0], follower[1] + b_c, k_c, times[1], 0.0, start),
    ]
    bodies[0].v = kick
    held = [[0.0] * leader[3], [0.0] * follower[3]]
    number = itertools.count()
    # (time, order, kind, side, content): messages that arrive at an instant come before who acts then.
    queue = [(0.0, 1, next(number), "sample", 0, None), (phase * times[1], 1, next(number), "sample", 1, None)]
    newest = [(-1, start, 0.0), (-1, start, 0.0)]
    reflected = (-1, 0.0)
    count, found = [0, 0], []
    heapq.heapify(queue)
    acting = []
    while queue and queue[0][0] <= seconds + 1e-12:
        now = queue[0][0]
        acting.clear()
        while queue and queue[0][0] <= now + 1e-9:
            _, _, _, kind, side, content = heapq.heappop(queue)
            if ends is not None and kind != "sample":
                ends[side].receive(content)
            elif kind == "position" and content[0] > newest[side][0]:
                newest[side] = content
            elif kind == "force" and content[0] > reflected[0]:
                reflected = content
            elif kind == "sample":
                acting.append(side)
                body = bodies[side]
                speed = (body.x - body.last) / times[side]
                message = (count[side], body.x, speed)
                if ends is not None:
                    ends[side].sample(body.x)
                    message = ends[side].message()
                late = delays[side] * (1 + jitter * rng.uniform(-1, 1))
                # An end that sends forces has one message for both, after its force.
                apart = ends is None or force is None or side == 0
                if rng.random() >= lost and apart:
                    if late < 1e-12:
                        if ends is not None:
                            ends[1 - side].receive(message)
                        elif message[0] > newest[1 - side][0]:
                            newest[1 - side] = message
                    else:
                        heapq.heappush(queue, (now + late, 0, next(number), "position", 1 - side, message))
        for side in sorted(acting):
            body = bodies[side]
            speed = (body.x - body.last) / times[side]
            pull = k * (newest[side][1] - body.x) + b * (newest[side][2] - speed)
            own = None if ends is None else ends[side].force()
            if side == 0:
                found.append((bodies[0].x, bodies[1].x))
                if force is not None:
                    pull = -reflected[1]
            elif force is not None:
                touch = k_c * body.x + b_c * body.v
                felt = touch if force == "measured" and contact != "fixed" else pull
                sent = (count[1], felt)
                if ends is not None:
                    sent = ends[1].message(felt if force == "measured" and contact != "fixed" else None)
                heapq.heappush(queue, (now + max(back, 1e-7), 0, next(number), "force", 0, sent))
            asked = float(np.clip(pull - local * speed, -limit, limit)) if own is None else own
            held[side].append(motors[side] * asked)
            body.last = body.x
            aim = [0.0, 0.0]
            if side == 0 and target is not None:
                aim = [target(now), (target(now + times[0]) - target(now)) / times[0]]
            body.move(held[side].pop(0), *aim)
            if side == 1 and contact == "fixed":
                body.x = body.v = 0.0
            if side == 1 and wall and body.x > 0:
                body.x, body.v = 0.0, min(body.v, 0.0)
            count[side] += 1
            heapq.heappush(
                queue, (count[side] * times[side] + side * phase * times[1], 1, next(number), "sample", side, None)
            )
    return np.array(found).T
