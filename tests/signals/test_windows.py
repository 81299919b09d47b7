"""Stretches of a day: averages, bridges, beginnings and ends."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.signals.windows import StateSegment, read_state, state_days, state_segments


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
