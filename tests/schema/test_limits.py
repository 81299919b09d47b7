"""One type of limit from the command line to the constraint: words, ranges, what holds."""

from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.schema.limits import CutLimit, Margins, limit_options, limit_words


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
