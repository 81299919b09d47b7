"""Conditions of a recording: name, list, constants; what is missing or contradicts is said."""

from math import acos, pi

import pytest

from pipeline.cutting.tool import Tool
from pipeline.identification.cutting.conditions import Said, conditions_of, said_of

TOOL = Tool(kind="flat", diameter_mm=12.0, flutes=3)
NAME = (
    r"(?P<immersion>slot|up|down)-n(?P<speed_rpm>\d+)f(?P<feed_mm_min>\d+)"
    r"ap(?P<axial_depth_mm>[\d.]+)(?:ae(?P<radial_depth_mm>[\d.]+))?"
)


def read(name: str, said: Said = Said(), **patterns: Said):  # noqa: B008 - it is frozen
    return conditions_of(said_of(name, NAME, patterns, said), TOOL)


def test_a_name_tells_all():
    found = read("down-n4000f600ap1.5ae6.csv")
    assert found.speed == pytest.approx(4000 / 60)
    assert found.f_z == pytest.approx(0.6 / (3 * 4000))  # 600 mm/min over teeth a minute
    assert found.a_p == pytest.approx(1.5e-3)
    assert (found.phi_st, found.phi_ex) == pytest.approx((pi - acos(0.0), pi))


def test_up_and_down_milling_lie_mirrored():
    up, down = read("up-n4000f600ap1ae3"), read("down-n4000f600ap1ae3")
    assert up.phi_st == 0.0
    assert up.phi_ex - up.phi_st == pytest.approx(down.phi_ex - down.phi_st)
    assert down.phi_ex == pytest.approx(pi)


def test_feed_by_tooth_and_by_minute_agree_or_are_refused():
    same = read("slot-n4000f600ap1", Said(feed_per_tooth_mm=0.05))
    assert same.f_z == pytest.approx(5e-5)
    with pytest.raises(ValueError, match=r"0\.05 mm for each tooth, its feed_per_tooth_mm 0\.06"):
        read("slot-n4000f600ap1", Said(feed_per_tooth_mm=0.06))


@pytest.mark.parametrize(
    ("name", "said", "message"),
    [
        ("run7.csv", Said(), "speed_rpm is not known"),
        ("slot-n0f600ap1", Said(), "speed_rpm = 0 must be finite and positive"),
        ("up-n4000f600ap1", Said(), "radial_depth_mm is not known"),
        ("up-n4000f600ap1ae13", Said(), "radial_depth_mm = 13 is more than the diameter"),
        ("slot-n4000f600ap1ae6", Said(), "radial_depth_mm = 6 is not the diameter"),
        ("slot-n4000f600ap1", Said(speed_rpm=5000), "speed_rpm is 5000"),
        ("slot-n4000f600ap1.2.3", Said(), r"axial_depth_mm = '1\.2\.3'"),
        ("run7", Said(speed_rpm=100, axial_depth_mm=1, immersion="slot"), "its feed is not known"),
        ("run7", Said(speed_rpm=100, axial_depth_mm=1, feed_mm_min=9), "immersion is not known"),
        ("r", Said(speed_rpm=1, axial_depth_mm=1, entry_deg=90, exit_deg=20), "entry_deg = 90"),
    ],
)
def test_what_is_missing_or_contradicts_is_one_sentence(name, said, message):
    with pytest.raises(ValueError, match=message):
        read(name, said)


def test_a_pattern_adds_to_a_name():
    found = read("slot-n4000f600ap1", Said(), **{"slot-*": Said(radial_depth_mm=12.0)})
    assert found.phi_ex == pytest.approx(pi)
    with pytest.raises(ValueError, match="by_pattern, 'slot"):
        read("slot-n4000f600ap1", Said(), **{"slot-*": Said(axial_depth_mm=2.0)})


@pytest.mark.parametrize("pattern", ["(?P<speed>", "(?P<revs>x)"])
def test_a_wrong_expression_is_named(pattern):
    with pytest.raises(ValueError, match=r"cutting_records\.name"):
        said_of("x", pattern, {}, Said())
