"""Estimators of velocity in plain Python, each as its paper has it: an object takes a position and gives a velocity."""

import math


class Foaw:
    """Janabi-Sharifi, Hayward and Chen 2000: the longest window whose line lies within the band of all its samples."""

    def __init__(self, period, start, band, window=15, fit="best"):
        self.period, self.band, self.fit, self.kept = period, band, fit, [start] * (window + 1)

    def __call__(self, value):
        self.kept = [value, *self.kept[:-1]]
        found = 0.0
        for n in range(1, len(self.kept)):
            some = self.kept[: n + 1]
            if self.fit == "end":
                slope = (some[0] - some[n]) / (n * self.period)
            else:
                times = [-i * self.period for i in range(n + 1)]
                mean_t, mean_y = sum(times) / (n + 1), sum(some) / (n + 1)
                slope = sum((t - mean_t) * (y - mean_y) for t, y in zip(times, some, strict=True)) / sum(
                    (t - mean_t) ** 2 for t in times
                )
            line = [some[0] - slope * i * self.period for i in range(n + 1)]
            if any(abs(a - b) > self.band * (1 + 1e-6) for a, b in zip(line, some, strict=True)):
                break
            found = slope
        self.position = value
        return found


class Levant:
    """Levant 1998 and 2003: z0' = z1 - lambda sqrt(|z0 - f|) sign(z0 - f), z1' = -alpha sign(z0 - f)."""

    def __init__(self, period, start, bound, discretisation="implicit"):
        self.period, self.alpha, self.root = period, 1.1 * bound, 1.5 * math.sqrt(bound)
        self.explicit, self.z0, self.z1, self.position = discretisation == "explicit", start, 0.0, start

    def __call__(self, value):
        h = self.period
        if self.explicit:
            e, self.position = self.z0 - value, self.z0
            velocity = self.z1 - self.root * math.sqrt(abs(e)) * ((e > 0) - (e < 0))
            self.z0 += h * velocity
            self.z1 -= h * self.alpha * ((e > 0) - (e < 0))
            return velocity
        # Implicit: the sign of the error after the step, a number of [-1, 1] where that error is 0; by bisection.
        before, low, high = self.z0 + h * self.z1 - value, -10.0, 10.0

        def left(e):
            return e + h * self.root * math.copysign(math.sqrt(abs(e)), e) - before

        for _ in range(200):
            middle = (low + high) / 2
            jump = h * h * self.alpha
            if left(middle) + (jump if middle > 0 else -jump) > 0:
                high = middle
            else:
                low = middle
        e = 0.0 if abs(before) <= h * h * self.alpha else (low + high) / 2
        sign = before / (h * h * self.alpha) if e == 0 else math.copysign(1.0, e)
        self.z1 -= h * self.alpha * sign
        self.z0 = self.position = value + e
        return self.z1


class Kalman:
    """Position and velocity of a body whose acceleration is white, by the variances' recursion until it stands."""

    def __init__(self, period, start, acceleration, noise):
        push = [period**2 / 2 * acceleration, period * acceleration]
        p, v, c = noise**2, (noise / period) ** 2, 0.0
        for _ in range(20000):
            p, c = p + 2 * period * c + period**2 * v + push[0] ** 2, c + period * v + push[0] * push[1]
            v += push[1] ** 2
            gains = p / (p + noise**2), c / (p + noise**2)
            p, c, v = p - gains[0] * p, c - gains[0] * c, v - gains[1] * c
        self.period, self.gains, self.position, self.velocity = period, gains, start, 0.0

    def __call__(self, value):
        coming = self.position + self.period * self.velocity
        self.position = coming + self.gains[0] * (value - coming)
        self.velocity += self.gains[1] * (value - coming)
        return self.velocity
