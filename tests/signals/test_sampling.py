"""Rows of a recorder come onto their grid: stamps round, repeat, jump and stop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.signals.windows import (
    LONGEST_BRIDGE,
    SHORTEST_SEGMENT,
    sampling_period,
    uniform_segments,
)

T = 1e-3


def clock(rows: int = 400) -> np.ndarray:
    return T * np.arange(rows)


def test_rounded_stamps_are_taken_as_evenly_spaced():
    stamps = np.round(clock() + 1.3e-5 * np.sin(np.arange(400)), 5)
    (piece,) = uniform_segments(stamps)
    assert piece.period == pytest.approx(T, rel=1e-4)
    assert np.array_equal(piece.places, np.arange(400))
    values = np.random.default_rng(0).standard_normal(400)
    assert np.array_equal(piece.on_grid(values), values)
    assert not piece.filled.any()


@given(st.lists(st.integers(40, 350), min_size=1, max_size=8, unique=True))
def test_dropped_rows_are_filled_by_straight_lines_and_marked(dropped):
    lonely = [k for k in dropped if not {k - 1, k + 1} & set(dropped)]
    kept = np.setdiff1d(np.arange(400), lonely)
    (piece,) = uniform_segments(clock()[kept])
    line = 3.0 * np.arange(400) + 1
    assert piece.on_grid(line[kept]) == pytest.approx(line, abs=1e-6)  # rounding of the places
    assert np.flatnonzero(piece.filled).tolist() == sorted(lonely)


def test_a_repeated_stamp_belongs_in_the_gap_behind_it():
    stamps = clock()
    stamps[200] = stamps[199]  # the row is its own, its stamp late
    (piece,) = uniform_segments(stamps)
    values = np.random.default_rng(1).standard_normal(400)
    assert np.array_equal(piece.on_grid(values), values)
    assert not piece.filled.any()


def test_a_copy_of_a_row_is_left_out():
    rows = np.insert(np.arange(400), 200, 199)
    (piece,) = uniform_segments(clock()[rows])
    assert piece.samples == 400
    assert np.array_equal(piece.on_grid(rows.astype(float)), np.arange(400.0))


@pytest.mark.parametrize("missing", [LONGEST_BRIDGE, LONGEST_BRIDGE + 1])
def test_a_long_gap_cuts_the_record(missing):
    stamps = np.delete(clock(), np.arange(200, 200 + missing))
    pieces = uniform_segments(stamps)
    assert len(pieces) == (1 if missing <= LONGEST_BRIDGE else 2)
    assert sum(len(piece.rows) for piece in pieces) == len(stamps)


def test_a_clock_that_starts_anew_cuts_the_record():
    pieces = uniform_segments(np.r_[clock(150), clock(250)])
    assert [piece.samples for piece in pieces] == [150, 250]


def test_a_clock_coarser_than_the_rows_gives_their_mean_period():
    stamps = np.floor(0.25 * np.arange(400)) * T  # four rows a tick
    assert sampling_period(stamps) == pytest.approx(0.25 * T, rel=0.01)  # the last tick's end
    (piece,) = uniform_segments(stamps)
    assert piece.samples == 400


def test_samples_taken_unevenly_are_interpolated_where_they_were_taken():
    rng = np.random.default_rng(2)
    stamps = clock() + rng.uniform(-0.3, 0.3, 400) * T
    (piece,) = uniform_segments(stamps)
    found = piece.on_grid(5.0 * stamps)  # a ramp of the true times comes out straight
    inner = np.diff(found)[5:-5]
    assert inner == pytest.approx(5.0 * piece.period, rel=1e-9)


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (clock(SHORTEST_SEGMENT - 1), f"{SHORTEST_SEGMENT - 1} rows"),
        (np.zeros(100), "never goes forward"),
    ],
)
def test_what_tells_no_period_is_refused(stamps, words):
    with pytest.raises(ValueError, match=words):
        uniform_segments(stamps)
