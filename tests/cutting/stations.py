"""Engagements made by hand."""

import numpy as np

from pipeline.cutting.engagement.engagement import Engagement

BINS = 72


def arc(phi_st: float, phi_ex: float, a_p: float, low: float = 0.0, bins: int = BINS):
    """Profile of a constant engagement: heights between angles, whole bins only."""
    phi = (np.arange(bins) + 0.5) * (2 * np.pi / bins)
    inside = (phi >= phi_st) & (phi < phi_ex)
    return np.where(inside, low, 0.0), np.where(inside, a_p, 0.0)


def stations(profiles, block, blocks: int, *, tool=None, slope=0.0, length=1e-3) -> Engagement:
    """Stations of profiles (lower, upper), in order; other columns as given or all the same."""
    many = len(profiles)
    each = {
        name: np.broadcast_to(np.asarray(value, dtype=np.float64), (many,)).copy()
        for name, value in (("slope", slope), ("length", length))
    }
    return Engagement(
        piece=np.arange(many, dtype=np.int32),
        block=np.asarray(block, dtype=np.int32),
        tool=np.zeros(many, np.int32) if tool is None else np.asarray(tool, dtype=np.int32),
        along=np.zeros(many),
        lower=np.array([one[0] for one in profiles], dtype=np.float32).reshape(many, BINS),
        upper=np.array([one[1] for one in profiles], dtype=np.float32).reshape(many, BINS),
        volume=np.zeros(many),
        feed=np.ones(many, dtype=bool),
        blocks=blocks,
        resolution=1e-4,
        **each,
    )


def random_profile(rng: np.random.Generator, least: float = 0.2):
    """An arc of uneven depth, as a stock that was cut before leaves it."""
    begin = rng.uniform(0, np.pi - least)
    lower, upper = arc(begin, rng.uniform(begin + least, np.pi), rng.uniform(1e-3, 6e-3))
    phi = (np.arange(BINS) + 0.5) * (2 * np.pi / BINS)
    return lower, upper * (1 + 0.2 * np.sin(3 * phi + rng.uniform(0, 6)))
