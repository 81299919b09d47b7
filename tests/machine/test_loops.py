"""Loops of a three-loop drive: gains by pole and zero, the fuzzy rules by hand, refused values."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.axis.loops import (
    CurrentLoopParameters,
    FuzzyParameters,
    PositionLoopParameters,
    SpeedLoopParameters,
    increments,
)

LOOPS = {
    "current_loop": (CurrentLoopParameters, {"bandwidth": 3000.0}),
    "speed_loop": (SpeedLoopParameters, {"torque_limit": 19.1}),
    "position_loop": (PositionLoopParameters, {"gain": 40.0}),
}


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


@pytest.mark.parametrize(
    ("loop", "name", "value"),
    [
        ("current_loop", "bandwidth", 0.0),
        ("current_loop", "period", float("nan")),
        ("speed_loop", "torque_limit", float("inf")),
        ("speed_loop", "proportional", 0.0),
        ("speed_loop", "integral", -1.0),
        ("speed_loop", "every", 1.5),
        ("speed_loop", "every", float("nan")),
        ("position_loop", "gain", -40.0),
        ("position_loop", "velocity_feedforward", float("nan")),
        ("position_loop", "every", 0),
    ],
)
def test_values_out_of_range_are_named(loop: str, name: str, value: float) -> None:
    kind, values = LOOPS[loop]
    with pytest.raises(ValueError, match=rf"{loop}\.{name} = {value}"):
        kind(**values | {name: value})


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


@given(inputs)
def test_the_sets_share_each_input_out(x: float) -> None:
    assert sum(membership(x, name) for name in NAMES) == pytest.approx(1, abs=1e-14)


def test_at_the_centres_each_rule_stands_alone() -> None:
    for i, (p_row, i_row) in enumerate(zip(PROPORTIONAL.split("\n")[1:8], INTEGRAL.split("\n")[1:8],
                                           strict=True)):  # fmt: skip
        for j, (p, k) in enumerate(zip(p_row.split(), i_row.split(), strict=True)):
            found = increments(10 * (i - 3) / 3, 10 * (j - 3) / 3)
            expected = (NAMES.index(p) - 3) / 3, (NAMES.index(k) - 3) / 3
            assert found == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("error", "change", "expected"),
    [
        # nothing to do: the middle of both ranges
        (0, 0, (0, 0)),
        # half way between ZO and PS, change zero: (ZO + NS) / 2 and (ZO + PS) / 2
        (5 / 3, 0, (-1 / 6, 1 / 6)),
        # the middle of four rules ZO NS / NS NS and ZO PS / PS PS, all with the weight 1/2
        (5 / 3, 5 / 3, (-1 / 4, 1 / 4)),
        # shares 0.3 of PS in E, 0.6 of PS in EC: weights 0.4, 0.6, 0.3, 0.3 of ZO NS NS NS
        (1, 2, (-1.2 / 1.6 / 3, 1.2 / 1.6 / 3)),
        # start of a step up: E = PB, EC = NB, both gains in the middle
        (10, -10, (0, 0)),
    ],
)
def test_cases_worked_out_by_hand(
    error: float, change: float, expected: tuple[float, float]
) -> None:
    assert increments(error, change) == pytest.approx(expected, abs=1e-12)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_beyond_the_universe_its_ends_count(error: float, change: float) -> None:
    p, i = increments(error, change)
    assert (p, i) == increments(min(max(error, -10), 10), min(max(change, -10), 10))
    assert -1 <= p <= 1 and -1 <= i <= 1


def turned(table: str) -> str:
    """The table for negated inputs with negated outputs."""
    opposite = dict(zip(NAMES, NAMES[::-1], strict=True))
    words = [opposite[word] for word in reversed(table.split())]
    return "\n".join(" ".join(words[7 * k : 7 * k + 7]) for k in range(7))


@given(inputs, inputs)
def test_negated_inputs_give_what_the_turned_tables_say(error: float, change: float) -> None:
    """Sets and inference are symmetric; whatever is not comes from the tables."""
    p, i = increments(-error, -change)
    assert p == pytest.approx(-inference(error, change, turned(PROPORTIONAL)), abs=1e-12)
    assert i == pytest.approx(-inference(error, change, turned(INTEGRAL)), abs=1e-12)


def test_the_tables_are_nearly_odd_and_far_from_even() -> None:
    """Braking an overshoot of a step up has other gains than of the same step down."""

    def differing(one: str, other: str) -> int:
        return sum(a != b for a, b in zip(one.split(), other.split(), strict=True))

    tables = (PROPORTIONAL, INTEGRAL)
    assert [differing(table, turned(table)) for table in tables] == [8, 2]
    backwards = [" ".join(reversed(table.split())) for table in tables]
    even = [differing(table, back) for table, back in zip(tables, backwards, strict=True)]
    assert even == [40, 38]


def test_default_spans_give_the_published_ranges() -> None:
    loop = SpeedLoopParameters(
        torque_limit=19.1, fuzzy=FuzzyParameters(error_scale=0.1, change_scale=1e-3)
    )
    for middle, span, expected in (
        (loop.proportional, loop.fuzzy.proportional_span, (0.2, 0.8)),
        (loop.integral, loop.fuzzy.integral_span, (20, 60)),
    ):
        assert (middle * (1 - span), middle * (1 + span)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("error_scale", -1.0),
        ("change_scale", float("nan")),
        ("proportional_span", 1.0),
        ("integral_span", float("nan")),
    ],
)
def test_scales_out_of_range_are_named(name: str, value: float) -> None:
    values = {"error_scale": 0.1, "change_scale": 1e-3} | {name: value}
    with pytest.raises(ValueError, match=re.escape(f"fuzzy.{name} = {value}")):
        FuzzyParameters(**values)
