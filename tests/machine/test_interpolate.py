"""Sampled positions against the programmed path, and the filters against a plain convolution."""

import dataclasses

import numpy as np
import pytest

from pipeline.gcode.moves import Kind
from pipeline.machine.control.interpolate import trace, traces
from pipeline.machine.control.planner import limited_path, plan
from tests.machine.programs import Writer, control
from tests.machine.random_programs import deviation, random_control, random_moves

FILTERS = {"cutting_filter": (0.012, 0.004), "rapid_filter": (0.02, 0.01)}


def planned(writer, **parameters):
    return plan(limited_path(writer.moves, control(**parameters)))


def mixed():
    writer = Writer().set(feed=6000).rapid(X=5, Y=2).to(X=20).to(Y=12)
    return writer.row(Kind.DWELL, value=0.1).arc((20, 8), 2.0).to(X=0)


@pytest.mark.parametrize(
    "seeds", [range(12), pytest.param(range(12, 60), marks=pytest.mark.proof)], ids=["few", "many"]
)
def test_unfiltered_samples_lie_on_the_programmed_path(seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        parameters = dataclasses.replace(random_control(rng, corner="jump"), rapid_mode="linear")
        moves = random_moves(rng)
        sampled = trace(plan(limited_path(moves, parameters)), period=1e-3)
        # arcs: the end is given in mm, the angle by its arctangent
        assert deviation(sampled.programmed[:, :3] * 1e3, moves).max() < 1e-9


def test_row_and_distance_name_the_place():
    result = planned(mixed(), **FILTERS)
    sampled = trace(result)
    straight = sampled.row == 1
    along = 0.005 + sampled.distance[straight]
    start = np.array([5.0, 2.0]) * 1e-3
    slope = (np.array([20.0, 2.0]) * 1e-3 - start) / 0.015
    assert sampled.programmed[straight, :2] == pytest.approx(
        start + slope * sampled.distance[straight, None], abs=1e-12
    )
    assert (np.diff(along) >= 0).all()
    begins = np.concatenate([[0], np.cumsum(result.time)])
    expected = np.searchsorted(begins[1:-1], sampled.time, side="right")
    assert sampled.row.tolist() == expected.tolist()


def test_speed_between_samples_is_that_of_the_plan():
    """Path length gained in a row over its time, against the trapezoid's mean speeds."""
    result = planned(Writer().set(feed=6000).to(X=20).to(X=40, Y=3).to(Y=30))
    sampled = trace(result, period=1e-4)
    speed = np.linalg.norm(np.diff(sampled.programmed[:, :3], axis=0), axis=1) / 1e-4
    inner = np.diff(sampled.row) == 0
    for row in range(3):
        here = inner & (sampled.row[1:] == row)
        # a mean over a period is below the peak by a p / 2 at most
        assert speed[here].max() == pytest.approx(result.v_peak[row], abs=2.9e-4)


def boxed(signal, length, period):
    """Moving average of the line through samples, by brute force on a grid 40 times finer."""
    fine = np.arange((len(signal) - 1) * 40 + 1) / 40
    dense = np.interp(fine, np.arange(len(signal)), signal)
    width = round(length / period * 40)
    weights = np.ones(width + 1)
    weights[[0, -1]] = 0.5
    padded = np.concatenate([np.full(width, dense[0]), dense])
    return np.convolve(padded, weights / width, "valid")[::40]


@pytest.mark.parametrize("lengths", [(0.012, 0.0), (0.0, 0.0075), (0.012, 0.0075), (0.008, 0.008)])
def test_filters_are_two_moving_averages(lengths):
    result = planned(Writer().set(feed=6000).to(X=3).arc((3, 2), 4.0), cutting_filter=lengths)
    sampled = trace(result, period=1e-3)
    expected = sampled.programmed.copy()
    for length in lengths:
        if length:
            expected = np.stack([boxed(axis, length, 1e-3) for axis in expected.T], axis=1)
    # the trapezoidal rule between the samples of the first average: v'' p^2 / 12 / 1600
    assert np.abs(sampled.position - expected).max() < 1e-9


def test_filter_shorter_than_the_period_and_none():
    writer = Writer().set(feed=6000).to(X=3)
    plain = trace(planned(writer))
    assert np.array_equal(plain.position, plain.programmed)
    short = trace(planned(writer, cutting_filter=(0.0004, 0.0)))
    # 0.2 ms behind
    assert np.abs(short.position - short.programmed).max() < 0.1 * 0.00021


@pytest.mark.parametrize("samples", [1, 7, 1000])
def test_chunks_are_the_whole(samples):
    result = planned(mixed(), **FILTERS)
    whole = trace(result)
    parts = list(traces(result, samples=samples))
    for name in ("time", "programmed", "position", "row", "distance"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        assert np.array_equal(joined, getattr(whole, name))


@pytest.mark.parametrize("profile", ["trapezoid", "s_curve"])
@pytest.mark.parametrize("rapid_mode", ["linear", "independent"])
def test_trace_ends_with_the_sum_of_the_row_times(profile, rapid_mode):
    result = planned(
        mixed(), profile=profile, rapid_mode=rapid_mode, limits={"jerk": 40000}, **FILTERS
    )
    sampled = trace(result, period=1e-4)
    last = np.flatnonzero(np.abs(sampled.position - sampled.position[-1]).max(axis=1) > 1e-12)[-1]
    # filtered motion dies out as the fourth power of the time left or faster: within 2 ms 1 pm
    assert result.total - 2e-3 < sampled.time[last] <= result.total + 1e-4
    assert 0 <= sampled.time[-1] - result.total < 1e-4 + 1e-9


def test_axes_stand_while_the_program_dwells():
    result = planned(mixed(), **FILTERS)
    sampled = trace(result)
    begin = np.cumsum(result.time)[2]
    dwelling = (sampled.time >= begin) & (sampled.time < begin + 0.1)
    assert dwelling.sum() == pytest.approx(100, abs=1)
    assert np.ptp(sampled.position[dwelling], axis=0).max() < 1e-9


def test_dog_leg_leaves_the_line():
    sampled = trace(planned(Writer().rapid(X=300, Y=40), rapid_mode="independent"))
    arrived = np.isclose(sampled.position, sampled.position[-1], atol=1e-12)
    reached = np.argmax(arrived[:, :2], axis=0) * 1e-3
    # X: 0.3 / 0.5 + 0.1; Y never reaches its speed: 2 sqrt(0.04 / 5)
    assert reached == pytest.approx([0.7, 2 * np.sqrt(0.04 / 5)], abs=2e-3)


def test_period_must_be_positive():
    with pytest.raises(ValueError, match=r"period = 0 s must be finite and positive"):
        trace(planned(mixed()), period=0)


def test_program_without_rows_is_refused():
    with pytest.raises(ValueError, match="no rows"):
        trace(planned(Writer()))
