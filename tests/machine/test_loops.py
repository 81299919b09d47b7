"""Loops of a three-loop drive: gains by pole and zero, the fuzzy rules by hand, refused values."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.axis.loops import (
    CurrentLoopParameters,
    FuzzyParameters,
    SpeedLoopParameters,
    increments,
)


@given(st.floats(0.01, 20), st.floats(1e-4, 0.1), st.floats(10, 2e4), st.floats(1e-5, 1e-3))
def test_current_gains_cancel_the_winding_s_pole(
    R: float, L: float, bandwidth: float, period: float
) -> None:
    """The sampled winding i+ = a i + b u under the sampled PI, both as polynomials in z."""
    loop = CurrentLoopParameters(bandwidth=bandwidth, period=period)
    proportional, integral = loop.gains(R, L)
    a, b = np.exp(-R * period / L), -np.expm1(-R * period / L) / R
    # (z - 1)(z - a) + b (K z - K + K_i): roots are the cancelled pole and the asked one
    poles = np.roots(
        np.polyadd([1, -1 - a, a], b * np.array([proportional, integral - proportional]))
    )
    expected = sorted([a, np.exp(-bandwidth * period)])
    # two roots that nearly meet are known to the root of rounding
    assert sorted(poles.real) == pytest.approx(expected, abs=1e-7)
    assert proportional == pytest.approx(integral / (1 - a), rel=1e-6)


def test_short_periods_give_the_continuous_gains() -> None:
    """w L and w R h, as with a controller in continuous time."""
    proportional, integral = CurrentLoopParameters(bandwidth=3000.0, period=1e-9).gains(0.2, 2e-3)
    assert (proportional, integral) == pytest.approx((6.0, 600e-9), rel=1e-5)


NAMES = ["NB", "NM", "NS", "ZO", "PS", "PM", "PB"]
PROPORTIONAL = """
PB PB PM PM PS ZO ZO
PB PB PM PS PS ZO NS
PM PM PM PS ZO NS NS
PM PM PS ZO NS NM NM
PS PS ZO NS NS NM NM
PS ZO NS NM NM NM NB
ZO ZO NM NM NM NB NB
"""
INTEGRAL = """
NB NB NM NM NS ZO ZO
NB NB NM NS NS ZO ZO
NB NM NS NS ZO PS PS
NM NM NS ZO PS PM PM
NM NS ZO PS PS PM PB
ZO ZO PS PS PM PB PB
ZO ZO PS PM PM PB PB
"""
inputs = st.floats(-10, 10)


def membership(x: float, name: str) -> float:
    """Triangle of a set: 1 at its centre, 0 at its neighbours' centres."""
    centre = 10 * (NAMES.index(name) - 3) / 3
    return max(0.0, 1 - abs(x - centre) / (10 / 3))


def inference(error: float, change: float, table: str) -> float:
    """All 49 rules, one after the other; outputs are the centres of seven sets on [-1, 1]."""
    rows = [line.split() for line in table.split("\n") if line]
    above = below = 0.0
    for e, row in zip(NAMES, rows, strict=True):
        for ec, out in zip(NAMES, row, strict=True):
            weight = min(membership(error, e), membership(change, ec))
            above += weight * (NAMES.index(out) - 3) / 3
            below += weight
    return above / below


@given(inputs, inputs)
def test_increments_are_those_of_the_forty_nine_rules(error: float, change: float) -> None:
    expected = inference(error, change, PROPORTIONAL), inference(error, change, INTEGRAL)
    # weights can be as small as the rounding of a set's edge, but one of them is at least a half
    assert increments(error, change) == pytest.approx(expected, abs=1e-12)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_beyond_the_universe_its_ends_count(error: float, change: float) -> None:
    p, i = increments(error, change)
    assert (p, i) == increments(min(max(error, -10), 10), min(max(change, -10), 10))
    assert -1 <= p <= 1 and -1 <= i <= 1


def test_default_spans_give_the_published_ranges() -> None:
    loop = SpeedLoopParameters(
        torque_limit=19.1, fuzzy=FuzzyParameters(error_scale=0.1, change_scale=1e-3)
    )
    for middle, span, expected in (
        (loop.proportional, loop.fuzzy.proportional_span, (0.2, 0.8)),
        (loop.integral, loop.fuzzy.integral_span, (20, 60)),
    ):
        assert (middle * (1 - span), middle * (1 + span)) == pytest.approx(expected)
