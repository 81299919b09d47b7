"""A simulated cut against what was found of it; angles, units, intervals."""

import pytest
from cutting_folders import cut_parameter, with_cutting
from drive_folders import report
from hypothesis import given
from hypothesis import strategies as st
from report_folders import empty_machine, machine

from pipeline.report.cutting_units import holds, interval, off_percent, unit_of, value_words


def test_the_truth_stands_beside_what_was_found(tmp_path):
    text = report(with_cutting(machine(tmp_path, "mill01", days=3)), tmp_path)
    # K_te misses: 21 +- 12 % ends at 23.52; three pitches of two teeth are 540 deg
    assert "what was simulated against what was found; 7 of 9 intervals hold the truth" in text
    assert "K_tc 1 800 1 820 +1.11 1 747 to 1 893 N/mm² holds the truth" in text
    assert "K_te 25.0 21.0 −16.00 18.5 to 23.5 N/mm misses the truth" in text
    assert "runout_angle 577 37.0 – 29.6 to 44.4 ° holds the truth" in text
    assert "helix 30.0 not determined – – ° –" in text
    assert "specific_force 1 950 2 010 +3.08 1 869 to 2 151 N/mm² holds the truth" in text
    # at the tool 0.9 of what the motor takes: 603 W, and 1710 W against 1564 +- 42 W
    assert "no-load power at 6 000 603 614 +1.82 587 to 641 W holds the truth" in text
    assert "no-load power at 12 000 1 710 1 564 −8.54 1 522 to 1 606 W misses the truth" in text
    assert "no-load power at 500" not in text


def test_a_recorded_machine_has_no_truth_to_show(tmp_path):
    text = report(with_cutting(empty_machine(tmp_path, "m", "recorded")), tmp_path)
    assert "holds the truth" not in text and "The cut: what was simulated" not in text


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e3), st.floats(-2, 2), st.integers(-5, 5))
def test_an_interval_holds_what_lies_within_it_and_whole_periods_from_it(value, half, place, k):
    p = {"value": value, "interval_95": [value - half, value + half], "determined": True}
    true = value + place * half
    inside = value - half <= true <= value + half
    assert holds(p, true) == inside
    if abs(place) < 0.99:  # away from the ends, where a period's rounding counts
        assert holds(p, true + 120.0 * k, 120.0)
    if half < 50 and 1.01 < abs(place) < 1.2:  # beyond the end and short of the next period
        assert not holds(p, true + 120.0 * k, 120.0)


@pytest.mark.parametrize("ends", [None, [1], [2.0, 1.0], ["a", 2], [1, float("inf")], 3])
def test_an_interval_that_is_none_judges_nothing(ends):
    p = {"value": 1.5, "interval_95": ends, "determined": True}
    assert interval(p) == (None, None) and holds(p, 1.5) is None
    assert value_words(p) == "1.50"


def test_a_value_without_being_determined_is_neither_shown_nor_compared():
    p = {**cut_parameter(3.0, "um"), "determined": False}
    assert value_words(p) == "not determined"
    assert holds(p, 3.0) is None and off_percent(p, 3.1) is None
    assert unit_of(p) == "µm"
