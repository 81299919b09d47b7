"""A parameter out of its range is refused with its name, value, unit and range."""

from dataclasses import dataclass
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.parameters import structure
from pipeline.schema.ranges import Count, Finite, Positive, Range, Ranged, Share


@dataclass(frozen=True, kw_only=True)
class Loop(Ranged, section="loop"):
    gain: Annotated[float, Range(above=0.0, unit="1/s")] = 1.0
    share: Share = 0.5
    limit: Annotated[float, Range(above=0.0, finite=False)] = float("inf")
    every: Count = 1
    scales: tuple[Positive, ...] = ()
    offset: Finite = 0.0
    prior: Positive | None = None
    window: Annotated[float, Range(above=0.0, below=2.0)] = 1.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"gain": 0.0}, "loop.gain = 0.0 1/s must be finite and positive"),
        ({"gain": float("inf")}, "loop.gain = inf 1/s must be finite and positive"),
        ({"gain": float("nan")}, "loop.gain = nan 1/s must be finite and positive"),
        ({"share": 1.5}, "loop.share = 1.5 must lie from 0 to 1"),
        ({"limit": -1.0}, "loop.limit = -1.0 must be positive"),
        ({"every": 0}, "loop.every = 0 must be finite and at least 1"),
        ({"scales": (1.0, -2.0)}, "loop.scales = -2.0 must be finite and positive"),
        ({"offset": float("nan")}, "loop.offset = nan must be finite"),
        ({"prior": -3.0}, "loop.prior = -3.0 must be finite and positive"),
        ({"window": 2.0}, "loop.window = 2.0 must lie above 0 and below 2"),
    ],
)
def test_a_value_out_of_range_is_named(values, message):
    with pytest.raises(ValueError, match="^" + message.replace(".", r"\.") + "$"):
        Loop(**values)


def test_infinity_is_allowed_where_it_is_declared_and_none_is_not_checked():
    assert Loop(limit=float("inf"), prior=None).limit == float("inf")


@given(st.floats(allow_nan=True), st.floats(-5, 5), st.floats(-5, 5))
def test_a_range_holds_what_lies_between_its_ends(value, one, other):
    low, high = min(one, other), max(one, other)
    assert Range(least=low, most=high).holds(value) == (low <= value <= high)


def test_params_yaml_is_checked_by_the_declared_ranges():
    with pytest.raises(ValueError, match=r"loop\.share = 7\.0 must lie from 0 to 1"):
        structure({"loop": {"share": 7}}, "loop", Loop)
