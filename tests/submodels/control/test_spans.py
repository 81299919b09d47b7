"""Span arithmetic against counting seconds one by one."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.submodels.control.runs import joined, stopped_within

MOMENT = st.integers(0, 40)
SPANS = st.lists(st.tuples(MOMENT, MOMENT).map(lambda s: (min(s), max(s))), max_size=8)


def seconds(spans):
    """The whole seconds that lie in any of the spans."""
    return {k for first, last in spans for k in range(first, last)}


@given(SPANS)
def test_joined_spans_cover_the_same_seconds_in_order_and_apart(spans):
    found = joined(spans)
    assert seconds(found) == seconds(spans)
    assert all(before[1] < after[0] for before, after in pairwise(found))


@given(SPANS, st.lists(st.tuples(MOMENT, MOMENT), max_size=6))
def test_time_held_between_two_moments_is_counted_second_by_second(spans, pairs):
    begin = np.array([min(p) for p in pairs], dtype=float)
    end = np.array([max(p) for p in pairs], dtype=float)
    held = stopped_within(joined(spans), begin, end)
    covered = seconds(spans)
    expected = [len(covered & set(range(min(p), max(p)))) for p in pairs]
    np.testing.assert_allclose(held, expected, atol=1e-12)  # sums of whole numbers


@given(SPANS, st.floats(-5, 45), st.floats(-5, 45), st.floats(-5, 45))
def test_time_held_adds_up_over_neighbouring_stretches(spans, a, b, c):
    a, b, c = sorted((a, b, c))
    held = stopped_within(joined(spans), np.array([a, b, a]), np.array([b, c, c]))
    assert abs(held[0] + held[1] - held[2]) < 1e-9
    assert (held >= -1e-12).all() and (held <= np.array([b - a, c - b, c - a]) + 1e-9).all()
