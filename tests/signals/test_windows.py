"""Segments of a day (averages, bridges, ends), and of a recorder whose stamps round or jump."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.signals.windows import (
    LONGEST_BRIDGE,
    SHORTEST_SEGMENT,
    StateSegment,
    read_state,
    row_period,
    sampling_period,
    state_days,
    state_segments,
    uniform_segments,
)


def day(seconds: int = 600) -> pd.DataFrame:
    return pd.DataFrame(
        {"load": np.arange(float(seconds)), "speed": 5.0, "temperature": 30.0},
        index=pd.date_range("2026-01-05T06:00", periods=seconds, freq="s", tz="UTC", name="time"),
    )


def cut(
    frame: pd.DataFrame, bridge_s: float = 60.0, shortest_s: float = 60.0
) -> list[StateSegment]:
    return list(
        state_segments(
            frame, "2026-01-05", inputs=["load", "speed"], target="temperature", step=10.0,
            bridge_s=bridge_s, shortest_s=shortest_s,
        )
    )  # fmt: skip


def test_steps_are_means_of_their_seconds() -> None:
    (piece,) = cut(day())
    np.testing.assert_allclose(piece.frame["load"], 10 * np.arange(60) + 4.5)
    assert piece.frame.index[1] == pd.Timestamp("2026-01-05T06:00:10Z")
    assert (piece.day, piece.step, piece.bridged) == ("2026-01-05", 10.0, 0)


def test_a_step_known_in_part_is_the_mean_of_what_is_known() -> None:
    frame = day()
    frame.iloc[3:10, 0] = np.nan
    (piece,) = cut(frame)
    assert piece.frame["load"].iloc[0] == 1.0
    assert piece.bridged == 0


def test_a_short_gap_is_bridged_and_counted() -> None:
    frame = day()
    frame.iloc[100:160, 0] = np.nan
    (piece,) = cut(frame)
    assert len(piece.frame) == 60
    assert piece.bridged == 6
    np.testing.assert_array_equal(piece.frame["load"].iloc[10:16], 94.5)


def test_a_longer_gap_ends_a_stretch_after_the_bridge() -> None:
    frame = day()
    frame.iloc[100:170, 0] = np.nan
    first, second = cut(frame)
    assert len(first.frame) == 16
    assert second.frame.index[0] == pd.Timestamp("2026-01-05T06:02:50Z")
    assert (first.bridged, second.bridged) == (6, 0)


def test_an_endless_bridge_ends_nothing_but_needs_a_beginning() -> None:
    frame = day()
    frame.iloc[:40, 1] = np.nan
    frame.iloc[100:590, 0] = np.nan
    (piece,) = cut(frame, bridge_s=np.inf)
    assert piece.frame.index[0] == pd.Timestamp("2026-01-05T06:00:40Z")
    assert len(piece.frame) == 56
    assert piece.bridged == 49


def test_without_a_bridge_nothing_is_held() -> None:
    frame = day()
    frame.iloc[100:110, 0] = np.nan
    assert [len(p.frame) for p in cut(frame, bridge_s=0.0)] == [10, 49]


def test_a_stretch_begins_and_ends_with_a_measured_target() -> None:
    frame = day()
    frame.iloc[:35, 2] = np.nan
    frame.iloc[200:300, 2] = np.nan
    frame.iloc[555:, 2] = np.nan
    (piece,) = cut(frame)
    assert piece.frame.index[0] == pd.Timestamp("2026-01-05T06:00:30Z")
    assert piece.frame.index[-1] == pd.Timestamp("2026-01-05T06:09:10Z")
    # the target itself is never held
    assert piece.frame["temperature"].isna().sum() == 10


def test_short_stretches_are_left() -> None:
    frame = day()
    frame.iloc[100:, 2] = np.nan
    assert len(cut(frame, shortest_s=100.0)) == 1
    assert cut(frame, shortest_s=110.0) == []


def test_a_day_without_target_or_inputs_has_none() -> None:
    assert cut(day().assign(temperature=np.nan)) == []
    assert cut(day().assign(load=np.nan), bridge_s=np.inf) == []


@pytest.mark.parametrize("name", ["speed", "temperature"])
def test_a_column_that_is_missing_or_no_number_is_named(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is no column of numbers.*2026-01-05"):
        cut(day().drop(columns=name))
    with pytest.raises(ValueError, match=f"{name} is no column of numbers"):
        cut(day().assign(**{name: "ACTIVE"}))


def test_words_do_not_stand_in_the_way() -> None:
    (piece,) = cut(day().assign(execution="ACTIVE"))
    assert "execution" not in piece.frame


def test_days_are_those_on_disk_between_both_ends(tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    for name in ("2026-01-07", "2026-01-05", "2026-01-06"):
        day(3).reset_index().to_parquet(tmp_path / f"state/{name}.parquet")
    assert state_days(tmp_path) == ["2026-01-05", "2026-01-06", "2026-01-07"]
    assert state_days(tmp_path, "2026-01-06", "2026-01-06") == ["2026-01-06"]
    pd.testing.assert_frame_equal(read_state(tmp_path, "2026-01-05"), day(3), check_freq=False)
    with pytest.raises(ValueError, match=r"no state table of 2026-01-08.*run the stage clean"):
        read_state(tmp_path, "2026-01-08")


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


@settings(max_examples=40, deadline=None)
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


N = np.arange(400.0)


@pytest.mark.parametrize(("t", "period"), [
    (N / 600, 1 / 600),
    (np.round(N / 600, 4), 1 / 600),
    (np.round(N / 2048, 4), 1 / 2048),
    (np.floor(N / 10) / 100, 1e-3),  # a clock that ticks slower than the rows
], ids=["even", "rounded", "coarser than half", "ticks"])  # fmt: skip
def test_rows_of_one_period_whatever_their_stamps_are_rounded_to(t, period) -> None:
    assert row_period(pd.DataFrame({"t": t})) == pytest.approx(period, rel=3e-2)


@pytest.mark.parametrize(("t", "said"), [
    (np.delete(N, 200), r"rows 200 and 201 of the input are 2 s apart, all rows 1.0025. s"),
    (np.delete(N, range(100, 300)), "rows 100 and 101 of the input are 201 s apart"),
    (-N, "t does not go forward: it is -0 s in row 1 and -1 s in row 2"),
    (0 * N, "t does not go forward"),
    (np.where(N == 5, 3.0, N), "it is 4 s in row 5 and 3 s in row 6"),
    (N**1.5, "give evenly spaced rows"),
    (np.where(N == 5, np.nan, N), "t is nan in row 6: give a value"),
    ([0.0], "no column t of two rows"),
])  # fmt: skip
def test_rows_that_are_not_even_are_refused_where_they_are_not(t, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        row_period(pd.DataFrame({"t": t}))


def test_rows_of_another_period_than_the_learnt_one_are_refused() -> None:
    table = pd.DataFrame({"t": 60.0 * N})
    assert row_period(table, learnt=60.5) == 60.5
    assert row_period(table[:1], learnt=60.0) == 60.0
    with pytest.raises(ValueError, match="60 s apart, 120 s were learnt"):
        row_period(table, learnt=120.0)
