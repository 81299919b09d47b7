"""Bounded command: close to a reference, within limits of speed and acceleration.

A command that is wished for is followed from sample to sample: as fast as the bounds let it where
it lies apart, at once where it does not.  Speed is (x_n - x_(n-1)) / T and acceleration its change
over T, so that the bounds hold for every sample and not on average.  Catching up, the command is
never faster than it can brake again before it is there: with the acceleration a that is left for
braking, a gap d is closed with at most sqrt(2 a d + (a T / 2)^2) - a T / 2 above the speed of what
is wished for.
"""

from math import sqrt

from pipeline.kernels import compiled

LEAST_SHARE = 0.05
"""Share of the bound of acceleration that counts as left for braking where less is [1]."""


@compiled
def follow_within(wished, period, speed, acceleration, command):  # type: ignore[no-untyped-def]
    """Fill a command that keeps its bounds, from rest at the first position that is wished for.

    What is wished for and keeps the bounds itself comes back as it is. ``wished`` and the filled
    ``command`` are positions (T,) [m] at a ``period`` [s]; ``speed`` and ``acceleration`` are
    positive bounds [m/s], [m/s^2].
    """
    last = wished.shape[0] - 1
    x, v = wished[0], 0.0
    command[0] = x
    for n in range(last):
        ahead = (wished[n + 1] - wished[n]) / period
        before = (wished[n] - wished[n - 1]) / period if n > 0 else 0.0
        change = min(max((ahead - before) / period, -acceleration), acceleration)
        gap = wished[n] - x
        left = 0.5 * (acceleration + change if gap > 0.0 else acceleration - change)
        left = max(left, LEAST_SHARE * acceleration)
        half = 0.5 * left * period
        most = sqrt(2.0 * left * abs(gap) + half * half) - half
        closing = min(abs(gap) / period, most)
        asked = ahead + (closing if gap > 0.0 else -closing)
        asked = min(max(asked, v - acceleration * period), v + acceleration * period)
        v = min(max(asked, -speed), speed)
        x = x + period * v
        command[n + 1] = x
