"""A firm hand presses a device against a wall and withdraws it; the wall is the exported C, the rest is written here.

    m x'' = -b x' - F + K (x_t - x) + B (x_t' - x')

K is so firm that x follows the target x_t, which goes from sample to sample along straight lines. F is what the C
asked for, held, a delay late. Everything between two samples is linear: scipy's matrix exponential advances it.
"""

import numpy as np
from exported import Exported
from scipy.linalg import expm

FIRM_N_PER_M = 1e6
ENTERING_S, PRESSED_S, WITHDRAWN_S, WATCHED_S = 0.25, 1.0, 0.5, 0.5
WITHDRAWN_M, NOTICED_N = 0.01, 0.1


def target_m(depth_m, time_s):
    """In at constant speed, a rest, and out by the polynomial whose jerk is least, with rest at both ends."""
    leaving_s = time_s - ENTERING_S - PRESSED_S
    if leaving_s < 0:
        return depth_m * min(time_s / ENTERING_S, 1.0)
    share = min(leaving_s / WITHDRAWN_S, 1.0)
    return depth_m - (depth_m + WITHDRAWN_M) * (10 * share**3 - 15 * share**4 + 6 * share**5)


def pushed_outside(coupling, depth_m, faces=8):
    """Return how far outside more than what is noticed acts, how long after the face, and the largest force there.

    The largest of each over places of the face within a step of the encoder; of a device that slides.
    """
    law, shares = Exported(coupling), np.arange(faces) / faces
    found = [_pushed_outside(coupling.problem.device, law, depth_m, share) for share in shares]
    return tuple(map(max, zip(*found, strict=True)))


def _pushed_outside(device, law, depth_m, face):
    mass, period_s, step_m = device.mass_kg, device.sample_time_s, device.encoder_resolution_m
    firm_ns_per_m = 2 * np.sqrt(FIRM_N_PER_M * mass)
    # Of position, speed, force, target and its speed.
    rates = np.zeros((5, 5))
    rates[0, 1] = rates[3, 4] = 1.0
    held = [-FIRM_N_PER_M, -device.damping_ns_per_m - firm_ns_per_m, -1.0, FIRM_N_PER_M, firm_ns_per_m]
    rates[1] = np.array(held) / mass
    whole, late = int(device.delay_samples), device.delay_samples % 1
    before_arrival, after_arrival = expm(rates * late * period_s), expm(rates * (1 - late) * period_s)
    asked, state = [0.0] * (whole + 2), np.zeros(5)
    face_s, last_s, far_m, largest_n = None, None, 0.0, 0.0
    law.start()
    # The device comes from outside: a law that begins at its face takes it for a device that is in the wall already.
    for _ in range(2):
        law.step(-2 * step_m)
    for sample in range(round((ENTERING_S + PRESSED_S + WITHDRAWN_S + WATCHED_S) / period_s)):
        now_s, position = sample * period_s, state[0]
        seen = step_m * (np.floor(position / step_m - face + 0.5) + face) if step_m else position
        asked = [law.step(seen), *asked[:-1]]
        if now_s > ENTERING_S + PRESSED_S and position < 0:
            face_s = now_s if face_s is None else face_s
            largest_n = max(largest_n, asked[whole])
            if asked[whole] > NOTICED_N:
                far_m, last_s = max(far_m, -position), now_s + period_s
        target, following = target_m(depth_m, now_s), target_m(depth_m, now_s + period_s)
        state[2:] = asked[whole + 1], target, (following - target) / period_s
        state = before_arrival @ state
        state[2] = asked[whole]
        state = after_arrival @ state
    return far_m, 0.0 if last_s is None else last_s - face_s, largest_n
