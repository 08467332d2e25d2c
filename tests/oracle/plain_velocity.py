"""A Kalman filter of velocity in plain Python: an object takes a position and gives a velocity."""


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
