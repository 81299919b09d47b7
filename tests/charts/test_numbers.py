import math

import pytest

from pipeline.charts.numbers import (
    NOT_KNOWN,
    day_list,
    day_words,
    duration,
    fixed,
    moment,
    number,
    percent,
    real,
)


@pytest.mark.parametrize(("value", "words"), [
    (0, "0"), (0.0123456, "0.0123"), (1234567, "1\u202f234\u202f567"), (-2.5, "−2.50"),
    (8.4056e-06, "8.41 × 10⁻⁶"), (123.456, "123"), (None, NOT_KNOWN), (math.nan, NOT_KNOWN),
    (math.inf, NOT_KNOWN), ("7", NOT_KNOWN), (True, NOT_KNOWN),
])  # fmt: skip
def test_number_has_three_digits_or_is_not_known(value, words):
    assert number(value) == words


@pytest.mark.parametrize(("part", "whole", "words"), [
    (0, 10, "0 %"), (10, 10, "100 %"), (23, 2_837_860, "< 0.01 %"), (999, 1000, "> 99 %"),
    (1, 80, "1.2 %"), (1, 4, "25 %"), (1, 0, NOT_KNOWN), (None, 5, NOT_KNOWN),
])  # fmt: skip
def test_percent_never_rounds_something_to_nothing_or_all(part, whole, words):
    assert percent(part, whole).replace("\u202f", " ") == words


@pytest.mark.parametrize(("seconds", "words"), [
    (0, "0 s"), (42.04, "42.0 s"), (59.99, "1 min 00 s"), (725, "12 min 05 s"),
    (3600, "1 h 00 min"), (86400, "24 h 00 min"), (216_000, "2.5 days"),
])  # fmt: skip
def test_duration_reads_as_people_say_it(seconds, words):
    assert duration(seconds).replace("\u202f", " ") == words


@pytest.mark.parametrize("value", [
    "2024-03-04T23:30:00-01:00", "2024-03-05T00:30:00Z", "2024-03-05T00:30:00.123456789",
    1_709_598_600_000_000_000,
])  # fmt: skip
def test_moments_are_utc_whatever_zone_they_came_in(value):
    assert moment(value).replace("\u00a0", " ") == "Tue 5 Mar 2024, 00:30 UTC"


@pytest.mark.parametrize("value", [None, "yesterday", 12.5, True, 10**30])
def test_what_is_no_time_is_not_known(value):
    assert moment(value) == NOT_KNOWN


def test_days_are_named_up_to_four():
    days = [f"2024-03-0{i}" for i in range(1, 8)]
    text = day_list(days).replace("\u00a0", " ")
    assert text == "Fri 1 Mar, Sat 2 Mar, Sun 3 Mar, Mon 4 Mar and 3 more"
    assert day_words("<b>") == "<b>"


def test_fixed_keeps_columns_aligned():
    assert [fixed(v, 2) for v in (0.5, 12, -3.456)] == ["0.50", "12.00", "−3.46"]
    assert real(True) is None
