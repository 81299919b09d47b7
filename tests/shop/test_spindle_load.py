"""The spindle's tests: balance of energy, engagement of the passes, what the log tells of power."""

import re
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from pipeline.shop.control.planner import Ramp
from pipeline.shop.cutting.parameters import Conditions, Cutting, EndMill, SpindleTests
from pipeline.shop.cutting.records import shown_load, write_cutting
from pipeline.shop.parameters import SpindleParameters
from pipeline.shop.spindle import available_power, no_load_power

from .conftest import LogFile, read_log, shop_parameters

RPM = 2 * np.pi / 60


def series(log: LogFile, name: str, since: float, until: float) -> np.ndarray:
    """Values of an item at each tenth of a second, as last written; from the first line on [s]."""
    begin = log.records[0].time
    told = [r for r in log.records if r.name == name]
    times = np.array([(r.time - begin).total_seconds() for r in told])
    values = np.array([float(r.fields[0]) for r in told])
    at = np.searchsorted(times, np.arange(since, until, 0.1), side="right") - 1
    return values[np.maximum(at, 0)]


def plateaus(log: LogFile) -> Iterator[tuple[float, float]]:
    """Speeds that the log stays at, and until when [s]."""
    begin = log.records[0].time
    told = [
        ((r.time - begin).total_seconds(), float(r.fields[0]))
        for r in log.records
        if r.name == "S1n"
    ]
    for (since, speed), (until, _) in pairwise(told):
        if until - since > 5:
            yield speed, until


def test_without_a_cut_the_log_shows_the_power_of_the_truth(cuts):
    """Means over the last seconds of each speed, when the peak of the start is gone.

    0.1 percent of the load, and a tenth of a whole percent where that is the meter's step: its
    noise is not large enough there to make the mean exact.
    """
    folder, truth, p = cuts.folder, cuts.truth, cuts.parameters
    log, motor = read_log(folder / "cutting/no-load-run1.txt"), p.spindle.motor
    expected = dict(truth["spindle"]["no_load_W"])
    met = []
    for speed, until in plateaus(log):
        load = series(log, "S1load", until - 4, until).mean()
        here = motor.rated_power * min(1.0, speed / motor.base_speed)
        assert load * here / 100 == pytest.approx(
            expected[speed], abs=here / 100 * max(0.1, 0.3 * p.cutting.spindle.step)
        )
        met.append(speed)
    assert met == [s for s, _ in truth["spindle"]["no_load_W"]]


def test_the_load_of_each_pass_is_its_power(cuts):
    """In the middle of each pass, less the power without a cut at that speed.

    3 % and 0.3 of the meter's step: its lag, its noise, its rounding.
    """
    folder, truth, p = cuts.folder, cuts.truth, cuts.parameters
    program = next(f for f in truth["spindle"]["files"] if "no-load" not in f["file"])
    log, tests = read_log(folder / program["file"]), p.cutting.spindle
    begin = log.records[0].time
    lines = [r for r in log.records if r.name == "ln"]
    for one in truth["spindle"]["passes"]:
        k = next(k for k, r in enumerate(lines) if r.fields[0] == str(one["line"]))
        start = (lines[k].time - begin).total_seconds()
        first = (5 + p.cutting.tool.diameter / 2 + 8) / (one["feed_mm_min"] / 60)
        last = (5 + p.cutting.tool.diameter / 2 + tests.block - 8) / (one["feed_mm_min"] / 60)
        load = series(log, "S1load", start + first + 4 * tests.lag, start + last).mean() / 100
        idle = no_load_power(np.array([one["speed_rpm"]]), p.spindle, tests.oil_temperature)
        assert one["speed_rpm"] >= p.spindle.motor.base_speed
        cut = (load * p.spindle.motor.rated_power - float(idle[0])) * tests.efficiency
        allowed = 0.03 * one["power_W"] + 0.003 * tests.step * p.spindle.motor.rated_power
        assert cut == pytest.approx(one["power_W"], abs=allowed)


def test_each_pass_meets_the_engagement_that_it_states(cuts):
    """The blank as a grid of heights, cut by the text of the program, 0.5 mm cells.

    What goes in the middle of the block's length is as deep and as wide as the comment says.
    """
    folder, truth, p = cuts.folder, cuts.truth, cuts.parameters
    name = next(f["program"] for f in truth["spindle"]["files"] if "no-load" not in f["file"])
    text = (folder / name).read_text()
    box = re.search(r"BLANK BOX X0\. X(\S+) Y0\. Y(\S+) Z(\S+) Z0\.", text)
    assert box is not None
    cells = np.arange(0.25, float(box[2]), 0.5)
    height, r = np.zeros(cells.size), p.cutting.tool.diameter / 2
    stated = re.findall(r"PASS \d+ (\w+) AP(\S+) AE(\S+?)\)", text)
    assert len(stated) == len(truth["spindle"]["passes"])
    for (side, depth, width), one in zip(stated, truth["spindle"]["passes"], strict=True):
        under = np.abs(cells - one["y_mm"]) < r
        met = under & (height > -float(depth))
        assert met.sum() * 0.5 == pytest.approx(float(width))
        assert (height[met] == 0).all()
        left = cells[met] > one["y_mm"]
        forward = one["to_x_mm"] > one["from_x_mm"]
        if side != "SLOT":  # clockwise: what is left of the way is cut up
            assert (side == "UP") == ((left.mean() > 0.5) == forward)
        height[under] = np.minimum(height[under], -float(depth))
        assert one["depth_mm"] == float(depth) and one["width_mm"] == float(width)
    assert -height.min() < -float(box[3])


def test_speeding_up_takes_the_energy_of_the_rotor():
    """The meter without lag and noise: power over time is friction's work and J w2 / 2.

    0.5 %: the meter counts below 10 rev/min as at 10, and rounds.
    """
    spindle, cycle = SpindleParameters(), 0.002
    tests = SpindleTests(lag=0.01, noise=0.0, step=0.01)
    ramp = Ramp(motor=spindle.motor, overload=1.2, n_0=0.0, n_1=9000.0)
    time = np.arange(0, ramp.duration + 1.0, cycle)
    speed = ramp.at(time)
    load = shown_load(speed, np.zeros(time.size), cycle, spindle, tests, np.random.default_rng(1))
    assert load.max() == pytest.approx(
        120 + 100 * float(no_load_power(np.array([9000.0]), spindle, 34.0)[0]) / 15e3, rel=0.02
    )
    fast = speed > spindle.motor.base_speed
    work = (load / 100 * available_power(speed, spindle.motor))[fast].sum() * cycle
    idle = no_load_power(speed, spindle, tests.oil_temperature)[fast].sum() * cycle
    base = spindle.motor.base_speed * RPM
    stored = spindle.motor.inertia * ((9000 * RPM) ** 2 - base**2) / 2
    assert work == pytest.approx(stored + idle, rel=0.01)  # the lag carries 1 % over the edge


def test_asking_for_what_there_is_not_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"a width of 14.0 \[mm\] is more than the tool's"):
        Cutting(
            spindle=SpindleTests(passes=(Conditions(immersion="down", width=14.0),)),
            tool=EndMill(diameter=12.0),
        )
    with pytest.raises(ValueError, match="at least one pass"):
        SpindleTests(passes=())
    other = shop_parameters("mill01", cutting={"tool": {"number": 77}})
    with pytest.raises(ValueError, match=r"EndMill.number = 77.*diameter of 12.0"):
        write_cutting(tmp_path, other)
