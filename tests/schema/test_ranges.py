"""Ranges of parameters, and limits from the command line to the constraint: words and refusals."""

from dataclasses import dataclass, fields
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.parameters import structure
from pipeline.schema.limits import CutLimit, Margins, limit_options, limit_words
from pipeline.schema.ranges import Count, Finite, Positive, Range, Ranged, Share


def test_every_limit_has_an_option_of_its_own_a_name_and_a_margin_that_exists() -> None:
    options = [words.option for _, _, words in limit_options()]
    assert len(set(options)) == len(options)
    margins = {item.name for item in fields(Margins)}
    for item in fields(CutLimit):
        if item.name not in ("margins", "practice"):
            words, unit = limit_words(item.name)
            assert words.name and words.help.endswith(".")
            assert words.margin == "" or words.margin in margins
            assert unit or item.name == "power_share"


@given(st.floats(1e-6, 1e6), st.floats(0.0, 0.9), st.floats(0.0, 1e5), st.floats(1e-6, 1e5))
def test_options_are_fields_of_the_type(
    load: float, margin: float, low: float, more: float
) -> None:
    found = CutLimit.of_options(
        {"load_N": load, "stability": margin, "feed_mm_min": (low, low + more), "chip_um": None}
    )
    assert found == CutLimit(
        load_N=load, feed_mm_min=(low, low + more), margins=Margins(stability=margin)
    )
    assert set(found.given) == {
        "load_N", "feed_mm_min", "power_share", "least_speed_change_rpm", "margins", "practice",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"load_N": 0.0}, r"limits\.load_N = 0\.0 N must lie above 0"),
        ({"roughness_um": float("nan")}, r"limits\.roughness_um = nan um"),
        ({"power_share": 0.0}, r"limits\.power_share = 0\.0 must lie above 0"),
        ({"speed_rpm": (3.0, 2.0)}, r"limits\.speed_rpm = \[3\.0, 2\.0\] must be two numbers"),
        ({"chip_um": (1.0,)}, r"limits\.chip_um = \[1\.0\] must be two numbers, the least first"),
        ({"chip_um": (0.0, 0.0)}, r"limits\.chip_um"),
        ({"feed_mm_min": (1.0, 1e12)}, r"limits\.feed_mm_min = .* mm/min must lie from 0"),
    ],
)
def test_a_limit_out_of_its_range_is_refused(change: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        CutLimit(**change)


def test_a_margin_takes_less_than_the_whole_limit() -> None:
    with pytest.raises(ValueError, match=r"margins\.power = 1\.0 must lie from 0 and below 1"):
        Margins(power=1.0)


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
