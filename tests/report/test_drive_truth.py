"""Simulated drives against what was found of them; units and digits in which both are shown."""

import pytest
from drive_folders import report, with_drives
from hypothesis import given
from hypothesis import strategies as st
from report_folders import machine

from pipeline.charts.numbers import resolved
from pipeline.report.drive_truth import truth_as_found
from pipeline.report.drive_units import FROM_SI, SHOP, in_shop_units, si_in_shop_units


def test_the_truth_stands_beside_what_was_found(tmp_path):
    text = report(with_drives(machine(tmp_path, "mill01", days=3)), tmp_path)
    assert "7 of 8 intervals hold the truth" in text
    assert "X mass 421.0 420.0 −0.24 417.5 to 422.5 kg holds the truth" in text
    assert "X stribeck_velocity_positive 4.00 4.10 +2.50 3.28 to 4.92 mm/s holds the truth" in text
    assert "X viscous_positive 960 902 −6.04 875 to 929 N s/m misses the truth" in text
    assert "Y static_positive 430 not determined – – N –" in text
    assert "motor L_d 6.00 6.10 +1.67 5.86 to 6.34 mH holds the truth" in text


@given(st.floats(1e-6, 1e6), st.sampled_from(sorted({*SHOP, *FROM_SI, "kg", "N"})))
def test_a_truth_equal_to_what_was_found_is_shown_equal(value, unit):
    in_file = value * FROM_SI.get(unit, 1.0)
    shown = in_shop_units({"value": in_file, "unit": unit})["value"]
    assert si_in_shop_units(value, unit) == pytest.approx(shown, rel=1e-12)


@given(st.floats(1e-3, 1e4), st.floats(1e-3, 0.5))  # narrower than five digits show
def test_printed_intervals_keep_their_width(value, share):
    low, high = value * (1 - share), value * (1 + share)
    digits = resolved(low, high)
    printed = [float(f"{x:.{digits}g}") for x in (low, high)]
    # two digits of the width: either end is off by at most a twentieth of it
    assert printed[1] - printed[0] == pytest.approx(high - low, rel=0.1)


LEVEL = st.floats(10.0, 1e3)


@given(LEVEL, LEVEL, LEVEL, st.floats(-2e3, 2e3), st.booleans())
def test_a_truth_parted_as_the_fit_parts_it_has_the_same_force_in_motion(
    positive, negative, more, force, alike
):
    truth = {"coulomb_positive": positive, "coulomb_negative": negative, "offset": force,
             "static_positive": positive + more, "static_negative": negative + more}  # fmt: skip
    value = {"value": 5.0}
    found = truth_as_found(truth, {
        "coulomb_positive": value, "coulomb_negative": value if alike else {"value": 6.0},
        "offset": {"value": 1.0 if alike else None, "determined": alike}})  # fmt: skip
    for kind in ("coulomb", "static"):
        there, back = (
            [t[f"{kind}_positive"] + t["offset"], -t[f"{kind}_negative"] + t["offset"]]
            for t in (truth, found)
        )
        assert back == pytest.approx(there, abs=1e-9)
    if alike:
        assert found["coulomb_positive"] == pytest.approx(found["coulomb_negative"])
    else:
        assert found["offset"] == 0


def test_a_fit_that_found_friction_and_force_apart_is_held_against_the_plain_truth():
    truth = {"coulomb_positive": 3.0, "coulomb_negative": 5.0, "offset": 7.0}
    found = {"coulomb_positive": {"value": 3.1}, "coulomb_negative": {"value": 4.9},
             "offset": {"value": 7.2, "determined": True}}  # fmt: skip
    assert truth_as_found(truth, found) == truth
